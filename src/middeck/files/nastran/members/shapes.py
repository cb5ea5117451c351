"""Cross-sections by their shapes (PBARL, PBEAML): area, second moments, torsion constant, shear factors.

I1 is for bending in plane 1 (own x-y), I2 in plane 2. Torsion constants are those of the reference guides:
polar for round sections, Roark's for a solid rectangle, Bredt's for a box, a sum over thin walls for open
sections.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

PI = float(np.pi)


class SectionShape(NamedTuple):
    """Area, second moments, torsion constant; shear factors K of the area, infinite if rigid in shear.

    ``centroid``: where it is (y, z) from the shear centre of thin walls; None if that is not known. A CBAR
    takes both to be one, a CBEAM does not.
    """

    area: float
    i1: float
    i2: float
    j: float
    k1: float = np.inf
    k2: float = np.inf
    centroid: tuple[float, float] | None = (0.0, 0.0)


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


def _walls(
    *walls: tuple[float, float, float, float], shear_centre: tuple[float, float] | None = None
) -> SectionShape:
    """An open section of thin rectangles: y and z of the middle, sizes along y and z; no product moment.

    Walls do not overlap; the torsion constant counts each up to the middle of the one that it meets.
    """
    y, z, h, w = np.array(walls).T
    _need(bool(np.all(h > 0.0) and np.all(w > 0.0)))
    area = h * w
    centre = area @ y / area.sum(), area @ z / area.sum()
    y, z = y - centre[0], z - centre[1]
    return SectionShape(
        float(area.sum()),
        float(np.sum(area * (y**2 + h**2 / 12.0))),
        float(np.sum(area * (z**2 + w**2 / 12.0))),
        float(np.sum(np.maximum(h, w) * np.minimum(h, w) ** 3) / 3.0),
        centroid=shear_centre and (float(centre[0] - shear_centre[0]), float(centre[1] - shear_centre[1])),
    )


def _i(height: float, lower: float, upper: float, web: float, t_lower: float, t_upper: float) -> SectionShape:
    inside = height - t_lower - t_upper
    _need(inside > 0.0 and min(lower, upper) > web)
    low, high = 0.5 * t_lower, height - 0.5 * t_upper
    # The flanges share a shear force across the web by their second moments.
    share = t_upper * upper**3 / (t_upper * upper**3 + t_lower * lower**3)
    made = _walls(
        (low, 0.0, t_lower, lower),
        (t_lower + 0.5 * inside, 0.0, inside, web),
        (high, 0.0, t_upper, upper),
        shear_centre=(low + share * (high - low), 0.0),
    )
    return made._replace(j=made.j + 0.5 * (t_lower + t_upper) * web**3 / 3.0)


def _i1(flange: float, web: float, inside: float, height: float) -> SectionShape:
    _need(height > inside)
    t, width = (height - inside) / 2.0, flange + web
    return _i(height, width, width, web, t, t)


def _t2(width: float, height: float, t_flange: float, t_web: float) -> SectionShape:
    """A T on its head; its shear centre is where the walls meet."""
    stem = height - t_flange
    _need(stem > 0.0)
    made = _walls((0.0, 0.0, t_flange, width), (0.5 * height, 0.0, stem, t_web), shear_centre=(0.0, 0.0))
    return made._replace(j=made.j + 0.5 * t_flange * t_web**3 / 3.0)


def _t(width: float, height: float, t_flange: float, t_web: float) -> SectionShape:
    made = _t2(width, height, t_flange, t_web)
    y, z = made.centroid or (0.0, 0.0)
    return made._replace(centroid=(-y, z))


def _quarter_turn(shape: SectionShape, sign: float) -> SectionShape:
    """The shape with its y and z exchanged, the centroid to the side of ``sign``."""
    y, z = shape.centroid or (0.0, 0.0)
    return shape._replace(i1=shape.i2, i2=shape.i1, centroid=(sign * z, sign * y))


def _t1(flange: float, web: float, t_flange: float, t_web: float) -> SectionShape:
    """A T that lies: ``web`` beside the flange, towards -z."""
    return _quarter_turn(_t2(flange, web + t_flange, t_flange, t_web), -1.0)


def _channel(width: float, height: float, t_web: float, t_flange: float) -> SectionShape:
    """Its web towards -z, and beyond that its shear centre (Timoshenko 1945)."""
    inside = height - 2.0 * t_flange
    _need(inside > 0.0 and width > t_web)
    leg, between, web = width - 0.5 * t_web, height - t_flange, 0.5 * (t_web - width)
    behind = 3.0 * leg**2 * t_flange / (6.0 * leg * t_flange + between * t_web)
    made = _walls(
        (0.5 * between, 0.0, t_flange, width),
        (-0.5 * between, 0.0, t_flange, width),
        (0.0, web, inside, t_web),
        shear_centre=(0.0, web - behind),
    )
    return made._replace(j=made.j + (t_flange * t_web**3 - t_web * t_flange**3) / 3.0)


def _channel1(flange: float, t_web: float, inside: float, height: float) -> SectionShape:
    return _channel(flange + t_web, height, t_web, (height - inside) / 2.0)


def _channel2(t_leg: float, t_base: float, height: float, width: float) -> SectionShape:
    """Its legs stand on a base: a channel turned by a right angle."""
    return _quarter_turn(_channel(height, width, t_base, t_leg), 1.0)


def _box1(width: float, height: float, top: float, bottom: float, left: float, right: float) -> SectionShape:
    w, h = width - left - right, height - top - bottom
    _need(w > 0.0 and h > 0.0)
    made = _walls(
        (0.5 * (height - top), 0.0, top, width),
        (-0.5 * (height - bottom), 0.0, bottom, width),
        (0.5 * (bottom - top), 0.5 * (left - width), h, left),
        (0.5 * (bottom - top), 0.5 * (width - right), h, right),
        shear_centre=(0.0, 0.0) if top == bottom and left == right else None,
    )
    product = 0.5 * w * h * (top - bottom) * (left - right)
    if abs(product) > 0.0:
        raise ValueError("a box whose walls differ both ways: it has a product moment, give a PBAR")
    across, along = width - 0.5 * (left + right), height - 0.5 * (top + bottom)
    around = across * (1.0 / top + 1.0 / bottom) + along * (1.0 / left + 1.0 / right)
    return made._replace(j=4.0 * (across * along) ** 2 / around)


def _cross(wings: float, t_vertical: float, height: float, t_wings: float) -> SectionShape:
    """``wings`` is the length of both together."""
    middle = 0.5 * t_vertical + 0.25 * wings
    made = _walls(
        (0.0, 0.0, height, t_vertical),
        (0.0, middle, t_wings, 0.5 * wings),
        (0.0, -middle, t_wings, 0.5 * wings),
        shear_centre=(0.0, 0.0),
    )
    return made._replace(j=(height * t_vertical**3 + (wings + t_vertical) * t_wings**3) / 3.0)


def _h(inside: float, legs: float, height: float, t_web: float) -> SectionShape:
    """``legs`` is the thickness of both together."""
    arm, leg = 0.5 * (inside + 0.5 * legs), 0.5 * legs
    walls = ((0.0, 0.0, t_web, inside), (0.0, arm, height, leg), (0.0, -arm, height, leg))
    made = _walls(*walls, shear_centre=(0.0, 0.0))
    return made._replace(j=made.j + leg * t_web**3 / 3.0)


SHAPES: dict[str, tuple[int, Callable[..., SectionShape]]] = {
    "ROD": (1, _rod),
    "TUBE": (2, _tube),
    "TUBE2": (2, _tube2),
    "BAR": (2, _bar),
    "BOX": (4, _box),
    "I": (6, _i),
    "I1": (4, _i1),
    "T": (4, _t),
    "T1": (4, _t1),
    "T2": (4, _t2),
    "CHAN": (4, _channel),
    "CHAN1": (4, _channel1),
    "CHAN2": (4, _channel2),
    "BOX1": (6, _box1),
    "CROSS": (4, _cross),
    "H": (4, _h),
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
