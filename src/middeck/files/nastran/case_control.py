"""What case control selects: sets of constraints and loads, and matrices, in any subcase."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

from middeck.files.nastran.sections import Line

_COMMAND = re.compile(r"\s*([A-Z0-9]+)\s*(?:\([^)]*\))?\s*=\s*(.*?)\s*$")
_SETS = frozenset(("SPC", "MPC", "LOAD", "METHOD", "METH", "SUPORT1", "NSM"))
_MATRICES = frozenset(("K2GG", "M2GG", "K2PP", "M2PP", "B2PP", "B2GG", "A2GG", "K42GG"))


class Selection(NamedTuple):
    """Numbers of sets by command, names of matrices by command, the line of each, and lines with PARAM."""

    sets: dict[str, frozenset[int]]
    matrices: dict[str, str]
    lines: dict[str, Line]
    params: tuple[Line, ...]

    def selects(self, command: str, number: int) -> bool:
        """Whether any subcase selects this set."""
        return number in self.sets.get(command, ())


def read_selection(lines: Iterable[Line]) -> Selection:
    """The commands of case control that modes depend on; all others are passed over."""
    sets: dict[str, frozenset[int]] = {}
    matrices: dict[str, str] = {}
    where: dict[str, Line] = {}
    params: list[Line] = []
    for line in lines:
        text = line[0].upper()
        if re.match(r"\s*PARAM\s*[, ]", text):
            params.append(line)
            continue
        found = _COMMAND.match(text)
        if found is None:
            continue
        command, value = found.groups()
        if command in _SETS and value.isdecimal():
            sets[command] = sets.get(command, frozenset()) | {int(value)}
            where.setdefault(command, line)
        elif command in _MATRICES:
            matrices[command] = value
            where.setdefault(command, line)
    return Selection(sets, matrices, where, tuple(params))
