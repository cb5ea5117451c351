"""Loops at infinite frequency where the delays of their direct terms have no common time.

There the loop comes as near as wanted to every combination of phases of these delays (Kronecker's theorem),
and its limits are the extremes over all of them: found by ascent from the best of a sample.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.optimize as opt
from jaxtyping import Complex, Float, Int

from middeck.control.analysis.loop.feedback_loop import FeedbackLoop
from middeck.control.analysis.loop.returned_wave import ReturnedWave
from middeck.values import record

SAMPLE, STARTS, SEED = 4096, 4, 7
"""Combinations of phases that are tried, and those from which the search ascends."""
STEP = 1e-5
"""Difference of a phase [rad] for a slope."""
REAL = 1e-8
"""Imaginary part of a ratio that counts as real."""
ASCENT = {"maxiter": 200, "ftol": 1e-12}
DIGITS = 12
"""Decimals of a delay, in parts of the longest, that are no rounding."""

Values = Callable[[Complex[np.ndarray, "point output input"]], np.ndarray]
"""Values [point, ...] of the loop where each path has an imaginary lag [rad]."""


@record
class AllPhases:
    """The phases of the distinct delays of direct terms, each free.

    Of delays that are sums of others, as those of inputs and outputs, limits are then on the safe side.

    Attributes:
        path: Number of the delay of each path of the plant, from one; zero for a path without delay.
        count: Number of distinct delays.
    """

    path: Int[np.ndarray, "output input"]
    count: int

    def lag(self, phases: Float[np.ndarray, "point delay"]) -> Complex[np.ndarray, "point output input"]:
        """The imaginary lag of each path."""
        return 1j * np.pad(phases, ((0, 0), (1, 0)))[:, self.path]

    def sample(self) -> Float[np.ndarray, "point delay"]:
        """Combinations spread over all."""
        return np.random.default_rng(SEED).uniform(0.0, 2.0 * np.pi, (SAMPLE, self.count))

    def around(self, phases: Float[np.ndarray, " delay"]) -> Float[np.ndarray, "point delay"]:
        """The phases, then one step further and back for each of them."""
        step = STEP * np.eye(self.count)
        return phases + np.concatenate([np.zeros((1, self.count)), step, -step])


def all_phases(loop: FeedbackLoop, wave: ReturnedWave) -> AllPhases:
    """The phases of a loop's direct terms, those of ``wave``, whose delays may be rounded."""
    delays = np.where(wave.through != 0.0, loop.plant.delay_s, 0.0)
    distinct, path = np.unique(np.append(0.0, delays), return_inverse=True)
    return AllPhases(path.ravel()[1:].reshape(delays.shape), len(distinct) - 1)


def highest_of(phases: AllPhases, size: Values) -> float:
    """The largest of a positive value at each point."""
    tried = phases.sample()
    value = size(phases.lag(tried))

    def fall(x: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = _slopes(-np.log(size(phases.lag(phases.around(x)))))
        return float(value.real), slope

    best = float(value.max())
    for k in np.argsort(-value, kind="stable")[:STARTS]:
        found = opt.minimize(fall, tried[k], jac=True, method="L-BFGS-B", options=ASCENT)
        best = max(best, float(np.exp(-found.fun)))
    return best


def largest_negative(phases: AllPhases, ratio: Values) -> float:
    """The largest size of a ``ratio`` that is real and negative; zero where it is nowhere."""
    tried = phases.sample()
    value = ratio(phases.lag(tried))
    before: dict[bytes, tuple[complex, np.ndarray]] = {}

    def both(x: np.ndarray) -> tuple[complex, np.ndarray]:
        if x.tobytes() not in before:
            before.clear()
            before[x.tobytes()] = _slopes(ratio(phases.lag(phases.around(x))))
        return before[x.tobytes()]

    # Slopes as copies: the search takes them for contiguous.
    real = {"type": "eq", "fun": lambda x: both(x)[0].imag, "jac": lambda x: both(x)[1].imag.copy()}
    best = 0.0
    off = np.real(value) + 2.0 * np.abs(np.imag(value))
    for k in np.argsort(off, kind="stable")[:STARTS]:
        found = opt.minimize(
            lambda x: both(x)[0].real,
            tried[k],
            jac=lambda x: both(x)[1].real.copy(),
            constraints=real,
            method="SLSQP",
            options=ASCENT,
        )
        end = both(found.x)[0]
        if abs(end.imag) < REAL and end.real < 0.0:
            best = max(best, -float(end.real))
    return best


def _slopes(value: np.ndarray) -> tuple[complex, np.ndarray]:
    """The value at the first of the points `AllPhases.around` some phases, and its slopes."""
    ahead, behind = value[1:].reshape(2, -1)
    return value[0], (ahead - behind) / (2.0 * STEP)
