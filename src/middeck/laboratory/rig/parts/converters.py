"""The converters and encoders behind the sampled outputs: steps, ranges, and how a reading is rounded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from middeck.laboratory.rig.parts.motors import EXACT, WHOLE
from middeck.laboratory.rig.parts.sensors import Encoder, Gyro, Sampler, Sensor, is_summed
from middeck.values import record


@record(kw_only=True)
class Readout:
    """Steps, ranges and errors of converters and encoders, one entry for each output.

    ``step`` is one count (`EXACT` for none), ``range`` the largest reading, a whole number of counts;
    ``noise_rms`` is white and added before them. ``bias`` and ``walk`` (per tick) are standard deviations of
    an error and of its random walk; ``gyro`` marks the outputs that have one, ``summed`` those that the
    computer adds up.
    """

    step: Float[np.ndarray, " output"]
    range: Float[np.ndarray, " output"]
    noise_rms: Float[np.ndarray, " output"]
    bias: Float[np.ndarray, " output"]
    walk: Float[np.ndarray, " output"]
    gyro: Bool[np.ndarray, " output"]
    summed: Bool[np.ndarray, " output"]


def gather_readout(sensors: Sequence[Sensor], period_s: float) -> Readout:
    """All sensors of a rig at a tick of ``period_s``."""
    step, reach, noise, bias, walk = np.zeros((5, len(sensors)))
    reach[:], step[:] = np.inf, EXACT
    for i, sensor in enumerate(sensors):
        match sensor:
            case Sampler():
                noise[i] = sensor.noise_rms
            case Encoder():
                step[i] = sensor.step
            case Gyro():
                step[i] = sensor.resolution or EXACT
                # Counts within the range; a range of whole steps keeps the last one, whatever its rounding.
                reach[i] = step[i] * np.floor(sensor.range / step[i] * (1.0 + 1e-12))
                bias[i], walk[i] = sensor.bias, sensor.bias_walk * np.sqrt(period_s)
                if np.isinf(sensor.anti_alias_hz):
                    noise[i] = sensor.noise / np.sqrt(period_s)
    gyro = np.array([isinstance(sensor, Gyro) for sensor in sensors], dtype=bool)
    summed = np.array(list(map(is_summed, sensors)), dtype=bool)
    return Readout(step=step, range=reach, noise_rms=noise, bias=bias, walk=walk, gyro=gyro, summed=summed)


class ConverterEnds(NamedTuple):
    """Ends of one converter's range, in its counts; those below ``whole`` are rounded."""

    lower: float
    upper: float
    whole: float


def converter_ends(readout: Readout) -> list[ConverterEnds]:
    """The ends of every output's converter."""
    reach = readout.range / readout.step
    whole = np.where(readout.step > EXACT, WHOLE, 0.0)
    return [ConverterEnds(*row) for row in np.column_stack([-reach, reach, whole]).tolist()]


def as_counts(counts: float, ends: ConverterEnds) -> float:
    """Counts of one converter: limited to its range, then rounded to whole (`whole` in ticks.c)."""
    lower, upper, whole = ends
    counts = lower if counts < lower else upper if counts > upper else counts
    return round(counts) if -whole < counts < whole else counts
