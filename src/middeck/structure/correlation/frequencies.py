"""A model against a survey of frequencies alone: the criteria that they decide, and the pairs that they leave
open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from middeck.errors import ConfigError
from middeck.structure.correlation.correlate import candidates, unmeasured, unpaired
from middeck.structure.correlation.evaluation import members, nothing_passes
from middeck.structure.correlation.frequency_pairs import SAME, nearest_two, pair_frequencies
from middeck.structure.correlation.measured_modes import MeasuredModes, called, not_measured
from middeck.structure.correlation.not_judged import below_the_test, not_judged
from middeck.structure.correlation.review_criteria import RECALLED, Criterion, Profile, Quantity
from middeck.structure.correlation.unit_slips import warnings_on_survey_units
from middeck.structure.modes.solve import Modes
from middeck.values import record


@record(kw_only=True)
class FrequencyFinding:
    """One criterion on frequencies: the worst error of its pairs, None where it has none.

    Where it applies to none it is met, unless the model's fundamental has no partner.
    """

    criterion: Criterion
    worst: float | None
    met: bool


@record(kw_only=True)
class FrequencyComparison:
    """Frequencies of a model and a test, in pairs that rise together.

    Attributes:
        pairs: (mode, measured mode), one to one.
        frequency_error: Frequency error of each pair, model over test less one.
        findings: Findings of the criteria on frequencies.
        unjudged: Criteria of the profile that need shapes.
        unpaired, unmeasured: Measured modes without a partner, and modes of the model within the test's band
            that have none.
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
        """Whether the whole profile is met: never, where it has criteria on shapes."""
        settled = not (self.unjudged or self.unpaired or self.undecided)
        return settled and all(f.met for f in self.findings)

    @property
    def verdict(self) -> str:
        """Open where no criterion is missed and all measured modes are paired, but too little is known."""
        missed = self.unpaired or any(f.worst is not None and not f.met for f in self.findings)
        return "passes" if self.passed else "does not pass" if missed else "open"


def compare_frequencies(modes: Modes, measured: MeasuredModes, profile: Profile) -> FrequencyComparison:
    """Pair frequencies as is likeliest (`frequency_pairs`), and judge the criteria on frequency.

    Frequencies do not distinguish two equal modes: where the model has another mode that fits a measured
    one within the profile's limit, or within twice the distance of its partner, the pair is ``undecided``.

    Raises `ConfigError` where no measured mode has a partner.
    """
    index = np.array(
        [i for i, kind in enumerate(modes.kind) if kind != "rigid" and modes.frequency_hz[i] > 0.0], int
    )
    ours_hz = np.repeat(modes.frequency_hz[index][:, None], len(measured.frequency_hz), axis=1)
    away = np.abs(np.log(ours_hz / measured.frequency_hz))
    ours, theirs = pair_frequencies(ours_hz, measured.frequency_hz).T
    if not len(ours):
        raise ConfigError(
            "no mode of the model has a frequency that was measured",
            where="measured modes",
            hint="; ".join(
                (
                    *warnings_on_survey_units(modes, measured),
                    f"are the frequencies in Hz? {nearest_two(modes.frequency_hz, measured.frequency_hz)}",
                )
            ),
        )
    pairs = np.stack([index[ours], theirs], axis=1)
    error = modes.frequency_hz[pairs[:, 0]] / measured.frequency_hz[theirs] - 1.0
    criteria = [c for c in profile.criteria if c.quantity is Quantity.FREQUENCY_ERROR]
    limit = max((c.limit for c in criteria), default=0.0)
    reach = np.maximum(limit, 2.0 * away[ours, theirs]) + SAME
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
        met = nothing_passes(model, criterion) if worst is None else criterion.holds(worst)
        found.append(FrequencyFinding(criterion=criterion, worst=worst, met=met))
    return tuple(found)


def _warnings(found: FrequencyComparison) -> tuple[str, ...]:
    modes, hz = found.modes, found.measured.frequency_hz
    partner = dict(zip(found.pairs[:, 1].tolist(), found.pairs[:, 0].tolist(), strict=True))
    remarks = list(found.measured.warnings)
    remarks += warnings_on_survey_units(modes, found.measured)
    remarks += ["frequencies alone: pairs rest on their order of size, not on shapes"]
    if found.unjudged:
        remarks.append(
            f"{len(found.unjudged)} criteria of {found.profile.name} need shapes and are not judged"
        )
    if any(f.criterion.recalled for f in found.findings):
        remarks.append(f"limits of {found.profile.name} are {RECALLED}")
    for j in found.undecided:
        left = np.delete(modes.frequency_hz, partner[j])
        remarks.append(
            f"{called(found.measured, j)}: {modes.name[partner[j]]!r} of "
            f"{modes.frequency_hz[partner[j]]:.4g} Hz is an ambiguous partner: "
            f"{_nearest(left, hz[j]):.4g} Hz fits too"
        )
    left = np.delete(modes.frequency_hz, found.pairs[:, 0])
    for j in found.unpaired:
        near = _nearest(left, hz[j])
        off = f": {near:.4g} Hz, the nearest left, is off by {100.0 * (near / hz[j] - 1.0):+.0f} %"
        remarks.append(f"{called(found.measured, j)} has no partner in the model{off if near > 0.0 else ''}")
    remarks += not_measured(modes, found.unmeasured)
    remarks += below_the_test(modes, found.measured, found.pairs[:, 0])
    remarks += not_judged(modes, found.profile, [f.criterion for f in found.findings if f.worst is None])
    return tuple(remarks)


def _nearest(ours_hz: np.ndarray, hz: float) -> float:
    """The one of ``ours_hz`` nearest to ``hz``; zero where all are."""
    moving = ours_hz[ours_hz > 0.0]
    return float(moving[np.argmin(np.abs(np.log(moving / hz)))]) if len(moving) else 0.0
