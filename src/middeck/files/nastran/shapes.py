"""Cross-sections by their shapes (PBARL, PBEAML): area, second moments, torsion constant, shear factors.

I1 is for bending in plane 1 (own x-y), I2 in plane 2. Torsion constants are those of the reference guides:
polar for round sections, Roark's for a solid rectangle, Bredt's for a box, a sum over thin walls for an I.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

PI = float(np.pi)


class SectionShape(NamedTuple):
    """Area, second moments, torsion constant; shear factors K of the area, infinite if rigid in shear."""

    area: float
    i1: float
    i2: float
    j: float
    k1: float = np.inf
    k2: float = np.inf


def _need(walls: bool) -> None:
    if not walls:
        raise ValueError("walls thicker than the section")


def _rod(r: float) -> SectionShape:
    i = PI * r**4 / 4.0
    return SectionShape(PI * r * r, i, i, 2.0 * i, 0.9, 0.9)


def _tube(outer: float, inner: float) -> SectionShape:
    _need(outer > inner >= 0.0)
    i = PI * (outer**4 - inner**4) / 4.0
    return SectionShape(PI * (outer**2 - inner**2), i, i, 2.0 * i, 0.5, 0.5)


def _tube2(outer: float, thickness: float) -> SectionShape:
    return _tube(outer, outer - thickness)


def _bar(width: float, height: float) -> SectionShape:
    long, short = max(width, height), min(width, height)
    ratio = short / long
    j = long * short**3 * (1.0 / 3.0 - 0.21 * ratio * (1.0 - ratio**4 / 12.0))
    i1, i2 = width * height**3 / 12.0, height * width**3 / 12.0
    return SectionShape(width * height, i1, i2, j, 5.0 / 6.0, 5.0 / 6.0)


def _box(width: float, height: float, t_flange: float, t_web: float) -> SectionShape:
    w, h = width - 2.0 * t_web, height - 2.0 * t_flange
    _need(w > 0.0 and h > 0.0)
    around = (width - t_web) / t_flange + (height - t_flange) / t_web
    return SectionShape(
        width * height - w * h,
        (width * height**3 - w * h**3) / 12.0,
        (height * width**3 - h * w**3) / 12.0,
        2.0 * ((width - t_web) * (height - t_flange)) ** 2 / around,
    )


def _i(height: float, lower: float, upper: float, web: float, t_lower: float, t_upper: float) -> SectionShape:
    if lower != upper or t_lower != t_upper:
        raise ValueError("an I whose flanges differ: its shear centre is not its centroid")
    inside = height - 2.0 * t_lower
    _need(inside > 0.0 and lower > web)
    return SectionShape(
        2.0 * lower * t_lower + inside * web,
        (lower * height**3 - (lower - web) * inside**3) / 12.0,
        (2.0 * t_lower * lower**3 + inside * web**3) / 12.0,
        (2.0 * lower * t_lower**3 + (height - t_lower) * web**3) / 3.0,
    )


def _i1(flange: float, web: float, inside: float, height: float) -> SectionShape:
    _need(height > inside)
    t, width = (height - inside) / 2.0, flange + web
    return _i(height, width, width, web, t, t)


SHAPES: dict[str, tuple[int, Callable[..., SectionShape]]] = {
    "ROD": (1, _rod),
    "TUBE": (2, _tube),
    "TUBE2": (2, _tube2),
    "BAR": (2, _bar),
    "BOX": (4, _box),
    "I": (6, _i),
    "I1": (4, _i1),
}


def section_shape(name: str, dims: list[float]) -> SectionShape:
    """The constants of shape ``name``; raises `ValueError` in words for dimensions that close over nothing.

    >>> shape = section_shape("BAR", [2.0, 3.0])
    >>> shape.area, shape.i1
    (6.0, 4.5)
    """
    count, make = SHAPES[name]
    if len(dims) != count:
        raise ValueError(f"{name} has {count} dimensions, here are {len(dims)}")
    solid = name == "TUBE" and dims[1] == 0.0
    if any(not d > 0.0 for d in (dims[:1] if solid else dims)):
        raise ValueError("a dimension that is not > 0")
    return make(*dims)
