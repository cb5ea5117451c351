"""The rms of a loop in a band with exact delays: stability first, then an integral over frequency."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.analysis.closed_response import closed_response
from middeck.control.analysis.loop import approximate_halves, close_channels, form_loop
from middeck.control.analysis.stability import decide_loop
from middeck.control.law.compensator import Compensator
from middeck.control.loop.closed_loop import close_loop
from middeck.control.loop.performance import Performance, measure_rms
from middeck.systems.norms import response_rms
from middeck.systems.plant import Plant
from middeck.systems.statespace import poles


def measure_delayed_rms(
    plant: Plant, compensator: Compensator, performance: Performance
) -> Float[np.ndarray, " z"]:
    """Rms of each output z within the band, delays exact; ``inf`` for an unstable loop.

    By adaptive quadrature of |T|^2 to 1e-8 and better, only after stability has been decided with exact
    delays (`decide_stability`). Without delays by the closed form (`measure_rms`).

    Raises
    ------
    ConfigError
        For ports that do not exist or a band that is not 0 <= low < high < inf.
    NumericalError
        Where stability cannot be decided.
    """
    if not plant.delayed:
        return measure_rms(close_loop(plant, compensator), performance)
    loop = form_loop(plant, compensator)
    if not decide_loop(loop).stable:
        return np.full(len(plant.z), np.inf)
    # The integrand peaks where the loop does; the approximation says where, and no more.
    peaks = poles(close_channels(approximate_halves(loop)))
    nz, nw = len(plant.z), len(plant.w)
    closed = closed_response(plant, compensator, plant.w)
    return response_rms(
        lambda omega: closed(omega)[:, :nz, :nw], peaks, performance.intensity, performance.band_hz
    )
