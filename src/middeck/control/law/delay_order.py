"""Order of the delay approximation that keeps the phase of every mode of a loop."""

import numpy as np

from middeck.control.law.partition import partition_modes
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, poles

System = StateSpace | SampledStateSpace

LEAST_PADE, MOST_PADE = 8, 40
"""Largest order, for 50 radians (800 Hz at 10 ms); beyond, the exact delay is cheaper."""


def pade_order(phase: float) -> int:
    """The order at which a Pade approximation of exp(-j ``phase``) errs by less than 1e-9.

    An all-pass needs an order of half of ``phase`` for an error below one; beyond that order the error falls
    faster than any power. The root term is fitted to errors computed up to 100 radians.

    >>> [pade_order(x) for x in (0.6, 6.0, 25.0)]
    [8, 11, 24]
    """
    return max(LEAST_PADE, int(np.ceil(0.5 * phase + 1.5 * np.sqrt(phase))) + 4)


def phase_of_modes(plant: Plant, law: System | None = None) -> float:
    """Largest frequency of a pole of plant or compensator times the largest delay [rad]."""
    inside = poles(remove_delays(partition_modes(plant).active).system)
    turning = np.abs(np.imag(inside if law is None else np.append(inside, poles(law))))
    return float(turning.max(initial=0.0) * plant.delay_s.max(initial=0.0))


def approximation_order(plant: Plant, law: System | None = None) -> int:
    """Order that keeps the phase of every mode of plant and compensator, at most `MOST_PADE`."""
    return min(pade_order(phase_of_modes(plant, law)), MOST_PADE)


def is_within(order: int, plant: Plant, values: np.ndarray) -> bool:
    """Whether an approximation of ``order`` is valid at the rightmost pole among ``values``."""
    if not len(values):
        return True
    lead = values[np.argmax(np.real(values))]
    return pade_order(float(abs(lead.imag) * plant.delay_s.max(initial=0.0))) <= order
