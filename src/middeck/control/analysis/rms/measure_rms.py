"""The rms of a plant under a compensator in a band, delays exact."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.control.analysis.loop.feedback_loop import (
    FeedbackLoop,
    approximate_halves,
    close_channels,
    loop_path,
)
from middeck.control.analysis.rms.closed_response import closed_response
from middeck.control.analysis.stability.stability import decide_loop
from middeck.control.law.compensator import Compensator, idle_compensator
from middeck.control.law.rounding_of_results import measure_known
from middeck.control.loop.closed_loop import close_loop
from middeck.control.loop.performance import Performance, loop_rms, require_one_each
from middeck.systems.norms.band_rms import response_rms
from middeck.systems.plants.plant import Plant, require_plant
from middeck.systems.poles.stability import growth_rates


@named_kinds
def measure_rms(
    plant: Plant, compensator: Compensator | None, performance: Performance
) -> Float[np.ndarray, " z"]:
    """Rms of each output z within the band, delays exact; ``inf`` for an unstable loop.

    ``compensator`` None: the plant alone. Without delays the closed form (`band_rms`) is used; with delays
    stability is decided first (`decide_stability`), then |T|^2 is integrated by adaptive quadrature to 1e-8
    or better. ``inf`` also for outputs that see a pole on the axis within the band, as the place of a body
    that is held by its rate alone, in a band from zero.

    Raises `ConfigError` for ports that do not exist, intensities that do not fit them, a band that is not 0
    <= low < high < inf, and a sampled compensator (`measure_noise_rms` takes both); `NumericalError` where
    stability cannot be decided. Warns (`UserWarning`) where rounding of the matrices makes the rms uncertain.
    """
    require_plant(plant)
    law = idle_compensator(plant) if compensator is None else compensator
    if not plant.delayed:
        return loop_rms(close_loop(plant, law), performance)
    return measure_known("rms", lambda *both: _delayed_rms(*both, performance), np.log, plant, law)


@named_kinds
def measure_metric(plant: Plant, compensator: Compensator | None, performance: Performance) -> float:
    """Weighted rms of all outputs together, otherwise as `measure_rms`."""
    require_one_each("weights", len(performance.weights), plant.z)
    rms = measure_rms(plant, compensator, performance)
    return float(np.linalg.norm(performance.weights * rms)) if np.isfinite(rms).all() else np.inf


def _delayed_rms(plant: Plant, compensator: Compensator, performance: Performance) -> Float[np.ndarray, " z"]:
    system = compensator.system  # refuses a sampled compensator, stable loop or not
    require_one_each("intensities", len(performance.intensity), plant.w)
    loop = FeedbackLoop(loop_path(plant, compensator), system)
    if not decide_loop(loop).stable:
        return np.full(len(plant.z), np.inf)
    # Poles of the approximation show where the integrand peaks, and what stays on the axis: exact there.
    peaks = growth_rates(close_channels(approximate_halves(loop)))
    closed, nz, nw = closed_response(plant, compensator, plant.w), len(plant.z), len(plant.w)
    return response_rms(
        lambda omega: closed(omega)[:, :nz, :nw], peaks, performance.intensity, performance.band_hz
    )
