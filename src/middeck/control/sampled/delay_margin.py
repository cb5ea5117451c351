"""How much later a path may be before a sampled loop is lost.

A further delay of n whole periods multiplies L(exp(j w T)) by exp(-j w n T). One of a part of a period does
not: each mode turns at its own frequency, also beyond half the rate, where its image may turn the other way.
So the plant is sampled anew at every delay.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from middeck.systems.statespace import StateSpace, poles

TURN = 0.5
"""Of the fastest light mode from one delay tried to the next [rad]: a loop of the mode alone that is unstable
over less of its turn, 2 arccos(1/L), lacks 3 % of gain."""
LOOKED = 20
"""Periods that are looked through where no frequency of unit gain says how far to look."""


def find_delay_limit(
    stable_at: Callable[[float], bool], system: StateSpace, period_s: float, guess_s: float
) -> float:
    """The least further delay [s] at which ``stable_at`` says no; ``inf`` where none is found.

    Looked for up to the first whole number of periods after ``guess_s`` that is unstable.
    """
    end = _far_enough(stable_at, period_s, guess_s)
    tried = np.linspace(0.0, end, int(np.ceil(end / _step(system, period_s))) + 1)
    for low, high in pairwise(float(t) for t in tried):
        if not stable_at(high):
            return _narrow(stable_at, low, high)
    return np.inf


def _far_enough(stable_at: Callable[[float], bool], period_s: float, guess_s: float) -> float:
    """By Nyquist's criterion the loop is unstable at some whole number of periods if unit gain is passed."""
    first = int(np.ceil(guess_s / period_s)) if np.isfinite(guess_s) else 0
    late = (n for n in range(first, first + LOOKED) if not stable_at(n * period_s))
    return period_s * next(late, first + LOOKED)


def _step(system: StateSpace, period_s: float) -> float:
    rates = np.asarray(poles(system))
    turning = np.abs(np.imag(rates))
    light = turning[turning > np.abs(np.real(rates))]
    return min(period_s, TURN / float(light.max(initial=TURN / period_s)))


def _narrow(stable_at: Callable[[float], bool], low: float, high: float) -> float:
    """The upper end, halved to a part in 1e9."""
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable_at(middle) else (low, middle)
    return high
