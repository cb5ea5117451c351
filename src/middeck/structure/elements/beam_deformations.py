"""Deformations of a beam element from its two end poses: eight invariants, and all derivatives.

The end poses are positions x1, x2 and triads T1 = (t1, t2, t3), T2 = (q1, q2, q3) whose first vectors are the
section normals. With the chord e = (x2 - x1)/l the invariants are l, the direction cosines a = T1' e and
b = T2' e, and the twist

    phi = atan2(q2.t3 - q3.t2, q2.t2 + q3.t3),

the twist part of the swing-twist decomposition of T1' T2. The bending rotation of an end against the chord
is the shortest rotation, angle/sin(angle) times (a3, -a2), exact in the plane for any size; both ends are
referred to the triad half-way along the twist. After Crisfield 1990 (CMAME 81) and Battini and Pacoste 2002
(CMAME 191), with invariants in place of an element triad.

The stretch is that of the centre line, chord and bow together: l - L + L/2 (mean of the slope squared); the
slope being the cubic's, an axial force has its consistent geometric stiffness (Przemieniecki 1968, 15.2;
`beam_geometric_stiffness`).

The chart of an end pose is (dx, theta) with T_new = exp(theta) T; arrays hold one element per row. All of it
is analytic: complex poses or lengths give derivatives by complex step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np
from jaxtyping import Inexact

from middeck.structure.elements.rotations import cross

Array = np.ndarray
# Rows of the invariants and of the deformations.
LENGTH, A, B, TWIST = 0, slice(1, 4), slice(4, 7), 7
STRETCH, Y1, Z1, Y2, Z2, PHI = range(6)
BENDING = slice(1, 5)
ONE, TWO = slice(3, 6), slice(9, 12)


@dataclass(frozen=True, kw_only=True, eq=False)
class Invariants:
    """Eight invariants of the end poses (l, a, b, twist), their slopes, and what second derivatives need."""

    value: Array  # (element, 8)
    slope: Array  # (element, 8, 12)
    T: Array
    chord: Array  # unit vector
    span: Array
    sine: Dots
    cosine: Dots


class Dots(NamedTuple):
    """A sum of products u . v with u fixed to end 2 and v to end 1: W = sum u v', its trace, its slope."""

    W: Array
    value: Array
    slope: Array


class EndStrain(NamedTuple):
    """Difference of the end poses of elements from undeformed ones, in the axes of the first end's triad.

    ``shift`` is the chord less the undeformed one, ``turn`` the second triad less the identity.
    """

    shift: Array  # (element, 3)
    turn: Array  # (element, 3, 3)


def end_strain(
    length: Array, triad: Array, shift: Inexact[np.ndarray, "element 2 3"], turn: Array
) -> EndStrain:
    """End strain from undeformed triads and the ends' shift and turn since then, in any frame.

    With T1 = (1 + E1) T and the chord L e + d they are T'(E1' L e + (1 + E1)'d) and T1'(E2 - E1) T.
    """
    E, d = turn[:, 0], shift[:, 1] - shift[:, 0]
    drawn = length[:, None] * triad[:, :, 0]
    moved = np.matvec(E.mT, drawn + d) + d
    first = triad + E @ triad
    return EndStrain(np.matvec(triad.mT, moved), first.mT @ ((turn[:, 1] - E) @ triad))


@dataclass(frozen=True, kw_only=True, eq=False)
class Deformation:
    """Deformations (stretch, y1, z1, y2, z2, twist) of each element and what their derivatives need.

    ``slope`` is (element, 6, 12) in the pose coordinates; `geometric_stiffness` takes the rest.
    """

    value: Array
    slope: Array
    invariants: Invariants
    first: Array  # (element, 6, 8) in the invariants
    second: Array  # (element, 6, 8, 8)


