"""Noise variance of each output on each line of a record, estimated from the residual of a fit.

One record has no second period to compare with: noise is what is smooth over frequency, in one of two ways:

    "output"   noise of sensors: |r|^2 is averaged over neighbouring lines;
    "motion"   forces on the article, shaped by its poles: |A r|^2 is averaged and divided by |A|^2, with
               A = prod (1 - exp(p T) exp(-s T)), the denominator of an innovations model (Ljung 1999, 4.2).

The second keeps the shape of a peak that is narrower than the spacing of lines. The likelier kind is taken.

Distortion of an input that repeats lies on the lines that the input drives (or between them, for even
powers), far above the noise beside them. Driven and silent lines are therefore averaged separately.
"""

from __future__ import annotations

import itertools
from typing import Literal

import numpy as np
from jaxtyping import Bool, Complex, Float

Noise = Literal["output", "motion"]
# Lines to either side in the average, and as a share of all.
HALF, SHARE = 15, 0.1
# No line is quieter than this share of the average: rounding, filters and what no model follows.
QUIETEST = 1e-6
# Mean square coherence of independent noise is one over its degrees of freedom: what is twice that is common.
COMMON = 2.0
# Turns of the search for both kinds of noise at once, and the least of their sum over the median power.
TURNS, LEAST = 10, 0.01


def noise_variance(
    residual: Complex[np.ndarray, "output line column"],
    shape: Float[np.ndarray, " line"] | None = None,
    left: Float[np.ndarray, "output line column"] | None = None,
    driven: Bool[np.ndarray, " line"] | None = None,
) -> Float[np.ndarray, "output line column"]:
    """Variance of each output on each line, common to all experiments: of sensors, or of forces (``shape``).

    ``shape`` is the model's `denominator`; ``left`` the share of noise that the fit leaves on each line, one
    less its leverage: without it the power is taken as it is. ``driven`` are the lines that inputs drive
    from silent ones (`driven_lines`).
    """
    shape = np.ones(residual.shape[1]) if shape is None else shape
    if driven is not None:
        v = np.empty(residual.shape)
        for at, kind in ((driven, noise_variance), (~driven, likelier_variance)):
            v[:, at] = kind(residual[:, at], shape[at], None if left is None else left[:, at])
        return v
    power = np.mean(np.abs(residual) ** 2, axis=2) * shape
    half = max(1, min(HALF, int(SHARE * len(shape))))
    smooth = np.array([_average(row, half) for row in power])
    if left is not None:
        smooth /= np.array([_average(row, half) for row in np.mean(left, axis=2)])
    # A response that is fitted exactly leaves nothing: weights stay finite, and their sum says nothing then.
    floor = QUIETEST * smooth.mean(axis=1, keepdims=True) + np.finfo(float).tiny
    v = (smooth + floor) / shape
    return np.repeat(v[:, :, None], residual.shape[2], axis=2)


def likelier_variance(
    residual: Complex[np.ndarray, "output line column"],
    shape: Float[np.ndarray, " line"],
    left: Float[np.ndarray, "output line column"] | None = None,
    driven: Bool[np.ndarray, " line"] | None = None,
) -> Float[np.ndarray, "output line column"]:
    """The variance under the kind of noise that makes the residual likelier."""
    both = (noise_variance(residual, by, left, driven) for by in (None, shape))
    return min(both, key=lambda v: negative_log_likelihood(residual, v))


def covering_variance(
    residual: Complex[np.ndarray, "output line column"],
    shape: Float[np.ndarray, " line"],
    left: Float[np.ndarray, "output line column"],
    driven: Bool[np.ndarray, " line"] | None = None,
) -> Float[np.ndarray, "output line column"]:
    """The likelier, or on each line that of sensors and forces together where it is more.

    A fit follows the few lines of a narrow peak, so that what is left there does not tell how strong the
    forces are; the flanks of the peak above the noise of sensors do.
    """
    found = likelier_variance(residual, shape, left, driven)
    for at in lines_alike(driven, len(shape)):
        both = _variance_of_both(residual[:, at], shape[at], left[:, at])
        found[:, at] = np.maximum(found[:, at], both)
    return found


def lines_alike(driven: Bool[np.ndarray, " line"] | None, lines: int) -> list[Bool[np.ndarray, " line"]]:
    """Groups of lines with alike noise: all, or the driven and the silent ones."""
    return [np.ones(lines, bool)] if driven is None else [driven, ~driven]


