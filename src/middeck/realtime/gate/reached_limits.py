"""What a law may ask for while its sensors stay within their ranges, and the limits that this reaches."""

from __future__ import annotations

import contextlib
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.errors import NumericalError
from middeck.realtime.gate.limited_loop import EPSILON, Parts
from middeck.realtime.package.l1_norms import bound_peaks
from middeck.realtime.package.package import ControllerPackage
from middeck.systems.state_space.balancing import balance

NOISES = np.geomspace(1e-6, 1e6, 7)
"""Of sensors, as shares of their ranges, where outputs take any value within their limits: powers."""
MOST_CONDITION, MOST_ERROR, SETTLINGS = 1e8, 1e-3, 30
SPARE = 1e-6
"""Added to the bound of what the law asks for: the error of that bound, and motions before they settle."""


class Limit(NamedTuple):
    """A limit that is reached: its output, whether it is one of slew, and the k of its sector."""

    output: int
    slew: bool
    sector: float


def bound_commands(
    package: ControllerPackage, parts: Parts, drives: Float[np.ndarray, " output"] | None = None
) -> Float[np.ndarray, " output"]:
    """Most that the law asks of each output once it has settled, with inputs and outputs within ranges.

    From sensors that may jump, as the law alone sees them; and from what an observer of the plant makes of
    inputs and outputs, which is what the sensors read once it has settled: the smoother, the less can jump.
    Each bound holds, and the least is taken. No output comes to exceed what is asked of it, which bounds it
    anew. Raises `NumericalError` without a bound.

    Beside a hold, whose sums the ``drives`` limit: what is asked for by the law itself, then of the sums.
    """
    law, m, n = parts.F - parts.E @ parts.K, len(parts.C), len(parts.A)
    by_y, none = parts.G - parts.E @ parts.D, np.zeros((len(law), m))
    K, D, most = parts.K, parts.D, package.upper
    if drives is not None:
        (own, through), most = parts.own, drives
        K, D = np.vstack([own, K - own]), np.vstack([through, D - through])
    direct = np.hstack([D, np.zeros((len(K), len(parts.K)))])
    peaks = [_peaks(law, np.hstack([by_y, parts.E]), K, direct)]
    for gain in _observers(parts, package.input_range, most):
        F = np.block([[parts.A - gain @ parts.C, np.zeros((n, len(law)))], [by_y @ parts.C, law]])
        G = np.block([[gain, parts.B], [none, parts.E]])
        peaks.append(_peaks(F, G, np.hstack([D @ parts.C, K]), 0.0 * direct))
    with np.errstate(invalid="ignore"):
        for _ in range(SETTLINGS):
            asked = np.min(peaks @ np.concatenate([package.input_range, most]), axis=0)
            if drives is not None:
                commands, hold = np.split(asked, 2)
                asked = np.concatenate([commands, hold + np.minimum(commands, package.upper)])
            most = np.clip(asked[-len(most) :], np.finfo(float).tiny, most)
    if not np.isfinite(asked).all():
        raise NumericalError("what the law asks for has no bound", hint="ranges of inputs, limits")
    return np.asarray(asked)


def _observers(
    parts: Parts, reads: Float[np.ndarray, " input"], drives: Float[np.ndarray, " output"]
) -> list[Float[np.ndarray, "state input"]]:
    """Gains of Kalman predictors, sensors more and less believed; none where there is no such gain."""
    if not len(parts.A):
        return []
    moves, gains = parts.B * drives, []
    for noise in NOISES:
        R = noise * np.diag(reads**2)
        with contextlib.suppress(np.linalg.LinAlgError, ValueError):
            S = sla.solve_discrete_are(parts.A.T, parts.C.T, moves @ moves.T, R)
            gains.append(np.linalg.solve(parts.C @ S @ parts.C.T + R, parts.C @ S @ parts.A.T).T)
    return gains


def _peaks(F: np.ndarray, G: np.ndarray, H: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Largest outputs for inputs of one, with what rounding may add; inf where no bound is found."""
    if not len(F):
        return np.asarray(np.abs(J) * (1.0 + SPARE))
    F, scale = balance(F)
    poles, vectors = np.linalg.eig(F)
    condition, radius = float(np.linalg.cond(vectors)), float(np.abs(poles).max())
    if not (radius < 1.0 and condition < MOST_CONDITION):
        return np.full_like(J, np.inf)
    error = len(F) * EPSILON * (1.0 + np.linalg.norm(F)) * condition * (condition + 8.0 / (1.0 - radius))
    if not error < MOST_ERROR:
        return np.full_like(J, np.inf)
    return np.asarray((1.0 + SPARE + error) * bound_peaks(F, G / scale[:, None], H * scale, J))


def reached_limits(package: ControllerPackage, asked: np.ndarray) -> list[Limit]:
    """Limits that commands of at most ``asked`` reach, and the sectors that these leave them."""
    found = reached_sizes(package.upper, asked)
    steps = asked + np.minimum(asked, package.upper)
    return found + [
        Limit(i, True, 1.0 - s / e) for i, (s, e) in enumerate(zip(package.slew, steps, strict=True)) if e > s
    ]


def reached_sizes(upper: np.ndarray, asked: np.ndarray) -> list[Limit]:
    """Limits of size that commands of at most ``asked`` reach."""
    return [Limit(i, False, 1.0 - L / w) for i, (L, w) in enumerate(zip(upper, asked, strict=True)) if w > L]
