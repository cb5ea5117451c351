"""The one curve on which all decays of a mode lie: amplitude and phase against time.

With rates that depend on the amplitude a alone, da/dt = -sigma(a) a and dphi/dt = omega(a) (Nayfeh and Mook
1979, section 2.3), all decays are parts of one: each begins somewhere on it, with a phase of its own. In
l = log a both are integrals, t = int dl / sigma and phi = int omega / sigma dl.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import BSpline, CubicSpline

from middeck.values import record

ROOM = 1.0  # of log amplitude, for phases and starts to be found
POINTS = 801  # of log amplitude
# Log of the largest and least rate that a search may try: time must advance from point to point in double
# precision.
STEEPEST = 14.0


@record
class Amplitudes:
    """Log amplitudes in falling order, and splines in them that change from ``least`` to ``largest``."""

    least: float
    largest: float
    log: Float[np.ndarray, " point"]
    basis: Float[np.ndarray, "point coefficient"]


def amplitudes(least: float, largest: float, coefficients: int) -> Amplitudes:
    """Splines with even knots in log amplitude, cubic from four coefficients, constant in `ROOM` beyond."""
    low, high = np.log(least), np.log(largest)
    log = np.linspace(high + ROOM, low - ROOM, POINTS)
    degree = min(3, coefficients - 1)
    inner = np.linspace(low, high, coefficients - degree + 1)
    knots = np.concatenate([np.full(degree, inner[0]), inner, np.full(degree, inner[-1])])
    basis = np.asarray(BSpline.design_matrix(np.clip(log, low, high), knots, degree).toarray())
    return Amplitudes(least, largest, log, basis)


def decay_curve(
    at: Amplitudes, log_sigma: Float[np.ndarray, " coefficient"], omega: Float[np.ndarray, " coefficient"]
) -> CubicSpline:
    """(log amplitude, phase) against the time since the largest amplitude."""
    slowness = np.exp(-np.clip(at.basis @ log_sigma, -STEEPEST, STEEPEST))
    time = cumulative_trapezoid(slowness, x=-at.log, initial=0.0)
    phase = cumulative_trapezoid((at.basis @ omega) * slowness, x=-at.log, initial=0.0)
    return CubicSpline(time, np.column_stack([at.log, phase]))
