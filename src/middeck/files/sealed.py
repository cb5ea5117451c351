"""Documents that are not to change: each carries the SHA-256 of all else that it says."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from middeck.errors import DataError
from middeck.files.json_input import read_json
from middeck.files.json_output import plain

SEAL = "sha256"


def seal(document: Mapping[str, Any]) -> dict[str, Any]:
    """``document`` as plain values with its seal; keys in their order, which the seal does not depend on."""
    values = dict(plain(document))
    return {**values, SEAL: _hash(values)}


def read_sealed(path: str | Path, schema: str) -> dict[str, Any]:
    """The document in ``path``. Raises `DataError` for another document, and where the seal does not fit."""
    found = read_json(path, schema, "the file as it was written")
    inside = {key: value for key, value in found.items() if key != SEAL}
    if found.get(SEAL) != _hash(inside):
        raise DataError(
            f"the document is not what was sealed: its {SEAL} does not fit its content",
            where=str(path),
            hint="the file as it was written; a changed promise is none",
        )
    return found


def _hash(values: Mapping[str, Any]) -> str:
    text = json.dumps(values, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
