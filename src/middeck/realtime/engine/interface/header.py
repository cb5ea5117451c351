"""What engine and supervisor share, read from the header that the engine is compiled with."""

import functools
import re
from importlib import resources

import numpy as np

from middeck.realtime.engine.interface.checksum import checksum

WORD = {"whole": "<i8", "real": "<f8", "unsigned char": "u1"}
"""Types of the header that are no records; a text of chars becomes bytes."""


def source_text(file: str) -> str:
    """The text of one of the engine's sources."""
    return resources.files("middeck.realtime.engine").joinpath("source", file).read_text(encoding="utf-8")


@functools.cache
def constants() -> dict[str, int]:
    """All enumerated names of the header and their values.

    >>> constants()["CHANNELS"], constants()["SLOTS"]
    (64, 2)
    """
    found: dict[str, int] = {}
    for body in re.findall(r"enum(?: \w+)? \{(.*?)\}", _header(), re.DOTALL):
        value = -1
        for entry in body.split(","):
            name, _, given = entry.partition("=")
            value = int(given.strip(), 0) if given else value + 1
            found[name.strip()] = value
    return found


@functools.cache
def names_of(enum: str) -> dict[int, str]:
    """Words for the values of one enumeration of the header, in lower case.

    >>> names_of("state")[4]
    'control'
    """
    (body,) = re.findall(rf"enum {enum} \{{(.*?)\}}", _header(), re.DOTALL)
    entries = [entry.partition("=")[0].strip() for entry in body.split(",")]
    return {constants()[name]: name.lower().replace("_", " ") for name in entries}


@functools.cache
def layout(record: str) -> np.dtype:
    """The fields of one shared record, as numpy lays them out without padding.

    >>> layout("asks").itemsize
    72
    """
    pattern = rf"typedef struct \{{((?:(?!typedef).)*?)\n\}} {record};"
    (body,) = re.findall(pattern, _header(), re.DOTALL)
    nested = re.compile(r"struct \{(.*?)\} (\w+)(\[\w+\])?;", re.DOTALL)
    inner = {name: _fields(text) for text, name, _ in nested.findall(body)}
    return _fields(nested.sub(r"\2 \2\3;", body), inner)


def _fields(body: str, inner: dict[str, np.dtype] | None = None) -> np.dtype:
    fields: list[tuple[str, object, tuple[int, ...]]] = []
    for declaration in filter(None, (part.strip() for part in body.split(";"))):
        ((kind, names),) = re.findall(r"^(unsigned char|\w+)\s+(.*)$", declaration, re.DOTALL)
        for name in names.split(","):
            field, *sizes = re.findall(r"\w+", name)
            shape = tuple(int(size) if size.isdigit() else constants()[size] for size in sizes)
            if kind == "char":
                fields.append((field, f"S{shape[-1]}", shape[:-1]))
            else:
                known = WORD.get(kind) or (inner or {}).get(kind)
                fields.append((field, known or layout(kind), shape))
    return np.dtype(fields)


@functools.cache
def layout_check() -> int:
    """Of all declarations: it stands in each shared file, so that no program misreads that of another build.

    >>> 0 < layout_check() < 1 << 63
    True
    """
    words = " ".join(_header().split()).encode()
    return checksum(words + bytes(-len(words) % 8)) >> 1


@functools.cache
def _header() -> str:
    return re.sub(r"/\*.*?\*/", "", source_text("shared.h"), flags=re.DOTALL)
