"""Stability of a sampled loop that rounding of the continuous plant leaves open.

Of mixed states the exponential that samples them loses more than their poles do, so that the sampled matrices
alone do not decide: the plant is sampled again with its entries moved by rounding.
"""

import numpy as np

from middeck.control.law.rounding_of_results import DRAWS, is_vague_half, move_half
from middeck.errors import NumericalError
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.stability import growth_limits, growth_rates
from middeck.systems.poles.verdict import CURE, OPEN
from middeck.systems.sampling.sampled_plant import sample_plant
from middeck.systems.state_space.feedback import feedback
from middeck.systems.state_space.statespace import SampledStateSpace

SPREADS = 10.0
"""Distance from the limit of growth, in spreads of the loops so moved, that decides."""


def sample_known(path: Plant, law: SampledStateSpace) -> Plant:
    """The plant from the compensator's outputs to its inputs, sampled at its period.

    Raises `NumericalError` where poles of the plant are vague (`is_vague`), and the loop with ``law`` is not
    `SPREADS` from the limit of growth.
    """
    sampled = sample_plant(path, law.period_s)
    if not is_vague_half(path):
        return sampled
    rng = np.random.default_rng(0)
    moved = [sample_plant(move_half(path, rng), law.period_s) for _ in range(DRAWS)]
    beyond = [_beyond(one, law) for one in (sampled, *moved)]
    if not min(map(abs, beyond)) > SPREADS * (max(beyond) - min(beyond)):
        raise NumericalError(f"stability of the sampled loop cannot be decided: {OPEN}", hint=CURE)
    return sampled


def _beyond(plant: Plant, law: SampledStateSpace) -> float:
    """Excess of the fastest growing pole [rad/s] over the limit; infinite for an overflow."""
    held = plant.sampled
    loop = feedback(held, law, range(held.D.shape[1]), range(len(held.D)))
    if not np.isfinite(loop.A).all():
        return np.inf
    rates = growth_rates(loop)
    return float((np.real(rates) - growth_limits(rates, law.period_s)).max(initial=-np.inf))
