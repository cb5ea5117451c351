"""Stations of a PBEAM and a PBEAML: the cross-sections of a beam from its end A to its end B.

After the remarks of both cards in the Quick Reference Guides: stations stand in any order, one of them at end
B; a blank at end B is the value of end A, one between is on the line between the ends.
"""

from collections.abc import Sequence
from typing import NamedTuple

from middeck.files.nastran.deck.entries import Entry
from middeck.files.nastran.deck.nastran_numbers import real
from middeck.files.nastran.members.section_shapes import SHAPES, section_shape

ROW = 8
OUTPUT = ("YES", "YESA", "NO")  # the first field of a station
OWN = ("a", "i1", "i2", "i12", "j", "nsm")  # of a PBEAM, in the order of its stations
ONE_SIDED = (
    "a DBOX that is another one in a mirror: programs may draw its sides otherwise; "
    "give its constants (PBAR, PBEAM)"
)
# The last two lines of a PBEAM.
FACTORS: tuple[str, ...] = ("K1", "K2", "S1", "S2", "NSI(A)", "NSI(B)", "CW(A)", "CW(B)")
AXES: tuple[str, ...] = ("M1(A)", "M2(A)", "M1(B)", "M2(B)", "N1(A)", "N2(A)", "N1(B)", "N2(B)")


class FieldError(ValueError):
    """A fault of the field of a card at ``place``."""

    def __init__(self, message: str, place: int) -> None:
        super().__init__(message)
        self.place = place


class Cut(NamedTuple):
    """A cross-section: area, second moments, torsion constant, and mass per length that is not structural.

    ``nsi`` is the polar inertia of that mass about its own centre (m1, m2); the centroid is at (n1, n2). Both
    places are (y, z) from the shear centre, through which the axis of the member goes.
    """

    area: float
    i1: float
    i2: float
    i12: float
    j: float
    nsm: float
    nsi: float = 0.0
    m1: float = 0.0
    m2: float = 0.0
    n1: float = 0.0
    n2: float = 0.0


class Stations(NamedTuple):
    """Cuts at fractions of the length, from 0 to 1 or at 0 alone, and the shear factors of all."""

    cuts: tuple[tuple[float, Cut], ...]
    k1: float
    k2: float


def read_pbeam(entry: Entry) -> Stations:
    """Stations of a PBEAM; raises `ValueError` for what they are not, and for shear relief (S1, S2)."""
    texts = [text or "" for text in entry["rest"]]  # from C1(A), the second line of eight
    rows = [[*texts[i : i + ROW], *[""] * ROW][:ROW] for i in range(0, len(texts), ROW)]
    # Points of stress recovery at end A may be left out before stations.
    row = 0 if rows and rows[0][0] in OUTPUT else 1
    own = [entry[key] for key in OWN]
    found: dict[float, list[float | None]] = {}
    while row < len(rows) and rows[row][0] in OUTPUT:
        at, *values = _reals(rows, row, 1)
        _add(found, at, values, ROW * (row + 1) + 1)
        stressed = rows[row][0] == "YES" or (row + 2 < len(rows) and rows[row + 2][0] in OUTPUT)
        row += 1
        if row < len(rows) and stressed and rows[row][0] not in OUTPUT:
            row += 1
    factors, axes = (
        dict(zip(names, _reals(rows, row + k, 0), strict=True)) for k, names in enumerate((FACTORS, AXES))
    )
    if any(any(more) for more in rows[row + 2 :]):
        raise FieldError("a line after that of M1(A) to N2(B)", ROW * (row + 3))
    for k, name in enumerate(FACTORS):
        if name in ("S1", "S2") and factors[name]:
            raise FieldError(f"shear relief {name} is not converted", ROW * (row + 1) + k)
    k1, k2 = (1.0 if factors[name] is None else factors[name] or 0.0 for name in ("K1", "K2"))
    all_of = factors | axes
    start = [all_of[f"{name}(A)"] or 0.0 for name in ("NSI", "M1", "M2", "N1", "N2")]
    end = [all_of[f"{name}(B)"] for name in ("NSI", "M1", "M2", "N1", "N2")]
    blank: list[float | None] = [None] * len(start)
    if not found and any(value is not None for value in end):
        found[1.0] = [None] * len(own)
    given = {at: values + (end if at == 1.0 else blank) for at, values in found.items()}
    return Stations(tuple((at, Cut(*values)) for at, values in _completed(own + start, given)), k1, k2)


