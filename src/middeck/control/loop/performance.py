"""Performance of a loop: the weighted, band-limited root mean square of its outputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.control.loop.closed_loop import ClosedLoop
from middeck.errors import ConfigError
from middeck.systems.norms.band_rms import band_rms
from middeck.values import record


@record
class Performance:
    """metric^2 = sum (weight * rms)^2 over the outputs z, disturbed at w within a band.

    Attributes:
        weights: One for each port of the group z.
        intensity: Two-sided intensity matrix [unit^2/Hz] of the white disturbance on the group w.
        band_hz: Lower and upper limit [Hz].
    """

    weights: Float[np.ndarray, " z"]
    intensity: Float[np.ndarray, "w w"]
    band_hz: tuple[float, float]

    def __post_init__(self) -> None:
        require_intensity("the intensity of the disturbance", self.intensity)
        if not np.all(np.isfinite(self.weights)):
            raise ConfigError("a weight is not a finite number", hint="0 for an output left alone")


def loop_rms(loop: ClosedLoop, performance: Performance) -> Float[np.ndarray, " z"]:
    """Rms of each output; ``inf`` for an unstable loop.

    Raises `ConfigError` for an intensity that does not fit the loop's disturbances.
    """
    require_one_each("intensities", len(performance.intensity), [p.name for p in loop.inputs])
    if not loop.stable:
        return np.full(len(loop.outputs), np.inf)
    return band_rms(loop.system, performance.intensity, performance.band_hz)


def loop_metric(loop: ClosedLoop, performance: Performance) -> float:
    """The metric, a number in the unit of the outputs; ``inf`` for an unstable loop.

    Raises `ConfigError` for weights and intensities that do not fit the loop's ports.
    """
    require_one_each("weights", len(performance.weights), [p.name for p in loop.outputs])
    if not loop.stable:
        return float(np.inf)
    return float(np.linalg.norm(performance.weights * loop_rms(loop, performance)))


def require_one_each(what: str, count: int, ports: Sequence[str]) -> None:
    """Raise `ConfigError` unless there is one value for each of ``ports``."""
    if count != len(ports):
        raise ConfigError(
            f"{count} {what} for {len(ports)} ports ({', '.join(ports)})", hint="one for each, in their order"
        )


def require_intensity(what: str, intensity: Float[np.ndarray, "w w"]) -> None:
    """Raise `ConfigError` unless the matrix is finite, symmetric and positive semidefinite."""
    if not np.all(np.isfinite(intensity)):
        raise ConfigError(f"{what} is not finite", hint="finite two-sided intensities, unit^2/Hz")
    lowest = np.linalg.eigvalsh(intensity).min(initial=0.0)
    # Rounding of an eigenvalue of a symmetric matrix, relative to its size.
    rounding = 1e-12 * np.abs(intensity).max(initial=0.0)
    if not np.array_equal(intensity, intensity.T) or lowest < -rounding:
        raise ConfigError(
            f"{what} is not symmetric and positive semidefinite",
            hint="a covariance matrix: symmetric, no negative eigenvalue",
        )
