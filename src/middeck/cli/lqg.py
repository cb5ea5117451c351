"""Design for a plant and judge the loop."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.cli.settings import LoopSettings
from middeck.control.closed_loop import ClosedLoop, close_loop, leave_open
from middeck.control.lqg import LQGCompensator, LQGWeights, design_lqg
from middeck.control.performance import Performance, measure_rms
from middeck.systems.plant import Plant
from middeck.values import record


@record
class DesignedLoop:
    """A compensator, the loop it makes, and the rms of each output in the band without and with it.

    The disturbance is white, enters at the control inputs and is the one that the design assumes.
    """

    compensator: LQGCompensator
    loop: ClosedLoop
    band_hz: tuple[float, float]
    rms_open: Float[np.ndarray, " output"]
    rms_closed: Float[np.ndarray, " output"]


def design_loop(plant: Plant, settings: LoopSettings, band_hz: tuple[float, float]) -> DesignedLoop:
    """LQG with equal weights on all measured outputs and on all control inputs; the rms is of ``band_hz``."""
    intensity = settings.disturbance_nm_per_rthz**2 * np.eye(len(plant.u))
    noise = np.full(len(plant.y), settings.angle_noise_rad_per_rthz**2)
    weights = LQGWeights(np.ones(len(plant.z)), np.ones(len(plant.u)), plant.w, intensity, noise)
    compensator = design_lqg(plant, weights, 10.0**settings.log10_authority)
    loop = close_loop(plant, compensator)
    performance = Performance(np.ones(len(plant.z)), intensity, band_hz)
    rms_open = measure_rms(leave_open(plant), performance)
    return DesignedLoop(compensator, loop, band_hz, rms_open, measure_rms(loop, performance))
