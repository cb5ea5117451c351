"""Has the article changed between two records? A test on their responses alone, without any model."""

from __future__ import annotations

import numpy as np
import scipy.special
from jaxtyping import Bool, Float

from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.spectra.excess_variance import averaged_degrees, by_output, spread_of
from middeck.identification.uncertainty.parameter_deviations import check_level, joint_tail
from middeck.signals.ports import Port
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

# Lines of two periods are one line if they agree to this share of their spacing.
SAME_LINE = 1e-6
# Lines that moved belong to one band if no more than so many that did not lie between them.
GAP = 3
# Inflation of all lines beyond which their variance is not what makes them differ.
TRUSTED = 1.5


@record(kw_only=True)
class MovedBand:
    """Neighbouring lines on which an entry of the response changed.

    Attributes:
        low_hz, high_hz: First and last line.
        output, input: The path that changed by the most deviations, ``deviations`` on its worst line.
        change: |after - before| / |before| there.
    """

    low_hz: float
    high_hz: float
    output: str
    input: str
    deviations: float
    change: float


@record(kw_only=True)
class ResponseDrift:
    """Differences of two responses.

    Attributes:
        frequency_hz: Lines that both have.
        statistic: |difference|^2 over the sum of both variances: F of 2 and many degrees if nothing changed.
        inflation: Ratio of the statistic's median to that of F, at least one; the statistic is divided by it
            (Devlin and Roeder 1999). A change of all lines alike is no mode but a variance that was stated
            too small: distortion that changes with the signal, where only the noise is known, for example.
        moved: Whether the difference is significant among all lines and paths.
        bands: Bands that changed, from low to high frequency.
        level: Probability that any line is reported as moved when nothing has (Holm 1979).
    """

    frequency_hz: Float[np.ndarray, " line"]
    statistic: Float[np.ndarray, "line output input"]
    inflation: float
    moved: Bool[np.ndarray, "line output input"]
    bands: tuple[MovedBand, ...]
    level: float

    @property
    def drifted(self) -> bool:
        """Whether any band of lines moved."""
        return bool(self.bands)

    @property
    def trusted(self) -> bool:
        """Whether the stated variance explains most lines; if not, single lines prove nothing."""
        return self.inflation <= TRUSTED

    @property
    def sentence(self) -> str:
        """One sentence: what changed."""
        if not self.bands:
            return f"the response moved on none of {len(self.frequency_hz)} lines at the level {self.level:g}"
        parts = [
            f"{_span(b)} Hz ({b.output} from {b.input} by {b.change:.1%}, {b.deviations:.1f} deviations)"
            for b in self.bands
        ]
        doubt = (
            ""
            if self.trusted
            else (
                f"; but all lines differ by {np.sqrt(self.inflation):.1f} times what their variance allows, "
                "so that single ones say little"
            )
        )
        return f"the response moved at {'; '.join(parts)}{doubt}"


def _span(band: MovedBand) -> str:
    low, high = f"{band.low_hz:.4g}", f"{band.high_hz:.4g}"
    return low if low == high else f"{low}-{high}"


