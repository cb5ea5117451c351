"""Laws of packages that have tripped, as a sealed file that gate and engine consult first."""

import os
from collections.abc import Mapping
from pathlib import Path

from middeck.errors import DataError
from middeck.files.json.hash_seal import read_sealed, seal
from middeck.files.json.output import write_json
from middeck.realtime.engine.process.folder_lock import locked

BLACKLIST = "middeck.blacklist/2"
HASH = 64
"""Hexadecimal digits of a SHA-256."""


def load_blacklist(path: str | Path) -> dict[str, str]:
    """Reasons by SHA-256 (`hash_law`) of the laws in file ``path``; none where there is no such file yet.

    Raises `DataError` for another file, for one that was changed, and for entries that are no hashes with
    reasons.
    """
    if not os.path.lexists(path):  # a link to nowhere is a list that is lost, not one that is empty
        return {}
    listed = read_sealed(path, BLACKLIST).get("laws")
    if not isinstance(listed, dict) or not all(map(_is_entry, listed.items())):
        raise DataError(
            "laws is no table of reasons by SHA-256", where=str(path), hint="the file as it was written"
        )
    return {str(sha256): str(reason) for sha256, reason in listed.items()}


def write_blacklist(path: str | Path, reasons: Mapping[str, str]) -> None:
    """Write reasons by SHA-256 to ``path``, whole or not at all."""
    write_json(path, seal({"schema": BLACKLIST, "laws": dict(sorted(reasons.items()))}))


def add_to_blacklist(path: str | Path, reasons: Mapping[str, str]) -> None:
    """Add laws to the blacklist in ``path``; several processes may add to it at once.

    Raises `DataError` where ``path`` is another file, as `load_blacklist` does.
    """
    folder = Path(path).parent
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder):
        write_blacklist(path, {**load_blacklist(path), **reasons})


def _is_entry(entry: tuple[object, object]) -> bool:
    sha256, reason = entry
    digits = isinstance(sha256, str) and len(sha256) == HASH and set(sha256) <= set("0123456789abcdef")
    return digits and isinstance(reason, str)
