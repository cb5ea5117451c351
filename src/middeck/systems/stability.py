"""Stability, by eigenvalues and nothing else.

Past an instability a frequency integral stays finite and looks good; so no norm ever answers this question.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex

from middeck.systems.statespace import SampledStateSpace, StateSpace, poles

GROWTH_LIMIT = 1e-8
"""Largest real part [rad/s] that still counts as stable: above rounding at an undamped pole, far below any
growth that an experiment could show (a factor e in three years)."""


def growth_rates(system: StateSpace | SampledStateSpace) -> Complex[np.ndarray, " state"]:
    """Poles in rad/s; those of a sampled system are mapped by log(p)/T (a pole at zero to -inf).

    >>> growth_rates(StateSpace([[-2.0]], [[1.0]], [[1.0]], [[0.0]])).real
    array([-2.])
    """
    p = poles(system)
    if isinstance(system, StateSpace):
        return p
    size = np.abs(p)
    rate = np.full(len(p), -np.inf)
    np.log(size, out=rate, where=size > 0.0)
    rates = np.empty(len(p), dtype=complex)
    rates.real, rates.imag = rate / system.period_s, np.angle(p) / system.period_s
    return rates


def is_stable(system: StateSpace | SampledStateSpace) -> bool:
    """True where no pole grows faster than `GROWTH_LIMIT`; a system without states is stable.

    >>> is_stable(StateSpace([[0.1]], [[1.0]], [[1.0]], [[0.0]]))
    False
    """
    return none_grows(growth_rates(system))


def none_grows(rates: Complex[np.ndarray, " state"]) -> bool:
    """The same, asked of poles [rad/s] that are known already.

    >>> none_grows(np.array([-1.0 + 2.0j, -1.0 - 2.0j]))
    True
    """
    return not len(rates) or bool(np.real(rates).max() <= GROWTH_LIMIT)
