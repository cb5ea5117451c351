"""What case control selects: sets of constraints and loads, and matrices, in any subcase."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

from middeck.files.nastran.deck.numbers import integer
from middeck.files.nastran.deck.sections import Line
from middeck.files.toml.faults import Fault, raise_faults

# Blanks may stand for the equals sign.
_COMMAND = re.compile(r"\s*([A-Z0-9]+)\s*(?:\([^)]*\))?(?:\s*=\s*|\s+)(.*?)\s*$")
_SETS = frozenset(("SPC", "MPC", "LOAD", "METHOD", "METH", "SUPORT1", "NSM"))
_MATRICES = frozenset(("K2GG", "M2GG", "K2PP", "M2PP", "B2PP", "B2GG", "A2GG", "K42GG"))
# Commands after which modes are those of another structure: a preload, a transfer function.
_OTHERS = frozenset(("STATSUB", "TFL"))


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
    """The commands of case control that modes depend on; all others are passed over.

    Raises `ConfigError` for a set that is no number, a preload (STATSUB) and a transfer function (TFL).
    """
    sets: dict[str, frozenset[int]] = {}
    matrices: dict[str, str] = {}
    where: dict[str, Line] = {}
    params: list[Line] = []
    faults: list[Fault] = []
    for line in lines:
        text = line[0].upper()
        if re.match(r"\s*PARAM\s*[, ]", text):
            params.append(line)
            continue
        found = _COMMAND.match(text)
        if found is None:
            continue
        command, value = found.groups()
        if command in _SETS:
            number = integer(value)
            if number is None or number < 0:
                faults.append(_fault(line, command, f"{value!r} is not the number of a set"))
            else:
                sets[command] = sets.get(command, frozenset()) | {number}
                where.setdefault(command, line)
        elif command in _OTHERS:
            faults.append(
                _fault(line, command, "not converted yet, and without it the modes would be others")
            )
        elif command in _MATRICES:
            matrices[command] = value
            where.setdefault(command, line)
    raise_faults(faults)
    return Selection(sets, matrices, where, tuple(params))


def _fault(line: Line, command: str, message: str) -> Fault:
    return Fault(file=line[1], line=line[2], key=command, message=message)