def common_noise_of_residual(
    residual: Complex[np.ndarray, "output line column"], driven: Bool[np.ndarray, " line"] | None = None
) -> Complex[np.ndarray, "output output line"] | None:
    """Correlation of the outputs' noise on each line, from neighbouring lines; None where it may be chance.

    Phases to an input turn over a peak, alike in all outputs that it drives.
    """
    outputs, lines, columns = residual.shape
    if outputs < 2 or driven is not None:
        return None
    half = max(1, min(HALF, int(SHARE * lines)))
    power = np.array([_average(row, half) for row in np.mean(np.abs(residual) ** 2, axis=2)])
    found = np.ones((outputs, outputs, lines), complex)
    for o, p in itertools.combinations(range(outputs), 2):
        cross = np.mean(residual[o] * residual[p].conj(), axis=1)
        both = _average(cross.real, half) + 1j * _average(cross.imag, half)
        found[o, p] = both / np.sqrt(np.maximum(power[o] * power[p], np.finfo(float).tiny))
        found[p, o] = found[o, p].conj()
    off = (np.mean(np.abs(found) ** 2) * outputs - 1.0) / (outputs - 1)
    return found if off > COMMON * np.sum(_hann(half) ** 2) / columns else None


def _hann(half: int) -> Float[np.ndarray, " some"]:
    window = np.hanning(2 * half + 3)[1:-1]
    return window / window.sum()


def _variance_of_both(
    residual: Complex[np.ndarray, "output line column"],
    shape: Float[np.ndarray, " line"],
    left: Float[np.ndarray, "output line column"],
) -> Float[np.ndarray, "output line column"]:
    """v = a + b / |A|^2 with a and b smooth over lines, by Fisher's scoring of each in turn."""
    half = max(1, min(HALF, int(SHARE * len(shape))))
    rows: list[np.ndarray] = []
    for power, share in zip(np.mean(np.abs(residual) ** 2, axis=2), np.mean(left, axis=2), strict=True):
        a, b = np.full_like(power, np.median(power)), np.zeros_like(power)
        least = LEAST * np.median(power) + np.finfo(float).tiny
        for _ in range(TURNS):
            v = a + b / shape + least
            b = _scored(power - share * a, share, 1.0 / shape, v, half)
            v = a + b / shape + least
            a = _scored(power - share * b / shape, share, np.ones_like(v), v, half)
        rows.append(a + b / shape)
    return np.repeat(np.array(rows)[:, :, None], residual.shape[2], axis=2)


def _scored(
    rest: Float[np.ndarray, " line"],
    share: Float[np.ndarray, " line"],
    by: Float[np.ndarray, " line"],
    v: Float[np.ndarray, " line"],
    half: int,
) -> Float[np.ndarray, " line"]:
    """Size of a part of the power that goes with ``by``, from neighbouring lines of variance ``v``."""
    x = by / v
    known = _average(share * x**2, half)
    return np.maximum(_average(rest / v * x, half), 0.0) / np.maximum(known, np.finfo(float).tiny)


def denominator(
    s: Complex[np.ndarray, " line"], poles: Complex[np.ndarray, " pole"], period_s: float
) -> Float[np.ndarray, " line"]:
    """|A|^2 of all ``poles`` [rad/s] with their conjugates: many small factors, taken by logarithms."""
    factors = 1.0 - np.exp(poles * period_s)[:, None] * np.exp(-s * period_s)
    size = np.maximum(np.abs(factors), np.finfo(float).tiny)
    return np.exp(2.0 * np.sum(np.log(size), axis=0))


def _average(power: Float[np.ndarray, " line"], half: int) -> Float[np.ndarray, " line"]:
    """Over neighbours, near ones more (a Hann window)."""
    padded = np.pad(power, half, mode="reflect" if len(power) > half else "edge")
    return np.convolve(padded, _hann(half), mode="valid")


def negative_log_likelihood(
    residual: Complex[np.ndarray, "output line column"], variance: Float[np.ndarray, "output line column"]
) -> float:
    """sum of log v + |r|^2 / v, for circular normal residuals, up to a constant."""
    return float(np.sum(np.log(variance) + np.abs(residual) ** 2 / variance))
