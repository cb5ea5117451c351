"""Bushings: a 6x6 stiffness between two frames, or a frame and the ground; energy, force and exact tangent.

With Q_A, Q_B the rotations of the frames since drawn, s the span between the points and s0 that as drawn, the
deformation is what the first frame sees, in its axes,

    u = Q_A' s - s0,    phi = log(Q_A' Q_B),

a displacement and a rotation vector: the bushing follows its first frame, and moving both as one body strains
nothing. Its energy is d'Kd/2 with d = (u, phi) in the bushing's own axes, for any displacement and for a
relative turn below pi, where phi has two directions. phi = f(y) a with the axial vector a of Q_A' Q_B and
y = 1 - cos(angle); the chart of a pose is (dx, theta), exp(theta) R, so that with P = exp(-theta_A)
exp(theta_B) all is made of traces tr(W P), whose derivatives are polynomials.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Inexact, Int

from middeck.structure.elements.rotations import skew, symmetric_double_cross

Array = np.ndarray
# Below this 1 - cos(angle) the factor is a series of so many terms, good to rounding.
NEAR, TERMS = 0.05, 12
# And up to here of 2, an angle of pi, where the vector has two directions; what lies beyond has its factor.
MOST = 2.0 - 1e-9
# Stiffness, after scaling to a unit diagonal, that is zero to rounding.
NOTHING = 1e-13
SHIFT_A, TURN_A, SHIFT_B, TURN_B = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)


class BushingState(NamedTuple):
    """Energy [J], gradient and Hessian in the twelve coordinates of two poses, the first frame's first.

    The Hessian is ``material``, slope' ``stiffness`` slope, plus ``geometric``, which is linear in the
    ``force`` on the ``strain``; ``excess`` is what their own force adds to the gradient where another has
    taken its place. ``stiffness`` is in the bushing's own ``axes``, which stand twice on the diagonal;
    ``angle`` [rad] is that of the relative turn, which `MOST` does not bound.
    """

    energy: Inexact[np.ndarray, " bushing"]
    strain: Inexact[np.ndarray, "bushing 6"]
    force: Inexact[np.ndarray, "bushing 6"]
    gradient: Inexact[np.ndarray, "bushing 12"]
    excess: Inexact[np.ndarray, "bushing 12"]
    material: Inexact[np.ndarray, "bushing 12 12"]
    geometric: Inexact[np.ndarray, "bushing 12 12"]
    slope: Inexact[np.ndarray, "bushing 6 12"]
    stiffness: Inexact[np.ndarray, "bushing 6 6"]
    axes: Inexact[np.ndarray, "bushing 6 6"]
    angle: Float[np.ndarray, " bushing"]

    def squares(self, motion: Inexact[np.ndarray, "bushing 12 mode"]) -> Inexact[np.ndarray, "mode mode"]:
        """``material`` applied to motions of the poses, as squared strains: rounding is that of a strain.

        Nothing of a motion enters that the bushing leaves free, however its axes lie.
        """
        strain = _roots(self.stiffness) @ (np.swapaxes(self.axes, 1, 2) @ (self.slope @ motion))
        return np.einsum("bim,bin->mn", strain, strain)

    def predicted(self, motion: Inexact[np.ndarray, "bushing 12"]) -> Inexact[np.ndarray, "bushing 6"]:
        """Forces after a ``motion`` of the poses, to first order."""
        strain = np.matvec(np.swapaxes(self.axes, 1, 2), self.strain + np.matvec(self.slope, motion))
        return np.matvec(self.axes, np.matvec(self.stiffness, strain))

    def of(self, rows: Int[np.ndarray, " some"]) -> BushingState:
        """The state of some of the bushings."""
        return BushingState(*(part[rows] for part in self))

    def turned(self, R: Inexact[np.ndarray, "bushing 3 3"]) -> BushingState:
        """The state in other axes of the poses, to which ``R`` turns."""
        out = np.zeros((len(R), 12, 12), R.dtype)
        for start in range(0, 12, 3):
            out[:, start : start + 3, start : start + 3] = R
        back = np.swapaxes(out, 1, 2)
        return self._replace(
            gradient=np.matvec(out, self.gradient),
            excess=np.matvec(out, self.excess),
            material=out @ self.material @ back,
            geometric=out @ self.geometric @ back,
            slope=self.slope @ back,
        )


# What most articles have: their state need not be computed in every assembly.
NO_BUSHINGS = BushingState(
    *(
        np.zeros((0, *size))
        for size in ((), *[(6,)] * 2, *[(12,)] * 2, *[(12, 12)] * 2, (6, 12), *[(6, 6)] * 2, ())
    )
)


def bushing_state(
    stiffness: Inexact[np.ndarray, "bushing 6 6"],
    axes: Inexact[np.ndarray, "bushing 3 3"],
    span: Inexact[np.ndarray, "bushing 3"],
    change: Inexact[np.ndarray, "bushing 3"],
    turn: Inexact[np.ndarray, "bushing 2 3 3"],
    force: Inexact[np.ndarray, "bushing 6"] | None = None,
) -> BushingState:
    """State of bushings whose points are ``span`` apart, by ``change`` more than as drawn.

    ``turn`` are the rotations since drawn less the identity, which keeps the digits of small ones; ``axes``
    have the bushing's own axes as columns. ``force`` takes the place of their own.
    """
    if not len(span):
        return NO_BUSHINGS
    moved = relative_motion(span, change, turn)
    own = np.zeros((len(span), 6, 6), np.result_type(stiffness, axes))
    own[:, :3, :3] = own[:, 3:, 3:] = axes
    K = own @ stiffness @ np.swapaxes(own, 1, 2)
    own_force = np.matvec(K, moved.value)
    force = own_force if force is None else force
    down = np.swapaxes(moved.slope, 1, 2)
    return BushingState(
        energy=0.5 * np.einsum("bi,bi->b", moved.value, own_force),
        strain=moved.value,
        force=force,
        gradient=np.matvec(down, force),
        excess=np.matvec(down, own_force - force),
        material=down @ K @ moved.slope,
        geometric=moved.second_order(force),
        slope=moved.slope,
        stiffness=stiffness,
        axes=own,
        angle=moved.phi.angle,
    )


def _roots(stiffness: Float[np.ndarray, "bushing 6 6"]) -> Float[np.ndarray, "bushing 6 6"]:
    """F of the stiffness F' F; what an eigenvalue below `NOTHING` of it stands for is free."""
    unit = np.sqrt(np.diagonal(stiffness, axis1=1, axis2=2))
    over = unit[:, :, None] * unit[:, None, :]
    size, turn = np.linalg.eigh(np.divide(stiffness, over, out=np.zeros_like(over), where=over > 0.0))
    size = np.where(size > NOTHING, size, 0.0)
    return np.sqrt(size)[:, :, None] * np.swapaxes(turn, 1, 2) * unit[:, None, :]


