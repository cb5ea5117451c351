"""Weights of a fit: the measured variance, and what the model cannot follow.

A variance per line estimated from few periods has few degrees of freedom: used as it is, lines that look
quiet by chance would rule the fit. It is averaged over neighbouring lines first.

A model of limited order, or a real structure that is not quite linear, leaves more than the variance says.
That excess is taken as one more variance on all lines, e P_o with P_o the mean square response of the output
and one share e for all outputs, solved from

    sum |r|^2 / (v + e P) = number of lines   (Paule and Mandel 1982)

so that a good model is weighted by its noise and a short one by the size of the responses it must follow. A
share for each output would let a fit give up one output and then weigh it less for being so.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.optimize
from jaxtyping import Complex, Float

from middeck.systems.response import FrequencyResponse

# Half width of the average over lines.
NEIGHBOURS = 10
# Smallest variance, as a share of the mean square response: rounding of double precision data.
ROUNDING = 1e-22


def line_variance(measured: FrequencyResponse) -> Float[np.ndarray, "output line input"]:
    """Variance averaged over neighbouring lines; rounding alone where none was measured."""
    power = np.mean(np.abs(measured.H) ** 2, axis=(0, 2))
    floor = ROUNDING * power[:, None, None]
    if measured.variance is None:
        return np.broadcast_to(floor, np.moveaxis(measured.H, 0, 1).shape).copy()
    v = np.moveaxis(measured.variance, 0, 1)
    half = min(NEIGHBOURS, v.shape[1] - 1)
    padded = np.pad(v, ((0, 0), (half, half), (0, 0)), mode="reflect")
    total = np.cumsum(np.pad(padded, ((0, 0), (1, 0), (0, 0))), axis=1)
    width = 2 * half + 1
    return (total[:, width:] - total[:, :-width]) / width + floor


def excess_variance(
    data: Complex[np.ndarray, "output line input"],
    residual: Complex[np.ndarray, "output line input"],
    variance: Float[np.ndarray, "output line input"],
) -> Float[np.ndarray, " output"]:
    """The variance that the model leaves beyond ``variance`` in each output; zero where none is left."""
    level = np.mean(np.abs(data) ** 2, axis=(1, 2))
    power = np.abs(residual) ** 2 / level[:, None, None]
    known = variance / level[:, None, None]
    if np.mean(power / known) <= 1.0:
        return np.zeros(len(level))
    # At e = max |r|^2 every term is below one: the root lies between; in units of that, for any size of e.
    top = power.max()

    def beyond_one(e: float) -> float:
        return float(np.mean(power / (known + e * top))) - 1.0

    share: Any = scipy.optimize.brentq(beyond_one, 0.0, 1.0, xtol=1e-12)
    return top * float(share) * level