def read_shape(entry: Entry) -> Stations:
    """Stations of a PBARL, at end A alone, or a PBEAML, whose centroid is off its shear centre."""
    name, dims = entry["type"], entry["dims"]
    if name not in SHAPES:
        raise ValueError(f"shape {name} is not converted yet; {', '.join(SHAPES)} are")
    count, first = SHAPES[name][0], 8  # the place of the first dimension
    values = _of_texts(dims[: count + 1], first)
    if None in values[:count] or len(values) < count:
        raise ValueError(f"{name} needs {count} real dimensions")
    own = [*(value or 0.0 for value in values), 0.0][: count + 1]
    tapers = entry.name == "PBEAML"
    if not tapers and len(dims) > count + 1:
        raise ValueError(f"more than the {count} dimensions of {name} and a mass per length")
    found: dict[float, list[float | None]] = {}
    for i in range(count + 1, len(dims), count + 3):
        if dims[i] not in (None, "", *OUTPUT):
            raise FieldError("must be YES or NO: dimensions and mass of a station stand after it", first + i)
        given = _of_texts(dims[i + 1 : i + count + 3], first + i + 1)
        at, *values = [*given, *[None] * (count + 2 - len(given))]
        _add(found, at, values, first + i + 1)
    cuts: list[tuple[float, Cut]] = []
    shape = section_shape(name, own[:count])
    for at, (*sizes, nsm) in _completed(own, found):
        shape = section_shape(name, sizes)
        n1, n2 = shape.centroid if tapers else (0.0, 0.0)
        if name == "DBOX" and any((shape.i12, n1, n2)):
            raise ValueError(ONE_SIDED)
        made = Cut(area=shape.area, i1=shape.i1, i2=shape.i2, i12=shape.i12, j=shape.j, nsm=nsm, n1=n1, n2=n2)
        cuts.append((at, made))
    return Stations(tuple(cuts), *(0.0 if k == float("inf") else k for k in (shape.k1, shape.k2)))


def _of_texts(texts: Sequence[str | None], place: int) -> list[float | None]:
    values = [real(text) if text else None for text in texts]
    for k, (text, value) in enumerate(zip(texts, values, strict=True)):
        if text and value is None:
            raise FieldError("must be a real number, with a decimal point", place + k)
    return values


def _reals(rows: list[list[str]], row: int, start: int) -> list[float | None]:
    """Numbers of a line after the first eight fields of the card; blanks where it ends before."""
    if row >= len(rows):
        return [None] * (ROW - start)
    return _of_texts(rows[row][start:], ROW * (row + 1) + start)


def _add(
    found: dict[float, list[float | None]], at: float | None, values: list[float | None], place: int
) -> None:
    at = 1.0 if at is None else at
    if not 0.0 < at <= 1.0 or at in found:
        raise FieldError("must be > 0 and at most 1, once for each station", place)
    found[at] = values


def _completed(start: list[float], found: dict[float, list[float | None]]) -> list[tuple[float, list[float]]]:
    """Numbers at every station in order, with those that are blank; one alone where all are alike."""
    if found and 1.0 not in found:
        raise ValueError("there is no station at end B, X/XB = 1.0")
    end = [a if b is None else b for a, b in zip(start, found.get(1.0, start), strict=True)]
    stations = {0.0: start}
    for at in sorted(found):
        line = [a + at * (b - a) for a, b in zip(start, end, strict=True)] if at < 1.0 else end
        stations[at] = [y if x is None else x for x, y in zip(found[at], line, strict=True)]
    if all(values == start for values in stations.values()):
        return [(0.0, start)]
    return [*stations.items()]
