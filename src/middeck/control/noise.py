"""The rms of a loop under process and sensor noise, whatever its time domain and delays."""

from __future__ import annotations

import numpy as np

from middeck.control.h2.noise_rms import NoiseOutcome, integrate_noise
from middeck.control.law.compensator import Compensator
from middeck.control.lqg import LQGWeights
from middeck.control.sampled import measure_sampled_loop
from middeck.systems.plant import Plant


def measure_noise_rms(plant: Plant, compensator: Compensator, weights: LQGWeights) -> NoiseOutcome:
    """Outputs and commands under the process and sensor noise of ``weights``, delays and hold exact.

    A continuous compensator's by an integral over frequency after stability is decided (`decide_stability`);
    a sampled one's over all time, between the samples too.

    Raises
    ------
    ConfigError
        For ports that do not exist, weights that do not fit, and process noise that reaches z directly.
    NumericalError
        Where stability cannot be decided.
    """
    if compensator.period_s is None:
        return integrate_noise(plant, compensator, weights)
    found = measure_sampled_loop(plant, compensator, weights, 1.0)
    effort = float(np.sqrt(np.sum(weights.input * found.control_rms**2)))
    return NoiseOutcome(found.stable, found.metric, effort)
