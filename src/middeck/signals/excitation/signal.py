"""The value that every design returns: the samples of one period, and their description."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.values import record


@record(kw_only=True)
class Excitation:
    """A designed test signal.

    Attributes:
        kind: "multisine", "swept sine", "stepped sine", "binary", "noise" or "burst random".
        what: One sentence on what it is, for a report.
        sample_hz: Rate at which the samples are issued; each is held until the next.
        u: One period of each experiment, or the whole signal if it does not repeat. With several inputs the
            experiments are to be run one after the other; together they tell the inputs apart.
        lines: Excited lines: whole multiples of 1/``period_s``.
        periodic: Whether ``u`` may be repeated without a jump in its spectrum.
    """

    kind: str
    what: str
    sample_hz: float
    u: Float[np.ndarray, "experiment sample input"]
    lines: np.ndarray
    periodic: bool

    @property
    def period_s(self) -> float:
        """Length of ``u`` [s]."""
        return self.u.shape[1] / self.sample_hz

    @property
    def frequency_hz(self) -> Float[np.ndarray, " line"]:
        """Frequencies of the excited lines [Hz]."""
        return self.lines / self.period_s

    @property
    def rms(self) -> Float[np.ndarray, " input"]:
        """Root mean square of each input over all experiments."""
        return np.sqrt(np.mean(self.u**2, axis=(0, 1)))

    @property
    def peak(self) -> Float[np.ndarray, " input"]:
        """Largest absolute sample of each input."""
        return np.abs(self.u).max(axis=(0, 1))

    @property
    def crest_factor(self) -> Float[np.ndarray, " input"]:
        """Peak over rms of each input: that of the worst experiment."""
        each = np.abs(self.u).max(axis=1) / np.sqrt(np.mean(self.u**2, axis=1))
        return each.max(axis=0)

    @property
    def slew(self) -> Float[np.ndarray, " input"]:
        """Largest step from sample to sample times the rate [unit/s], into the next period included."""
        return slew_of(self.u, self.sample_hz, periodic=self.periodic).max(axis=0)

    @property
    def power(self) -> Float[np.ndarray, "line input"]:
        """Mean square that each excited line carries, mean of the experiments [unit^2].

        The two-sided intensity there is half of it times ``period_s`` (docs/conventions.md).
        """
        return line_power(self.u)[self.lines]


def slew_of(
    u: Float[np.ndarray, "experiment sample input"], sample_hz: float, *, periodic: bool
) -> Float[np.ndarray, "experiment input"]:
    """Largest step times the sampling rate."""
    steps = np.diff(u, axis=1, append=u[:, :1]) if periodic else np.diff(u, axis=1)
    return np.abs(steps).max(axis=1) * sample_hz


def line_power(u: Float[np.ndarray, "experiment sample input"]) -> Float[np.ndarray, "line input"]:
    """Mean square of each line from zero to the Nyquist frequency; they add up to that of ``u`` (Parseval).

    >>> t = np.arange(8) / 8.0
    >>> line_power(2.0 * np.cos(2.0 * np.pi * t)[None, :, None])[:, 0].round(12).tolist()
    [0.0, 2.0, 0.0, 0.0, 0.0]
    """
    samples = u.shape[1]
    power = 2.0 * np.mean(np.abs(np.fft.rfft(u, axis=1) / samples) ** 2, axis=0)
    power[0] *= 0.5
    if samples % 2 == 0:
        power[-1] *= 0.5
    return power


def repeat_periods(
    excitation: Excitation, periods: int
) -> Float[np.ndarray, "experiment period sample input"]:
    """The command of so many periods; raises `ConfigError` for a signal that does not repeat."""
    if periods < 1 or (periods > 1 and not excitation.periodic):
        raise ConfigError(
            f"{periods} periods of a signal that is {'' if excitation.periodic else 'not '}periodic",
            hint="one or more periods of a periodic signal, or one of any other",
        )
    return np.repeat(excitation.u[:, None], periods, axis=1)