def deform(
    length: Inexact[np.ndarray, " element"],
    bow: Inexact[np.ndarray, "element 4 4"],
    x: Inexact[np.ndarray, "element 2 3"],
    T: Inexact[np.ndarray, "element 2 3 3"],
    strain: EndStrain | None = None,
) -> Deformation:
    """Deformations of elements of undeformed ``length`` and mean squared slope ``bow`` (see `element_forms`).

    Where the ``strain`` of the ends is known they have all its digits.
    """
    s = _invariants(x, T)
    stretch = s.value[:, LENGTH] - length if strain is None else _refine(s, length, strain)
    m, dm, ddm = _bending_and_twist(s.value, np.result_type(s.value, length, bow))
    m[:, STRETCH] = stretch
    dm[:, STRETCH, LENGTH] = 1.0
    theta, dtheta, ddtheta = m[:, BENDING], dm[:, BENDING], ddm[:, BENDING]
    curve = length[:, None, None] * bow
    pull = np.matvec(curve, theta)
    m[:, STRETCH] += 0.5 * _dot(pull, theta)
    dm[:, STRETCH] += (pull[:, None] @ dtheta)[:, 0]
    ddm[:, STRETCH] += dtheta.mT @ curve @ dtheta + np.einsum("ek,ekij->eij", pull, ddtheta)
    return Deformation(value=m, slope=dm @ s.slope, invariants=s, first=dm, second=ddm)


def _refine(s: Invariants, length: Array, strain: EndStrain) -> Array:
    """The stretch of the chord; small invariants of ``s`` take the digits that ``strain`` has of them."""
    w, M, span = strain.shift, strain.turn, s.value[:, LENGTH]
    s.value[:, [2, 3]] = w[:, 1:] / span[:, None]
    across = w[:, 1:] + length[:, None] * M[:, 0, 1:] + (M.mT @ w[:, :, None])[:, 1:, 0]
    s.value[:, [5, 6]] = across / span[:, None]
    s.value[:, TWIST] = arctan2(M[:, 2, 1] - M[:, 1, 2], s.cosine.value)
    return (2.0 * length * w[:, 0] + _dot(w, w)) / (span + length)


def chord(x: Inexact[np.ndarray, "element 2 3"]) -> tuple[Array, Array]:
    """Unit vector from end 1 to end 2, and their distance."""
    along = x[:, 1] - x[:, 0]
    span = np.sqrt(_dot(along, along))
    return along / span[:, None], span


def _invariants(x: Array, T: Array) -> Invariants:
    e, span = chord(x)
    dtype = np.result_type(x, T)
    s, ds = np.zeros((len(x), 8), dtype), np.zeros((len(x), 8, 12), dtype)
    s[:, LENGTH] = span
    ds[:, LENGTH, 0:3], ds[:, LENGTH, 6:9] = -e, e
    for end, rows, rotation in ((0, A, ONE), (1, B, TWO)):
        t = T[:, end].mT  # rows are the triad's vectors
        s[:, rows] = np.matvec(t, e)
        Pt = (t - s[:, rows, None] * e[:, None, :]) / span[:, None, None]
        ds[:, rows, 0:3], ds[:, rows, 6:9] = -Pt, Pt
        ds[:, rows, rotation] = cross(t, e[:, None, :])
    t2, t3, q2, q3 = T[:, 0, :, 1], T[:, 0, :, 2], T[:, 1, :, 1], T[:, 1, :, 2]
    sine, cosine = _dots((q2, t3, 1.0), (q3, t2, -1.0)), _dots((q2, t2, 1.0), (q3, t3, 1.0))
    s[:, TWIST] = arctan2(sine.value, cosine.value)
    r2 = sine.value**2 + cosine.value**2
    ds[:, TWIST] = (cosine.value / r2)[:, None] * sine.slope - (sine.value / r2)[:, None] * cosine.slope
    return Invariants(value=s, slope=ds, T=T, chord=e, span=span, sine=sine, cosine=cosine)


def _dots(*terms: tuple[Array, Array, float]) -> Dots:
    W = reduce(np.add, (sign * (u[:, :, None] * v[:, None, :]) for u, v, sign in terms))
    moment = reduce(np.add, (sign * cross(u, v) for u, v, sign in terms))
    slope = np.zeros((len(W), 12), dtype=W.dtype)
    slope[:, TWO], slope[:, ONE] = moment, -moment
    return Dots(W, np.trace(W, axis1=1, axis2=2), slope)


