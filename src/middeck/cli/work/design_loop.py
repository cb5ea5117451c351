"""Design for a plant and judge the loop."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.cli.given.checked_options import LoopSettings
from middeck.control.loop.closed_loop import ClosedLoop, close_loop, leave_open
from middeck.control.loop.performance import Performance, loop_rms
from middeck.control.lqg.design import LQGCompensator, design_lqg
from middeck.control.lqg.weights import LQGWeights
from middeck.errors import NumericalError
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import poles
from middeck.values import record

# The fastest pole over the slowest, beyond which the Pade states of a delay are the first suspects where a
# Riccati equation has no trustworthy solution.
FAR_APART = 1e4


@record(kw_only=True)
class DesignedLoop:
    """A compensator, its closed loop, and the rms of each output in the band without and with it.

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
    weights = LQGWeights(
        output=np.ones(len(plant.z)),
        input=np.ones(len(plant.u)),
        disturbed=plant.w,
        process=intensity,
        sensor=noise,
    )
    compensator = _designed(plant, weights, 10.0**settings.log10_authority)
    loop = close_loop(plant, compensator)
    performance = Performance(np.ones(len(plant.z)), intensity, band_hz)
    rms_open = loop_rms(leave_open(plant), performance)
    return DesignedLoop(
        compensator=compensator,
        loop=loop,
        band_hz=band_hz,
        rms_open=rms_open,
        rms_closed=loop_rms(loop, performance),
    )


def _designed(plant: Plant, weights: LQGWeights, authority: float) -> LQGCompensator:
    """The design; where it fails beside fast poles of approximated delays, what would slow them."""
    try:
        return design_lqg(plant, weights, authority)
    except NumericalError as error:
        size = np.abs(poles(plant.system))
        size = size[size > 0.0]
        if "delay" not in plant.state_names or size.max() < FAR_APART * size.min():
            raise
        hz = size / (2.0 * np.pi)
        raise type(error)(
            f"{error.what}; the poles lie from {hz.min():.3g} to {hz.max():.3g} Hz, the fastest of them of "
            "approximated delays",
            where=error.where,
            hint=f"--pade-order 3, or a common delay (identify --delay common); otherwise {error.hint}",
            **error.data,
        ) from error
