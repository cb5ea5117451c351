"""Modal surveys in universal files: shapes in data sets 55 or 2414, nodes in 15 or 2411, units in 164.

Places and motions in Cartesian, cylindrical and spherical systems of 2420 are turned into the part's own.

Columns as SDRC defined them (University of Cincinnati, Structural Dynamics Research Laboratory, universal
file formats). Functions (58) of the same file are passed over. Trace lines (82) are the lines of pictures and
show what is missing; the header (151) says where the survey is from.
"""

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import numpy as np

from middeck.errors import DataError
from middeck.files.nastran.deck.coordinates import BASIC, System
from middeck.files.records.uff_lines import AGAIN, fortran
from middeck.files.records.uff_sets import HEADER, TextSet, few, require_stated, scan_texts
from middeck.structure.correlation.measured_modes import AXES, MeasuredModes
from middeck.values import record

NODES, SHAPES, UNITS, SYSTEMS, LINES = (15, 2411), (55, 2414), 164, (18, 2420), 82
NORMAL, COMPLEX = 2, (3, 7)  # analysis types that are modes; 3 and 7 state an eigenvalue
# Derivatives of displacement by the specific data type; of unknown and general data none.
DERIVATIVE = {0: 0, 1: 0, 8: 0, 11: 1, 12: 2}
# How far a matrix of axes may be from the global one: printed digits.
AXES_OFF = 1e-6
# Largest relative difference of an eigenvalue or a shape that is given twice; data sets differ in digits.
SAME = 1e-4
# Units of length in a metre by the code of units; 9 is the user's own.
LENGTHS = {1: 1.0, 2: 3.28084, 3: 1.0, 4: 3.28084, 5: 1e3, 6: 1e2, 7: 39.3701, 8: 1e3, 10: 1e3}


@record(kw_only=True)
class Shape:
    """One mode: frequency [Hz], eigenvalue, damping ratio, complex motions by node number, oddities."""

    hz: float
    root: complex
    damping: float
    rows: dict[int, np.ndarray]
    is_complex: bool
    warnings: tuple[str, ...]


def load_uff(path: Path) -> MeasuredModes:
    """The survey in a universal file, in SI; nodes are named by their numbers until an article is known.

    Directions that no mode moves count as not measured, as the format has it (data set 55, note 15).

    Raises `DataError`, with the line, for a file that is cut or holds no modes, for nodes with displacement
    axes of their own, units that contradict themselves, and shapes that are not motions.
    """
    sets = scan_texts(path, (HEADER, *NODES, *SHAPES, *SYSTEMS, UNITS, LINES))
    heads, there = [s for s in sets if s.number == HEADER], sum(s.number in SHAPES for s in sets)
    require_stated(heads, there, "modes", path)
    shapes = _once([mode for s in sets if s.number in SHAPES if (mode := _shape(s, path)) is not None])
    rigid = sum(s.hz == 0.0 for s in shapes)
    shapes = [s for s in shapes if s.hz != 0.0]
    if not path.stat().st_size:
        raise DataError("the file is empty", where=str(path), hint="export it again")
    if not shapes:
        hint = "export mode shapes as data set 55 (normal mode, complex eigenvalue) or 2414"
        raise DataError("no mode shapes", where=str(path), hint=hint)
    factor = _metre([s for s in sets if s.number == UNITS], path)
    systems = _Systems(sets, path)
    found = dict[int, tuple[np.ndarray, np.ndarray]]()
    for s in (s for s in sets if s.number in NODES):
        _nodes(s, path, systems, found)
    places = {n: at for n, (at, _) in found.items()}
    numbers = sorted({n for shape in shapes for n in shape.rows})
    table = np.array([[_six(s.rows.get(n)) for s in shapes] for n in numbers]).reshape(-1, len(shapes), 6)
    table[:, :, :3] /= factor or 1.0
    for k, n in enumerate(numbers):
        if n in found:
            table[k] = _turn(table[k], found[n][1], n, path)
    moved = [(k, a) for k in range(len(numbers)) for a in range(6) if table[k, :, a].any()]
    located = bool(places) and all(n in places for n in numbers)
    notes = dict.fromkeys(w for s in shapes for w in (*s.warnings, *_lacking(s, len(numbers))))
    traced = [line for s in sets if s.number == LINES for line in _traced(s, path)]
    if places and (lost := sorted({n for line in traced for n in line} - places.keys())):
        notes[f"trace lines join nodes without coordinates ({few(lost)}): is the file whole?"] = None
    if rigid:
        notes[f"{rigid} modes at 0 Hz are left out"] = None
    if factor is None and (places or any(a > 2 for _, a in moved)):
        notes["no units (data set 164): lengths are taken as metres"] = None
    if systems.placed_in:
        # The form speaks of the part's system there, programs of the node's; 15 is clear.
        labels = ", ".join(map(str, sorted(systems.placed_in)))
        notes[f"places in data set 2411 are taken along the axes of their own system {labels}"] = None
    if places and not located:
        notes["some nodes have no coordinates: nodes are known by their numbers only"] = None
    value = np.array([table[k, :, a] for k, a in moved]).reshape(-1, len(shapes))
    try:
        return MeasuredModes(
            frequency_hz=np.array([s.hz for s in shapes]),
            damping=np.array([s.damping for s in shapes]),
            node=tuple(str(numbers[k]) for k, _ in moved),
            direction=tuple(AXES[a] for _, a in moved),
            shape=value if any(s.is_complex for s in shapes) else np.real(value),
            position_m=np.array([places[numbers[k]] for k, _ in moved]) / (factor or 1.0)
            if located
            else None,
            lines=tuple(dict.fromkeys(tuple(map(str, line)) for line in traced)),
            source=_source(heads),
            warnings=tuple(notes),
        )
    except DataError as error:
        raise DataError(error.what, where=str(path), hint=error.hint) from None