@dataclass(frozen=True, kw_only=True, eq=False)
class RelativeMotion:
    """Displacement and rotation vector of second frames seen by first ones, and derivatives by both poses."""

    value: Inexact[np.ndarray, "pair 6"]
    slope: Inexact[np.ndarray, "pair 6 12"]
    span: Array
    first: Array
    between: Array
    toward: Array
    phi: _Turn

    def second_order(self, force: Inexact[np.ndarray, "pair 6"]) -> Inexact[np.ndarray, "pair 12 12"]:
        """Second derivatives of ``value``, weighted by the ``force`` on it."""
        return _second_order(force, self.span, self.first, self.between, self.toward, self.phi)


def relative_motion(
    span: Inexact[np.ndarray, "pair 3"],
    change: Inexact[np.ndarray, "pair 3"],
    turn: Inexact[np.ndarray, "pair 2 3 3"],
) -> RelativeMotion:
    """Motion of points ``span`` apart, by ``change`` more than as drawn; ``turn`` as in `bushing_state`."""
    E = np.swapaxes(turn[:, 0], 1, 2)
    Q = np.eye(3) + turn[:, 0]
    phi = _relative_turn(E + turn[:, 1] + E @ turn[:, 1])
    G = (np.eye(3) + turn[:, 1]) @ (np.eye(3) + E)
    slope = np.zeros((len(span), 6, 12), np.result_type(span, change, turn))
    back = np.swapaxes(Q, 1, 2)
    slope[:, :3, SHIFT_B], slope[:, :3, SHIFT_A], slope[:, :3, TURN_A] = back, -back, back @ skew(span)
    toward = np.stack([-_axial(_twisted(G, Q[:, :, i])) for i in range(3)], axis=1)
    steeper = phi.factor[0][:, None, None] * toward + _outer(phi.factor[1][:, None] * phi.axial, _axial(G))
    slope[:, 3:, TURN_B], slope[:, 3:, TURN_A] = steeper, -steeper
    value = np.concatenate([np.matvec(E, span) + change, phi.vector], axis=1)
    return RelativeMotion(value=value, slope=slope, span=span, first=Q, between=G, toward=toward, phi=phi)


