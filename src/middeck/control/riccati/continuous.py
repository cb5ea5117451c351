"""The continuous algebraic Riccati equation, over many decades of intensity.

Balanced Hamiltonian (Benner 2001), ordered real Schur form (Laub 1979), Newton steps (Kleinman 1968); SciPy's
generalised Schur method where the first finds no solution.

Two measures keep the residual at rounding although X B cancels with good sensors: X B R^-1/2 is formed before
it is squared, and Newton's method adds a correction driven by the residual instead of solving afresh, in
coordinates where X has a unit diagonal.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex, Float

from middeck.control.law.stabilisability import CANDIDATE, require_reachable
from middeck.control.riccati.hamiltonian_units import fold_weights, refine, unit_diagonal, unit_scales
from middeck.control.riccati.lyapunov import solve_lyapunov
from middeck.control.riccati.stable_subspace import solve_by_subspace
from middeck.errors import ConfigError, NumericalError
from middeck.values import record

SPOILT = 1e3
"""Residual after refinement in fine units, in units of rounding, above which coarser units are tried too."""
WORTHLESS = 1e-6
"""Relative residual above which there is no solution to return; rounding leaves 1e-15 to 1e-12."""
PROPORTION = 1e3
"""Feedback, relative to A, up to which a closed loop proves that its modes are controllable: to move a pole
by `CANDIDATE` through a coupling of `RANK_FLOOR` (see `stabilisability`) takes ten times as much."""

MISSED = "the cost (or process noise) misses it"
WEIGH_IT = (
    "weigh an output that sees it, and more where its weight is many decades below others; of a filter, let "
    "process noise reach it"
)


@record
class RiccatiSolution:
    """The stabilising solution of a Riccati equation, continuous or of discrete time.

    Attributes:
        X: Symmetric solution.
        gain: K of the regulator u = -K x.
        poles: Eigenvalues of A - BK [rad/s], or in the z-plane.
        residual: Frobenius norm of the left-hand side over the sum of its terms' norms, in the caller's
            coordinates.
    """

    X: Float[np.ndarray, "state state"]
    gain: Float[np.ndarray, "input state"]
    poles: Complex[np.ndarray, " state"]
    residual: float

    def in_units(self, unit: Float[np.ndarray, " state"]) -> RiccatiSolution:
        """The solution of the states x / ``unit``, its residual that of the former units."""
        return dataclasses.replace(self, X=self.X * unit * unit[:, None], gain=self.gain * unit)


def solve_riccati(
    A: Float[np.ndarray, "state state"],
    B: Float[np.ndarray, "state input"],
    Q: Float[np.ndarray, "state state"],
    R: Float[np.ndarray, "input input"],
    S: Float[np.ndarray, "state input"] | None = None,
    *,
    names: Sequence[str] = (),
    complaint: str = "no input reaches it",
) -> RiccatiSolution:
    """Solve A'X + XA - (XB + S) R^-1 (XB + S)' + Q = 0 for the stabilising X.

    ``names`` (one per state) and ``complaint`` (of what B does not reach) are used in errors.
    Raises `NotStabilisableError` naming the modes that B does not reach (real part >= 0) or Q does not see
    (real part = 0), `ConfigError` for R that is not positive definite, `NumericalError` if no method gives a
    stabilising solution.

    >>> solve_riccati(np.eye(1), np.eye(1), 3.0 * np.eye(1), np.eye(1)).X     # 2x - x^2 + 3 = 0
    array([[3.]])
    """
    cross, factor, Abar, Bn, Qbar = fold_weights(A, B, Q, R, S)
    X, remains = _solve_balanced(Abar, Bn, Qbar)
    gain = None if X is None else sla.cho_solve((factor, True), (X @ B + cross).T)
    poles = None if gain is None else np.linalg.eigvals(A - B @ gain).astype(complex)
    if X is None or gain is None or poles is None or _doubtful(poles, gain, A, B):
        require_reachable(Abar, B, names, complaint=complaint)
        require_reachable(Abar.T, Qbar, names, only_axis=True, complaint=MISSED, hint=WEIGH_IT)
    if X is None or gain is None or poles is None:
        raise NumericalError(
            "the Riccati equation has no stabilising solution: its Hamiltonian has poles on the axis",
            hint="check that the cost (or the noise intensity) is positive semidefinite",
        )
    if not np.isfinite(remains) or remains > WORTHLESS or poles.real.max(initial=-1.0) >= 0.0:
        raise NumericalError(
            f"no stabilising Riccati solution: relative residual {remains:.1e}, largest real part "
            f"{poles.real.max(initial=-np.inf):.1e} rad/s",
            hint="bring the weights or intensities closer together",
            residual=remains,
            poles=poles,
        )
    return RiccatiSolution(X, gain, poles, remains)


def _doubtful(poles: np.ndarray, gain: np.ndarray, A: np.ndarray, B: np.ndarray) -> bool:
    """Whether a mode may be uncontrollable or missing from the cost although a solution was found.

    Such a mode keeps its pole under any feedback, or stays on the axis. Poles all clear of the axis exclude
    it, unless an excessive gain moved them through a coupling that is rounding.
    """
    # Between the largest singular value and, of a modal form, not much more.
    size = float(np.sqrt(np.linalg.norm(A, 1) * np.linalg.norm(A, np.inf)))
    near = bool(np.real(poles).max(initial=-np.inf) >= -CANDIDATE * size)
    feedback = float(np.linalg.norm(B, axis=0) @ np.linalg.norm(gain, axis=1))
    return near or feedback > PROPORTION * size


def _solve_balanced(
    A: np.ndarray, B: np.ndarray, Q: np.ndarray
) -> tuple[Float[np.ndarray, "state state"] | None, float]:
    """X of A'X + XA - (XB)(XB)' + Q = 0, and its relative residual."""
    if not np.all(np.isfinite(A)) or not np.all(np.isfinite(B)) or not np.all(np.isfinite(Q)):
        raise ConfigError("the Riccati equation contains a number that is not finite", hint="check the plant")
    t = unit_scales(A, B @ B.T, Q)
    scaled = A * t / t[:, None], B / t[:, None], Q * np.outer(t, t)
    found = solve_by_subspace(scaled[0], scaled[1] @ scaled[1].T, scaled[2])
    found = _solve_pencil(*scaled) if found is None else found
    if found is None:
        return None, np.inf
    unit = unit_diagonal(found)
    fine = t * unit
    units = A * fine / fine[:, None], B / fine[:, None], Q * np.outer(fine, fine)
    refined = _refine(found * np.outer(unit, unit), *units) / np.outer(unit * t, unit * t)
    remains = residual(refined, A, B, Q)[1]
    if remains <= SPOILT * _rounding(A):
        return refined, remains
    # The diagonal of a state without cost is rounding, and a unit derived from it spoils the others.
    coarse = _refine(found, *scaled) / np.outer(t, t)
    other = residual(coarse, A, B, Q)[1]
    return (refined, remains) if remains <= other else (coarse, other)


def _solve_pencil(A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"] | None:
    try:
        return np.asarray(sla.solve_continuous_are(A, B, Q, np.eye(B.shape[1])))
    except (np.linalg.LinAlgError, ValueError):
        return None


def _refine(X: np.ndarray, A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"]:
    return refine(
        X, lambda X: residual(X, A, B, Q), lambda X, defect: _step(X, defect, A, B), least=_rounding(A)
    )


def _rounding(A: np.ndarray) -> float:
    """Relative residual attributable to rounding."""
    return 0.1 * len(A) * float(np.finfo(float).eps)


def residual(
    X: np.ndarray, A: np.ndarray, B: np.ndarray, Q: np.ndarray
) -> tuple[Float[np.ndarray, "state state"], float]:
    """A'X + XA - (XB)(XB)' + Q, and its Frobenius norm relative to the sum of those of its terms.

    ``inf`` for an X whose terms are beyond numbers, as after a Newton step from far away.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        linear, factor = A.T @ X, X @ B
        quadratic = factor @ factor.T
        defect = linear + linear.T - quadratic + Q
        terms = 2.0 * np.linalg.norm(linear) + np.linalg.norm(quadratic) + np.linalg.norm(Q)
    if not np.isfinite(terms):
        return defect, np.inf
    return defect, float(np.linalg.norm(defect) / terms) if terms > 0.0 else 0.0


def _step(X: np.ndarray, defect: np.ndarray, A: np.ndarray, B: np.ndarray) -> np.ndarray | None:
    try:
        step = solve_lyapunov(A - B @ (X @ B).T, defect)
    except np.linalg.LinAlgError:
        return None
    return step if np.all(np.isfinite(step)) else None
