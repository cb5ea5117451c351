"""Say where a windowed response is the window's rather than the structure's."""

from __future__ import annotations

import numpy as np

from middeck.identification.spectra.averages import Spectra
from middeck.identification.spectra.scatter import ResponseScatter

# Half-power width, in widths of the window, below which the window makes the peak: a resonance three of them
# wide is seen 5 % too low and 12 % too wide (its decay under the autocorrelation of a Hann window).
WIDTHS_IN_PEAK = 3.0
# A peak stands this far above its own variance; noise has peaks too.
CLEAR_OF_NOISE = 25.0


def doubts_of_window(found: ResponseScatter, spectra: Spectra) -> list[str]:
    """Peaks of a response that are as narrow as the window it was seen through; none for whole periods.

    Examples
    --------
    >>> from middeck.identification.spectra.averages import estimate_spectra
    >>> from middeck.identification.spectra.ratios import spectra_response
    >>> from middeck.signals.ports import Port
    >>> from middeck.signals.record import Record
    >>> from scipy.signal import lfilter
    >>> u = np.random.default_rng(0).standard_normal((1, 1, 65536, 1))
    >>> y = lfilter([1.0], [1.0, -1.9, 0.9975], u, axis=2)          # a mode 1 % of the sampling rate wide
    >>> S = estimate_spectra(Record(1.0, u, y, (Port("u", ""),), (Port("y", ""),), periodic=False))
    >>> len(doubts_of_window(spectra_response(S), S))
    1
    """
    if spectra.window_hz == 0.0:
        return []
    size = np.sqrt(np.sum(np.abs(found.H) ** 2, axis=(1, 2)))
    noise = np.zeros(len(size)) if found.total is None else np.sum(found.total, axis=(1, 2))
    inner = size[1:-1]
    peaks = 1 + np.flatnonzero((inner > size[:-2]) & (inner >= size[2:]))
    return [
        f"the peak at {found.frequency_hz[k]:.4g} Hz is as narrow as the window ({spectra.window_hz:.2g} Hz):"
        " its height and damping are the window's; use longer segments or a local model"
        for k in peaks
        if size[k] ** 2 > CLEAR_OF_NOISE * noise[k]
        and _half_power_hz(found.frequency_hz, size, int(k)) < WIDTHS_IN_PEAK * spectra.window_hz
    ]


def _half_power_hz(frequency: np.ndarray, size: np.ndarray, peak: int) -> float:
    """Width at 3 dB below the peak; infinite if a side never falls so far before it rises above the peak."""
    width = 0.0
    for side in (range(peak, -1, -1), range(peak, len(size))):
        ends = [k for k in side if size[k] < size[peak] / np.sqrt(2.0) or size[k] > size[peak]]
        if not ends or size[ends[0]] > size[peak]:
            return np.inf
        width += abs(frequency[ends[0]] - frequency[peak])
    return float(width)