class _Turn(NamedTuple):
    """A relative rotation: vector, axial vector, and factor with two derivatives in y, and angle."""

    vector: Array
    axial: Array
    factor: tuple[Array, Array, Array]
    angle: Array


def _relative_turn(less_one: Array) -> _Turn:
    axial = _axial(less_one)
    y = -0.5 * np.trace(less_one, axis1=1, axis2=2)
    factor = _factor(y)
    angle = np.arccos(np.clip(1.0 - np.real(y), -1.0, 1.0))
    return _Turn(factor[0][:, None] * axial, axial, factor, angle)


def _factor(y: Array) -> tuple[Array, Array, Array]:
    """f = angle / sin(angle) with y = 1 - cos(angle), and two derivatives.

    (y(2-y)) f' = 1 - (1-y) f, and its own derivative; f = 1 + y/3 + 2 y^2/15 + ... near zero.
    """
    small = np.real(y) < NEAR
    near, far = np.where(small, y, 0.0), np.where(small, 0.5, np.where(np.real(y) < MOST, y, MOST))
    series, term = np.zeros((3, *y.shape), y.dtype), 1.0
    for k in range(TERMS):
        series[0] += term * near**k
        if k > 0:
            series[1] += term * k * near ** (k - 1)
        if k > 1:
            series[2] += term * k * (k - 1) * near ** (k - 2)
        term *= (k + 1.0) / (2.0 * k + 3.0)
    square = far * (2.0 - far)
    angle = 2.0 * np.arctan(np.sqrt(far / (2.0 - far)))
    f = angle / np.sqrt(square)
    slope = (1.0 - (1.0 - far) * f) / square
    curve = (f - 3.0 * (1.0 - far) * slope) / square
    return tuple(np.where(small, s, c) for s, c in zip(series, (f, slope, curve), strict=True))


def _second_order(force: Array, span: Array, Q: Array, G: Array, toward: Array, phi: _Turn) -> Array:
    """Second derivatives of the deformations, weighted by the ``force`` on them."""
    out = np.zeros((len(span), 12, 12), np.result_type(force, span, Q, G))
    pull, twist = np.matvec(Q, force[:, :3]), force[:, 3:]
    out[:, TURN_A, TURN_A] = symmetric_double_cross(pull, span)
    for shift, sign in ((SHIFT_B, 1.0), (SHIFT_A, -1.0)):
        out[:, TURN_A, shift] = sign * skew(pull)
        out[:, shift, TURN_A] = np.swapaxes(out[:, TURN_A, shift], 1, 2)
    f, slope, curve = phi.factor
    along = np.einsum("bi,bi->b", twist, phi.axial)
    dy, da = _axial(G), np.einsum("bi,bij->bj", twist, toward)
    both = slope[:, None, None] * (_outer(da, dy) + _outer(dy, da))
    both = both + (curve * along)[:, None, None] * _outer(dy, dy)
    mixed = 0.5 * f[:, None, None] * _trace_form(_twisted(G, np.matvec(Q, twist)))
    mixed = mixed - 0.5 * (slope * along)[:, None, None] * _trace_form(G)
    own = 0.5 * (mixed + np.swapaxes(mixed, 1, 2))
    out[:, TURN_A, TURN_A] += both + own
    out[:, TURN_B, TURN_B] += both + own
    out[:, TURN_A, TURN_B] -= both + mixed
    out[:, TURN_B, TURN_A] -= both + np.swapaxes(mixed, 1, 2)
    return out


def _twisted(G: Array, n: Array) -> Array:
    """W of the component of the axial vector along n: half the trace of W P."""
    return -G @ skew(n)


def _trace_form(W: Array) -> Array:
    """H of tr(W [u]x [v]x) = u'Hv."""
    return W - np.trace(W, axis1=1, axis2=2)[:, None, None] * np.eye(3)


def _axial(W: Array) -> Array:
    return 0.5 * np.stack([W[:, 2, 1] - W[:, 1, 2], W[:, 0, 2] - W[:, 2, 0], W[:, 1, 0] - W[:, 0, 1]], axis=1)


def _outer(a: Array, b: Array) -> Array:
    return a[:, :, None] * b[:, None, :]
