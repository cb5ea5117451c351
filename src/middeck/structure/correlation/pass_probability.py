"""Pass rate of a correct model: its own modes with the test's noise, through the same evaluation."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from middeck.campaign.confidence_of_draws import probability_interval
from middeck.errors import ConfigError
from middeck.structure.correlation.evaluation import (
    Candidates,
    Evaluation,
    criterion_values,
    evaluate_shapes,
    nothing_passes,
)
from middeck.structure.correlation.measured_modes import (
    MeasuredModes,
    MeasurementNoise,
    sort_rms,
    straight_channels,
)
from middeck.structure.correlation.review_criteria import Profile
from middeck.structure.modes.solve import Modes
from middeck.values import record

# Percentiles of the worst value under a correct model.
EXPECTED = (5.0, 50.0, 95.0)


@record
class Probability:
    """A share of runs with its 95 % confidence interval (Clopper and Pearson 1934)."""

    passed: int
    runs: int

    @property
    def value(self) -> float:
        """The share itself."""
        return self.passed / self.runs

    @property
    def interval(self) -> tuple[float, float]:
        """Lowest and highest probability that the count does not contradict.

        >>> low, high = Probability(0, 100).interval
        >>> low, round(high, 4)
        (0.0, 0.0362)
        """
        return probability_interval(self.passed, self.runs)


@record
class CorrectModel:
    """Results of the runs of a correct model.

    Attributes:
        passed: Whether each run met each criterion.
        worst: Worst value of each criterion in each run; nan where it applied to no mode.
        paired: Whether every mode of the run found its pair.
    """

    passed: Bool[np.ndarray, "run criterion"]
    worst: Float[np.ndarray, "run criterion"]
    paired: Bool[np.ndarray, " run"]

    @property
    def overall(self) -> Probability:
        """Probability that all criteria are met and all modes paired."""
        both = self.passed.all(axis=1) & self.paired
        return Probability(int(both.sum()), len(both))

    def of(self, criterion: int) -> Probability:
        """Probability that one criterion is met."""
        return Probability(int(self.passed[:, criterion].sum()), len(self.passed))

    def expected(self, criterion: int) -> Float[np.ndarray, "3"] | None:
        """5, 50 and 95 % of the worst value; None where the criterion never applied."""
        seen = self.worst[:, criterion]
        seen = seen[np.isfinite(seen)]
        return np.percentile(seen, EXPECTED) if len(seen) else None


def stated_noise(
    modes: Modes, measured: MeasuredModes, noise: MeasurementNoise | None
) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations of frequencies [Hz] and shapes: of ``noise`` if given, else the test's own.

    Raises `ConfigError` where neither states them.
    """
    if noise is not None:
        rms = sort_rms(straight_channels(modes, measured.node, measured.direction), measured.shape)
        return noise.frequency * measured.frequency_hz, noise.shape * rms
    if measured.frequency_std_hz is None or measured.shape_std is None:
        raise ConfigError(
            "the test states no standard deviations of its frequencies and shapes",
            where="measured modes",
            hint="noise=MeasurementNoise(0.001, 0.02), or frequency_std_hz and shape_std in a JSON file",
        )
    return measured.frequency_std_hz, measured.shape_std


def run_correct_model(
    model: Candidates,
    profile: Profile,
    nominal: Evaluation,
    measured: MeasuredModes,
    noise: tuple[np.ndarray, np.ndarray],
    rng: np.random.Generator,
    runs: int,
) -> CorrectModel:
    """Judge ``runs`` tests of an article that is the model: its paired modes with the stated noise.

    A shape's noise keeps its size relative to the shape, whose scale is the test's own.
    """
    ours, theirs = nominal.pairs.T
    hz, shape = model.frequency_hz[ours], model.shape[:, ours]
    hz_std = noise[0][theirs] * hz / measured.frequency_hz[theirs]
    length = np.linalg.norm(shape, axis=0) / np.linalg.norm(measured.shape[:, theirs], axis=0)
    shape_std = noise[1][:, theirs] * length
    passed, worst = np.zeros((2, runs, len(profile.criteria)))
    paired = np.zeros(runs, dtype=bool)
    for r in range(runs):
        drawn_hz = hz + hz_std * rng.standard_normal(hz.shape)
        noise_of_unit_size = rng.standard_normal(shape.shape)
        if not measured.is_real:
            noise_of_unit_size = (noise_of_unit_size + 1j * rng.standard_normal(shape.shape)) / np.sqrt(2.0)
        drawn = shape + shape_std * noise_of_unit_size
        # No test reports a frequency below zero; one drawn there finds no pair.
        found = evaluate_shapes(model, np.maximum(drawn_hz, np.finfo(float).tiny), drawn, shape_std)
        paired[r] = len(found.pairs) == len(hz)
        passed[r], worst[r] = judge(model, found, profile)
    return CorrectModel(passed.astype(bool), worst, paired)


def judge(model: Candidates, found: Evaluation, profile: Profile) -> tuple[np.ndarray, np.ndarray]:
    """Whether each criterion is met, and its worst value (nan where it applies to no pair)."""
    passed, worst = np.ones(len(profile.criteria), dtype=bool), np.full(len(profile.criteria), np.nan)
    for c, criterion in enumerate(profile.criteria):
        values, _ = criterion_values(model, found, criterion)
        if len(values):
            worst[c] = values.max() if criterion.quantity.has_upper_limit else values.min()
            passed[c] = criterion.holds(float(worst[c]))
        else:
            passed[c] = nothing_passes(model, criterion)
    return passed, worst
