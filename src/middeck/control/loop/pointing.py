r"""Pointing budgets: absolute error, mean over a window, jitter within it, drift between two windows.

Terms of ECSS-E-ST-60-10C (Control performance, 2008): absolute, mean and relative performance error and
performance drift. As variances of a stationary error with two-sided density S each is \int F(f) S(f) df
with an exact weight (Pittelkau 2003, "Definitions, metrics, and algorithms for displacement,
jitter, and stability", AAS 03-559):

    absolute   1
    mean       sinc^2(pi f T), of the mean over a window T
    relative   1 - sinc^2(pi f T), of what is left about that mean, averaged over the window: jitter
    drift      4 sin^2(pi f tau) sinc^2(pi f T), of the difference of two means a time tau apart: stability

with sinc x = sin x / x.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.loop.closed_loop import ClosedLoop
from middeck.control.loop.performance import Performance, loop_rms
from middeck.errors import ConfigError
from middeck.systems.norms.band_rms import weighed_rms
from middeck.values import record

PERIODS = 20_000
"""Largest number of periods of a window's weight in the band; more take minutes of quadrature."""
PERIODS_A_PANEL = 2.0
"""Periods per panel: a Gauss rule of 16 points integrates two periods of a cosine to 1e-13."""


@record
class PointingWindow:
    """Averaging window of an error, and the time between two windows.

    Attributes:
        length_s: T, the window (an exposure).
        lag_s: tau, between the beginnings of two windows.
    """

    length_s: float
    lag_s: float

    def __post_init__(self) -> None:
        if not 0.0 < self.length_s < np.inf or not 0.0 < self.lag_s < np.inf:
            raise ConfigError(
                f"window of {self.length_s} s, lag of {self.lag_s} s", hint="both positive and finite"
            )


@record(kw_only=True)
class PointingBudget:
    """Root mean squares of each output, in its unit; ``inf`` for an unstable loop.

    Attributes:
        outputs: Names of the outputs z.
        absolute: Rms of the error.
        mean: Rms of the mean over a window.
        relative: Rms about that mean (jitter); absolute^2 = mean^2 + relative^2.
        drift: Rms of the difference of two windows' means.
    """

    outputs: tuple[str, ...]
    absolute: Float[np.ndarray, " z"]
    mean: Float[np.ndarray, " z"]
    relative: Float[np.ndarray, " z"]
    drift: Float[np.ndarray, " z"]


def budget_pointing(loop: ClosedLoop, performance: Performance, window: PointingWindow) -> PointingBudget:
    """The budget of each output z, disturbed at w within the band of ``performance``.

    The absolute error has a closed form; the others use adaptive quadrature with exact weights. All are one
    standard deviation. Raises `ConfigError` for a window too long for the band.

    >>> from middeck.control.loop.closed_loop import leave_open
    >>> from middeck.systems.plants.plant import Plant
    >>> from middeck.signals.ports import Port
    >>> from middeck.systems.state_space.statespace import StateSpace
    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> plant = Plant(dynamics=lag, inputs=(Port("w", "N"),), outputs=(Port("z", "rad"),), w=("w",), z=("z",))
    >>> disturbance = Performance(np.ones(1), np.eye(1), (0.0, 100.0))
    >>> budget = budget_pointing(leave_open(plant), disturbance, PointingWindow(0.1, 10.0))
    >>> round(float(budget.relative[0] / budget.absolute[0]), 3)            # slower than the window
    0.178
    """
    names = tuple(port.name for port in loop.outputs)
    absolute = loop_rms(loop, performance)
    if not loop.stable:
        unbounded = np.full(len(names), np.inf)
        parts = dict.fromkeys(("absolute", "mean", "relative", "drift"), unbounded)
        return PointingBudget(outputs=names, **parts)
    cuts = _cuts(window, performance.band_hz)
    mean, relative, drift = (
        weighed_rms(
            loop.system,
            performance.intensity,
            performance.band_hz,
            lambda omega, weight=weight: weight(omega / (2.0 * np.pi), window),
            cuts,
        )
        for weight in (mean_weight, relative_weight, drift_weight)
    )
    return PointingBudget(outputs=names, absolute=absolute, mean=mean, relative=relative, drift=drift)


def mean_weight(
    frequency_hz: Float[np.ndarray, " line"], window: PointingWindow
) -> Float[np.ndarray, " line"]:
    """sinc^2(pi f T); NumPy's sinc includes the pi."""
    return np.sinc(frequency_hz * window.length_s) ** 2


def relative_weight(
    frequency_hz: Float[np.ndarray, " line"], window: PointingWindow
) -> Float[np.ndarray, " line"]:
    """1 - sinc^2(pi f T), by its series where the difference would cancel.

    >>> relative_weight(np.array([1e-6]), PointingWindow(1.0, 1.0)) * 3.0 / (np.pi * 1e-6) ** 2
    array([1.])
    """
    square = (np.pi * frequency_hz * window.length_s) ** 2
    # 1 - sinc^2 x = x^2/3 - 2 x^4/45 + x^6/315 - ...; below x^2 = 1e-2 the next term is 1e-10 of the first.
    series = square / 3.0 * (1.0 - square * (2.0 / 15.0 - square * (1.0 / 105.0 - square * 2.0 / 4725.0)))
    return np.where(square < 1e-2, series, 1.0 - mean_weight(frequency_hz, window))


def drift_weight(
    frequency_hz: Float[np.ndarray, " line"], window: PointingWindow
) -> Float[np.ndarray, " line"]:
    """4 sin^2(pi f tau) sinc^2(pi f T)."""
    return 4.0 * np.sin(np.pi * frequency_hz * window.lag_s) ** 2 * mean_weight(frequency_hz, window)


def _cuts(window: PointingWindow, band_hz: tuple[float, float]) -> Float[np.ndarray, " cut"]:
    """Panels short enough for the weights to be smooth in them [rad/s]."""
    longest = max(window.length_s, window.length_s + window.lag_s)
    count = (band_hz[1] - band_hz[0]) * longest
    if count > PERIODS:
        raise ConfigError(
            f"{longest:g} s span {count:.0f} periods of the band {band_hz[0]:g} to {band_hz[1]:g} Hz",
            hint=f"a shorter window, lag or band: at most {PERIODS} periods",
        )
    return 2.0 * np.pi * np.arange(band_hz[0], band_hz[1], PERIODS_A_PANEL / longest)
