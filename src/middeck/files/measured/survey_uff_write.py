"""Mode shapes as a universal file: header (151), units (164), nodes, members (82), shapes.

Nodes are set 2411 or 15, shapes 55 or 2414.
"""

import itertools
import re
from collections.abc import Iterable
from pathlib import Path
from typing import IO

import numpy as np

from middeck.errors import ConfigError, DataError
from middeck.files.disk.atomic import replacing
from middeck.structure.correlation.measured_modes import AXES, MeasuredModes
from middeck.structure.correlation.placing import unbroken
from middeck.structure.model.article import Structure

NONE = "NONE"
DISPLACEMENT, REAL, COMPLEX = 8, 2, 5
SETS = (2411, 55)
LONGEST = 250  # entries of a trace line, as the format has it
CHOICES = {(nodes, shapes) for nodes in (2411, 15) for shapes in (55, 2414)}


def write_uff(
    path: Path, measured: MeasuredModes, structure: Structure | None = None, sets: tuple[int, int] = SETS
) -> None:
    """Write shapes in SI and global axes, whole or not at all; lines and members as trace lines.

    A node has the number at the end of its name; without one, or with another's, a number that no name has.
    ``sets`` are those of nodes (2411, or 15 with six digits) and of shapes (55 or 2414). Numbers have six
    digits; standard deviations have no place in the format and are left out. Directions that were not
    measured are zero, as the format has it, and so is a modal mass that is not known.

    Raises `DataError` for what the format cannot hold: no shapes, the angle or travel of a joint, damping
    that is not stated, complex modes of a ratio of 1 or more, nodes without number and place.
    """
    where = str(path)
    if tuple(sets) not in CHOICES:
        hint = "two: nodes as 2411 or 15, shapes as 55 or 2414"
        message = f"data sets {' and '.join(map(str, sets)) or 'of none'} are not written"
        raise ConfigError(message, where="sets", hint=hint)
    odd = sorted({d for d in measured.direction if d not in AXES})
    if odd or not measured.node:
        what = f"the {odd[0]} of a joint" if odd else "frequencies without shapes"
        hint = "measure_modes(modes, at=[(node, direction), ...]) of x ... rz, or write .json"
        raise DataError(f"data set {sets[1]} has no place for {what}", where=where, hint=hint)
    if np.isnan(measured.damping).any():
        hint = "state it, or write .json"
        raise DataError("a damping is not stated, and zero would be read", where=where, hint=hint)
    if not measured.is_real and np.any(np.abs(measured.damping) >= 1.0):
        raise DataError("a complex mode that does not oscillate", where=where, hint="leave it out")
    numbers = _numbers(measured, where)
    name = " ".join(measured.source.split())[:80] or path.stem
    with replacing(path) as temporary, open(temporary, "w", encoding="ascii", errors="replace") as text:
        _set(text, 151, [name, f"{len(measured.frequency_hz)} modes", "middeck", "", "", "middeck", ""])
        _set(
            text,
            164,
            [f"{1:10d}{'SI: m N':<20}{2:10d}", "".join(map(_real25, (1.0, 1.0, 1.0))), _real25(273.15)],
        )
        if measured.position_m is not None:
            _set(text, sets[0], _node_lines(measured, numbers, sets[0]))
        for lines in _trace_lines(measured, structure, numbers):
            _set(text, 82, lines)
        for mode in range(len(measured.frequency_hz)):
            _set(text, sets[1], _mode_lines(measured, numbers, mode, sets[1]))


def _numbers(measured: MeasuredModes, where: str) -> dict[str, int]:
    names = list(dict.fromkeys(measured.node))
    ends = {name: int(m[0]) for name in names if (m := re.search(r"\d{1,9}$", name))}
    own = {name: n for name, n in ends.items() if n and list(ends.values()).count(n) == 1}
    if len(own) < len(names) and measured.position_m is None:
        hint = "names that end in numbers, or position_m of each channel"
        raise DataError("nodes have neither numbers of their own nor places", where=where, hint=hint)
    free = itertools.count(max(ends.values(), default=0) + 1)
    return {name: own.get(name) or next(free) for name in names}


