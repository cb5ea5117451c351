"""Samplers: cases of named parameters, the same in any order and on any number of workers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

from middeck.campaign.cases import Case, case_seed
from middeck.campaign.distributions import Distribution, Uniform, from_normal
from middeck.errors import ConfigError
from middeck.values import record

MOST_CASES = 1_000_000
"""A factorial design of more is a mistake."""
MOST_SOBOL = 21_201
"""Parameters for which Sobol directions are tabulated (Joe and Kuo 2008)."""
LEAST_PIVOT = 1e-12
"""Pivot of a correlation matrix below which a parameter follows from those before it."""


@record
class Parameter:
    """A named number and its distribution."""

    name: str
    distribution: Distribution


@record
class Group:
    """Parameters that vary together: rank correlation by a normal copula.

    ``correlation``: of the normal numbers behind each pair, unless a ``matrix`` is given. 1: all at the same
    quantile; -1 (of two): at opposite ones.
    """

    names: tuple[str, ...]
    correlation: float = 1.0
    matrix: Float[np.ndarray, "member member"] | None = None


def monte_carlo(
    parameters: Sequence[Parameter], count: int, *, seed: int, groups: Sequence[Group] = ()
) -> tuple[Case, ...]:
    """Independent draws; more cases of the same seed begin with the same cases.

    >>> [c.index for c in monte_carlo([Parameter("mass", Uniform(1.0, 2.0))], 2, seed=1)]
    [0, 1]
    """
    _check(parameters, count)
    draws = [np.random.default_rng(case_seed(seed, k)).random(len(parameters)) for k in range(count)]
    return _cases(parameters, np.reshape(draws, (count, len(parameters))), seed, groups)


def latin_hypercube(
    parameters: Sequence[Parameter], count: int, *, seed: int, groups: Sequence[Group] = ()
) -> tuple[Case, ...]:
    """One draw in each of ``count`` equally likely strata of each parameter (McKay and others 1979).

    A correlation below 1 in a group leaves the strata of its first member alone exact.
    """
    _check(parameters, count)
    from scipy.stats import qmc  # a second of import that no worker needs

    points = qmc.LatinHypercube(len(parameters), **_stream(seed)).random(count)
    return _cases(parameters, points, seed, groups)


def sobol(
    parameters: Sequence[Parameter], count: int, *, seed: int, groups: Sequence[Group] = ()
) -> tuple[Case, ...]:
    """Scrambled Sobol points (Owen 1998); balanced where ``count`` is a power of two, as it must be."""
    _check(parameters, count)
    if count & (count - 1) or len(parameters) > MOST_SOBOL:
        raise ConfigError(
            f"{count} Sobol points of {len(parameters)} parameters",
            hint=f"a power of two, as {1 << (count - 1).bit_length()}, and at most {MOST_SOBOL} parameters",
        )
    from scipy.stats import qmc  # a second of import that no worker needs

    points = qmc.Sobol(len(parameters), scramble=True, **_stream(seed)).random_base2(count.bit_length() - 1)
    return _cases(parameters, points, seed, groups)


def full_factorial(
    parameters: Sequence[Parameter],
    levels: int = 2,
    *,
    seed: int = 0,
    groups: Sequence[Group] = (),
    deviations: float = 3.0,
) -> tuple[Case, ...]:
    """All combinations of equidistant levels, the first parameter slowest; two levels are the corners.

    Levels span the range of a `Uniform`, and +- ``deviations`` of the normal number behind any other
    distribution. A group moves as one; its correlations must be 1 or -1.
    """
    _check(parameters, 1)
    mixing = _mixing(parameters, groups)
    if not np.isin(mixing, (-1.0, 0.0, 1.0)).all():
        raise ConfigError("corners of partly correlated parameters", hint="a correlation of 1 or -1, or none")
    free = np.flatnonzero(mixing.any(axis=0))
    if levels < 2 or not deviations > 0.0 or levels ** len(free) > MOST_CASES:
        raise ConfigError(
            f"{levels} levels of {len(free)} parameters at {deviations:g} deviations",
            hint=f"two levels or more, deviations > 0 and {MOST_CASES} cases at most",
        )
    grid = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, levels)] * len(free), indexing="ij"), axis=-1)
    signed = grid.reshape(-1, len(free)) @ mixing[:, free].T
    values = [
        d.low + (d.high - d.low) * (0.5 + 0.5 * s)
        if isinstance(d, Uniform)
        else from_normal(d, deviations * s)
        for d, s in zip([p.distribution for p in parameters], signed.T, strict=True)
    ]
    return _named(parameters, np.transpose(values), seed)


def _check(parameters: Sequence[Parameter], count: int) -> None:
    names = [p.name for p in parameters]
    if not names or len(set(names)) < len(names):
        raise ConfigError(
            f"parameters {', '.join(names) or 'missing'}", hint="at least one, with different names"
        )
    if count < 1:
        raise ConfigError(f"{count} cases", hint="at least one")


def _stream(seed: int) -> dict[str, Any]:
    """Random numbers of the design as a whole, apart from those of the cases."""
    return {"seed": np.random.default_rng(np.random.SeedSequence(seed))}


def _cases(
    parameters: Sequence[Parameter], points: np.ndarray, seed: int, groups: Sequence[Group]
) -> tuple[Case, ...]:
    # The ends have no finite normal number.
    inside = np.clip(points, 2.0**-54, 1.0 - 2.0**-53)
    mixing = _mixing(parameters, groups)
    # Summed term by term, as the last digits must not depend on BLAS: a campaign's hash is of all digits.
    normal = [
        sum(z * share for z, share in zip(ndtri(inside).T, row, strict=True) if share) for row in mixing
    ]
    values = [from_normal(p.distribution, np.asarray(z)) for p, z in zip(parameters, normal, strict=True)]
    return _named(parameters, np.transpose(values), seed)


def _named(parameters: Sequence[Parameter], values: np.ndarray, seed: int) -> tuple[Case, ...]:
    names = tuple(p.name for p in parameters)
    return tuple(Case(k, case_seed(seed, k), names, row) for k, row in enumerate(values))


def _mixing(parameters: Sequence[Parameter], groups: Sequence[Group]) -> Float[np.ndarray, "name name"]:
    """Lower factor of the correlation matrix of all parameters."""
    names = [p.name for p in parameters]
    grouped = [n for g in groups for n in g.names]
    if len(set(grouped)) < len(grouped) or not set(grouped) <= set(names):
        raise ConfigError(
            f"groups of {', '.join(grouped)}", hint=f"each in one group at most, of {', '.join(names)}"
        )
    mixing = np.eye(len(names))
    for group in groups:
        at = [names.index(n) for n in group.names]
        mixing[np.ix_(at, at)] = _factor(group)
    return mixing


def _factor(group: Group) -> np.ndarray:
    """Cholesky's factor, also of a singular matrix."""
    size = len(group.names)
    R = np.eye(size) + group.correlation * (1.0 - np.eye(size)) if group.matrix is None else group.matrix
    L = np.zeros((size, size))
    fits = R.shape == L.shape and bool(
        np.all(R == R.T) and np.all(np.diag(R) == 1.0) and np.all(abs(R) <= 1.0)
    )
    for k in range(size if fits else 0):
        pivot = R[k, k] - math.fsum(L[k, :k] ** 2)
        if pivot > LEAST_PIVOT:
            L[k, k] = math.sqrt(pivot)
            L[k + 1 :, k] = [(R[i, k] - math.fsum(L[i, :k] * L[k, :k])) / L[k, k] for i in range(k + 1, size)]
        fits = fits and pivot > -LEAST_PIVOT
    if not fits or np.abs(L @ L.T - R).max(initial=0.0) > math.sqrt(LEAST_PIVOT):
        raise ConfigError(
            f"the correlation of {', '.join(group.names)} is none",
            hint="symmetric, ones on the diagonal, no negative eigenvalue",
        )
    return L
