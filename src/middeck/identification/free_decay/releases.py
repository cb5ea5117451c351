"""The samples of each free decay in a record of several releases."""

from __future__ import annotations

import numpy as np
import scipy.ndimage
from jaxtyping import Float

CYCLES = 2  # over which the oscillation and the mean are taken apart
FREE = 0.1  # largest mean of a free decay over the largest oscillation: above it something pushes
BEGUN = 0.5  # share of the largest oscillation from which a decay is one
SETTLE = 1  # cycles after a release that are left out
SHORTEST = 20  # cycles
# A tail is noise where its last quarter is no smaller than so much of the third one, and far below the start.
FLAT, FALLEN = 0.75, 0.2
EACH = 3  # cycles of the parts of a decay whose rms is compared with that of the tail
ABOVE = 2.0  # rms of the tail from which on a part is decay


def dominant_hz(samples: Float[np.ndarray, " sample"], sample_hz: float) -> float:
    """Frequency of the highest line of an oscillation, in the parts of the record that move."""
    steps = np.diff(samples)  # a slow push has little of its power there
    power = np.abs(np.fft.rfft(steps * np.hanning(len(steps)))) ** 2
    return float(np.fft.rfftfreq(len(steps), 1.0 / sample_hz)[1 + int(np.argmax(power[1:]))])


def find_releases(samples: Float[np.ndarray, " sample"], sample_hz: float) -> tuple[slice, ...]:
    """Each free decay: from a cycle after the release to the next push, or to the end.

    Mean and oscillation are those of `CYCLES` cycles of the dominant frequency. A push moves the mean.

    >>> t = np.arange(6000) / 100.0
    >>> decay = np.where(t < 3.0, 8.0, 8.0 * np.exp(-0.1 * (t - 3.0)) * np.cos(50.0 * (t - 3.0)))
    >>> [(round(s.start / 100.0, 1), s.stop) for s in find_releases(decay, 100.0)]
    [(3.4, 6000)]
    """
    hz = dominant_hz(samples, sample_hz)
    cycle = sample_hz / hz
    width = max(round(CYCLES * cycle), 3)
    rest = float(np.median(samples))
    mean = scipy.ndimage.uniform_filter1d(samples - rest, width, mode="nearest")
    turned = (samples - rest - mean) * np.exp(-2j * np.pi * hz * np.arange(len(samples)) / sample_hz)
    size = 2.0 * np.abs(
        scipy.ndimage.uniform_filter1d(turned.real, width, mode="nearest")
        + 1j * scipy.ndimage.uniform_filter1d(turned.imag, width, mode="nearest")
    )
    pushed = np.abs(mean) > FREE * float(np.quantile(size, 0.999))
    free = np.asarray(scipy.ndimage.minimum_filter1d(~pushed, width), dtype=bool)
    large = BEGUN * float(size[free].max(initial=0.0))
    edges = np.flatnonzero(np.diff(free.astype(int), prepend=0, append=0))
    found: list[slice] = []
    for first, stop in edges.reshape(-1, 2).tolist():
        peak = first + int(np.argmax(size[first:stop]))
        begin = peak + round(SETTLE * cycle)
        if size[peak] >= large and stop - begin >= SHORTEST * cycle:
            found.append(slice(begin, stop))
    return tuple(found)


def without_tail(samples: Float[np.ndarray, " sample"], decay: slice, cycle: float) -> slice:
    """``decay`` as far as it is above the noise of its end; all of it where it falls to its end.

    >>> t = np.arange(8000) / 100.0
    >>> noise = 0.01 * np.random.default_rng(0).standard_normal(8000)
    >>> without_tail(np.exp(-0.5 * t) * np.cos(50.0 * t) + noise, slice(0, 8000), 12.6).stop < 1500
    True
    """
    y = samples[decay]
    parts = np.array_split(y - np.mean(y[len(y) // 2 :]), max(4, int(len(y) / (EACH * cycle))))
    rms = np.sqrt(np.array([np.mean(part**2) for part in parts]))
    quarter = len(rms) // 4
    third, last = (np.sqrt(np.mean(r**2)) for r in (rms[-2 * quarter : -quarter], rms[-quarter:]))
    if last < FLAT * third or last > FALLEN * rms.max():
        return decay
    kept = int(np.argmax(rms < ABOVE * last)) or 1
    return slice(decay.start, decay.start + sum(len(part) for part in parts[:kept]))
