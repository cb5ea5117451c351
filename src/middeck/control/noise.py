"""Rms of a continuous or sampled loop, with or without delays, under process and sensor noise."""

from __future__ import annotations

import numpy as np

from middeck.control.h2.noise_rms import NoiseOutcome, integrate_noise
from middeck.control.law.compensator import Compensator, arrange_ports, driven_ports, measured_ports
from middeck.control.lqg.weights import LQGWeights
from middeck.control.sampled.sampled_loop import measure_sampled_loop
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.stability import growth_limit


def measure_noise_rms(plant: Plant, compensator: Compensator, weights: LQGWeights) -> NoiseOutcome:
    """Outputs and commands under the process and sensor noise of ``weights``, delays and hold exact.

    Weights and noises are in the order of the plant's groups z, u and y, whatever the compensator's order.

    For a continuous compensator stability is decided (`decide_stability`), then the response is integrated
    over frequency; for a sampled one the rms is over all time, between the samples too.

    Raises `ConfigError` for ports that do not exist, weights that do not fit, and process noise that reaches
    z directly; `NumericalError` where stability cannot be decided.
    """
    law = arrange_ports(compensator, measured_ports(plant), driven_ports(plant))
    if law.period_s is None:
        return integrate_noise(plant, law, weights)
    found = measure_sampled_loop(plant, law, weights, 1.0)
    decays = np.abs(found.poles).max(initial=0.0) < np.exp(-growth_limit(law.period_s) * law.period_s)
    if not decays:  # whether noise drives it or not
        return NoiseOutcome(found.stable, np.inf, np.inf)
    effort = float(np.sqrt(np.sum(weights.input * found.control_rms**2)))
    return NoiseOutcome(found.stable, found.metric, effort)
