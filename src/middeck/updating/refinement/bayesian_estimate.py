"""Linear estimate of unknowns and of the model's own errors, each with its prior.

    y = J x + S d + e,    x ~ N(m, spread^2),  d_j ~ N(0, tau_j^2),  e ~ N(0, std^2)

y is what was measured, in logarithms, S how much each measured mode shares of the modes whose own errors d
the model cannot take away (its mesh, its joints). tau is what makes y most probable (type II maximum
likelihood, MacKay 1992, Neural Computation 4). All by orthogonal factors: of y, J and S each divided by
deviations (Bjorck 1996, "Numerical methods for least squares problems", 2.7).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import scipy.linalg as sla
import scipy.optimize as opt
from jaxtyping import Bool, Float, Int
from scipy.special import erf, ndtr, ndtri

from middeck.values import record

# Model errors in the logarithm of a frequency between which the most probable is looked for; one that is
# thought larger before is looked for up to four times as much.
LEAST, MOST, TIMES = 1e-6, 0.1, 4.0
# A good mesh and good joints leave 0.03 % of a frequency, give or take a factor of three.
USUAL, FACTOR = 3e-4, 3.0
SWEEPS, GRID = 3, 24
KNOWN = -1
# Factors of e about the most probable, and points there, over which it is uncertain; what an interval holds.
AWAY, POINTS = 4.0, 41
HELD, NORMAL_95 = 0.95, 1.959964
# A mean that is so many deviations below zero is no chance.
BELOW = 2.0


@record(kw_only=True)
class Linear:
    """The problem, the mean of the prior taken from y.

    Attributes:
        y: Residuals at the mean of the prior.
        std: Standard deviation of each by the noise of the test.
        J: Slopes by the unknowns, of which ``spread`` are the prior deviations.
        S: Share of each of the model's own errors in each row.
        rest: Variance of each row by errors that no other row shares.
        sort, row_sort: Sort of each error, and of the rest of each row, from 0: one sort has one tau; `KNOWN`
            for an error whose size is known, and in S: its deviation is one.
        sorts: Number of sorts, with those that no row has.
    """

    y: Float[np.ndarray, " row"]
    std: Float[np.ndarray, " row"]
    J: Float[np.ndarray, "row unknown"]
    spread: Float[np.ndarray, " unknown"]
    S: Float[np.ndarray, "row error"]
    rest: Float[np.ndarray, " row"]
    sort: Int[np.ndarray, " error"]
    row_sort: Int[np.ndarray, " row"]
    sorts: int


@record(kw_only=True)
class Estimate:
    """Mean of x and of d, and a root of their covariance: that is ``root @ root.T``.

    Attributes:
        tau: Standard deviation of the model's errors, one a sort.
        gain: Singular values of what the data say of each direction of the prior, which ``direction`` has in
            its rows: below one the data add less than was known.
    """

    x: Float[np.ndarray, " unknown"]
    d: Float[np.ndarray, " error"]
    root: Float[np.ndarray, "both both"]
    tau: Float[np.ndarray, " sort"]
    gain: Float[np.ndarray, " direction"]
    direction: Float[np.ndarray, "direction unknown"]

    @property
    def x_std(self) -> Float[np.ndarray, " unknown"]:
        """Standard deviations of the unknowns."""
        return np.sqrt(np.einsum("ij,ij->i", self.root, self.root))[: len(self.x)]


def estimate(problem: Linear, usual: float | Float[np.ndarray, " sort"] = USUAL) -> Estimate:
    """The most probable tau, and x and d with it; ``usual`` is the prior median of tau."""
    return estimate_at(problem, most_probable(problem, usual))


def estimate_at(problem: Linear, tau: Float[np.ndarray, " sort"]) -> Estimate:
    """The most probable x and d, the errors of the model being as large as ``tau``."""
    std = _deviations(problem, tau)
    n, m = len(problem.spread), len(problem.sort)
    scale = np.concatenate([problem.spread, _sizes(problem, tau)])
    A = np.hstack([problem.J, problem.S]) * scale / std[:, None]
    Q, R = np.linalg.qr(np.vstack([A, np.eye(n + m)]))
    z = sla.solve_triangular(R, Q[: len(A)].T @ (problem.y / std))
    root = scale[:, None] * sla.solve_triangular(R, np.eye(n + m))
    # What data say of x alone, the model's own errors counted as noise.
    noise = np.linalg.cholesky(_of_the_rest(problem, tau))
    _, gain, direction = np.linalg.svd(
        sla.solve_triangular(noise, problem.J * problem.spread, lower=True), full_matrices=True
    )
    gain = np.concatenate([gain, np.zeros(n - len(gain))])
    return Estimate(x=(scale * z)[:n], d=(scale * z)[n:], root=root, tau=tau, gain=gain, direction=direction)


def most_probable(
    problem: Linear, usual: float | Float[np.ndarray, " sort"] = USUAL
) -> Float[np.ndarray, " sort"]:
    """The most probable tau of each sort, with a lognormal prior about ``usual``."""

    most = np.maximum(MOST, TIMES * np.broadcast_to(usual, problem.sorts))
    best = np.full(problem.sorts, np.log(LEAST))
    of_unknowns = _of_unknowns(problem)
    for k in list(range(problem.sorts)) * SWEEPS:
        grid = np.linspace(np.log(LEAST), np.log(most[k]), GRID)
        along = _surprise_along(problem, usual, of_unknowns, np.exp(best), k)
        i = int(np.argmin([along(g) for g in grid]))
        bounds = grid[max(i - 1, 0)], grid[min(i + 1, GRID - 1)]
        found = opt.minimize_scalar(along, bounds=bounds, method="bounded", options={"xatol": 1e-3})
        best[k] = cast("Any", found).x
    return np.exp(best)


def unseen_deviations(
    problem: Linear, tau: Float[np.ndarray, " sort"], usual: float | Float[np.ndarray, " sort"] = USUAL
) -> Float[np.ndarray, " sort"]:
    """Standard deviations of errors that no test measured: 95 % intervals that allow for an uncertain tau.

    Few modes hardly determine tau, and the most probable one is too small for errors that they do not show.
    ``tau`` are the most probable; each is freed by itself, the others held.
    """
    of_unknowns, away = _of_unknowns(problem), np.linspace(-AWAY, AWAY, POINTS)
    out = np.empty(len(tau))
    for k, own in enumerate(tau.tolist()):
        surprise = _surprise_along(problem, usual, of_unknowns, tau, k)
        cost = np.array([surprise(np.log(own) + far) for far in away])
        weight = np.exp(cost.min() - cost)
        scale = own * np.exp(away)

        def short(q: float, weight: np.ndarray = weight, scale: np.ndarray = scale) -> float:
            return float(weight @ erf(q / (np.sqrt(2.0) * scale)) / weight.sum() - HELD)

        out[k] = opt.root_scalar(short, bracket=(scale[0], 4.0 * scale[-1])).root / NORMAL_95
    return out


def cut_below(
    n: Float[np.ndarray, " both"], along: Float[np.ndarray, " both"], mean: float
) -> Float[np.ndarray, " both"]:
    """Standard normal numbers at which ``mean`` + ``along`` @ n is not negative, from ``n`` without this.

    They move along ``along`` alone, to the same quantile of the truncated distribution; not where the mean is
    `BELOW`.
    """
    size = float(np.linalg.norm(along))
    if mean < -BELOW * size or not size:
        return n
    at = float(along @ n) / size
    return n + along / size * (-float(ndtri(ndtr(mean / size) * ndtr(-at))) - at)


def excess(problem: Linear, found: Estimate, rows: Bool[np.ndarray, " row"]) -> float:
    """Rms residual of ``rows`` over that expected from noise and ``found.tau``.

    The residuals r have the covariance N C^-1 N, N that of the noise and C that of y. Zero where the estimate
    takes up all but a part of one row.
    """
    std = _deviations(problem, found.tau)
    left = (problem.y - problem.J @ found.x - problem.S @ found.d) / std
    C = _of_the_rest(problem, found.tau) + _of_unknowns(problem)
    root = sla.solve_triangular(np.linalg.cholesky(C), np.diag(std)[:, rows], lower=True)
    free = float(np.sum(root**2))
    return float(np.linalg.norm(left[rows])) / np.sqrt(free) if free >= 1.0 else 0.0


def errors_shown(problem: Linear, tau: Float[np.ndarray, " sort"]) -> Bool[np.ndarray, " sort"]:
    """Whether the tests determine the model's errors of each sort, or only their prior does.

    They do where without them y is less likely by more than chance lets expect (ratio of likelihoods, 95 %).
    """
    none, unlikely = np.where(np.eye(len(tau), dtype=bool), LEAST, tau), _unlikely_of(problem)
    return np.array([unlikely(row) - unlikely(tau) > 0.5 * NORMAL_95**2 for row in none])


def unlikely(problem: Linear, tau: Float[np.ndarray, " sort"]) -> float:
    """Minus the log likelihood of ``tau``, up to a constant."""
    return _unlikely_of(problem)(tau)


def _unlikely_of(problem: Linear) -> Callable[[Float[np.ndarray, " sort"]], float]:
    """Minus the logarithm of the likelihood of tau."""
    of_unknowns = _of_unknowns(problem)

    def unlikely(tau: np.ndarray) -> float:
        return _of_normal(_of_the_rest(problem, tau) + of_unknowns, problem.y)

    return unlikely


def _surprise_along(
    problem: Linear,
    usual: float | Float[np.ndarray, " sort"],
    of_unknowns: Float[np.ndarray, "row row"],
    tau: Float[np.ndarray, " sort"],
    k: int,
) -> Callable[[float], float]:
    """Minus the logarithm of the posterior of the logarithm of ``tau[k]``, the others held."""
    held = _of_the_rest(problem, np.where(np.arange(len(tau)) == k, 0.0, tau)) + of_unknowns
    shared = problem.S[:, problem.sort == k]
    own = shared @ shared.T + np.diag(problem.rest * (problem.row_sort == k))
    likely = np.log(np.broadcast_to(usual, len(tau))[k])

    def surprise(log_tau: float) -> float:
        before = 0.5 * ((log_tau - likely) / np.log(FACTOR)) ** 2
        return _of_normal(held + np.exp(2.0 * log_tau) * own, problem.y) + before

    return surprise


def _of_normal(C: Float[np.ndarray, "row row"], y: Float[np.ndarray, " row"]) -> float:
    """Minus the logarithm of the density of ``y``, but for a constant; the covariance C is overwritten."""
    # A thousand times a refinement, of some fifty rows: NumPy's and SciPy's own checks take longer.
    lapack: Any = sla.lapack
    root, failed = lapack.dpotrf(C.T, lower=True, clean=False, overwrite_a=True)
    if failed:
        raise np.linalg.LinAlgError("a covariance of what was measured is not positive definite")
    white, _ = lapack.dtrtrs(root, y, lower=True)
    return float(np.log(root.diagonal()).sum() + 0.5 * white @ white)


def _deviations(problem: Linear, tau: np.ndarray) -> np.ndarray:
    return np.sqrt(problem.std**2 + problem.rest * tau[problem.row_sort] ** 2)


def _sizes(problem: Linear, tau: np.ndarray) -> np.ndarray:
    """Deviation of each error."""
    return np.where(problem.sort == KNOWN, 1.0, tau[problem.sort])


def _of_unknowns(problem: Linear) -> np.ndarray:
    scaled = problem.J * problem.spread
    return scaled @ scaled.T


def _of_the_rest(problem: Linear, tau: np.ndarray) -> np.ndarray:
    """Covariance of y by noise and the model's errors."""
    shared = problem.S * _sizes(problem, tau)
    return np.diag(_deviations(problem, tau) ** 2) + shared @ shared.T
