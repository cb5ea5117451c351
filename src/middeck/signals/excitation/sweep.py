"""Sines whose frequency moves: swept within a period, or stepped from one to the next."""

from collections.abc import Sequence

import numpy as np

from middeck.errors import ConfigError
from middeck.signals.excitation.grids import band_lines, whole_samples
from middeck.signals.excitation.limits import Limits, as_large_as_allowed
from middeck.signals.excitation.orthogonal_inputs import spread_signs
from middeck.signals.excitation.signal import Excitation


def design_sweep(
    band_hz: tuple[float, float],
    period_s: float,
    sample_hz: float,
    limits: Limits | Sequence[Limits],
    *,
    law: str = "linear",
    inputs: int = 1,
) -> Excitation:
    """A sine that sweeps the band once a period and begins again (periodic chirp).

    "linear" gives all frequencies the same power, "logarithmic" all octaves. The number of cycles is rounded
    to a whole one, so that the period closes; all frequencies move by less than half a cycle a period. Crest
    factor 1.41. Several inputs take turns in sign over the experiments. Raises `ConfigError` as
    `random_multisine`, and for a band that does not rise.

    >>> made = design_sweep((1.0, 8.0), 16.0, 64.0, Limits(peak=2.0))
    >>> made.kind, float(made.crest_factor[0].round(2))
    ('swept sine', 1.41)
    """
    low, high = band_hz
    if not 0.0 < low < high:
        raise ConfigError(f"sweep from {low} to {high} Hz: not positive and ascending", hint="0 < low < high")
    samples = whole_samples(period_s, sample_hz)
    first, last = band_lines(band_hz, period_s, sample_hz)
    t = np.arange(samples) / samples
    match law:
        case "linear":
            cycles = period_s * (low * t + 0.5 * (high - low) * t**2)
            whole = period_s * 0.5 * (low + high)
        case "logarithmic":
            ratio = np.log(high / low)
            cycles = period_s * low * np.expm1(ratio * t) / ratio
            whole = period_s * (high - low) / ratio
        case _:
            raise ConfigError(f"no sweep law named {law!r}", hint="linear or logarithmic")
    cycles *= max(1, round(whole)) / whole
    u = spread_signs(np.sin(2.0 * np.pi * cycles), inputs)
    what = f"{law} sweep from {low:.6g} to {high:.6g} Hz in {period_s:.6g} s"
    return as_large_as_allowed("swept sine", what, u, np.arange(first, last + 1), limits, sample_hz)
