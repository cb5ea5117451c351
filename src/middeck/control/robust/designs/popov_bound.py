"""A bound on the H2 cost for all stiffnesses and dampings of a box, and its gradient (How 1994).

For A + B0 F C0, F diagonal between 0 and M, take V(x) = x' (P + C0' F N C0) x, which depends on the
parameters as Popov's multiplier H + N s does. With p = F C0 x, N C0 B0 = 0, H > 0 and N >= 0 diagonal,

    dV/dt + x' C'C x <= x' (A'P + P A + C'C) x + 2 p' S x - p' R0 p,
    S = B0' P + N C0 A + H C0,   R0 = 2 H M^-1,

because 2 p' H (C0 x - M^-1 p) is not negative. Where a row of C0 B0 is not zero (a damping) its N is. The
largest value over p vanishes where

    A' P + P A + S' R0^-1 S + C'C = 0:

then every such loop is stable and costs at most tr((P + C0' M N C0) B B'). Bounds that are not [0, M] are
made so by moving A to the lower end. The gradient is that of the Lagrangian: with At = A + B0 R0^-1 S and
At L + L At' + B B' = 0, it is 2 (P + C0' N R0^-1 S) L for A, 2 (P + C0' M N C0) B for B and 2 C L for C.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.h2.closed_cost import Law, LawCost, closed_matrices, law_gradient, solve_gramian
from middeck.control.h2.generalized_plant import GeneralizedPlant
from middeck.control.riccati.lyapunov import solve_lyapunov
from middeck.control.riccati.stable_subspace import solve_by_subspace
from middeck.control.robust.problem.directions import Directions
from middeck.values import record

SOUND = 1e-9
"""Largest relative residual, and ratio of negative to largest eigenvalue, of an accepted Riccati solution."""


@record
class Multipliers:
    """H and N of each uncertain parameter, positive; N of a damping is zero."""

    H: Float[np.ndarray, " delta"]
    N: Float[np.ndarray, " delta"]


@record
class PopovBound:
    """The bound, its gradient with respect to the compensator, and with respect to log H and log N."""

    law: LawCost
    log_H: Float[np.ndarray, " delta"]
    log_N: Float[np.ndarray, " delta"]


def evaluate_bound(
    model: GeneralizedPlant, law: Law, directions: Directions, multipliers: Multipliers
) -> PopovBound:
    """The bound over the box; ``inf`` where the Riccati equation has no solution."""
    nominal, B, C = closed_matrices(model, law)
    modes, states = len(directions.low), len(nominal)
    into, out = np.zeros((states, modes)), np.zeros((modes, states))
    into[: len(directions.into)], out[:, : len(directions.into)] = directions.into, directions.out
    A = nominal + into @ (directions.low[:, None] * out)
    M = directions.high - directions.low
    H, N = multipliers.H, multipliers.N
    fixed = N[:, None] * (out @ A) + H[:, None] * out
    R0 = 2.0 * H / M
    P = _solve(A, into, C, fixed, R0)
    if P is None:
        return _infinite(modes)
    S = into.T @ P + fixed
    L = solve_gramian(A + into @ (S / R0[:, None]), B)
    if L is None:
        return _infinite(modes)
    whole = P + out.T @ ((M * N)[:, None] * out)
    cost = float(np.sum((whole @ B) * B))
    by_A = (P + out.T @ (N[:, None] * S / R0[:, None])) @ L
    gradient = law_gradient(model, law, cost, L, whole, (by_A, whole @ B, C @ L))
    SL = (S / R0[:, None]) @ L
    by_N = M * np.einsum("ms,sk,mk->m", out, B @ B.T, out) + 2.0 * np.sum(SL * (out @ A), axis=1)
    by_H = 2.0 * np.sum(SL * out, axis=1) - np.sum(SL * (S / R0[:, None]), axis=1) * 2.0 / M
    return PopovBound(gradient, by_H * H, by_N * N)


def _infinite(modes: int) -> PopovBound:
    return PopovBound(LawCost(cost=np.inf), np.zeros(modes), np.zeros(modes))


def first_multipliers(model: GeneralizedPlant, law: Law, directions: Directions) -> Multipliers | None:
    """Optimal H of small boxes with N = 0, and N = H / omega of a stiffness; None if unstable."""
    A, B, C = closed_matrices(model, law)
    L, P = solve_gramian(A, B), solve_gramian(A.T, C.T)
    if L is None or P is None:
        return None
    known = slice(0, len(directions.into))
    pushed = directions.into.T @ P[known]
    read = np.sum((directions.out @ L[known, known]) * directions.out, axis=1)
    H = np.sqrt(np.sum((pushed @ L) * pushed, axis=1) / read)
    moving = directions.out @ A[known]
    rate = np.sqrt(np.sum((moving @ L) * moving, axis=1) / read)
    return Multipliers(H, np.where(directions.stiff, H / rate, 0.0))


def _solve(
    A: np.ndarray, into: np.ndarray, C: np.ndarray, fixed: np.ndarray, R0: np.ndarray
) -> Float[np.ndarray, "state state"] | None:
    """P >= 0 from the stable subspace of the Hamiltonian (Laub 1979), and one step of Newton's method."""
    if np.linalg.eigvals(A).real.max() >= 0.0:
        return None
    moved = A + into @ (fixed / R0[:, None])
    R, Q = (into / R0) @ into.T, C.T @ C + fixed.T @ (fixed / R0[:, None])
    unit = np.sqrt(np.linalg.norm(Q) / np.linalg.norm(R))
    scaled = solve_by_subspace(moved, -unit * R, Q / unit)
    if scaled is None:
        return None
    P = unit * scaled
    solved = P + solve_lyapunov(moved + R @ P, _defect(P, moved, R, Q)[0])
    lowest, *_, highest = np.linalg.eigvalsh(solved)
    # A guaranteed bound needs a positive solution accurate to nearly rounding.
    sound = _defect(solved, moved, R, Q)[1] <= SOUND and lowest >= -SOUND * highest
    return solved if sound else None


def _defect(P: np.ndarray, A: np.ndarray, R: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, float]:
    """Residual of the Riccati equation, and its norm relative to that of the terms."""
    linear, square = P @ A, P @ R @ P
    defect = linear + linear.T + square + Q
    size = 2.0 * np.linalg.norm(linear) + np.linalg.norm(square) + np.linalg.norm(Q)
    return (defect + defect.T) / 2.0, float(np.linalg.norm(defect) / size)