def _set(text: IO[str], number: int, lines: list[str]) -> None:
    text.write(f"{-1:6d}\n{number:6d}\n" + "".join(f"{line}\n" for line in lines) + f"{-1:6d}\n")


def _real25(x: float) -> str:
    return f"{x:25.16e}"


def _node_lines(measured: MeasuredModes, numbers: dict[str, int], kind: int) -> list[str]:
    assert measured.position_m is not None
    lines: list[str] = []
    for name, number in numbers.items():
        at = measured.position_m[measured.node.index(name)]
        head = f"{number:10d}{1:10d}{1:10d}{11:10d}"
        lines += [head + _reals(list(at))[0]] if kind == 15 else [head, "".join(map(_real25, at))]
    return lines


def _trace_lines(
    measured: MeasuredModes, structure: Structure | None, numbers: dict[str, int]
) -> list[list[str]]:
    """Lines of the survey and members whose ends are measured, one behind the other; 0 lifts the pen."""
    ends = [] if structure is None else [(m.start, m.end) for m in structure.members]
    every = dict.fromkeys((*measured.lines, *ends))
    known = [[n if n in numbers else None for n in line] for line in every]
    pens = [part[k : k + LONGEST - 1] for line in known for part in unbroken(line)
            for k in range(0, len(part) - 1, LONGEST - 2)]  # fmt: skip
    paths: list[list[int]] = []
    for pen in pens:
        if not paths or len(paths[-1]) + len(pen) + 1 > LONGEST:
            paths.append([])
        paths[-1] += [*(numbers[name] for name in pen), 0]
    rows = [[_whole(path[k : k + 8]) for k in range(0, len(path), 8)] for path in paths]
    heads = [_whole((number, len(path), 11)) for number, path in enumerate(paths, 1)]
    return [[head, "lines", *own] for head, own in zip(heads, rows, strict=True)]


def _mode_lines(measured: MeasuredModes, numbers: dict[str, int], mode: int, kind: int) -> list[str]:
    real, hz, zeta = measured.is_real, float(measured.frequency_hz[mode]), float(measured.damping[mode])
    wide = any(d in AXES[3:] for d in measured.direction)
    size = 6 if wide else 3
    rows = {n: np.zeros(size, dtype=complex) for n in numbers.values()}
    for name, way, value in zip(measured.node, measured.direction, measured.shape[:, mode], strict=True):
        rows[numbers[name]][AXES.index(way)] = value
    omega, mass = 2.0 * np.pi * hz, 0.0 if measured.modal_mass is None else float(measured.modal_mass[mode])
    root = [-zeta * omega, omega * np.sqrt(1.0 - zeta**2)]
    data = (1, 2 if real else 3, 3 if wide else 2, DISPLACEMENT, REAL if real else COMPLEX, size)
    names = [f"mode {mode + 1}", f"{hz:.6g} Hz", NONE, NONE, NONE]
    if kind == 55:
        values = [hz, mass, zeta, 0.0] if real else [*root, *[0.0] * 4]
        lines = [*names, _whole(data), _whole((2, len(values), 1, mode + 1)), *_reals(values)]
    else:
        lines = [_whole((mode + 1,)), names[0], _whole((1,)), *names, _whole(data)]
        lines += [_whole((1, 1, 1, 0, 1, mode + 1, 0, 0)), _whole((0, 0))]
        lines += _reals([0.0, hz, omega**2, mass if real else 0.0, zeta, 0.0])
        lines += _reals([*([0.0, 0.0] if real else root), *[0.0] * 4])
    for number, row in rows.items():
        lines += [_whole((number,)), *_reals(list(np.real(row) if real else row.view(float)))]
    return lines


def _whole(numbers: Iterable[int]) -> str:
    return "".join(f"{n:10d}" for n in numbers)


def _reals(values: list[float]) -> list[str]:
    return ["".join(f"{x:13.5e}" for x in values[k : k + 6]) for k in range(0, len(values), 6)]
