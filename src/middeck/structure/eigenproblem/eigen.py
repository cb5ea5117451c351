"""Natural modes of a symmetric pair, all of them (dense) or the lowest few (sparse).

Both solve M phi = mu (K + sigma M) phi. The direct problem leaves rounding of 1e-16 times the largest omega^2
(1e13 here) on the smallest; its inverse is accurate where the interest lies (Parlett 1980, section 15).
Motions without mass have mu = 0 and are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from jaxtyping import Bool, Float

from middeck.errors import NumericalError
from middeck.structure.assembly.factorisation import Factor, factorise, order, positive_factor
from middeck.structure.eigenproblem.stiff_modes import part_stiff_modes

# A mode is rigid whose energy is below this part of the sum of the absolute terms that cancel in it. Rounding
# leaves 1e-17 on the two articles; a 0.02 Hz restraint on them leaves 1e-10.
ROUNDING = 1e-14
# Part of the terms that cancel: less is no mass, and no stiffness. Rounding would decide whether matrices
# with neither are positive definite, and so whether there are modes.
NOTHING = 1e-12
# Shifts tried, each ten times the one before, until K + sigma M is positive definite.
SHIFTS = 20
# A shift serves modes whose omega^2 is between its thousandth and its thousandfold to thirteen digits.
RUNG = 1e6
# Modes whose omega^2 is so many shifts high have so many roundings of others in their shapes.
COARSE = 1e2
# Modes sought beyond those asked for: among them the Sturm count looks for the widest gap.
SPARE = 8
# Part of omega^2 that is no gap: a Sturm count in it would be rounding.
ONE_FREQUENCY = 1e-9
SEED = 1993
# Most rounds of search for what is missing: repeated modes of so many equal parts.
ROUNDS = 60
# Relative residual of a shape; its frequency is as good as the square of it.
LANCZOS = 1e-10

# Up to so many coordinates all modes cost less than a few.
SMALL = 600

Soft = Bool[np.ndarray, " n"] | None


class Eigenpairs(NamedTuple):
    """Ascending lambda = omega^2, mass-normalised shapes in columns, and the rounding of each lambda."""

    lam: Float[np.ndarray, " mode"]
    shapes: Float[np.ndarray, "n mode"]
    noise: Float[np.ndarray, " mode"]

    def pick(self, some: slice | np.ndarray) -> Eigenpairs:
        """Some of the modes, by number."""
        return Eigenpairs(self.lam[some], self.shapes[:, some], self.noise[some])

    def beside(self, others: Eigenpairs) -> Eigenpairs:
        """These modes, then the others."""
        both = zip(self, others, strict=True)
        return Eigenpairs(*(np.concatenate(pair, axis=-1) for pair in both))


def all_cost_less(K: sp.csr_array, count: int = 0) -> bool:
    """Whether all modes cost less to compute than the lowest ``count``."""
    return order(K) <= max(SMALL, 4 * count)


def solve_pairs(K: sp.csr_array, M: sp.csr_array, count: int | None, soft: Soft = None) -> Eigenpairs | None:
    """The lowest ``count`` modes or more, all for None; None if a massless motion has no stiffness."""
    if count is None or all_cost_less(K, count):
        return solve_all(K, M, soft, sharp=count)
    return solve_lowest(K, M, count, soft)


def solve_all(
    K: sp.csr_array, M: sp.csr_array, soft: Soft = None, *, sharp: int | None = None
) -> Eigenpairs | None:
    """Every mode of finite frequency; None where a massless motion has no stiffness either.

    The ``sharp`` lowest, all by default, have shapes to rounding; those of the stiffest others may be coarse.
    ``soft`` marks the coordinates in which the low modes move, all of them by default: in carried ones,
    strains of stiff parts are many powers of ten above, and a ladder of shifts serves all.
    """
    sigma, last = _least_shift(K, M, 1e-9, soft), _least_shift(K, M, 1e-9, None)
    found = _solve_shifted(K, M, sigma)
    while found is not None and sigma < last:
        before, sigma = sigma, min(sigma * RUNG, last)
        higher = _solve_shifted(K, M, sigma)
        found = higher and _join(found, higher, np.sqrt(before * sigma))
    return found and _sharpen(K, M, found, sigma, len(found.lam) if sharp is None else sharp)


def _sharpen(K: sp.csr_array, M: sp.csr_array, pairs: Eigenpairs, sigma: float, count: int) -> Eigenpairs:
    """The modes, of which the lowest ``count`` have shapes to rounding where they are far above ``sigma``."""
    stiff = np.zeros(len(pairs.lam), bool)
    stiff[:count] = pairs.lam[:count] ** 2 > COARSE * sigma * pairs.noise[:count] / ROUNDING
    lam, X = part_stiff_modes(K, M, pairs.lam, pairs.shapes, stiff)
    return Eigenpairs(lam, X, pairs.noise).pick(np.argsort(lam, kind="stable"))


def _join(low: Eigenpairs, high: Eigenpairs, at: float) -> Eigenpairs:
    """The modes of the one below ``at``, by their number, and those of the other above."""
    first = min(int(np.sum(low.lam < at)), len(low.lam), len(high.lam))
    return low.pick(slice(first)).beside(high.pick(slice(first, None)))


def _solve_shifted(K: sp.csr_array, M: sp.csr_array, sigma: float) -> Eigenpairs | None:
    dense, mass = K.toarray(), M.toarray()
    for _ in range(SHIFTS):
        try:
            mu, phi = sla.eigh(mass, dense + sigma * mass)
        except sla.LinAlgError:  # an unstable state: shift beyond its growth rate
            sigma *= 10.0
            continue
        if _moves_nothing(K, M, sigma, lambda b, phi=phi: phi @ (phi.T @ b)):
            return None
        # A motion without mass has rounding for mu, and less in its own kinetic energy.
        own = np.minimum(mu, np.einsum("im,im->m", phi, mass @ phi))
        moved = own > len(mu) * np.finfo(float).eps * mu[-1]
        return _refine(K, M, 1.0 / mu[moved][::-1] - sigma, phi[:, moved][:, ::-1], sigma)
    return None


def _moves_nothing(
    K: sp.csr_array, M: sp.csr_array, sigma: float, inverse: Callable[[np.ndarray], np.ndarray]
) -> bool:
    """Whether the motion that K + sigma M resists least, for its coordinates, has neither mass nor stiffness.

    ``inverse`` solves with that matrix: three steps of inverse iteration leave that motion alone.
    """
    size = np.sqrt(np.abs(K.diagonal() + sigma * M.diagonal()))
    x = np.random.default_rng(SEED).standard_normal(order(K))
    for _ in range(3):
        x = size * inverse(size * x)
        x = x / np.linalg.norm(x)
    v = x / np.where(size > 0.0, size, 1.0)
    return all(abs(v @ (A @ v)) <= NOTHING * (np.abs(v) @ (abs(A) @ np.abs(v))) for A in (K, M))


def solve_lowest(K: sp.csr_array, M: sp.csr_array, count: int, soft: Soft = None) -> Eigenpairs | None:
    """The ``count`` lowest modes by shifted and inverted Lanczos iteration, none left out.

    A Sturm count (a second factorisation, between two modes) proves that none is missing: Lanczos iteration
    with one vector may overlook one of a cluster. Overlooked modes are then sought orthogonal to those found,
    again and again: each round finds one more of every repeated mode. Raises `NumericalError` where
    the count is still not reached.
    """
    sigma = _least_shift(K, M, 1e-12, soft)
    for _ in range(SHIFTS):
        factor = positive_factor(sp.csr_array(K + sigma * M))
        if factor is not None:
            break
        sigma *= 10.0
    else:
        return None
    if _moves_nothing(K, M, sigma, factor.solve):
        return None
    wanted = min(count + SPARE, order(K) - 2)
    pairs = _lanczos(K, M, factor, sigma, wanted, None)
    for _ in range(ROUNDS):
        missing = _missing(K, M, pairs.lam, count)
        if missing == 0:
            return pairs.pick(slice(count))
        if missing < 0:
            break
        more = min(missing + 2, order(K) - len(pairs.lam) - 2)
        pairs = pairs.beside(_lanczos(K, M, factor, sigma, more, pairs.shapes))
        pairs = pairs.pick(np.argsort(pairs.lam, kind="stable"))
    raise NumericalError(
        f"the iteration for the {count} lowest modes leaves some out",
        hint="ask for a few modes more, or for all of them (count=None) if the model is small",
    )


def count_zero(K: sp.csr_array, M: sp.csr_array, soft: Soft = None) -> int:
    """Number of modes whose omega^2 is zero but for rounding, by a Sturm count just above zero."""
    shift = 1e-12 * _largest_ratio(K, M, soft) or 1.0
    factor = factorise(sp.csr_array(K - shift * M))
    if factor is None or factor.negative < 0:
        raise NumericalError(
            "the number of rigid-body modes could not be counted",
            hint="a motion without mass or stiffness? ask for all modes (count=None) of a coarser mesh",
        )
    return factor.negative


def _largest_ratio(K: sp.csr_array, M: sp.csr_array, soft: Soft) -> float:
    here = slice(None) if soft is None or not np.any(soft) else soft
    return float(np.abs(K.diagonal()[here]).max() / np.abs(M.diagonal()[here]).max())


def _least_shift(K: sp.csr_array, M: sp.csr_array, part: float, soft: Soft) -> float:
    return part * _largest_ratio(K, M, soft) + 1.0


def _lanczos(
    K: sp.csr_array, M: sp.csr_array, factor: Factor, sigma: float, count: int, known: np.ndarray | None
) -> Eigenpairs:
    """The ``count`` lowest modes, or the lowest that are orthogonal to the ``known`` ones."""
    weighted = None if known is None else M @ known

    def apart(x: np.ndarray) -> np.ndarray:
        return x if known is None or weighted is None else x - known @ (weighted.T @ x)

    def inverse(b: np.ndarray) -> np.ndarray:
        return apart(factor.solve(b))

    n, found = order(K), 0 if known is None else known.shape[1]
    lam, phi = spla.eigsh(
        K,
        k=count,
        M=M,
        sigma=-sigma,
        OPinv=spla.LinearOperator((n, n), matvec=inverse, dtype=float),  # ty: ignore
        v0=apart(np.random.default_rng(SEED + found).standard_normal(n)),
        ncv=min(n - found, count + count // 2 + 10),
        maxiter=50 * count,
        tol=LANCZOS,
    )
    ascending = np.argsort(lam)
    return _refine(K, M, lam[ascending], apart(phi[:, ascending]), sigma)


def _refine(K: sp.csr_array, M: sp.csr_array, lam: np.ndarray, phi: np.ndarray, sigma: float) -> Eigenpairs:
    phi = phi / np.sqrt(np.abs(np.einsum("im,im->m", phi, M @ phi)))  # may be negative by rounding
    size = np.einsum("im,im->m", np.abs(phi), abs(K) @ np.abs(phi))
    # The inverse rounds to eps lam^2 / sigma, the Rayleigh quotient to eps size: take the finer.
    high = lam**2 > sigma * size
    lam[high] = np.einsum("im,im->m", phi[:, high], K @ phi[:, high])
    # Near zero every coordinate rounds the inverse.
    return Eigenpairs(lam, phi, ROUNDING * (size + len(phi) * sigma))


def _missing(K: sp.csr_array, M: sp.csr_array, lam: np.ndarray, count: int) -> int:
    """Modes below the widest gap at or after number ``count`` that are not in the list; -1 if undecided.

    A list that ends within one frequency has no gap to count at: `SPARE` more are wanted.
    """
    gap = np.diff(lam[count - 1 :])
    last = count - 1 + int(np.argmax(gap))
    if len(lam) < order(K) - SPARE and gap.max() <= ONE_FREQUENCY * abs(lam[last + 1]):
        return SPARE
    factor = factorise(sp.csr_array(K - 0.5 * (lam[last] + lam[last + 1]) * M))
    return -1 if factor is None or factor.negative < 0 else factor.negative - (last + 1)
