"""The file that engine and supervisor map, and what the engine has written there, as far as it is whole."""

from __future__ import annotations

import contextlib
import mmap
import os
import struct
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float

from middeck.errors import DataError
from middeck.realtime.engine.interface.header import constants, layout, layout_check
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_bytes import encode_package

LARGEST, PROOF = 1 << 24, 128
"""Bytes of the largest package that an engine takes, and of the proof beside it."""
STAGING = LARGEST + PROOF
"""Bytes of the room in which both wait to be loaded."""
ALIGNED = 64


def record_type(sensors: int, outputs: int) -> np.dtype:
    """One sample in the ring: its head, then numbers by name, ``added`` and ``wanted`` for each slot."""
    slots = constants()["SLOTS"]
    law = [(f"{what}_{k}", "<f8", (outputs,)) for k in range(slots) for what in ("added", "wanted")]
    return np.dtype(
        [
            *((name, layout("record_head")[name]) for name in layout("record_head").names or ()),
            ("y", "<f8", (sensors,)),
            ("u", "<f8", (outputs,)),
            ("hold", "<f8", (outputs,)),
            ("excitation", "<f8", (outputs,)),
            *law,
            ("gain", "<f8"),
        ]
    )


class SharedFile:
    """A mapped file with the regions as arrays; each is a view, and what the engine writes is seen."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open("r+b") as file:
            self.map = mmap.mmap(file.fileno(), 0)
        (at,) = np.frombuffer(self.map, layout("places"), 1)
        self.places = at
        self.settings = self._one("settings")
        self.asks, self.status = self._one("asks"), self._one("status")
        self.commands = self._many(layout("command"), at["commands"], constants()["COMMANDS"])
        self.acknowledgements = self._many(
            layout("acknowledgement"), at["acknowledgements"], constants()["COMMANDS"]
        )
        self.events = self._many(layout("event"), at["events"], constants()["EVENTS"])
        kind = record_type(int(self.settings["inputs"]), int(self.settings["outputs"]))
        self.ring = self._many(kind, at["ring"], int(at["ring_count"]))
        self.pretrip = self._many(kind, at["pretrip"], int(at["pretrip_count"]))

    def stage(self, package: ControllerPackage | bytes, proof: bytes = b"") -> int:
        """Put a package, and a proof beside it, where LOAD takes them from; the package's size in bytes."""
        data = package if isinstance(package, bytes) else encode_package(package)
        start, both = int(self.places["staging"]), (data[:LARGEST] + proof)[:STAGING]
        self.map[start : start + len(both)] = both
        return len(data)

    def _one(self, record: str) -> np.ndarray:
        return self._many(layout(record), self.places[record], 1)[0]

    def _many(self, kind: np.dtype, place: int, count: int) -> np.ndarray:
        return np.frombuffer(self.map, kind, count, int(place))


def make_shared_file(
    path: Path,
    settings: np.ndarray,
    article: np.ndarray,
    numbers: Float[np.ndarray, " number"],
    waveform: Float[np.ndarray, "sample output"],
    banned: bytes = b"",
    *,
    ring: int,
    pretrip: int,
) -> SharedFile:
    """Lay the file out for an engine: ``ring`` records for the recorder, ``pretrip`` before a trip.

    ``banned`` are the hashes of laws that it refuses from the start, one after the other.
    """
    kind = record_type(int(settings["inputs"]), int(settings["outputs"]))
    sizes = {
        "settings": settings.nbytes,
        "article": article.nbytes,
        "article_numbers": numbers.nbytes,
        "asks": layout("asks").itemsize,
        "status": layout("status").itemsize,
        "commands": constants()["COMMANDS"] * layout("command").itemsize,
        "acknowledgements": constants()["COMMANDS"] * layout("acknowledgement").itemsize,
        "events": constants()["EVENTS"] * layout("event").itemsize,
        "ring": ring * kind.itemsize,
        "pretrip": pretrip * kind.itemsize,
        "waveform": waveform.nbytes,
        "blacklist": len(banned),
        "staging": STAGING,
    }
    places, end = np.zeros((), layout("places")), _aligned(layout("places").itemsize)
    for region, size in sizes.items():
        places[region] = end
        end = _aligned(end + size)
    places["magic"], places["layout"], places["size"] = constants()["MAGIC"], layout_check(), end
    places["article_count"], places["stride"] = len(numbers), kind.itemsize
    places["ring_count"], places["pretrip_count"] = ring, pretrip
    places["blacklist_count"] = len(banned) // 32
    places["waveform_samples"], places["staging_size"] = len(waveform), STAGING
    path.unlink(missing_ok=True)  # who still reads an old one keeps it
    with path.open("xb") as file:
        _take_room(file, end)
        for region, data in (
            (0, places),
            (int(places["settings"]), settings),
            (int(places["article"]), article),
            (int(places["article_numbers"]), numbers),
            (int(places["waveform"]), waveform),
            (int(places["blacklist"]), np.frombuffer(banned, "u1")),
        ):
            file.seek(region)
            file.write(np.ascontiguousarray(data).tobytes())
    return SharedFile(path)


