"""Samples of a period, lines of a band, and which of them are excited."""

import numpy as np

from middeck.errors import ConfigError

GRIDS = ("full", "odd", "odd-odd", "random-odd")
# One line of this many odd ones in succession is left out at random (Pintelon and Schoukens 2012, sec. 4.3).
GROUP = 4


def whole_samples(period_s: float, sample_hz: float) -> int:
    """Samples of a period; raises `ConfigError` if they are not a whole number.

    >>> whole_samples(0.1, 250.0)
    25
    """
    if not (np.isfinite(period_s) and np.isfinite(sample_hz) and period_s > 0.0 and sample_hz > 0.0):
        raise ConfigError(f"period {period_s} s, sample rate {sample_hz} Hz", hint="both positive and finite")
    samples = round(period_s * sample_hz)
    # 1e-9 of a sample: decimals are not exact in binary.
    if samples < 1 or abs(samples - period_s * sample_hz) > 1e-9 * samples:
        raise ConfigError(
            f"a period of {period_s} s at {sample_hz} Hz has {period_s * sample_hz} samples, no whole number",
            hint="choose a period that is a whole number of samples",
        )
    return samples


def band_lines(band_hz: tuple[float, float], period_s: float, sample_hz: float) -> tuple[int, int]:
    """First and last multiple of 1/``period_s`` in the band, limits included; zero is left out.

    Raises `ConfigError` if the band holds no line, or if it reaches half the sampling rate.
    """
    samples = whole_samples(period_s, sample_hz)
    if not np.isfinite(band_hz).all():
        raise ConfigError(f"band_hz = {band_hz} is not finite", hint="two finite frequencies")
    first = max(1, int(np.ceil(band_hz[0] * period_s - 1e-9)))
    last = int(np.floor(band_hz[1] * period_s + 1e-9))
    if last < first:
        raise ConfigError(f"no multiple of 1/{period_s} Hz lies in {band_hz} Hz", hint="use a longer period")
    if 2 * last >= samples:
        raise ConfigError(
            f"{last / period_s} Hz is not below half of {sample_hz} Hz",
            hint="sample faster or narrow the band",
        )
    return first, last


def choose_lines(first: int, last: int, grid: str, rng: np.random.Generator) -> np.ndarray:
    """The excited lines of a grid.

    "full": all. "odd": the odd ones; even nonlinearity falls between them. "odd-odd": 1, 5, 9, ...; odd
    nonlinearity also falls on 3, 7, 11, ... "random-odd": odd lines, one of each four left out at random,
    which shows both and wastes less. Raises `ConfigError` for another grid or where nothing is left.
    """
    lines = np.arange(first, last + 1)
    match grid:
        case "full":
            pass
        case "odd":
            lines = lines[lines % 2 == 1]
        case "odd-odd":
            lines = lines[lines % 4 == 1]
        case "random-odd":
            lines = lines[lines % 2 == 1]
            whole = len(lines) // GROUP
            silent = GROUP * np.arange(whole) + rng.integers(GROUP, size=whole)
            lines = np.delete(lines, silent)
        case _:
            raise ConfigError(f"no grid named {grid!r}", hint=f"one of {', '.join(GRIDS)}")
    if not len(lines):
        raise ConfigError(
            f"no frequency line of the {grid} grid lies in the band", hint="use a longer period"
        )
    return lines
