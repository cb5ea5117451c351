"""Reduced components: matrices of boundary poses and modal coordinates; energy, force, exact tangent.

The component follows a frame of its own, the best fit to its boundary (Kabsch 1976): the rotation Q that
maximises

    sum_i w_i y_i . Q Y_i + sum_i v_i sum_k R_i e_k . Q e_k

with the places Y_i, y_i of the grids about their centroid, drawn and now, and their rotations R_i since
drawn. With one grid Q is its rotation; with several their places count, rotations only about a line of grids.
In the frame each grid has a displacement and a rotation vector, as the end of a bushing has, and with the
modal coordinates q they are d:

    E = d'K d / 2 - m g . c - g . Q (s + P d)

c the centroid, s the first moment of mass about it and P d what deformation adds to that: P is the mass
matrix times unit translations. Nothing strains in a motion as one body, of any size. What K does not know,
the stiffness that forces inside have by their direction (geometric stiffness), is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Inexact, Int

from middeck.structure.elements.bushings import SHIFT_A, TURN_A, relative_motion
from middeck.structure.elements.rotations import cross, skew, symmetric_double_cross, turn_of
from middeck.values import record

Array = np.ndarray
# Newton's method for the frame, from the best fit but for rounding: each step squares the error.
STEPS = 4
SECOND = slice(6, 12)


@record(kw_only=True)
class ComponentElement:
    """A component in a model; everything in the axes of W as drawn.

    Attributes:
        point: Pose of each boundary grid.
        joint: Place of each modal coordinate among the angles of the configuration.
        basis: Coordinates of the component as it came, per coordinate of these.
        stiffness, mass: On shift and rotation vector of each grid, then on modal coordinates.
        arms: Places of the grids about their centroid as drawn.
        weights: Weights of each grid's place and rotation in the frame.
        moment: First moment of mass about the centroid.
    """

    point: Int[np.ndarray, " grid"]
    joint: Int[np.ndarray, " modal"]
    basis: Inexact[np.ndarray, "n n"]
    stiffness: Inexact[np.ndarray, "n n"]
    mass: Inexact[np.ndarray, "n n"]
    arms: Inexact[np.ndarray, "grid 3"]
    weights: Inexact[np.ndarray, "grid 2"]
    moment: Inexact[np.ndarray, "3"]

    @property
    def drag(self) -> Inexact[np.ndarray, "3 n"]:
        """First moment of mass per unit of each coordinate: unit translations times the mass matrix."""
        grids = 6 * len(self.point)
        return self.mass[:grids].reshape(-1, 6, len(self.mass))[:, :3].sum(axis=0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ComponentState:
    """Energy, and derivatives in the boundary poses and modal coordinates.

    ``slope`` is that of the deformation: ``material`` is slope' K slope, and ``geometric`` the rest.
    """

    energy: float
    gradient: Inexact[np.ndarray, " n"]
    material: Inexact[np.ndarray, "n n"]
    geometric: Inexact[np.ndarray, "n n"]
    slope: Inexact[np.ndarray, "n n"]
    deformation: Inexact[np.ndarray, " n"]
    stiffness: Inexact[np.ndarray, "n n"]
    axes: Inexact[np.ndarray, "3 3"]
    modal: int

    def seen(self, motion: Inexact[np.ndarray, "n mode"]) -> Inexact[np.ndarray, "n mode"]:
        """Motions in W as the component's frame sees them, those as one body included."""
        grids = len(motion) - self.modal
        turned = np.einsum("ji,gjm->gim", self.axes, motion[:grids].reshape(grids // 3, 3, motion.shape[1]))
        return np.concatenate([turned.reshape(grids, -1), motion[grids:]])

    def squares(self, motion: Inexact[np.ndarray, "n mode"]) -> Inexact[np.ndarray, "mode mode"]:
        """``material`` applied to motions, as squared strains."""
        strain = self.slope @ motion
        return strain.T @ (self.stiffness @ strain)


def component_state(
    part: ComponentElement, places: Array, change: Array, turn: Array, modal: Array, gravity: Array
) -> ComponentState:
    """State with grids at ``places``, shifted by ``change`` and turned by ``turn`` (less the identity)."""
    n, size = len(part.point), len(part.stiffness)
    w = part.weights[:, 0] / part.weights[:, 0].sum()
    centre, moved = w @ places, w @ change
    span, stretch = places - centre, change - moved
    frame = _fit(part, stretch, turn)
    Q = np.eye(3) + frame
    turns = np.stack([np.broadcast_to(frame, turn.shape), turn], axis=1)
    relative = relative_motion(span, stretch, turns)
    d = np.concatenate([relative.value.ravel(), modal])
    P = part.drag
    mass = P[0, : 6 * n : 6].sum()
    where = Q @ (part.moment + P @ d)
    strained = part.stiffness @ d
    force = strained - P.T @ (Q.T @ gravity)
    # Columns: centroid (3), turn of the frame (3), poses of the grids and modal coordinates.
    motion = _frame_motion(part, w, Q, span, turn)
    T = np.vstack([motion.slope, np.eye(size)])
    S = np.zeros((size, 6 + size), np.result_type(relative.slope, T))
    H = np.zeros((6 + size, 6 + size), S.dtype)
    curved = relative.second_order(force[: 6 * n].reshape(n, 6))
    for i in range(n):
        own = slice(6 + 6 * i, 12 + 6 * i)
        rows = slice(6 * i, 6 * i + 6)
        S[rows, :6], S[rows, own] = relative.slope[i][:, :6], relative.slope[i][:, SECOND]
        H[:6, :6] += curved[i][:6, :6]
        H[:6, own] += curved[i][:6, SECOND]
        H[own, :6] += curved[i][SECOND, :6]
        H[own, own] += curved[i][SECOND, SECOND]
    S[6 * n :, 6 + 6 * n :] = np.eye(size - 6 * n)
    gradient = S.T @ force
    gradient[SHIFT_A] -= mass * gravity
    gradient[TURN_A] -= cross(where, gravity)
    lean = skew(gravity) @ Q @ P @ S
    H[TURN_A] += lean
    H[:, TURN_A] += lean.T
    H[TURN_A, TURN_A] -= symmetric_double_cross(gravity, where)
    slope = S @ T
    return ComponentState(
        energy=0.5 * d @ strained - mass * gravity @ centre - gravity @ where,
        gradient=T.T @ gradient,
        material=slope.T @ part.stiffness @ slope,
        geometric=T.T @ H @ T + motion.second_order(gradient[TURN_A]),
        slope=slope,
        deformation=d,
        stiffness=part.stiffness,
        axes=Q,
        modal=len(modal),
    )


def component_mass(part: ComponentElement, change: Array, turn: Array) -> Inexact[np.ndarray, "n n"]:
    """Mass matrix in the boundary poses and modal coordinates, in W: it turns with the frame."""
    w = part.weights[:, 0] / part.weights[:, 0].sum()
    Q = np.eye(3) + _fit(part, change - w @ change, turn)
    grids = 2 * len(part.point)
    whole = np.eye(len(part.mass), dtype=Q.dtype)
    whole[: 3 * grids, : 3 * grids] = np.kron(np.eye(grids), Q)
    return whole @ part.mass @ whole.T


def _arms(part: ComponentElement, stretch: Array, turn: Array) -> tuple[Array, Array, Array]:
    """Weights, drawn vectors, and how they have changed: places of the grids, then axes of each."""
    n = len(part.point)
    weight = np.concatenate([part.weights[:, 0], np.repeat(part.weights[:, 1], 3)])
    drawn = np.concatenate([part.arms, np.tile(np.eye(3), (n, 1))])
    return weight, drawn, np.concatenate([stretch, np.swapaxes(turn, 1, 2).reshape(-1, 3)])


def _fit(part: ComponentElement, stretch: Array, turn: Array) -> Inexact[np.ndarray, "3 3"]:
    """Rotation of the frame since drawn, less the identity: with all its digits where it is small."""
    weight, drawn, changed = _arms(part, stretch, turn)
    U, _, Vt = np.linalg.svd(np.real((weight[:, None] * (drawn + changed)).T @ drawn))
    proper = np.diag([1.0, 1.0, np.linalg.det(U @ Vt)])
    turned = U @ proper @ Vt - np.eye(3)
    # What rounding leaves of stretch in it would be strained, drawn or not.
    stretched = turned + turned.T + turned.T @ turned
    turned = turned - 0.5 * (stretched + turned @ stretched)
    for _ in range(STEPS):
        bent = drawn @ turned.T
        left = weight @ (cross(drawn, changed) + cross(bent, drawn + changed))
        theta = np.linalg.solve(_stiffness(weight, drawn + bent, drawn + changed), -left)
        step = turn_of(theta)
        turned = step + turned + step @ turned
    return turned


def _stiffness(weight: Array, p: Array, b: Array) -> Array:
    """Derivative of the sum of w p x b as p turns: the sum of w (p b' - p.b)."""
    return (weight[:, None] * p).T @ b - np.sum(weight * np.sum(p * b, axis=1)) * np.eye(3)


@dataclass(frozen=True, kw_only=True, eq=False)
class _FrameMotion:
    """Centroid and turn of the frame per coordinate, and what its second order is made of."""

    slope: Array
    weights: Array
    resists: Array  # sum of w (p b' - p.b): how the frame's condition changes as it turns
    drawn: Array
    places: Array
    Q: Array
    R: Array

    def second_order(self, moment: Array) -> Array:
        """Second derivatives of the frame's turn, weighted by the ``moment`` on it.

        Of the condition sum w p x b = 0, by the theorem of implicit functions.
        """
        mu = np.linalg.solve(self.resists, moment)
        size = self.slope.shape[1]
        twice = np.zeros((3 + size, 3 + size), self.slope.dtype)
        for i, (w, v) in enumerate(self.weights):
            shift, turn = slice(3 + 6 * i, 6 + 6 * i), slice(6 + 6 * i, 9 + 6 * i)
            p = self.drawn[i]
            twice[:3, :3] += w * symmetric_double_cross(cross(self.places[i], mu), p)
            twice[:3, shift] += w * ((p @ mu) * np.eye(3) - np.outer(mu, p))
            for p, b in zip(self.Q.T, self.R[i].T, strict=True):
                twice[:3, :3] += v * symmetric_double_cross(cross(b, mu), p)
                twice[:3, turn] -= v * ((p @ mu) * np.eye(3) - np.outer(mu, p)) @ skew(b)
                twice[turn, turn] += v * symmetric_double_cross(cross(mu, p), b)
        twice[3:, :3] = twice[:3, 3:].T
        both = np.vstack([self.slope[3:], np.eye(size)])
        return -both.T @ twice @ both


def _frame_motion(part: ComponentElement, w: Array, Q: Array, span: Array, turn: Array) -> _FrameMotion:
    weights, p, R = part.weights, part.arms @ Q.T, np.eye(3) + turn
    between = R @ Q.T  # the sum over each grid's axes of b p'
    trace = np.trace(between, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    resists = _stiffness(weights[:, 0], p, span)
    resists = resists + np.einsum("g,gij->ij", weights[:, 1], np.swapaxes(between, 1, 2) - trace)
    felt = np.zeros((3, len(part.stiffness)), np.result_type(p, between))
    slope = np.zeros((6, len(part.stiffness)), felt.dtype)
    for i in range(len(p)):
        shift, rotation = slice(6 * i, 6 * i + 3), slice(6 * i + 3, 6 * i + 6)
        slope[:3, shift] = w[i] * np.eye(3)
        felt[:, shift] = weights[i, 0] * skew(p[i])
        felt[:, rotation] = weights[i, 1] * (trace[i] - between[i])
    slope[3:] = -np.linalg.solve(resists, felt)
    return _FrameMotion(slope=slope, weights=weights, resists=resists, drawn=p, places=span, Q=Q, R=R)
