"""The discrete algebraic Riccati equation of sampled designs, delay states included.

Structure-preserving doubling (Chu, Fan, Lin and Wang 2004, Int. J. Control 77, "Structure-preserving
algorithms for periodic discrete-time algebraic Riccati equations"): each step squares the closed loop, so
that a pole at distance d from the circle needs log2(40/d) of them. The transition matrix is never inverted,
so that poles at zero (delays) do no harm. Newton steps follow (Hewer 1971, IEEE TAC 16) in correction form;
SciPy's generalised Schur method is used where doubling finds nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.control.law.stabilisability import require_reachable
from middeck.control.riccati.continuous import MISSED, WEIGH_IT, WORTHLESS, RiccatiSolution
from middeck.control.riccati.hamiltonian_units import fold_weights, refine, unit_diagonal, unit_scales
from middeck.control.riccati.lyapunov import solve_discrete_lyapunov
from middeck.errors import NumericalError
from middeck.systems.state_space.reached_states import reached_states

DOUBLINGS = 60
"""Number of doublings for a pole at 1 - 1e-16, the closest to the circle in double precision."""
NOTHING = 1e-60
"""Entries over the largest, below which they have no part in the units: what decays within a fraction of a
period, as exp(-1000), would ask for units of 1e100."""


def solve_discrete_riccati(
    A: Float[np.ndarray, "state state"],
    B: Float[np.ndarray, "state input"],
    Q: Float[np.ndarray, "state state"],
    R: Float[np.ndarray, "input input"],
    S: Float[np.ndarray, "state input"] | None = None,
    *,
    names: Sequence[str] = (),
    complaint: str = "no input reaches it",
) -> RiccatiSolution:
    """Solve A'XA - X - (A'XB + S)(R + B'XB)^-1 (A'XB + S)' + Q = 0 for the stabilising X.

    ``A`` may be singular; ``names`` (one per state) and ``complaint`` (of what B does not reach) are used in
    errors. Raises `NotStabilisableError` naming the modes that B does not reach (on or outside the circle) or
    Q does not see (on it), `ConfigError` for R that is not positive definite, `NumericalError` if no method
    gives a stabilising solution.

    >>> solution = solve_discrete_riccati(*4 * [np.eye(1)])                   # x^2 - x - 1 = 0
    >>> round(float(solution.X[0, 0]), 12)
    1.61803398875
    """
    cross, _, Abar, Bn, Qbar = fold_weights(A, B, Q, R, S)
    require_reachable(Abar, B, names, sampled=True, complaint=complaint)
    require_reachable(Abar.T, Qbar, names, only_axis=True, sampled=True, complaint=MISSED, hint=WEIGH_IT)
    X = _solve_scaled(Abar, Bn, Qbar)
    residual = _residual(X, Abar, Bn, Qbar)[1]
    through = R + B.T @ X @ B
    gain = np.linalg.solve(through, (A.T @ (X @ B) + cross).T)
    poles = np.linalg.eigvals(A - B @ gain).astype(complex)
    size = float(np.abs(poles).max(initial=0.0))
    # R + B'XB is the second variation of the cost; where not positive the law is stable but no minimum.
    minimum = bool(np.linalg.eigvalsh(through).min(initial=1.0) > 0.0)
    if size >= 1.0:
        # An unstable mode missing from the cost: doubling finds a solution that does not move it.
        require_reachable(Abar.T, Qbar, names, sampled=True, complaint=MISSED, hint=WEIGH_IT)
    if not np.isfinite(residual) or residual > WORTHLESS or size >= 1.0 or not minimum:
        raise NumericalError(
            f"no stabilising discrete Riccati solution: residual {residual:.1e}, largest pole {size:.9f}"
            + ("" if minimum else ", and the cost has no minimum"),
            hint="bring the weights or intensities closer together",
            residual=residual,
            poles=poles,
        )
    return RiccatiSolution(X, gain, poles, residual)


def _solve_scaled(A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"]:
    """X is zero of states that decay and that the cost does not see: no units would even them out."""
    seen = reached_states(_counted(A).T, np.any(_counted(Q) != 0.0, axis=0))
    if not seen.all() and np.all(np.abs(np.linalg.eigvals(A[~seen][:, ~seen])) < 1.0):
        X = np.zeros_like(A)
        X[np.ix_(seen, seen)] = _solve_seen(A[seen][:, seen], B[seen], Q[seen][:, seen])
        return X
    return _solve_seen(A, B, Q)


def _counted(M: np.ndarray) -> np.ndarray:
    """The matrix without entries that are `NOTHING`."""
    return np.where(np.abs(M) > NOTHING * np.abs(M).max(initial=0.0), M, 0.0)


def _solve_seen(A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"]:
    t = unit_scales(*map(_counted, (A, B @ B.T, Q)))
    scaled = A * t / t[:, None], B / t[:, None], Q * np.outer(t, t)
    found = _solve_doubling(*scaled)
    found = _solve_pencil(*scaled) if found is None else found
    if found is None:
        raise NumericalError(
            "the discrete Riccati equation has no stabilising solution: its pencil has poles on the circle",
            hint="check that the cost (or the noise intensity) is positive semidefinite",
        )
    unit = unit_diagonal(found)
    t = t * unit
    A, B, Q = A * t / t[:, None], B / t[:, None], Q * np.outer(t, t)
    X = refine(
        found * np.outer(unit, unit),
        lambda X: _residual(X, A, B, Q),
        lambda X, defect: solve_discrete_lyapunov(_closed(A, B, X), defect),
    )
    return X / np.outer(t, t)


def _solve_doubling(A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"] | None:
    """X = A'X(I + BB'X)^-1 A + Q by doubling; None where it does not settle."""
    step, reach, cost = A, B @ B.T, Q
    for _ in range(DOUBLINGS):
        try:
            step, reach, cost, more = _doubled(step, reach, cost)
        except np.linalg.LinAlgError:
            return None
        change, size = float(np.linalg.norm(more)), float(np.linalg.norm(cost))
        if not np.isfinite(change + size):
            return None
        # Convergence is quadratic: after a change of 1e-12 the next is below rounding.
        if change <= 1e-12 * size:
            return cost
    return None


def _doubled(
    step: np.ndarray, reach: np.ndarray, cost: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The three over twice as many samples, and what was added to the cost."""
    n = len(step)
    half = np.linalg.solve(np.eye(n) + reach @ cost, np.hstack([step, reach]))
    over, damped = half[:, :n], half[:, n:]
    more = step.T @ (cost @ over)
    reach, cost = reach + step @ damped @ step.T, cost + more
    return step @ over, (reach + reach.T) / 2.0, (cost + cost.T) / 2.0, more


