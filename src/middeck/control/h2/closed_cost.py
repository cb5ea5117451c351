"""The H2 cost of one model under one compensator, and its gradient, from one real Schur form.

With A the closed loop's matrix, J = tr(C X C') where A X + X A' + B B' = 0, and with A' P + P A + C'C = 0
the gradient is dJ = 2 tr(P X dA') + 2 tr(P B dB') + 2 tr(C X dC') (Levine and Athans 1970; for dynamic laws
of any order Hyland and Bernstein 1984). Both equations share the Schur form of A.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from jaxtyping import Float
from scipy.linalg import lapack

from middeck.control.h2.generalized_plant import GeneralizedPlant
from middeck.control.riccati.lyapunov import real_schur, solve_triangular
from middeck.values import record


@record
class Law:
    """A strictly proper compensator x' = A x + B y, u = C x; its last states integrate measurements."""

    A: Float[np.ndarray, "law law"]
    B: Float[np.ndarray, "law y"]
    C: Float[np.ndarray, "u law"]


@dataclass(frozen=True, kw_only=True, eq=False)
class LawCost:
    """Cost of a model under a compensator, its gradient, and the scales of the compensator's coordinates.

    ``cost`` is ``inf`` and the rest None where the loop is unstable. ``covariance`` and ``worth`` are the
    compensator's blocks of X and P; ``measured`` is the mean square of each measurement without sensor noise,
    ``pushed`` the cost of a unit impulse at each input.
    """

    cost: float
    A: Float[np.ndarray, "law law"] | None = None
    B: Float[np.ndarray, "law y"] | None = None
    C: Float[np.ndarray, "u law"] | None = None
    covariance: Float[np.ndarray, "law law"] | None = None
    worth: Float[np.ndarray, "law law"] | None = None
    measured: Float[np.ndarray, " y"] | None = None
    pushed: Float[np.ndarray, " u"] | None = None


def closed_matrices(model: GeneralizedPlant, law: Law) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C of the loop from w to e; states of the model, then the law's."""
    n = len(model.A)
    A = np.empty((n + len(law.A), n + len(law.A)))
    A[:n, :n] = model.A
    A[:n, n:] = model.B2 @ law.C
    A[n:, :n] = law.B @ model.C2
    A[n:, n:] = law.A + law.B @ (model.D22 @ law.C)
    C = np.empty((len(model.C1), len(A)))
    C[:, :n], C[:, n:] = model.C1, model.D12 @ law.C
    held = len(model.integrals)
    if held:
        C[-held:, -held:] = np.diag([weight for _, weight in model.integrals])
    B = np.empty((len(A), model.B1.shape[1]))
    B[:n], B[n:] = model.B1, law.B @ model.D21
    return A, B, C


def spectral_abscissa(model: GeneralizedPlant, law: Law) -> float:
    """Largest real part of the closed loop's poles [rad/s]."""
    return float(np.linalg.eigvals(closed_matrices(model, law)[0]).real.max(initial=-np.inf))


def evaluate_cost(model: GeneralizedPlant, law: Law) -> LawCost:
    """The cost and its gradient with respect to the law's matrices."""
    A, B, C = closed_matrices(model, law)
    form = _stable_form(A)
    if form is None:
        return LawCost(cost=np.inf)
    T, into, out = form
    F, H = out @ B, C @ into
    X = into @ solve_triangular(T, F @ F.T, transposed=False) @ into.T
    P = out.T @ solve_triangular(T, H.T @ H, transposed=True) @ out
    cost = float(((C @ X) * C).sum())
    if not np.isfinite(cost):
        return LawCost(cost=np.inf)
    return law_gradient(model, law, cost, X, P, (P @ X, P @ B, C @ X))


def law_gradient(
    model: GeneralizedPlant,
    law: Law,
    cost: float,
    X: Float[np.ndarray, "state state"],
    P: Float[np.ndarray, "state state"],
    halves: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> LawCost:
    """Gradient by a `Law`'s matrices, from half of dJ/dA, dJ/dB and dJ/dC (PX, PB and CX of an H2 cost)."""
    PX, PB, CX = halves
    n, through = len(model.A), model.D22 @ law.C
    return LawCost(
        cost=cost,
        A=2.0 * PX[n:, n:],
        B=2.0 * (PX[n:, :n] @ model.C2.T + PX[n:, n:] @ through.T + PB[n:] @ model.D21.T),
        C=2.0 * (model.B2.T @ PX[:n, n:] + (law.B @ model.D22).T @ PX[n:, n:] + model.D12.T @ CX[:, n:]),
        covariance=X[n:, n:],
        worth=P[n:, n:],
        measured=((model.C2 @ X[:n, :n]) * model.C2).sum(axis=1),
        pushed=((model.B2.T @ P[:n, :n]) * model.B2.T).sum(axis=1),
    )


def solve_gramian(
    A: Float[np.ndarray, "state state"], B: Float[np.ndarray, "state w"]
) -> Float[np.ndarray, "state state"] | None:
    """X of A X + X A' + B B' = 0; None where A is not stable."""
    form = _stable_form(A)
    if form is None:
        return None
    T, into, out = form
    F = out @ B
    return into @ solve_triangular(T, F @ F.T, transposed=False) @ into.T


def _stable_form(A: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """T, V and V^-1 of A = V T V^-1, T the real Schur form of balanced A; None where A is not stable."""
    if not np.isfinite(A).all():
        return None
    balanced, _, _, scale, _ = cast("Any", lapack).dgebal(A, scale=1, permute=0)
    try:
        T, U = real_schur(balanced)
    except np.linalg.LinAlgError:
        return None
    # The diagonal of a standard real Schur form holds the real parts.
    if not T.diagonal().max(initial=-np.inf) < 0.0:
        return None
    return T, scale[:, None] * U, U.T / scale