def compare_responses(
    before: FrequencyResponse, after: FrequencyResponse, *, level: float = 0.05
) -> ResponseDrift:
    """Test two measured responses for a change, line by line.

    The variances, averaged over neighbouring lines, have known degrees of freedom; |difference|^2 over their
    sum is then F-distributed. It says where something changed, not what, and needs no order. A change on more
    than half of all lines is taken for noise (`ResponseDrift.inflation`): that is for `compare_fits` to find.

    Args:
        before, after: Responses of the same channels with their variances.
        level: Probability of any false alarm.

    Raises `ConfigError` if the channels differ, a variance is missing, no line is common, or the level is no
    probability.
    """
    check_level(level)
    check_channels(before, after)
    if before.variance is None or after.variance is None:
        raise ConfigError(
            "without a variance no difference can be judged", hint="records of two periods or more"
        )
    a, b = common_lines(before.frequency_hz, after.frequency_hz)
    v = [by_output(spread_of(m, relative=False).variance) for m in (before, after)]
    v = [v[0][a], v[1][b]]
    difference = np.abs(after.H[b] - before.H[a])
    statistic = difference**2 / (v[0] + v[1])
    degrees = [2.0 * averaged_degrees(m) for m in (before, after)]
    share = v[0] / (v[0] + v[1])
    slowness = share**2 / degrees[0] + (1.0 - share) ** 2 / degrees[1]
    degrees = 1.0 / np.maximum(slowness, 1e-9)
    inflation = max(1.0, float(np.median(statistic / scipy.special.fdtri(2, degrees, 0.5))))
    p = joint_tail(2.0 * statistic / inflation, 2, degrees)
    moved = holm(p.ravel(), level).reshape(p.shape)
    f = before.frequency_hz[a]
    change = difference / np.maximum(np.abs(before.H[a]), np.finfo(float).tiny)
    deviations = np.sqrt(2.0 * statistic / inflation)
    bands = _bands(f, moved, deviations, change, before.outputs, before.inputs)
    return ResponseDrift(
        frequency_hz=f, statistic=statistic, inflation=inflation, moved=moved, bands=bands, level=level
    )


def holm(p: Float[np.ndarray, " test"], level: float) -> Bool[np.ndarray, " test"]:
    """Significant ones of several tests, with no more than ``level`` of any false one (Holm 1979).

    >>> holm(np.array([0.001, 0.04, 0.02]), 0.05)
    array([ True,  True,  True])
    >>> holm(np.array([0.001, 0.04, 0.03]), 0.05)
    array([ True, False, False])
    """
    order = np.argsort(p)
    passed = p[order] <= level / (len(p) - np.arange(len(p)))
    counts = np.zeros(len(p), dtype=bool)
    counts[order] = np.cumprod(passed).astype(bool)
    return counts


def common_lines(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions of the lines that both have."""
    spacing = min(np.diff(f).min(initial=f[-1]) for f in (before, after))
    near = np.searchsorted(0.5 * (after[1:] + after[:-1]), before)
    same = np.flatnonzero(np.abs(after[near] - before) <= SAME_LINE * spacing)
    if not len(same):
        raise ConfigError(
            "the responses have no line in common", hint="records of one period, or bands that overlap"
        )
    return same, near[same]


def check_channels(
    before: MeasurementModel | FrequencyResponse, after: MeasurementModel | FrequencyResponse
) -> None:
    """Raise `ConfigError` unless both have the same inputs and outputs, by name and unit."""
    for side in ("inputs", "outputs"):
        named = [[f"{p.name} [{p.unit}]" for p in getattr(which, side)] for which in (before, after)]
        if named[0] != named[1]:
            both = " and ".join(", ".join(names) for names in named)
            raise ConfigError(f"the {side} differ: {both}", hint="the same channels, in one order")


def _bands(
    f: np.ndarray,
    moved: np.ndarray,
    deviations: np.ndarray,
    change: np.ndarray,
    outputs: tuple[Port, ...],
    inputs: tuple[Port, ...],
) -> tuple[MovedBand, ...]:
    lines = np.flatnonzero(moved.any(axis=(1, 2)))
    if not len(lines):
        return ()
    bands: list[MovedBand] = []
    for group in np.split(lines, np.flatnonzero(np.diff(lines) > GAP + 1) + 1):
        k, o, i = np.unravel_index(np.argmax(deviations[group]), deviations[group].shape)
        bands.append(
            MovedBand(
                low_hz=float(f[group[0]]),
                high_hz=float(f[group[-1]]),
                output=outputs[o].name,
                input=inputs[i].name,
                deviations=float(deviations[group][k, o, i]),
                change=float(change[group][k, o, i]),
            )
        )
    return tuple(bands)