def _solve_pencil(A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"] | None:
    try:
        return np.asarray(sla.solve_discrete_are(A, B, Q, np.eye(B.shape[1])))
    except (np.linalg.LinAlgError, ValueError):
        return None


def _closed(A: np.ndarray, B: np.ndarray, X: np.ndarray) -> Float[np.ndarray, "state state"]:
    XB = X @ B
    return A - B @ np.linalg.solve(np.eye(B.shape[1]) + B.T @ XB, XB.T @ A)


def _residual(
    X: np.ndarray, A: np.ndarray, B: np.ndarray, Q: np.ndarray
) -> tuple[Float[np.ndarray, "state state"], float]:
    """``inf`` for an X whose terms are beyond numbers, as after a Newton step from far away."""
    with np.errstate(over="ignore", invalid="ignore"):
        XA, XB = X @ A, X @ B
        cross, gram = A.T @ XB, np.eye(B.shape[1]) + B.T @ XB
        if not np.isfinite(gram).all():
            return X, np.inf
        linear, quadratic = A.T @ XA, cross @ np.linalg.solve(gram, cross.T)
        defect = linear - X - quadratic + Q
        terms = sum(float(np.linalg.norm(M)) for M in (linear, X, quadratic, Q))
    if not np.isfinite(terms):
        return defect, np.inf
    return (defect + defect.T) / 2.0, float(np.linalg.norm(defect)) / terms if terms > 0.0 else 0.0
