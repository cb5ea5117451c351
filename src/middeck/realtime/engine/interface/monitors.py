"""What an engine looks at in a band of one channel: its power, and whether it grows."""

import functools
import math
from typing import Literal

import numpy as np

from middeck.errors import ConfigError
from middeck.values import record

LONGEST_S = 1e6
"""Longest time that a setting may name."""
PASSES = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0])
"""A section that changes nothing."""


@record(kw_only=True)
class Monitor:
    """Band-passed signal of a sensor or an output, and what of it trips.

    Attributes:
        channel, side: Name of a port, and whether it is a "sensor" or an "output".
        band_hz: Lower and upper edge: a Butterworth band pass of order two; from 0 a low pass, to inf a high
            pass.
        limit: Rms that trips, inf for none: the root of a mean square that forgets with ``seconds``.
        seconds: Time constant of that mean.
        window_s, factor, times, floor: Growth trips where the rms has grown by ``factor`` from window to
            window so many ``times`` in a row, each time above ``floor``; ``factor`` 0 for no such test.
    """

    channel: str
    side: Literal["sensor", "output"] = "sensor"
    band_hz: tuple[float, float]
    limit: float = math.inf
    seconds: float = 1.0
    window_s: float = 1.0
    factor: float = 0.0
    times: int = 3
    floor: float = 0.0

    def __post_init__(self) -> None:
        low, high = band_edges(self.band_hz, f"monitor of {self.channel}")
        lasts = all(0.0 < time <= LONGEST_S for time in (self.seconds, self.window_s))
        sound = 0.0 <= low < high and self.limit > 0.0 and lasts and 0.0 <= self.floor < math.inf
        grows = self.factor == 0.0 or 1.0 < self.factor < math.inf
        if not (
            sound
            and grows
            and 1 <= self.times < 1 << 31
            and self.times == int(self.times)
            and self.side in ("sensor", "output")
        ):
            raise ConfigError(
                f"monitor of {self.channel}: band {low} to {high} Hz of a {self.side}, limit {self.limit}, "
                f"factor {self.factor}, floor {self.floor}, {self.seconds} s, {self.times} windows of "
                f"{self.window_s} s",
                hint="sensor or output, 0 <= low < high, positive limit, positive times up to 1e6 s, "
                "a finite floor, a finite factor above one or zero",
            )

    def sections(self, period_s: float) -> np.ndarray:
        """Two second-order sections b0 b1 b2 a1 a2; raises `ConfigError` for a band beyond half the rate."""
        low, high = (2.0 * edge * period_s for edge in self.band_hz)
        if low >= 1.0:
            raise ConfigError(
                f"monitor of {self.channel} from {self.band_hz[0]} Hz",
                hint=f"below {0.5 / period_s:g} Hz, half the sampling rate",
            )
        if low > 0.0 and high < 1.0:
            rows = _butterworth((low, high), "bandpass")
        elif low > 0.0:
            rows = np.vstack([_butterworth(low, "highpass"), PASSES])
        elif high < 1.0:
            rows = np.vstack([_butterworth(high, "lowpass"), PASSES])
        else:
            rows = np.vstack([PASSES, PASSES])
        if not np.all((np.abs(rows[:, 5]) < 1.0) & (np.abs(rows[:, 4]) < 1.0 + rows[:, 5])):
            raise ConfigError(
                f"monitor of {self.channel}: poles of its band {self.band_hz} Hz round to the unit circle",
                hint=f"edges not so far below the sampling rate of {1.0 / period_s:g} Hz",
            )
        return rows[:, [0, 1, 2, 4, 5]]

    def encode(self, words: np.ndarray, channel: int, period_s: float) -> None:
        """Fill the shared record (one row)."""
        words["channel"] = channel
        words["band"]["g"][0] = self.sections(period_s)
        words["forget"] = -math.expm1(-period_s / self.seconds)
        words["limit"], words["floor"], words["factor"] = self.limit, self.floor, self.factor
        words["window"], words["times"] = max(1, round(self.window_s / period_s)), self.times


def band_edges(band_hz: tuple[float, float], where: str) -> tuple[float, float]:
    """The edges of a band; raises `ConfigError` where they are not two."""
    if np.shape(band_hz) != (2,):
        raise ConfigError(f"a band of {band_hz} Hz", where=where, hint="two edges, low and high")
    return band_hz


@functools.cache  # many monitors share a band
def _butterworth(edges: float | tuple[float, float], kind: str) -> np.ndarray:
    import scipy.signal  # takes a second and more, which who only reads settings need not wait for

    made = np.asarray(scipy.signal.butter(2, edges, kind, output="sos"))
    made.flags.writeable = False
    return made
