"""Cross-sections by their shapes (PBARL, PBEAML): area, second moments, torsion constant, shear factors.

I1 is for bending in plane 1 (own x-y), I2 in plane 2. Torsion constants are those of the reference guides:
polar for round sections, Roark's for a solid rectangle, Bredt's for a box, a sum over thin walls for open
sections; for HEXA, of which they say nothing, the exact one.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from middeck.structure.model.section_torsion import Wall, torsion_of_polygon, twist_walls
from middeck.values import record

PI = float(np.pi)
ROUNDING = 1e-12  # rounding of a product moment over the second moments, of a place over the sizes


@record(kw_only=True)
class SectionShape:
    """Area, second moments, torsion constant; shear factors K of the area, infinite if rigid in shear.

    ``centroid``: where it is (y, z) from the shear centre of thin walls. A CBAR takes both to be one, a CBEAM
    does not.
    """

    area: float
    i1: float
    i2: float
    j: float
    k1: float = np.inf
    k2: float = np.inf
    centroid: tuple[float, float] = (0.0, 0.0)
    i12: float = 0.0


def _need(walls: bool) -> None:
    if not walls:
        raise ValueError("walls thicker than the section")


def _rod(r: float) -> SectionShape:
    i = PI * r**4 / 4.0
    return SectionShape(area=PI * r * r, i1=i, i2=i, j=2.0 * i, k1=0.9, k2=0.9)


def _tube(outer: float, inner: float) -> SectionShape:
    _need(outer > inner >= 0.0)
    i = PI * (outer**4 - inner**4) / 4.0
    return SectionShape(area=PI * (outer**2 - inner**2), i1=i, i2=i, j=2.0 * i, k1=0.5, k2=0.5)


def _tube2(outer: float, thickness: float) -> SectionShape:
    return _tube(outer, outer - thickness)


def _bar(width: float, height: float) -> SectionShape:
    long, short = max(width, height), min(width, height)
    ratio = short / long
    j = long * short**3 * (1.0 / 3.0 - 0.21 * ratio * (1.0 - ratio**4 / 12.0))
    i1, i2 = width * height**3 / 12.0, height * width**3 / 12.0
    return SectionShape(area=width * height, i1=i1, i2=i2, j=j, k1=5.0 / 6.0, k2=5.0 / 6.0)


def _box(width: float, height: float, t_flange: float, t_web: float) -> SectionShape:
    w, h = width - 2.0 * t_web, height - 2.0 * t_flange
    _need(w > 0.0 and h > 0.0)
    around = (width - t_web) / t_flange + (height - t_flange) / t_web
    return SectionShape(
        area=width * height - w * h,
        i1=(width * height**3 - w * h**3) / 12.0,
        i2=(height * width**3 - h * w**3) / 12.0,
        j=2.0 * ((width - t_web) * (height - t_flange)) ** 2 / around,
    )


def _walls(*walls: tuple[float, float, float, float], shear_centre: tuple[float, float]) -> SectionShape:
    """An open section of thin rectangles: y and z of the middle, sizes along y and z.

    Walls do not overlap; the torsion constant counts each up to the middle of the one that it meets.
    """
    y, z, h, w = np.array(walls).T
    _need(bool(np.all(h > 0.0) and np.all(w > 0.0)))
    area = h * w
    centre = np.array([area @ y, area @ z]) / area.sum()
    y, z = y - centre[0], z - centre[1]
    i1, i2 = float(np.sum(area * (y**2 + h**2 / 12.0))), float(np.sum(area * (z**2 + w**2 / 12.0)))
    i12 = float(np.sum(area * y * z))
    return SectionShape(
        area=float(area.sum()),
        i1=i1,
        i2=i2,
        j=float(np.sum(np.maximum(h, w) * np.minimum(h, w) ** 3) / 3.0),
        centroid=(_off(centre[0] - shear_centre[0], h.sum()), _off(centre[1] - shear_centre[1], w.sum())),
        i12=_off(i12, i1 + i2),
    )


def _off(value: float, size: float) -> float:
    """Zero for what is rounding of ``size``."""
    return float(value) if abs(value) > ROUNDING * size else 0.0


def _joined(
    walls: Sequence[tuple[float, float, float, float]],
    points: Sequence[tuple[float, float]],
    lines: Sequence[Wall],
) -> SectionShape:
    """Rectangles, see `_walls`, whose middle lines are ``lines`` between ``points``."""
    centre, cells, open_walls = twist_walls(points, lines)
    made = _walls(*walls, shear_centre=(float(centre[0]), float(centre[1])))
    return dataclasses.replace(made, j=cells + open_walls)


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
    return dataclasses.replace(made, j=made.j + 0.5 * (t_lower + t_upper) * web**3 / 3.0)


def _i1(flange: float, web: float, inside: float, height: float) -> SectionShape:
    _need(height > inside)
    t, width = (height - inside) / 2.0, flange + web
    return _i(height, width, width, web, t, t)


def _t2(width: float, height: float, t_flange: float, t_web: float) -> SectionShape:
    """A T on its head; its shear centre is where the walls meet."""
    stem = height - t_flange
    _need(stem > 0.0)
    made = _walls((0.0, 0.0, t_flange, width), (0.5 * height, 0.0, stem, t_web), shear_centre=(0.0, 0.0))
    return dataclasses.replace(made, j=made.j + 0.5 * t_flange * t_web**3 / 3.0)


def _t(width: float, height: float, t_flange: float, t_web: float) -> SectionShape:
    made = _t2(width, height, t_flange, t_web)
    y, z = made.centroid
    return dataclasses.replace(made, centroid=(-y, z))


def _quarter_turn(shape: SectionShape, sign: float) -> SectionShape:
    """The shape with its y and z exchanged, the centroid to the side of ``sign``."""
    y, z = shape.centroid
    return dataclasses.replace(shape, i1=shape.i2, i2=shape.i1, centroid=(sign * z, sign * y))


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
    return dataclasses.replace(made, j=made.j + (t_flange * t_web**3 - t_web * t_flange**3) / 3.0)


def _channel1(flange: float, t_web: float, inside: float, height: float) -> SectionShape:
    return _channel(flange + t_web, height, t_web, (height - inside) / 2.0)


def _channel2(t_leg: float, t_base: float, height: float, width: float) -> SectionShape:
    """Its legs stand on a base: a channel turned by a right angle."""
    return _quarter_turn(_channel(height, width, t_base, t_leg), 1.0)


def _box1(width: float, height: float, top: float, bottom: float, right: float, left: float) -> SectionShape:
    """Its right wall is the one at +z."""
    w, h = width - left - right, height - top - bottom
    _need(w > 0.0 and h > 0.0)
    across, along = width - 0.5 * (left + right), height - 0.5 * (top + bottom)
    corners = ((0.0, 0.0), (0.0, across), (along, across), (along, 0.0))  # from the lower one at -z
    y, z = twist_walls(corners, ((0, 1, bottom), (1, 2, right), (2, 3, top), (3, 0, left)))[0]
    made = _walls(
        (0.5 * (height - top), 0.0, top, width),
        (-0.5 * (height - bottom), 0.0, bottom, width),
        (0.5 * (bottom - top), 0.5 * (left - width), h, left),
        (0.5 * (bottom - top), 0.5 * (width - right), h, right),
        shear_centre=(0.5 * (bottom - height) + float(y), 0.5 * (left - width) + float(z)),
    )
    around = across * (1.0 / top + 1.0 / bottom) + along * (1.0 / left + 1.0 / right)
    return dataclasses.replace(made, j=4.0 * (across * along) ** 2 / around)


def _l(width: float, height: float, t_base: float, t_web: float) -> SectionShape:
    """A base from its corner towards +z, a web up from there."""
    _need(height > t_base and width > t_web)
    corner = (0.5 * t_base, 0.5 * t_web)
    return _joined(
        (
            (0.5 * t_base, 0.5 * width, t_base, width),
            (0.5 * (height + t_base), 0.5 * t_web, height - t_base, t_web),
        ),
        ((0.5 * t_base, width), corner, (height, 0.5 * t_web)),
        ((0, 1, t_base), (1, 2, t_web)),
    )


def _z(flange: float, t_web: float, inside: float, height: float) -> SectionShape:
    """The upper flange goes from the web towards -z, the lower one towards +z."""
    t = 0.5 * (height - inside)
    _need(t > 0.0)
    y, z = 0.5 * (inside + t), 0.5 * t_web + flange
    return _joined(
        (
            (y, -0.5 * flange, t, t_web + flange),
            (0.0, 0.0, inside, t_web),
            (-y, 0.5 * flange, t, t_web + flange),
        ),
        ((y, -z), (y, 0.0), (-y, 0.0), (-y, z)),
        ((0, 1, t), (1, 2, t_web), (2, 3, t)),
    )


def _hat(height: float, t: float, top: float, brim: float) -> SectionShape:
    """Open below; a brim stands out ``brim`` from each web."""
    y, z, web = height - t, 0.5 * (top - t), height - 2.0 * t
    _need(web > 0.0 and top > 2.0 * t)
    feet = brim + t
    return _joined(
        (
            (y, 0.0, t, top),
            *((0.5 * y, side * z, web, t) for side in (1.0, -1.0)),
            *((0.0, side * (z + 0.5 * brim), t, feet) for side in (1.0, -1.0)),
        ),
        ((0.0, -z - 0.5 * t - brim), (0.0, -z), (y, -z), (y, z), (0.0, z), (0.0, z + 0.5 * t + brim)),
        tuple((k, k + 1, t) for k in range(5)),
    )


def _hat1(width: float, height: float, top: float, t: float, plate: float) -> SectionShape:
    """A HAT closed below by a plate as wide as its brims, which are doubled there."""
    z, web, brim = 0.5 * (top - t), height - t - plate, 0.5 * (width - top)
    _need(web > 0.0 and top > 2.0 * t and brim > 0.0)
    low, high, end = 0.5 * plate, height - 0.5 * t, 0.5 * width
    return _joined(
        (
            (low, 0.0, plate, width),
            (high, 0.0, t, top),
            *((plate + 0.5 * web, side * z, web, t) for side in (1.0, -1.0)),
            *((plate + 0.5 * t, side * 0.5 * (top + brim), t, brim) for side in (1.0, -1.0)),
        ),
        ((low, -end), (low, -z), (high, -z), (high, z), (low, z), (low, end)),
        ((0, 1, plate + t), (1, 2, t), (2, 3, t), (3, 4, t), (4, 5, plate + t), (1, 4, plate)),
    )


def _dbox(width: float, height: float, middle: float, *t: float) -> SectionShape:
    """Two cells; ``middle`` is where the wall between them is, from the left.

    ``t`` are the left wall, that between and the right one, then above and below of the left and right cell.
    """
    left, between, right, *covers = t
    inside = middle - left - 0.5 * between, width - middle - right - 0.5 * between
    _need(min(inside) > 0.0 and min(height - covers[0] - covers[1], height - covers[2] - covers[3]) > 0.0)
    at = 0.5 * left, middle, width - 0.5 * right
    centres = left + 0.5 * inside[0], width - right - 0.5 * inside[1]
    high = [height - 0.5 * x for x in (covers[0], 0.5 * (covers[0] + covers[2]), covers[2])]
    low = [0.5 * x for x in (covers[1], 0.5 * (covers[1] + covers[3]), covers[3])]
    points = (*zip(low, at, strict=True), *zip(high, at, strict=True))
    lines = ((0, 3, left), (1, 4, between), (2, 5, right), (3, 4, covers[0]), (0, 1, covers[1]))
    lines += ((4, 5, covers[2]), (1, 2, covers[3]))
    centre, cells, _ = twist_walls(points, lines)
    upright = tuple((0.5 * height, z, height, x) for z, x in zip(at, (left, between, right), strict=True))
    over = tuple(
        (0.5 * x if below else height - 0.5 * x, centres[cell], x, inside[cell])
        for (cell, below), x in zip(((0, 0), (0, 1), (1, 0), (1, 1)), covers, strict=True)
    )
    walls = _walls(*upright, *over, shear_centre=(float(centre[0]), float(centre[1])))
    return dataclasses.replace(walls, j=cells)


def _hexa(corner: float, width: float, height: float) -> SectionShape:
    """A solid with points at -z and +z, each as long as ``corner``."""
    flat = width - 2.0 * corner
    _need(flat > 0.0)
    outline = (
        complex(0.5 * width, 0.0),
        complex(0.5 * flat, 0.5 * height),
        complex(-0.5 * flat, 0.5 * height),
        complex(-0.5 * width, 0.0),
        complex(-0.5 * flat, -0.5 * height),
        complex(0.5 * flat, -0.5 * height),
    )
    i1 = height**3 * (flat / 12.0 + corner / 24.0)
    i2 = height * (flat**3 / 12.0 + corner * (0.5 * flat + corner / 3.0) ** 2 + corner**3 / 18.0)
    return SectionShape(area=height * (flat + corner), i1=i1, i2=i2, j=torsion_of_polygon(outline))


def _cross(wings: float, t_vertical: float, height: float, t_wings: float) -> SectionShape:
    """``wings`` is the length of both together."""
    middle = 0.5 * t_vertical + 0.25 * wings
    made = _walls(
        (0.0, 0.0, height, t_vertical),
        (0.0, middle, t_wings, 0.5 * wings),
        (0.0, -middle, t_wings, 0.5 * wings),
        shear_centre=(0.0, 0.0),
    )
    return dataclasses.replace(made, j=(height * t_vertical**3 + (wings + t_vertical) * t_wings**3) / 3.0)


def _h(inside: float, legs: float, height: float, t_web: float) -> SectionShape:
    """``legs`` is the thickness of both together."""
    arm, leg = 0.5 * (inside + 0.5 * legs), 0.5 * legs
    walls = ((0.0, 0.0, t_web, inside), (0.0, arm, height, leg), (0.0, -arm, height, leg))
    made = _walls(*walls, shear_centre=(0.0, 0.0))
    return dataclasses.replace(made, j=made.j + leg * t_web**3 / 3.0)


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
    "L": (4, _l),
    "Z": (4, _z),
    "HAT": (4, _hat),
    "HAT1": (5, _hat1),
    "DBOX": (10, _dbox),
    "HEXA": (3, _hexa),
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
