"""A model against a survey of frequencies alone: what they can tell, and where they leave open which mode is
meant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from middeck.errors import ConfigError
from middeck.structure.correlation.correlate import candidates, unmeasured, unpaired
from middeck.structure.correlation.evaluation import WINDOW, members
from middeck.structure.correlation.measured_modes import MeasuredModes, not_measured
from middeck.structure.correlation.review_criteria import RECALLED, Criterion, Profile, Quantity
from middeck.structure.correlation.unit_slips import doubt_survey_units
from middeck.structure.modes.solve import Modes
from middeck.values import record


@record(kw_only=True)
class FrequencyFinding:
    """One criterion on frequencies: the worst error of the pairs that it applies to, None where to none."""

    criterion: Criterion
    worst: float | None
    met: bool


@record(kw_only=True)
class FrequencyComparison:
    """Frequencies of a model and a test, paired by nearness.

    Attributes:
        pairs: (mode, measured mode), one to one.
        frequency_error: Frequency error of each pair, model over test less one.
        findings: Findings of the criteria on frequencies.
        unjudged: Criteria of the profile that need shapes.
        unpaired, unmeasured: Measured modes without a partner within an octave, and modes of the model within
            the test's band that have none.
        undecided: Measured modes that another mode of the model fits within the limit, or nearly as well.
    """

    modes: Modes
    measured: MeasuredModes
    profile: Profile
    pairs: Int[np.ndarray, "pair 2"]
    frequency_error: Float[np.ndarray, " pair"]
    findings: tuple[FrequencyFinding, ...]
    unjudged: tuple[Criterion, ...]
    unpaired: tuple[int, ...]
    unmeasured: tuple[int, ...]
    undecided: tuple[int, ...]
    warnings: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether the whole profile is shown to be met: never, where it has criteria on shapes."""
        settled = not (self.unjudged or self.unpaired or self.undecided)
        return settled and all(f.met for f in self.findings)


def compare_frequencies(modes: Modes, measured: MeasuredModes, profile: Profile) -> FrequencyComparison:
    """Pair frequencies at the least sum of relative distances, and judge the criteria on frequency.

    Two modes of one frequency are not told apart by it: where the model has another mode that fits a measured
    one within the profile's limit, or within twice the distance of its partner, the pair is ``undecided``.

    Raises `ConfigError` where no mode of the model is within an octave of a measured one.
    """
    index = np.array(
        [i for i, kind in enumerate(modes.kind) if kind != "rigid" and modes.frequency_hz[i] > 0.0], int
    )
    away = np.abs(np.log(modes.frequency_hz[index][:, None] / measured.frequency_hz))
    # Beyond the window any partner is as bad as none.
    ours, theirs = linear_sum_assignment(np.minimum(away, np.log(WINDOW)))
    near = away[ours, theirs] < np.log(WINDOW)
    order = np.argsort(theirs[near], kind="stable")
    ours, theirs = ours[near][order], theirs[near][order]
    if not len(ours):
        raise ConfigError(
            "no mode of the model is within an octave of a measured one",
            where="measured modes",
            hint="are the frequencies in Hz?",
        )
    pairs = np.stack([index[ours], theirs], axis=1)
    error = modes.frequency_hz[pairs[:, 0]] / measured.frequency_hz[theirs] - 1.0
    criteria = [c for c in profile.criteria if c.quantity is Quantity.FREQUENCY_ERROR]
    limit = max((c.limit for c in criteria), default=0.0)
    reach = np.maximum(limit, 2.0 * away[ours, theirs])
    undecided = tuple(int(j) for j, r in zip(theirs, reach, strict=True) if np.sum(away[:, j] <= r) > 1)
    found = FrequencyComparison(
        modes=modes,
        measured=measured,
        profile=profile,
        pairs=pairs,
        frequency_error=error,
        findings=_judge(modes, index, ours, error, criteria, profile),
        unjudged=tuple(c for c in profile.criteria if c not in criteria),
        unpaired=unpaired(measured, pairs),
        unmeasured=unmeasured(modes, measured, pairs),
        undecided=undecided,
        warnings=(),
    )
    return replace(found, warnings=_warnings(found))


def _judge(
    modes: Modes,
    index: np.ndarray,
    ours: np.ndarray,
    error: np.ndarray,
    criteria: list[Criterion],
    profile: Profile,
) -> tuple[FrequencyFinding, ...]:
    model = candidates(modes, index, np.zeros((0, len(index))), np.zeros((0, 0)), profile)
    found: list[FrequencyFinding] = []
    for criterion in criteria:
        values = np.abs(error[members(model, ours, criterion.group)])
        worst = float(values.max()) if len(values) else None
        found.append(
            FrequencyFinding(criterion=criterion, worst=worst, met=worst is None or worst <= criterion.limit)
        )
    return tuple(found)


def _warnings(found: FrequencyComparison) -> tuple[str, ...]:
    modes, hz = found.modes, found.measured.frequency_hz
    partner = dict(zip(found.pairs[:, 1].tolist(), found.pairs[:, 0].tolist(), strict=True))
    said = list(found.measured.warnings)
    said += doubt_survey_units(modes, found.measured)
    said += ["frequencies alone: pairs rest on their order of size, not on shapes"]
    if found.unjudged:
        said.append(f"{len(found.unjudged)} criteria of {found.profile.name} need shapes and are not judged")
    if any(f.criterion.recalled for f in found.findings):
        said.append(f"limits of {found.profile.name} are {RECALLED}")
    for j in found.undecided:
        left = np.delete(modes.frequency_hz, partner[j])
        left = left[left > 0.0]
        other = left[np.argmin(np.abs(np.log(left / hz[j])))]
        said.append(
            f"measured mode {j} of {hz[j]:.4g} Hz: {modes.name[partner[j]]!r} of "
            f"{modes.frequency_hz[partner[j]]:.4g} Hz is an ambiguous partner: {other:.4g} Hz fits too"
        )
    said += [f"measured mode {j} of {hz[j]:.4g} Hz has no partner in the model" for j in found.unpaired]
    said += not_measured(modes, found.unmeasured)
    said += [f"no measured mode is judged by: {f.criterion}" for f in found.findings if f.worst is None]
    return tuple(said)
