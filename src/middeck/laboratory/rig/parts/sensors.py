"""Real sensors: integrated rate gyros, encoders that count, and samplers that only add noise."""

import math

import numpy as np

from middeck.errors import ConfigError
from middeck.values import record

BUTTERWORTH_DELAY = math.sqrt(2.0)  # low-frequency delay of the second-order filter, times its omega


@record
class Sampler:
    """Reads an output of any kind as it is, with white noise of ``noise_rms`` at each sample."""

    noise_rms: float = 0.0

    def __post_init__(self) -> None:
        _refuse_negative("Sampler", noise_rms=self.noise_rms)


@record
class Encoder:
    """Counts steps of ``step`` [rad]; ``gain`` is its reading per true radian."""

    step: float
    gain: float = 1.0

    def __post_init__(self) -> None:
        if not (0.0 < self.step < math.inf):
            raise ConfigError(f"an encoder in steps of {self.step} rad", where="Encoder", hint="above zero")
        _refuse_gain("Encoder", self.gain)


@record(kw_only=True)
class Gyro:
    """A rate gyro or tachometer behind an anti-alias filter; the computer adds its samples up to an angle.

    Attributes:
        bandwidth_hz: Corner frequency of its first-order lag; infinite for none.
        noise: Root of its two-sided intensity [rad/s/sqrt(Hz)], white, behind the lag and before the filter.
        bias: Standard deviation [rad/s] of the constant error that is drawn when it is switched on.
        bias_walk: Intensity of the random walk of this error [rad/s/sqrt(s)].
        anti_alias_hz: Corner frequency of a Butterworth filter of second order before the converter; infinite
            for none, and the noise is then taken in the band of the samples.
        resolution, range: One step of the converter [rad/s] (zero for none), and its largest rate: it
            reads whole steps up to there.
        gain: Reading per true rad/s.
        summed: Whether it stands at an angle and is added up; otherwise at a rate, whose samples are read.

    Raises `ConfigError` for a value out of its range.
    """

    bandwidth_hz: float = math.inf
    noise: float = 0.0
    bias: float = 0.0
    bias_walk: float = 0.0
    anti_alias_hz: float = math.inf
    resolution: float = 0.0
    range: float = math.inf
    gain: float = 1.0
    summed: bool = True

    def __post_init__(self) -> None:
        _refuse_negative(
            "Gyro", noise=self.noise, bias=self.bias, bias_walk=self.bias_walk, resolution=self.resolution
        )
        if not (self.bandwidth_hz > 0.0 and self.anti_alias_hz > 0.0 and self.range > 0.0):
            what = f"a gyro of {self.bandwidth_hz} Hz, filtered at {self.anti_alias_hz} Hz"
            hint = "all above zero; infinite for no limit"
            raise ConfigError(f"{what}, up to {self.range} rad/s", where="Gyro", hint=hint)
        if self.resolution > self.range:
            what = f"a converter in steps of {self.resolution} rad/s with a range of {self.range} rad/s"
            raise ConfigError(what, where="Gyro", hint="a range of one step or more")
        _refuse_gain("Gyro", self.gain)


Sensor = Sampler | Encoder | Gyro


def _refuse_negative(where: str, **values: float) -> None:
    for name, value in values.items():
        if not 0.0 <= value < math.inf:
            raise ConfigError(f"{name} = {value}", where=where, hint="finite, from zero")


def _refuse_gain(where: str, gain: float) -> None:
    if not 0.0 < abs(gain) < math.inf:
        raise ConfigError(f"a gain of {gain}", where=where, hint="finite, not zero")


def is_summed(sensor: Sensor) -> bool:
    """Whether the computer sums its samples."""
    return isinstance(sensor, Gyro) and sensor.summed


def sensor_lag(sensor: Sensor) -> float:
    """Delay [s] of the sensor's filters at low frequency."""
    if not isinstance(sensor, Gyro):
        return 0.0
    return (1.0 / sensor.bandwidth_hz + BUTTERWORTH_DELAY / sensor.anti_alias_hz) / (2.0 * np.pi)
