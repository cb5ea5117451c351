"""Corotational cubic beam elements from one strain energy: forces, tangent and mass.

An element sees its two end poses only: positions x1, x2 and triads T1 = (t1, t2, t3), T2 = (q1, q2, q3)
whose first vectors are the section normals. With the chord e = (x2 - x1)/l the energy depends on eight
invariants: l, the direction cosines a = T1' e and b = T2' e, and the twist

    phi = atan2(q2.t3 - q3.t2, q2.t2 + q3.t3),

the twist part of the swing-twist decomposition of T1' T2. The bending rotation of an end against the chord
is the shortest rotation, angle/sin(angle) times (a3, -a2), exact in the plane for any size; both ends are
referred to the triad half-way along the twist. First and second derivatives of the invariants are exact,
so the tangent is symmetric and contains the whole geometric stiffness. After Crisfield 1990 (CMAME 81) and
Battini and Pacoste 2002 (CMAME 191), with invariants in place of an element triad.

The chart of an end pose is (dx, theta) with T_new = exp(theta) T; arrays hold one element per row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.structure.article import Section
from middeck.structure.rotations import skew, symmetric_double_cross
from middeck.values import record

Array = np.ndarray
# Columns of the invariants and of the deformations.
LENGTH, A, B, TWIST = 0, slice(1, 4), slice(4, 7), 7
STRETCH, Y1, Z1, Y2, Z2, PHI = range(6)


@record
class BeamProperties:
    """Length [m], stiffness and inertia of each element; the fields of `Section`, one row an element."""

    length: Float[np.ndarray, " element"]
    EA: Float[np.ndarray, " element"]
    GJ: Float[np.ndarray, " element"]
    EI_y: Float[np.ndarray, " element"]
    EI_z: Float[np.ndarray, " element"]
    rho_A: Float[np.ndarray, " element"]
    rho_I_y: Float[np.ndarray, " element"]
    rho_I_z: Float[np.ndarray, " element"]
    shear_y: Float[np.ndarray, " element"]  # Phi = 12 EI_z / (GA_y L^2): bending in the own x-y plane
    shear_z: Float[np.ndarray, " element"]


def beam_properties(sections: list[Section], lengths: Float[np.ndarray, " element"]) -> BeamProperties:
    """Gather one section and one length per element."""

    def column(name: str) -> Array:
        return np.array([getattr(s, name) for s in sections], dtype=float)

    lengths = np.asarray(lengths, dtype=float)
    names = ("EA", "GJ", "EI_y", "EI_z", "rho_A", "rho_I_y", "rho_I_z")
    return BeamProperties(
        lengths,
        *(column(n) for n in names),
        shear_y=12.0 * column("EI_z") / (column("GA_y") * lengths**2),
        shear_z=12.0 * column("EI_y") / (column("GA_z") * lengths**2),
    )


class BeamState(NamedTuple):
    """Energy [J], gradient (element, 12) and Hessian (element, 12, 12) in (dx1, theta1, dx2, theta2)."""

    energy: Array
    gradient: Array
    hessian: Array


def beam_state(
    beams: BeamProperties,
    x: Float[np.ndarray, "element 2 3"],
    T: Float[np.ndarray, "element 2 3 3"],
) -> BeamState:
    """Energy, forces and tangent stiffness of every element at the given end poses."""
    s, ds, dds = _invariants(x, T)
    m, dm, ddm = _deformations(s)
    m[:, STRETCH] -= beams.length
    k = beam_stiffness(beams)
    force = np.einsum("eij,ej->ei", k, m)
    energy = 0.5 * np.einsum("ei,ei->e", force, m)
    slope = np.einsum("ei,eij->ej", force, dm)
    curvature = np.einsum("eki,ekl,elj->eij", dm, k, dm) + np.einsum("ek,ekij->eij", force, ddm)
    gradient = np.einsum("ei,eia->ea", slope, ds)
    hessian = np.einsum("eia,eij,ejb->eab", ds, curvature, ds, optimize=True)
    hessian += np.einsum("ei,eiab->eab", slope, dds)
    return BeamState(energy, gradient, hessian)


def beam_deformations(
    x: Float[np.ndarray, "element 2 3"], T: Float[np.ndarray, "element 2 3 3"]
) -> tuple[Float[np.ndarray, "element 6"], Float[np.ndarray, "element 6 12"]]:
    """(length, y1, z1, y2, z2, twist) and their derivative in the twelve pose coordinates."""
    s, ds, _ = _invariants(x, T)
    m, dm, _ = _deformations(s)
    return m, np.einsum("eij,eja->eia", dm, ds)


def beam_stiffness(beams: BeamProperties) -> Float[np.ndarray, "element 6 6"]:
    """Stiffness on (stretch, y1, z1, y2, z2, twist): Przemieniecki 1968, with shear factor Phi."""
    k = np.zeros((len(beams.length), 6, 6))
    k[:, STRETCH, STRETCH] = beams.EA / beams.length
    k[:, PHI, PHI] = beams.GJ / beams.length
    for (i, j), EI, shear in (
        ((Y1, Y2), beams.EI_y, beams.shear_z),
        ((Z1, Z2), beams.EI_z, beams.shear_y),
    ):
        scale = EI / (beams.length * (1.0 + shear))
        k[:, i, i] = k[:, j, j] = scale * (4.0 + shear)
        k[:, i, j] = k[:, j, i] = scale * (2.0 - shear)
    return k


def beam_weight(
    beams: BeamProperties,
    x: Float[np.ndarray, "element 2 3"],
    T: Float[np.ndarray, "element 2 3 3"],
    gravity: Float[np.ndarray, "3"],
) -> BeamState:
    """Potential of the distributed weight on the cubic centre line, with its consistent end moments.

    The Hermite curve through both ends has the mean (x1 + x2)/2 + L/12 (t1 - q1).
    """
    n = len(beams.length)
    weight = (beams.rho_A * beams.length)[:, None] * gravity
    lever = beams.length / 12.0
    t = T[:, :, :, 0]
    mean = 0.5 * (x[:, 0] + x[:, 1]) + lever[:, None] * (t[:, 0] - t[:, 1])
    gradient = np.zeros((n, 12))
    hessian = np.zeros((n, 12, 12))
    for end, sign in ((0, 1.0), (1, -1.0)):
        arm = sign * lever[:, None] * t[:, end]
        rows = slice(6 * end + 3, 6 * end + 6)
        gradient[:, 6 * end : 6 * end + 3] = -0.5 * weight
        gradient[:, rows] = -np.cross(arm, weight)
        hessian[:, rows, rows] = -symmetric_double_cross(weight, arm)
    return BeamState(-np.sum(weight * mean, axis=1), gradient, hessian)


def beam_mass(
    beams: BeamProperties,
    x: Float[np.ndarray, "element 2 3"],
    T: Float[np.ndarray, "element 2 3 3"],
) -> Float[np.ndarray, "element 12 12"]:
    """Consistent mass, rotary and polar inertia included, on the current chord.

    The mass per element is that of the undeformed state; the chord's own length makes rigid rotations of a
    stretched element exact.
    """
    chord = np.linalg.norm(x[:, 1] - x[:, 0], axis=1)
    e = (x[:, 1] - x[:, 0]) / chord[:, None]
    y = T[:, 0, :, 1] + T[:, 1, :, 1]
    y = _unit(y - np.sum(y * e, axis=1)[:, None] * e)
    frame = np.stack([e, y, np.cross(e, y)], axis=-1)
    turn = np.einsum("eij,pq->epiqj", frame, np.eye(4)).reshape(-1, 12, 12)
    return turn @ _local_mass(beams, chord) @ np.swapaxes(turn, 1, 2)


def _local_mass(beams: BeamProperties, chord: Array) -> Array:
    """Gauss quadrature of shape functions; four points are exact for products of cubics."""
    points, weights = np.polynomial.legendre.leggauss(4)
    n = len(chord)
    mass = np.zeros((n, 12, 12))
    for xi, w in zip(0.5 * (points + 1.0), 0.5 * weights, strict=True):
        N = np.zeros((n, 6, 12))  # displacement and rotation fields at the point
        for axis in (0, 3):
            N[:, axis, axis], N[:, axis, axis + 6] = 1.0 - xi, xi
        v, slope = _transverse_shapes(xi, chord, beams.shear_y)
        N[:, 1][:, [1, 5, 7, 11]], N[:, 5][:, [1, 5, 7, 11]] = v, slope
        v, slope = _transverse_shapes(xi, chord, beams.shear_z)
        sign = np.array([1.0, -1.0, 1.0, -1.0])  # w' = -theta_y
        N[:, 2][:, [2, 4, 8, 10]], N[:, 4][:, [2, 4, 8, 10]] = v * sign, -slope * sign
        density = np.stack(
            [beams.rho_A] * 3 + [beams.rho_I_y + beams.rho_I_z, beams.rho_I_y, beams.rho_I_z], axis=1
        )
        mass += (w * beams.length)[:, None, None] * np.einsum("eia,ei,eib->eab", N, density, N)
    return mass


def _transverse_shapes(xi: float, L: Array, shear: Array) -> tuple[Array, Array]:
    """Deflection v and section rotation for (v1, theta1, v2, theta2); cubic for shear = 0 (Friedman 1993)."""
    f, xi2, xi3 = 1.0 / (1.0 + shear), xi**2, xi**3
    v = [
        f * (2 * xi3 - 3 * xi2 - shear * xi + 1 + shear),
        f * L * (xi3 - (2 + shear / 2) * xi2 + (1 + shear / 2) * xi),
        f * (-2 * xi3 + 3 * xi2 + shear * xi),
        f * L * (xi3 - (1 - shear / 2) * xi2 - shear / 2 * xi),
    ]
    slope = [
        f * 6 / L * (xi2 - xi),
        f * (3 * xi2 - (4 + shear) * xi + 1 + shear),
        -f * 6 / L * (xi2 - xi),
        f * (3 * xi2 - (2 - shear) * xi),
    ]
    return np.stack(v, axis=1), np.stack(slope, axis=1)


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def _invariants(x: Array, T: Array) -> tuple[Array, Array, Array]:
    """Values (element, 8), gradients (element, 8, 12) and Hessians (element, 8, 12, 12)."""
    n = len(x)
    chord = x[:, 1] - x[:, 0]
    span = np.linalg.norm(chord, axis=1)
    e = chord / span[:, None]
    s = np.zeros((n, 8))
    ds, dds = np.zeros((n, 8, 12)), np.zeros((n, 8, 12, 12))
    P = np.eye(3) - e[:, :, None] * e[:, None, :]
    s[:, LENGTH] = span
    _put_chord(ds[:, LENGTH], dds[:, LENGTH], e, P / span[:, None, None])
    for end, first in ((0, 1), (1, 4)):
        for k in range(3):
            _direction_cosine(s, ds, dds, first + k, e, span, P, T[:, end, :, k], 6 * end + 3)
    _twist(s, ds, dds, T)
    return s, ds, dds


def _put_chord(grad: Array, hess: Array, g: Array, H: Array) -> None:
    """Write the derivatives in the chord x2 - x1 to both end positions."""
    for a, sign_a in ((0, -1.0), (6, 1.0)):
        grad[:, a : a + 3] = sign_a * g
        for b, sign_b in ((0, -1.0), (6, 1.0)):
            hess[:, a : a + 3, b : b + 3] = sign_a * sign_b * H


def _direction_cosine(
    s: Array, ds: Array, dds: Array, i: int, e: Array, span: Array, P: Array, t: Array, rot: int
) -> None:
    """e . t for a triad vector t whose rotation coordinates start at ``rot``."""
    c = np.sum(e * t, axis=1)
    Pt = t - c[:, None] * e
    outer = Pt[:, :, None] * e[:, None, :]
    s[:, i] = c
    H = -(outer + np.swapaxes(outer, 1, 2) + c[:, None, None] * P) / (span**2)[:, None, None]
    _put_chord(ds[:, i], dds[:, i], Pt / span[:, None], H)
    r = slice(rot, rot + 3)
    ds[:, i, r] = np.cross(t, e)
    dds[:, i, r, r] = symmetric_double_cross(e, t)
    mixed = skew(t) @ P / span[:, None, None]
    for a, sign in ((0, -1.0), (6, 1.0)):
        dds[:, i, r, a : a + 3] = sign * mixed
        dds[:, i, a : a + 3, r] = sign * np.swapaxes(mixed, 1, 2)


def _twist(s: Array, ds: Array, dds: Array, T: Array) -> None:
    t2, t3, q2, q3 = T[:, 0, :, 1], T[:, 0, :, 2], T[:, 1, :, 1], T[:, 1, :, 2]
    sine, cosine = _dot_jet(q2, t3), _dot_jet(q2, t2)
    for total, (u, v), sign in ((sine, (q3, t2), -1.0), (cosine, (q3, t3), 1.0)):
        for part, more in zip(total, _dot_jet(u, v), strict=True):
            part += sign * more
    (S, gS, HS), (C, gC, HC) = sine, cosine
    r2 = S**2 + C**2
    fS, fC = C / r2, -S / r2
    fSS, fSC = -2.0 * S * C / r2**2, (S**2 - C**2) / r2**2
    s[:, TWIST] = np.arctan2(S, C)
    ds[:, TWIST] = fS[:, None] * gS + fC[:, None] * gC
    cross = gS[:, :, None] * gC[:, None, :]
    dds[:, TWIST] = (
        fS[:, None, None] * HS
        + fC[:, None, None] * HC
        + fSS[:, None, None] * (gS[:, :, None] * gS[:, None, :] - gC[:, :, None] * gC[:, None, :])
        + fSC[:, None, None] * (cross + np.swapaxes(cross, 1, 2))
    )


def _dot_jet(u: Array, v: Array) -> tuple[Array, Array, Array]:
    """u . v with u fixed to end 2 and v to end 1: value, gradient and Hessian."""
    n = len(u)
    grad, hess = np.zeros((n, 12)), np.zeros((n, 12, 12))
    one, two = slice(3, 6), slice(9, 12)
    dot = np.sum(u * v, axis=1)
    moment = np.cross(u, v)
    grad[:, two], grad[:, one] = moment, -moment
    hess[:, one, one] = hess[:, two, two] = symmetric_double_cross(u, v)
    mixed = dot[:, None, None] * np.eye(3) - v[:, :, None] * u[:, None, :]
    hess[:, two, one] = mixed
    hess[:, one, two] = np.swapaxes(mixed, 1, 2)
    return dot, grad, hess


def _deformations(s: Array) -> tuple[Array, Array, Array]:
    """Deformations (element, 6) of the invariants with first and second derivatives."""
    n = len(s)
    m, dm, ddm = np.zeros((n, 6)), np.zeros((n, 6, 8)), np.zeros((n, 6, 8, 8))
    m[:, STRETCH], dm[:, STRETCH, LENGTH] = s[:, LENGTH], 1.0
    m[:, PHI], dm[:, PHI, TWIST] = s[:, TWIST], 1.0
    for first, half, (iy, iz) in ((1, 0.5, (Y1, Z1)), (4, -0.5, (Y2, Z2))):
        f, df, ddf = _angle_over_sine(s[:, first])
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


def _angle_over_sine(c: Array) -> tuple[Array, Array, Array]:
    """f = acos(c)/sqrt(1 - c^2) and two derivatives, smooth through c = 1.

    (1 - c^2) f' = c f - 1; hence the series in x = 1 - c has a_n = n/(2n + 1) a_(n-1).
    """
    x = 1.0 - c
    near = x < 0.2
    f, df, ddf = np.zeros_like(c), np.zeros_like(c), np.zeros_like(c)
    a = 1.0
    xn = x[near]
    for n in range(24):  # 0.1^24: below rounding
        if n:
            a *= n / (2.0 * n + 1.0)
        f[near] += a * xn**n
        df[near] -= n * a * xn ** max(n - 1, 0)
        ddf[near] += n * (n - 1) * a * xn ** max(n - 2, 0)
    far = ~near
    cf = c[far]
    q = 1.0 - cf**2
    f[far] = np.arccos(cf) / np.sqrt(q)
    df[far] = (cf * f[far] - 1.0) / q
    ddf[far] = (f[far] + 3.0 * cf * df[far]) / q
    return f, df, ddf
