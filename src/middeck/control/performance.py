"""How well a loop does: the weighted, band-limited root mean square of its outputs."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.closed_loop import ClosedLoop
from middeck.systems.norms import band_rms
from middeck.values import record


@record
class Performance:
    """metric^2 = sum (weight * rms)^2 over the outputs z, disturbed at w within a band.

    Parameters
    ----------
    weights:
        One for each port of the group z.
    intensity:
        Two-sided intensity matrix [unit^2/Hz] of the white disturbance on the group w.
    band_hz:
        Lower and upper limit [Hz].
    """

    weights: Float[np.ndarray, " z"]
    intensity: Float[np.ndarray, "w w"]
    band_hz: tuple[float, float]


def measure_rms(loop: ClosedLoop, performance: Performance) -> Float[np.ndarray, " z"]:
    """Rms of each output; ``inf`` for an unstable loop."""
    if not loop.stable:
        return np.full(len(loop.outputs), np.inf)
    return band_rms(loop.system, performance.intensity, performance.band_hz)


def measure_metric(loop: ClosedLoop, performance: Performance) -> float:
    """The metric, a number in the unit of the outputs; ``inf`` for an unstable loop."""
    if not loop.stable:
        return float(np.inf)
    return float(np.linalg.norm(performance.weights * measure_rms(loop, performance)))
