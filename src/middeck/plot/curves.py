"""Responses as curves: thousands of lines are thinned so that every peak and notch stays."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Complex, Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.plot.style import frequency_axis, new_figure, phase_axis

BINS = 280  # logarithmic, over the plotted band: at the figures' size about one printed point each


def decibels(H: Complex[np.ndarray, " line"]) -> Float[np.ndarray, " line"]:
    """20 log10 of the magnitude.

    >>> decibels(np.array([10.0 + 0.0j])).tolist()
    [20.0]
    """
    return 20.0 * np.log10(np.abs(H))


def keep_extremes(
    frequency_hz: Float[np.ndarray, " line"], value: Float[np.ndarray, " line"], bins: int = BINS
) -> Int[np.ndarray, " kept"]:
    """Indices of the least and the largest value in each logarithmic bin of frequency, in order.

    A curve through them has the same envelope as the whole one, however many lines there are.

    >>> f = np.geomspace(1.0, 100.0, 10_000)
    >>> kept = keep_extremes(f, np.sin(f), bins=50)
    >>> len(kept) <= 102 and bool(np.isclose(np.sin(f[kept]).max(), 1.0, atol=1e-3))
    True
    """
    if len(frequency_hz) <= 3 * bins:
        return np.arange(len(frequency_hz))
    position = np.log(frequency_hz / frequency_hz[0]) / np.log(frequency_hz[-1] / frequency_hz[0])
    bin_of = np.minimum((position * bins).astype(int), bins - 1)
    first = np.flatnonzero(np.diff(bin_of, prepend=-1))
    last = np.append(first[1:], len(value))
    kept = {0, len(value) - 1}
    for a, b in zip(first, last, strict=True):
        kept.add(int(a + np.argmin(value[a:b])))
        kept.add(int(a + np.argmax(value[a:b])))
    return np.array(sorted(kept), dtype=int)


def wrapped_phase_deg(H: Complex[np.ndarray, " line"]) -> Float[np.ndarray, " line"]:
    """Phase in (-180, 180], with NaN, a gap in the curve, where it wraps around.

    >>> wrapped_phase_deg(np.exp(1j * np.radians([170.0, 190.0, 200.0]))).round().tolist()
    [170.0, nan, -160.0]
    """
    phase = np.degrees(np.angle(H))
    jumps = np.flatnonzero(np.abs(np.diff(phase)) > 180.0) + 1
    broken = phase.copy()
    broken[jumps] = np.nan
    return broken


def draw_magnitude(
    axes: Axes,
    frequency_hz: Float[np.ndarray, " line"],
    H: Complex[np.ndarray, " line"],
    bins: int = BINS,
    **style: Any,
) -> None:
    """Decibels of ``H``."""
    level = decibels(H)
    kept = keep_extremes(frequency_hz, level, bins)
    axes.plot(frequency_hz[kept], level[kept], **style)


def bode_figure(height_in: float, frequency_hz: Float[np.ndarray, " line"]) -> tuple[Figure, Axes, Axes]:
    """An empty figure for magnitude over phase [deg], from the first to the last frequency."""
    low, high = frequency_hz[[0, -1]]
    figure = new_figure(height_in)
    magnitude, phase = figure.subplots(2, 1, sharex=True, height_ratios=[1.35, 1.0])
    frequency_axis(magnitude, low, high, label=False)
    frequency_axis(phase, low, high)
    phase.tick_params(labelbottom=True)
    phase_axis(phase)
    return figure, magnitude, phase


def draw_bode(
    magnitude: Axes,
    phase: Axes,
    frequency_hz: Float[np.ndarray, " line"],
    H: Complex[np.ndarray, " line"],
    **style: Any,
) -> None:
    """Decibels of ``H`` and, at the same lines, its phase."""
    kept = keep_extremes(frequency_hz, decibels(H))
    magnitude.plot(frequency_hz[kept], decibels(H[kept]), **style)
    phase.plot(frequency_hz[kept], wrapped_phase_deg(H[kept]), **style)
