"""What stands at the front of a run file: ports, forms of its numbers, and what ran."""

import hashlib
from typing import Any

import numpy as np

from middeck.realtime.engine.interface.commands import KINDS, STATES
from middeck.realtime.engine.interface.header import layout
from middeck.realtime.engine.interface.settings import EngineSettings, encode_settings
from middeck.realtime.engine.interface.shared_file import SharedFile
from middeck.realtime.engine.recording.run_frames import SCHEMA


def run_head(settings: EngineSettings, file: SharedFile, start: str) -> dict[str, Any]:
    """The document: inputs and outputs are those of the plant, so outputs and sensors of the engine."""
    loaded = file.status["loaded"]
    return {
        "schema": SCHEMA,
        "start": start,
        "period_s": settings.period_s,
        "real_time": bool(file.settings["clock"]),
        "inputs": [[port.name, port.unit] for port in settings.outputs],
        "outputs": [[port.name, port.unit] for port in settings.inputs],
        "settings_sha256": hashlib.sha256(encode_settings(settings).tobytes()).hexdigest(),
        "packages": [
            bytes(h).hex() for h, there in zip(file.status["slot_hash"], loaded, strict=True) if there
        ],
        "kinds": {str(code): word for code, word in KINDS.items()},
        "states": [STATES[k] for k in sorted(STATES)],
        "record": _fields(file.ring.dtype),
        "event": _fields(layout("event")),
    }


def _fields(kind: np.dtype) -> list[list[Any]]:
    """Name, type and shape of each field."""
    found = []
    for name in kind.names or ():
        field = kind[name]
        found.append([name, field.base.str, list(field.shape)])
    return found
