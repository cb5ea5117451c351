"""The line of a TOML file on which a key stands, which the standard reader does not give."""

import re
import tomllib
from typing import Any, cast

Path = tuple[str | int, ...]
ENDS = re.compile(r"""(?:[\]}]|\"{3}|'{3})\s*(?:#.*)?$""")
"""The last line of a value of several lines."""


def key_lines(text: str) -> dict[Path, int]:
    """Line, counted from one, of every table and key of a valid TOML ``text``.

    Items of arrays of tables are numbered from zero; those of an array in brackets stand where they end.

    >>> key_lines("[[node]]\\nx = 1\\n[[node]]\\nx = 2\\n")[("node", 1, "x")]
    4
    >>> key_lines("node = [\\n{x = 1},\\n{x = 2},\\n]\\n")[("node", 1, "x")]
    3
    """
    lines = text.splitlines()
    found: dict[Path, int] = {}
    counts: dict[Path, int] = {}
    table: Path = ()
    number = 0
    while number < len(lines):
        line = lines[number].strip()
        span = 1
        if line.startswith("["):
            table = _open_table(line, counts)
            for end in range(1, len(table) + 1):
                found.setdefault(table[:end], number + 1)
        elif line and not line.startswith("#"):
            value, span = _value(lines, number)
            ends = _ends_of_items(lines[number : number + span])
            for path in _paths(value):
                item = next((key for key in path if isinstance(key, int)), None)
                below = 0 if item is None else ends[item] if item < len(ends) else span - 1
                found.setdefault(table + path, number + 1 + below)
        number += span
    return found


def line_of(lines: dict[Path, int], path: Path) -> int:
    """Line of ``path`` or of the nearest table around it; the first line if there is none."""
    for end in range(len(path), 0, -1):
        if path[:end] in lines:
            return lines[path[:end]]
    return 1


def _open_table(line: str, counts: dict[Path, int]) -> Path:
    keys = _only_path(tomllib.loads(line))
    path: Path = ()
    for depth, key in enumerate(keys):
        path = (*path, key)
        last = depth == len(keys) - 1
        if last and line.startswith("[["):
            counts[path] = counts.get(path, -1) + 1
        if path in counts:
            path = (*path, counts[path])
    return path


def _only_path(value: Any) -> tuple[str, ...]:
    keys: list[str] = []
    while value:
        value = cast("list[Any]", value)[0] if isinstance(value, list) else value
        if not value:
            break
        key, value = next(iter(value.items()))
        keys.append(key)
    return tuple(keys)


def _value(lines: list[str], first: int) -> tuple[dict[str, Any], int]:
    """The key and value that begin on line ``first``, counted from zero, and how many lines they take."""
    for span in range(1, len(lines) - first + 1):
        if span > 1 and not ENDS.search(lines[first + span - 1]):
            continue
        try:
            return tomllib.loads("\n".join(lines[first : first + span])), span
        except tomllib.TOMLDecodeError:
            continue
    return {}, 1


def _ends_of_items(lines: list[str]) -> list[int]:
    """Index of the line on which each item of an array ends, without items of the last of its ``lines``."""
    ends: list[int] = []
    pending: list[str] = []
    head = ""
    for end, line in enumerate(lines[:-1]):
        pending.append(line if pending or not head else line.lstrip().removeprefix(","))
        try:
            value: Any = tomllib.loads("\n".join([head, *pending, "]"]))
        except tomllib.TOMLDecodeError:
            continue
        while isinstance(value, dict):
            value = next(iter(cast("dict[str, Any]", value).values()))
        ends += [end] * len(value)
        if value or head:  # what is left is read alone: arrays may have thousands of lines
            pending, head = [], "items = ["
    return ends


def _paths(value: Any) -> list[Path]:
    paths: list[Path] = []
    items = enumerate(cast("list[Any]", value)) if isinstance(value, list) else value.items()
    for key, child in items:
        paths.append((key,))
        if isinstance(child, dict | list):
            paths += [(key, *path) for path in _paths(child)]
    return paths
