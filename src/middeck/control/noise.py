"""Rms of a continuous or sampled loop, with or without delays, under process and sensor noise."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.control.h2.generalized_plant import generalize
from middeck.control.h2.noise_rms import NoiseOutcome, integrate_noise
from middeck.control.law.compensator import Compensator, arrange_ports, driven_ports, measured_ports
from middeck.control.law.rounding_of_results import measure_known
from middeck.control.lqg.weights import LQGWeights
from middeck.control.robust.verification.exact_family import family_law, measure_in_family
from middeck.control.sampled.sampled_loop import measure_held
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.poles.stability import growth_limit

FEW_LINES = 2000
"""Lines that cost less than roots; compensators of high authority would need more."""


@named_kinds
def measure_noise_rms(plant: Plant, compensator: Compensator, weights: LQGWeights) -> NoiseOutcome:
    """Outputs and commands under the process and sensor noise of ``weights``, delays and hold exact.

    Weights and noises are in the order of the plant's groups z, u and y, whatever the compensator's order.

    For a continuous compensator stability is decided (`decide_stability`, or sooner by phase where all modes
    decay), then the response is integrated over frequency; for a sampled one the rms is over all time,
    between the samples too.

    Raises `ConfigError` for ports that do not exist, weights that do not fit, and process noise that reaches
    z directly; `NumericalError` where stability cannot be decided. Warns (`UserWarning`) where rounding of
    the matrices makes the rms uncertain (`measure_known`).
    """
    return measure_known("rms", lambda *both: _measure(*both, weights), _numbers, plant, compensator)


def _numbers(outcome: NoiseOutcome) -> Float[np.ndarray, " number"]:
    return np.log([outcome.rms, outcome.control_rms])


def _measure(plant: Plant, compensator: Compensator, weights: LQGWeights) -> NoiseOutcome:
    law = arrange_ports(compensator, measured_ports(plant), driven_ports(plant))
    if law.period_s is None:
        return _measure_delayed_modes(plant, law, weights) or integrate_noise(plant, law, weights)
    found = measure_held(plant, law, weights, 1.0)
    decays = np.abs(found.poles).max(initial=0.0) < np.exp(-growth_limit(law.period_s) * law.period_s)
    if not decays:  # whether noise drives it or not
        return NoiseOutcome(found.stable, np.inf, np.inf)
    effort = float(np.sqrt(np.sum(weights.input * found.control_rms**2)))
    return NoiseOutcome(found.stable, found.metric, effort)


def _measure_delayed_modes(plant: Plant, law: Compensator, weights: LQGWeights) -> NoiseOutcome | None:
    """The outcome for a delayed plant in modal form, three times as fast; None where undecided."""
    if plant.modal is None or not plant.delayed:
        return None
    generalize(remove_delays(plant), weights, 1.0)  # refuses a plant of infinite cost
    known = family_law(law, weights)
    return None if known is None else measure_in_family(plant, known, most_lines=FEW_LINES)