def _bending_and_twist(s: Array, dtype: np.dtype) -> tuple[Array, Array, Array]:
    """Deformations but the stretch (element, 6), with first and second derivatives in the invariants."""
    n = len(s)
    m, dm, ddm = np.zeros((n, 6), dtype), np.zeros((n, 6, 8), dtype), np.zeros((n, 6, 8, 8), dtype)
    m[:, PHI], dm[:, PHI, TWIST] = s[:, TWIST], 1.0
    both = np.moveaxis(_angle_over_sine(s[:, [1, 4]]), -1, 0)
    for first, half, (iy, iz), (f, df, ddf) in ((1, 0.5, (Y1, Z1), both[0]), (4, -0.5, (Y2, Z2), both[1])):
        c2, c3 = s[:, first + 1], s[:, first + 2]
        cos, sin = np.cos(half * s[:, TWIST]), np.sin(half * s[:, TWIST])
        # y = f h with h = cos c3 - sin c2, z = f g with g = -(sin c3 + cos c2); dh/dtwist = half g.
        h, g = cos * c3 - sin * c2, -(sin * c3 + cos * c2)
        for row, value, turned, (d2, d3), (e2, e3) in (
            (iy, h, half * g, (-sin, cos), (-half * cos, -half * sin)),
            (iz, g, -half * h, (-cos, -sin), (half * sin, -half * cos)),
        ):
            m[:, row] = f * value
            dm[:, row, first] = df * value
            dm[:, row, first + 1], dm[:, row, first + 2] = f * d2, f * d3
            dm[:, row, TWIST] = f * turned
            ddm[:, row, first, first] = ddf * value
            ddm[:, row, TWIST, TWIST] = -f * half**2 * value
            for a, b, value_ab in (
                (first, first + 1, df * d2),
                (first, first + 2, df * d3),
                (first, TWIST, df * turned),
                (first + 1, TWIST, f * e2),
                (first + 2, TWIST, f * e3),
            ):
                ddm[:, row, a, b] = ddm[:, row, b, a] = value_ab
    return m, dm, ddm


def _series(count: int) -> Array:
    """Coefficients of acos(c)/sqrt(1 - c^2) in x = 1 - c (term, 3), and of its two derivatives in c."""
    n = np.arange(count + 2.0)
    a = np.cumprod(np.where(n > 0.0, n / (2.0 * n + 1.0), 1.0))
    slope, bend = -n[1:] * a[1:], (n * (n - 1.0) * a)[2:]
    return np.column_stack([a[:count], slope[:count], bend[:count]])


SERIES = _series(24)


def _angle_over_sine(c: Array) -> Array:
    """f = acos(c)/sqrt(1 - c^2) and two derivatives (3, ...), smooth through c = 1.

    (1 - c^2) f' = c f - 1; hence the series in x = 1 - c has a_n = n/(2n + 1) a_(n-1).
    """
    x = 1.0 - c
    near = np.real(x) < 0.2
    found = np.zeros((3, *c.shape), c.dtype)
    xn = x[near]
    total = np.zeros((3, *xn.shape), c.dtype)
    for terms in SERIES[: _terms(xn)][::-1]:
        total = total * xn + terms[:, None]
    found[:, near] = total
    if near.all():
        return found
    f, df, ddf = found
    far = ~near
    cf = c[far]
    q = 1.0 - cf**2
    f[far] = arctan2(np.sqrt(q), cf) / np.sqrt(q)
    df[far] = (cf * f[far] - 1.0) / q
    ddf[far] = (f[far] + 3.0 * cf * df[far]) / q
    return found


def _terms(x: Array) -> int:
    """Terms of the series whose coefficients fall like 2^-n, down to rounding; two for the derivatives."""
    largest = float(np.abs(x).max(initial=0.0))
    return 3 if largest == 0.0 else 4 + int(np.log(np.finfo(float).eps) / np.log(0.5 * largest))


def arctan2(y: Array, x: Array) -> Array:
    """The angle of (x, y), analytic: an imaginary part is taken to first order, as complex step needs."""
    a, b = np.real(y), np.real(x)
    angle = np.arctan2(a, b)
    if not (np.iscomplexobj(y) or np.iscomplexobj(x)):
        return angle
    return angle + 1j * (b * np.imag(y) - a * np.imag(x)) / (a**2 + b**2)


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("ei,ei->e", a, b)