def _lacking(shape: Shape, nodes: int) -> tuple[str, ...]:
    """A word on nodes that other modes have: the format means that they stand still, a cut looks alike."""
    lacks = nodes - len(shape.rows)
    what = f"the mode of {shape.hz:.6g} Hz leaves out {lacks} of {nodes} nodes"
    return (f"{what}: they are taken to stand still in it (is the file whole?)",) if lacks else ()


def _source(heads: list[TextSet]) -> str:
    """Model, description, program and date of the first header; of our own the name of the model alone."""
    model, about, program, date, *_ = [*(heads[0].lines if heads else ()), "", "", "", ""]
    parts = [model] if program.strip() == "middeck" else [model, about, program, date[:20]]
    return "; ".join(" ".join(text.split()) for text in parts if text.strip().upper() not in ("", "NONE"))


def _traced(found: TextSet, path: Path) -> list[list[int]]:
    """Nodes that a trace line joins, 0 lifting the pen; `DataError` for fewer than it states."""
    lines = _Lines(found, path)
    stated = lines.whole(2)[1]
    lines.line()  # its name
    joined = [
        n for line in lines.lines[2:] if line.strip() for n in lines.whole(-(-len(line.rstrip()) // 10))
    ]
    if len(joined) < stated:
        what = f"{len(joined)} of the {stated} nodes of a trace line"
        raise DataError(what, where=lines.where(), hint=AGAIN)
    drawn = [list(pen) for down, pen in groupby(joined, bool) if down]
    return [line for line in drawn if len(line) > 1]


def _six(row: np.ndarray | None) -> np.ndarray:
    """Six motions of a node; zeros where a mode leaves the node out, as the format allows."""
    found = np.zeros(6, dtype=complex)
    if row is not None:
        found[: len(row)] = row
    return found


class _Lines:
    """Walks through the lines of a data set and knows on which line of the file it is."""

    def __init__(self, found: TextSet, path: Path) -> None:
        self.lines, self.first, self.path, self.at = found.lines, found.line, path, 0

    def where(self) -> str:
        return f"{self.path}:{self.first + self.at - 1}"

    def more(self) -> bool:
        return any(line.strip() for line in self.lines[self.at :])

    def line(self) -> str:
        self.at += 1
        if self.at > len(self.lines):
            raise DataError("truncated: the data set ends early", where=self.where(), hint=AGAIN)
        return self.lines[self.at - 1]

    def whole(self, count: int) -> list[int]:
        """The first ``count`` whole numbers of a line, ten columns each."""
        text = self.line()
        try:
            found = [int(text[k : k + 10]) for k in range(0, len(text.rstrip()), 10)]
        except ValueError:
            found = []
        if len(found) < count:
            raise DataError(f"{text[:40]!r} is not {count} whole numbers", where=self.where(), hint=AGAIN)
        return found[:count]

    def real(self, count: int, width: int = 13, on_line: int = 6) -> np.ndarray:
        """``count`` numbers, in fixed columns or parted by blanks."""
        found: list[float] = []
        while len(found) < count:
            text, due = self.line().rstrip(), min(on_line, count - len(found))
            parts = text.split()
            if len(parts) != due:
                parts = [text[k : k + width] for k in range(0, len(text), width)]
            try:
                values = [float(fortran(p.strip())) for p in parts]
            except ValueError:
                values = []
            if len(values) != due or not np.isfinite(values).all():
                raise DataError(f"{text[:60]!r} is not {due} numbers", where=self.where(), hint=AGAIN)
            found += values
        return np.array(found)


def _metre(sets: list[TextSet], path: Path) -> float | None:
    """Units of length in a metre; None where nothing says so."""
    stated = {_length(s, path) for s in sets}
    if len(stated) > 1:
        raise DataError("several data sets 164 that differ", where=str(path), hint="export one unit system")
    return next(iter(stated), None)


def _length(found: TextSet, path: Path) -> float:
    lines = _Lines(found, path)
    text = lines.line()
    if not text[:10].strip().isdigit():
        raise DataError(f"{text[:10]!r} is no code of units", where=lines.where(), hint=AGAIN)
    code = int(text[:10])
    factor = float(lines.real(3, 25, 3)[0])
    known = LENGTHS.get(code, factor)
    if not factor > 0.0 or abs(factor / known - 1.0) > 1e-3:
        raise DataError(
            f"a length factor of {factor:g} with the units code {code}",
            where=lines.where(),
            hint=f"this code has {known:g} units of length in a metre; mend data set 164",
        )
    return factor


class _Systems:
    """The coordinate systems of a file by their labels; 0 and 1 are the part's own where it says no more."""

    def __init__(self, sets: list[TextSet], path: Path) -> None:
        self.read = {0: BASIC, 1: BASIC}
        self.odd, self.placed_in = set[int](), set[int]()
        self.unread = any(s.number == 18 for s in sets)
        for found in (s for s in sets if s.number == 2420):
            lines = _Lines(found, path)
            lines.whole(1)
            lines.line()  # name of the part
            while lines.more():
                label, kind = lines.whole(2)
                lines.line()
                matrix = np.array([lines.real(3, 25, 3) for _ in range(4)])
                with np.errstate(over="ignore", invalid="ignore"):  # a damaged exponent
                    square = np.abs(matrix[:3] @ matrix[:3].T - np.eye(3)).max() < AXES_OFF
                self.read[label] = System("RCS"[kind] if kind in (0, 1, 2) else "", matrix[3], matrix[:3].T)
                if not self.read[label].kind or not square or np.linalg.det(matrix[:3]) < 0.0:
                    self.odd.add(label)

    def own(self, node: int, what: str, label: int, where: str) -> System:
        """The system of a node. Raises `DataError` for one that is not described, or no system."""
        if label in self.read and label not in self.odd:
            return self.read[label]
        known = "no unit vectors, or an unknown kind" if label in self.read else "not in data set 2420"
        if self.unread and label not in self.read:
            known = "in data set 18, which is not read"
        raise DataError(
            f"node {node} has {what} axes of its own, system {label}: {known}",
            where=where,
            hint="export shapes and nodes in global axes",
        )

    def axes(self, node: int, label: int, at: np.ndarray, where: str) -> np.ndarray:
        """Unit vectors of displacement in rows, at a place; `DataError` where they have no direction."""
        system = self.own(node, "displacement", label, where)
        off = system.axes.T @ (at - system.origin)
        size = np.abs([off, at, system.origin]).max()  # what rounding leaves of them has no direction
        if system.kind != "R" and not np.hypot(off[0], off[1]) > AXES_OFF * size:
            raise DataError(
                f"node {node} has displacement axes of its own, system {label}: its axis runs through it",
                where=where,
                hint="export shapes in global axes",
            )
        axes = system.axes_at(at).T
        return np.where(np.abs(axes) > AXES_OFF, axes, 0.0)  # printed zeros


def _turn(table: np.ndarray, axes: np.ndarray, node: int, path: Path) -> np.ndarray:
    """Motions [mode, 6] of a node along its own ``axes`` as motions along those of the file."""
    for part in (slice(0, 3), slice(3, 6)):
        moved = np.any(table[:, part] != 0.0, axis=0)
        mixes = np.count_nonzero(axes) > 3
        if mixes and 0 < np.sum(moved) < 3:
            raise DataError(
                f"node {node} moves along {np.sum(moved)} of the three axes of its system, which are askew: "
                "along those of the file it is not known",
                where=str(path),
                hint="export all three directions, or give the survey as CSV",
            )
    return np.hstack([table[:, :3] @ axes, table[:, 3:] @ axes])


def _once(shapes: list[Shape]) -> list[Shape]:
    """The shapes, each once: of a complex pair the forward one, of duplicates the first."""

    def again(k: int, shape: Shape) -> bool:
        back = shape.root.imag < 0.0 and any(_close(s.root, shape.root.conjugate()) for s in shapes)
        return back or any(_equal(s, shape) for s in shapes[:k])

    return [s for k, s in enumerate(shapes) if not again(k, s)]


def _close(one: complex, other: complex) -> bool:
    return abs(one - other) <= SAME * abs(one)


def _equal(one: Shape, other: Shape) -> bool:
    if one.rows.keys() != other.rows.keys() or not _close(one.root, other.root):
        return False
    here, there = (np.array([_six(s.rows[n]) for n in one.rows]) for s in (one, other))
    return bool(np.abs(here - there).max(initial=0.0) <= SAME * np.abs(here).max(initial=0.0))


def _nodes(
    found: TextSet, path: Path, systems: _Systems, places: dict[int, tuple[np.ndarray, np.ndarray]]
) -> None:
    """Add to ``places`` those of a data set, and the axes of displacement there."""
    lines = _Lines(found, path)
    while lines.more():
        if found.number == 15:
            text = lines.line()
            inner = _Lines(TextSet(15, found.line + lines.at - 1, (text[:40], text[40:])), path)
            number, defined, axes, *_ = inner.whole(4)
            at = inner.real(3)
        else:
            number, defined, axes, *_ = lines.whole(4)
            at = lines.real(3, 25, 3)
        system = systems.own(number, "coordinate", defined, lines.where())
        moved = system.to_basic(at)
        if found.number == 2411 and np.abs(moved - at).max() > AXES_OFF * np.abs(at).max():
            systems.placed_in.add(defined)
        at = moved
        own = systems.axes(number, axes, at, lines.where())
        apart = np.abs(places[number][0] - at).max() if number in places else 0.0
        if apart > SAME * np.abs(at).max():  # data sets differ in digits
            raise DataError(f"node {number} stands at two places", where=lines.where(), hint=AGAIN)
        places[number] = at, own


def _shape(found: TextSet, path: Path) -> Shape | None:
    """The mode in a data set 55 or 2414; None for what is no mode (static, transient, response)."""
    lines = _Lines(found, path)
    for _ in range(5 if found.number == 55 else 2):
        lines.line()
    if found.number == 2414:
        if lines.whole(1)[0] != 1:
            return None  # at elements
        for _ in range(5):
            lines.line()
    _, analysis, characteristic, quantity, kind, per_node = lines.whole(6)
    if analysis != NORMAL and analysis not in COMPLEX:
        return None
    sound = (characteristic, per_node) in ((2, 3), (3, 6)) and kind in (2, 4, 5, 6) and quantity in DERIVATIVE
    if not sound:
        raise DataError(
            f"data characteristic {characteristic}, specific type {quantity}, data type {kind}, "
            f"{per_node} values a node",
            where=lines.where(),
            hint="motions (0, 1, 8, 11 or 12) of 3 or 6 degrees of freedom, real or complex, are read",
        )
    hz, damping, root, notes = _eigenvalue(lines, found.number, analysis)
    is_complex = kind in (5, 6)
    divisor = root if is_complex else abs(root)  # the sign and phase of a real shape are free
    scale = 1.0 / divisor ** DERIVATIVE[quantity] if root else 1.0
    rows = {n: scale * v for n, v in _rows(lines, per_node, is_complex)}
    return Shape(hz=hz, root=root, damping=damping, rows=rows, is_complex=is_complex, warnings=notes)


def _eigenvalue(lines: _Lines, number: int, analysis: int) -> tuple[float, float, complex, tuple[str, ...]]:
    """Frequency, damping ratio, the root that differentiates, what is odd."""
    if number == 55:
        ints = lines.whole(2)
        real = lines.real(ints[1] if 1 <= ints[1] <= 12 else 1)
        normal = real[[0, 2, 3]] if len(real) >= 4 else np.full(3, np.nan)
        root = complex(*real[:2]) if len(real) >= 2 else complex(np.nan)
    else:
        lines.whole(8)
        lines.whole(2)
        first, second = lines.real(6), lines.real(6)
        normal, root = first[[1, 4, 5]], complex(*second[:2])
    if not np.isfinite(normal if analysis == NORMAL else root).all():
        raise DataError("the mode states too few numbers", where=lines.where(), hint=AGAIN)
    if analysis != NORMAL:
        hz, ratio = abs(root) / (2.0 * np.pi), (0.0 - root.real) / abs(root) if root else 0.0
        grows = (f"the mode of {hz:.6g} Hz has an eigenvalue with positive real part",) if ratio < 0.0 else ()
        return hz, ratio, root, grows
    hz, viscous, hysteretic = map(float, normal)
    if viscous and hysteretic and abs(hysteretic / (2.0 * viscous) - 1.0) > 0.01:
        notes = (f"the mode of {hz:.6g} Hz states two dampings: the viscous ratio {viscous:g} is taken",)
    else:
        notes = ()
    return hz, viscous or 0.5 * hysteretic, complex(2.0 * np.pi * hz), notes


def _rows(lines: _Lines, per_node: int, is_complex: bool) -> Iterator[tuple[int, np.ndarray]]:
    seen = set[int]()
    while lines.more():
        (number, *_) = lines.whole(1)
        values = lines.real(per_node * (1 + is_complex))
        if number in seen:
            raise DataError(f"node {number} occurs twice in one mode", where=lines.where(), hint=AGAIN)
        seen.add(number)
        yield number, values[0::2] + 1j * values[1::2] if is_complex else values.astype(complex)