def open_shared_file(path: Path) -> SharedFile:
    """The shared file of an engine; raises `DataError` for what is none, or of another build.

    Another build may give other numbers to states and events: its words would be taken for others.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            start = file.read(layout("places").itemsize)
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", where=str(path), hint="engine.shared") from None
    if len(start) == layout("places").itemsize:
        (at,) = np.frombuffer(start, layout("places"))
        if (at["magic"], at["layout"], at["size"]) == (constants()["MAGIC"], layout_check(), size):
            with contextlib.suppress(ValueError, OverflowError):  # places that do not lie within it
                return SharedFile(path)
        if at["magic"] == constants()["MAGIC"] and at["layout"] != layout_check():
            raise DataError(
                "the shared file of another build of the engine, or changed", where=str(path),
                hint="the release of middeck that started it",
            )  # fmt: skip
    raise DataError("no shared file of an engine, or changed", where=str(path), hint="engine.shared")


def process_of(path: Path) -> tuple[int, int]:
    """Number and birth of the engine's process that a shared file of any build names; zeros where none is."""
    try:
        with path.open("rb") as file:
            magic, _, size, status = struct.unpack("<4q", file.read(32))
            if magic != constants()["MAGIC"] or not 0 < status < size:
                return 0, 0
            file.seek(status)
            pid, born = struct.unpack("<2q", file.read(16))
    except (OSError, struct.error):
        return 0, 0
    return pid, born


def _take_room(file: BinaryIO, size: int) -> None:
    """All of it now: on a full disk a page of a mapped file ends the process that first writes to it."""
    try:
        os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        raise DataError(
            f"no room of {size} bytes: {error.strerror}",
            where="shared file",
            hint="another folder, a shorter pretrip_s",
        ) from None


def _aligned(size: int) -> int:
    return -(-size // ALIGNED) * ALIGNED


def take_records(file: SharedFile, last: int, *, runs_on: bool) -> tuple[np.ndarray, int]:
    """Records up to sample ``last`` that have not been taken yet, and how many were overwritten before.

    ``runs_on``: the engine does not wait for its supervisor.
    """
    ring, first = file.ring, int(file.asks["taken"])
    begin = max(first, last - len(ring))
    found = ring[np.arange(begin, last) % len(ring)]
    # The engine may be in the midst of the record after the last that it has told of.
    safe = int(file.status["sample"]) - len(ring) + (2 if runs_on else 0)
    kept = found[max(0, safe - begin) :]
    whole = kept["sequence"] == np.arange(last - len(kept), last) + 1
    kept = kept[len(whole) - int(np.argmin(whole[::-1])) :] if not whole.all() else kept
    return kept, last - first - len(kept)


def event_rows(file: SharedFile, seen: int) -> np.ndarray:
    """Events after number ``seen`` that are still there, without a gap."""
    count, most = int(file.status["events"]), len(file.events)
    numbers = np.arange(max(seen, count - most), count) + 1
    places = (numbers - 1) % most
    rows = file.events[places]
    return rows[(rows["sequence"] == numbers) & (file.events["sequence"][places] == numbers)]


def pretrip_records(file: SharedFile) -> np.ndarray:
    """Records up to the trip that holds the loop in SAFE, oldest first; without one, those until now."""
    kept, end = file.pretrip, int(file.status["frozen_at"])
    samples = np.arange(max(0, end - len(kept)), end)
    found = kept[samples % len(kept)]
    return found[found["sequence"] == samples + 1]  # none was kept while an earlier trip held the loop
