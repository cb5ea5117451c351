"""Selections of case control in one subcase or in all: sets of constraints and loads, and matrices."""

import re
from collections.abc import Iterable
from typing import NamedTuple

from middeck.errors import ConfigError
from middeck.files.nastran.deck.deck_lines import Line, fault_on
from middeck.files.nastran.deck.nastran_numbers import integer
from middeck.files.toml.faults import DocumentFault, raise_faults

# Blanks may stand for the equals sign.
_COMMAND = re.compile(r"\s*([A-Z0-9]+)\s*(?:\([^)]*\))?(?:\s*=\s*|\s+)(.*?)\s*$")
_SETS = frozenset(("SPC", "MPC", "LOAD", "METHOD", "METH", "SUPORT1", "NSM"))
_HEAT = frozenset(("TEMP", "TEMPERATURE"))
_MATRICES = frozenset(("K2GG", "M2GG", "K2PP", "M2PP", "B2PP", "B2GG", "A2GG", "K42GG"))
_SUBCASE = re.compile(r"\s*(SUBCASE|SYM|REPCASE|SUBCOM|SUBSEQ|SYMCOM)\s*=?\s*(\d*)\s*(?:=|$)")
# Sums of subcases before them, which select nothing of the model.
_SUMS = frozenset(("SUBCOM", "SUBSEQ", "SYMCOM"))
# What may differ between subcases: a load set is a load case, and how to solve is no part of a model.
_FREE = frozenset(("LOAD", "METHOD", "METH", "TEMPERATURE"))
# Commands after which modes are those of another structure: a preload (DSCOEFFICIENT in the rigid formats of
# NASTRAN-95, where four letters are enough), a transfer function, glued surfaces.
_OTHERS = re.compile("STATSUB|DSCO.*|TFL|BGSET|BCONTACT")


class CaseSelection(NamedTuple):
    """Numbers of sets by command, names of matrices by command, the first line of each command and number or
    name, and lines with PARAM."""

    sets: dict[str, frozenset[int]]
    matrices: dict[str, str]
    lines: dict[tuple[str, int | str], Line]
    params: tuple[Line, ...]

    def selects(self, command: str, number: int) -> bool:
        """Whether any subcase selects this set."""
        return number in self.sets.get(command, ())

    def fault(self, command: str, value: int | str, message: str, hint: str = "") -> DocumentFault:
        """A complaint about the line that selects ``value`` by ``command``."""
        return fault_on(self.lines[command, value], command, message, f"{value}", hint)


class _Choice(NamedTuple):
    """The line and the value of a command."""

    line: Line
    value: int | str


def read_selection(lines: Iterable[Line], subcase: int | None = None) -> CaseSelection:
    """The commands of case control that modes depend on; all others are passed over.

    Those of ``subcase``, or of all where they agree but for loads; set 0 is none. Raises `ConfigError` for a
    set that is no number, a preload (STATSUB, DSCOEFFICIENT), a transfer function (TFL), glue or contact
    (BGSET, BCONTACT), a subcase that is not there, and subcases that differ.
    """
    parts = _parts(lines)
    common, own = parts.pop(None), parts
    if subcase is not None and subcase not in own:
        raise ConfigError(
            f"there is no subcase {subcase}", where="case control", hint=f"it has {_listed(own)}"
        )
    kept = own if subcase is None else {subcase: own[subcase]}
    faults: list[DocumentFault] = []
    defaults = _choices(common, faults)
    cases = {name: defaults | _choices(some, faults) for name, some in kept.items()} or {0: defaults}
    raise_faults(faults)
    cases = {name: {c: v for c, v in case.items() if v.value != 0} for name, case in cases.items()}
    raise_faults(_unlike(cases))
    sets: dict[str, frozenset[int]] = {}
    matrices: dict[str, str] = {}
    where: dict[tuple[str, int | str], Line] = {}
    for command, (line, value) in (item for case in cases.values() for item in case.items()):
        where.setdefault((command, value), line)
        if isinstance(value, int):
            sets[command] = sets.get(command, frozenset()) | {value}
        else:
            matrices[command] = value
    params = [line for some in (common, *kept.values()) for line in some if _is_param(line)]
    return CaseSelection(sets, matrices, where, tuple(params))


def _parts(lines: Iterable[Line]) -> dict[int | None, list[Line]]:
    """Lines before the first subcase, under None, and those of each."""
    parts: dict[int | None, list[Line]] = {None: []}
    at: list[Line] = parts[None]
    for line in lines:
        found = _SUBCASE.match(line[0].upper())
        if found is None:
            at.append(line)
        elif found[1] in _SUMS:
            at = []
        else:
            at = parts.setdefault(int(found[2] or 0), [])
    return {name: some for name, some in parts.items() if name is None or not any(map(_is_super, some))}


def _is_super(line: Line) -> bool:
    """Whether a line SUPER restricts its subcase to numbered superelements (not 0 or ALL)."""
    return bool(re.match(r"\s*SUPER(?:\s*=|\s)\s*(?!(?:0|ALL)\b)[^\s=]", line[0].upper()))


def _is_param(line: Line) -> bool:
    return bool(re.match(r"\s*PARAM\s*[, ]", line[0].upper()))


def _choices(lines: Iterable[Line], faults: list[DocumentFault]) -> dict[str, _Choice]:
    """Selections of some lines, by command."""
    out: dict[str, _Choice] = {}
    for line in lines:
        found = None if _is_param(line) else _COMMAND.match(line[0].upper())
        if found is None:
            continue
        command, value = found.groups()
        if command in _HEAT:
            number = integer(value)
            if number and "(LOAD" not in line[0].upper().replace(" ", ""):  # else of loads alone
                out["TEMPERATURE"] = _Choice(line, number)
        elif command in _SETS:
            number = integer(value)
            if number is None or number < 0:
                faults.append(fault_on(line, command, f"{value!r} is not the number of a set"))
            else:
                out[command] = _Choice(line, number)
        elif _OTHERS.fullmatch(command):
            faults.append(
                fault_on(line, command, "not converted yet, and without it the modes would be others")
            )
        elif command in _MATRICES:
            out[command] = _Choice(line, value)
    return out


def _unlike(cases: dict[int | None, dict[str, _Choice]]) -> list[DocumentFault]:
    """A fault for each command that selects one thing in a subcase and another, or nothing, in the next."""
    faults: list[DocumentFault] = []
    for command in dict.fromkeys(c for case in cases.values() for c in case if c not in _FREE):
        chosen = {name: case.get(command) for name, case in cases.items()}
        if len({c and c.value for c in chosen.values()}) > 1:
            first = next(c for c in chosen.values() if c is not None)
            listed = ", ".join(f"{c.value if c else 'none'} in {name}" for name, c in chosen.items())
            message = f"subcases select different ones, {listed}: each is another structure"
            hint = f"name one with --subcase: {_listed(cases)}"
            faults.append(fault_on(first.line, command, message, hint=hint))
    return faults


def _listed(cases: Iterable[int | None]) -> str:
    return ", ".join(f"{name}" for name in cases) or "none"
