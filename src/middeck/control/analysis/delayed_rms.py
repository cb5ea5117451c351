"""The rms of a loop in a band with exact delays: stability first, then an integral over frequency."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.loop import (
    approximate_halves,
    close_channels,
    evaluate_halves,
    form_loop,
    is_late,
    select_dynamics,
    transfer_of,
)
from middeck.control.analysis.stability import decide_loop
from middeck.control.closed_loop import close_loop
from middeck.control.compensator import Compensator
from middeck.control.partition import partition_modes
from middeck.control.performance import Performance, measure_rms
from middeck.systems.delayed_plant import DelayedPlant
from middeck.systems.norms import response_rms
from middeck.systems.plant import Plant
from middeck.systems.statespace import poles


def measure_delayed_rms(
    plant: Plant | DelayedPlant, compensator: Compensator, performance: Performance
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
    if not isinstance(plant, DelayedPlant):
        return measure_rms(close_loop(plant, compensator), performance)
    loop = form_loop(plant, compensator)
    if not is_late(loop) and not np.any(plant.delay_s):
        return measure_rms(close_loop(plant.plant, compensator), performance)
    if not decide_loop(loop).stable:
        return np.full(len(plant.plant.z), np.inf)
    # The integrand peaks where the loop does; the approximation says where, and no more.
    peaks = poles(close_channels(approximate_halves(loop)))
    return response_rms(
        closed_response(plant, compensator), peaks, performance.intensity, performance.band_hz
    )


def closed_response(
    plant: DelayedPlant, compensator: Compensator
) -> Callable[[np.ndarray], Complex[np.ndarray, "line z w"]]:
    """T = G_zw + G_zu (1 - K G_yu)^-1 K G_yw over omega [rad/s], from the group w to z, delays exact."""
    active = partition_modes(plant.plant).active
    w, z = active.input_indices(active.w), active.output_indices(active.z)
    u = active.input_indices([p.name for p in compensator.outputs])
    y = active.output_indices([p.name for p in compensator.inputs])
    rows, columns = [*z, *y], [*w, *u]
    transfer = transfer_of(select_dynamics(active, columns, rows))
    late = plant.delay_s[np.ix_(rows, columns)]
    halves = evaluate_halves(form_loop(plant, compensator))
    nz, nw = len(z), len(w)

    def response(omega: np.ndarray) -> np.ndarray:
        s = 1j * omega
        G = transfer(s) * np.exp(-s[:, None, None] * late)
        K = halves(s)[1]
        difference = np.eye(len(u)) - K @ G[:, nz:, nw:]
        return G[:, :nz, :nw] + G[:, :nz, nw:] @ np.linalg.solve(difference, K @ G[:, nz:, :nw])

    return response
