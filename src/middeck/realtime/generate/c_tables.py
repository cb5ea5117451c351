"""Constant tables of the generated C: every number in hexadecimal, so that none is rounded on the way."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from middeck.realtime.package.package import ControllerPackage, TestVectors, largest

WIDTH = 110


def literal(value: float, single: bool = False) -> str:
    """A C99 constant of exactly this value; the largest number for inf.

    >>> literal(0.1), literal(-0.5, single=True), literal(float("inf"), single=True)
    ('0x1.999999999999ap-4', '-0x1.0000000000000p-1f', '0x1.fffffe0000000p+127f')
    """
    return float(np.clip(value, -largest(single), largest(single))).hex() + ("f" if single else "")


def law_tables(package: ControllerPackage) -> Iterator[str]:
    """All tables of the law that are not empty; matrices stand column by column."""
    core, single = package.core, package.single
    if core.pairs is None:
        dynamics = {"A": core.A}
    else:
        first = np.arange(core.pairs)
        dynamics = {
            "diagonal": np.diag(core.A),
            "upper": core.A[first, first + core.pairs],
            "lower": core.A[first + core.pairs, first],
        }
    applied = {"E": core.E} if core.drives else {}
    places = [(f.input, 0) for f in package.filters] + [(p.input, p.output) for p in package.paths]
    sections = [place.section for place in (*package.filters, *package.paths)]
    numbers = {
        **dynamics, "B": core.B, "C": core.C, "D": core.D, **applied,
        "sections": np.array([number for s in sections for number in (*s.b, *s.a)]),
        "reach": package.input_range, "least": package.lower, "most": package.upper, "slew": package.slew,
    }  # fmt: skip
    for name, values in numbers.items():
        if values.size:
            yield _table(name, [literal(v, single) for v in np.ravel(values, order="F").tolist()])
    if places:
        rows = ", ".join(f"{{{i}, {o}}}" for i, o in places)
        yield f"static const int place[{len(places)}][2] = {{{rows}}}; /* input, output */"


def vector_tables(vectors: TestVectors, single: bool) -> Iterator[str]:
    """Inputs, engagement and outputs of the test vectors, sample by sample."""
    engaged = ", ".join(str(int(e)) for e in vectors.engaged.tolist())
    yield f"static const int test_engaged[SAMPLES] = {{{engaged}}};"
    for name, rows in (("test_y", vectors.y), ("test_u", vectors.u)):
        yield _table(name, [literal(v, single) for v in rows.ravel().tolist()])


def _table(name: str, words: list[str]) -> str:
    lines, line = [], "   "
    for word in words:
        if len(line) + len(word) + 2 > WIDTH:
            lines.append(line)
            line = "   "
        line += f" {word},"
    body = "\n".join([*lines, line]).rstrip(",")
    return f"static const real {name}[{len(words)}] = {{\n{body}\n}};"
