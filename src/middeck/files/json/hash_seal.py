"""Sealed documents: each carries the SHA-256 of its other content, so that a change shows."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from middeck.errors import DataError
from middeck.files.json.input import read_json
from middeck.files.json.output import plain

SEAL = "sha256"


def seal(document: Mapping[str, Any]) -> dict[str, Any]:
    """``document`` as plain values with its seal; keys in their order, which the seal does not depend on."""
    values = dict(plain(document))
    return {**values, SEAL: _hash(values)}


def read_sealed(path: str | Path, schema: str) -> dict[str, Any]:
    """The document in ``path``. Raises `DataError` for another document, and where the seal does not fit."""
    found = read_json(path, schema, "the file as it was written")
    doubled = doubled_key(Path(path).read_text(encoding="utf-8-sig"))
    if doubled:  # a reader sees the first, a parser the last
        raise DataError(f"key {doubled!r} stands twice", where=str(path), hint="the file as it was written")
    inside = {key: value for key, value in found.items() if key != SEAL}
    try:
        fits = found.get(SEAL) == _hash(inside)
    except (ValueError, RecursionError):  # NaN, infinity, tables without end: no sealed document holds them
        fits = False
    if not fits:
        raise DataError(
            f"the document is not what was sealed: its {SEAL} does not fit its content",
            where=str(path),
            hint="the file as it was written; a promise that was changed is void",
        )
    if not _is_text(found):
        what = "a name or text in it is not valid Unicode: half a character (a lone surrogate)"
        raise DataError(what, where=str(path), hint="the file as it was written")
    return found


def _is_text(values: Mapping[str, Any]) -> bool:
    """Whether all texts can be written as UTF-8, which has no lone surrogates; JSON has escapes for them."""
    try:
        json.dumps(values, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        return False
    return True


def doubled_key(text: str) -> str:
    """The first key that a table of the JSON ``text`` has twice; empty for none."""
    twice: list[str] = []

    def table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        names = [name for name, _ in pairs]
        twice.extend(name for name in names if names.count(name) > 1)
        return dict(pairs)

    json.loads(text, object_pairs_hook=table)
    return next(iter(twice), "")


def _hash(values: Mapping[str, Any]) -> str:
    text = json.dumps(values, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
