"""A model against measured modes, as reviews ask for it, and how often a correct model would pass."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.structure.correlation.assurance import modal_assurance, nearest_basis, phase_collinearity
from middeck.structure.correlation.effective_mass import EffectiveMass, measure_effective_mass
from middeck.structure.correlation.evaluation import (
    WINDOW,
    Candidates,
    Evaluation,
    criterion_values,
    evaluate_shapes,
    nearby_pairs,
)
from middeck.structure.correlation.measured_modes import (
    MeasuredModes,
    MeasurementNoise,
    called,
    not_measured,
    seen,
    sensor_rows,
)
from middeck.structure.correlation.not_judged import (
    below_the_test,
    fundamental_modes,
    hardly_seen,
    not_judged,
)
from middeck.structure.correlation.pass_probability import (
    CorrectModel,
    Probability,
    judge,
    run_correct_model,
    stated_noise,
)
from middeck.structure.correlation.placing import place_channels
from middeck.structure.correlation.reduction import ReducedMass, Reduction, reduce_mass
from middeck.structure.correlation.review_criteria import RECALLED, Criterion, Profile, Quantity
from middeck.structure.correlation.unit_slips import warnings_on_units
from middeck.structure.eigenproblem.repeated import repeated
from middeck.structure.modes.solve import Modes
from middeck.values import record

RUNS = 1000


@record(kw_only=True)
class Finding:
    """Result of one criterion.

    Attributes:
        items: Names of the modes, for a COMAC of the channels, that it applies to.
        values, worst: Value of each item, and the one nearest to failing or farthest beyond; None where it
            applies to nothing, which passes, unless the model's fundamental was not measured.
        probability: Probability that a correct model meets this criterion, given the noise of the test.
        expected: 5, 50 and 95 % of the worst value that a correct model would show.
    """

    criterion: Criterion
    items: tuple[str, ...]
    values: Float[np.ndarray, " item"]
    worst: float | None
    passed: bool
    probability: Probability
    expected: Float[np.ndarray, "3"] | None


@record(kw_only=True)
class Correlation:
    """A model and a test, compared and judged.

    Attributes:
        candidates: Indices in ``modes`` of the rows of ``evaluation.mac``; modes of one frequency are
            compared in the basis nearest to the test's.
        pairs: (mode, measured mode), one to one.
        evaluation: Frequency errors, MAC, COMAC, cross-orthogonality, self-orthogonality; its pairs count
            candidates.
        reduced: The mass at the channels, how it was made, and the condition of the sensor set.
        phase_collinearity: Phase collinearity of each measured mode; 1 for a real shape.
        effective_mass: Effective mass of every mode of the model.
        unpaired, unmeasured: Measured modes without a partner (the verdict is then no), and modes of the
            model within the test's band that were not measured.
        probability: Probability that a correct model passes the whole profile.
    """

    modes: Modes
    measured: MeasuredModes
    profile: Profile
    candidates: Int[np.ndarray, " candidate"]
    pairs: Int[np.ndarray, "pair 2"]
    evaluation: Evaluation
    reduced: ReducedMass
    phase_collinearity: Float[np.ndarray, " measured"]
    effective_mass: EffectiveMass
    findings: tuple[Finding, ...]
    unpaired: tuple[int, ...]
    unmeasured: tuple[int, ...]
    probability: Probability
    warnings: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether every criterion is met and every measured mode is paired."""
        return not self.unpaired and all(f.passed for f in self.findings)

    @property
    def verdict(self) -> str:
        """Open where only an unmeasured fundamental keeps the profile from being met."""
        missed = self.unpaired or any(f.worst is not None and not f.passed for f in self.findings)
        return "passes" if self.passed else "does not pass" if missed else "open"


@named_kinds
def correlate_modes(
    modes: Modes,
    measured: MeasuredModes,
    profile: Profile,
    *,
    rng: np.random.Generator,
    noise: MeasurementNoise | None = None,
    reduction: Reduction = Reduction.SEREP,
    runs: int = RUNS,
) -> Correlation:
    """Compare a model's modes with measured ones and judge them by ``profile``.

    Each criterion comes with the probability that a correct model would meet it: ``runs`` times the model's
    own paired modes get the stated noise and go through the same pairing, measures and limits. ``noise``
    replaces the standard deviations that the test states. The reduced mass is built once, on the modes that
    were paired.

    Two models on different meshes are compared by `measure_modes` of the one at common nodes.

    Raises `ConfigError` for a channel that the model does not have, a test without stated noise, no mode in
    common, or channels that the reduction cannot work with.
    """
    if not measured.node:
        raise ConfigError(
            "the test has frequencies alone", where="measured modes", hint="compare_frequencies judges these"
        )
    measured = place_channels(modes.equilibrium.model, measured)
    spread = stated_noise(modes, measured, noise)
    if runs < 1:
        raise ConfigError(f"{runs} runs of a correct model", where="runs", hint="1 or more, e.g. 1000")
    rows = sensor_rows(modes, measured.node, measured.direction)
    units = warnings_on_units(modes, measured, seen(rows, modes))
    index = _candidates(modes, measured, units)
    model, reduced = _model(modes, measured, rows, index, profile, reduction, units)
    found = evaluate_shapes(model, measured.frequency_hz, measured.shape, spread[1])
    correct = run_correct_model(model, profile, found, measured, spread, rng, runs)
    pairs = np.stack([index[found.pairs[:, 0]], found.pairs[:, 1]], axis=1)
    findings = _findings(modes, measured, model, found, profile, correct, pairs)
    alone, missing = unpaired(measured, pairs), unmeasured(modes, measured, pairs)
    faint = hardly_seen(modes, measured, spread[1], pairs, seen(rows, modes)) * (reduction is Reduction.SEREP)
    return Correlation(
        modes=modes,
        measured=measured,
        profile=profile,
        candidates=index,
        pairs=pairs,
        evaluation=found,
        reduced=reduced,
        phase_collinearity=phase_collinearity(measured.shape),
        effective_mass=measure_effective_mass(modes),
        findings=findings,
        unpaired=alone,
        unmeasured=missing,
        probability=correct.overall,
        warnings=(
            *measured.warnings,
            *units,
            *faint,
            *_warnings(modes, measured, profile, findings, pairs, alone, missing),
        ),
    )


def _candidates(modes: Modes, measured: MeasuredModes, units: tuple[str, ...]) -> np.ndarray:
    """Modes that are not rigid and within the pairing window of any measured frequency."""
    low, high = measured.frequency_hz.min() / WINDOW, measured.frequency_hz.max() * WINDOW
    hz = modes.frequency_hz
    inside = [
        i for i, kind in enumerate(modes.kind) if kind != "rigid" and hz[i] > 0.0 and low <= hz[i] <= high
    ]
    if not inside:
        flexible = [f"{hz[i]:.4g}" for i, kind in enumerate(modes.kind) if kind != "rigid"][:6]
        raise ConfigError(
            f"no mode of the model between {low:.4g} and {high:.4g} Hz",
            where="measured modes",
            hint="; ".join(
                (
                    *units,
                    f"are the frequencies in Hz? the model's lowest are {', '.join(flexible) or 'none'} Hz",
                )
            ),
        )
    return np.array(inside, dtype=int)


def _model(
    modes: Modes,
    measured: MeasuredModes,
    rows: sp.csr_array,
    index: np.ndarray,
    profile: Profile,
    reduction: Reduction,
    units: tuple[str, ...],
) -> tuple[Candidates, ReducedMass]:
    """The candidates at the channels, and the mass reduced on those that the test pairs with.

    Pairs rest on the MAC alone, so that they can be found before there is a mass.
    """
    shape = seen(rows, modes)[:, index]
    alike = modal_assurance(shape, measured.shape)
    pairs = nearby_pairs(alike, modes.frequency_hz[index], measured.frequency_hz)
    if not len(pairs):
        raise ConfigError(
            "no measured mode resembles any of the model's",
            hint="; ".join((*units, "check nodes, directions and frequencies")),
        )
    reduced = reduce_mass(modes, rows, reduction, [int(i) for i in index[pairs[:, 0]]])
    for cluster in repeated(modes.omega[index] ** 2):
        partners = pairs[np.isin(pairs[:, 0], cluster), 1]
        shape[:, cluster] = nearest_basis(shape[:, cluster], measured.shape[:, partners])
    return candidates(modes, index, shape, reduced.mass, profile), reduced


def candidates(
    modes: Modes, index: np.ndarray, shape: np.ndarray, mass: np.ndarray, profile: Profile
) -> Candidates:
    """The modes ``index`` with their ``shape`` at channels of the reduced ``mass``."""
    effective = measure_effective_mass(modes).fraction[index]
    lowest = fundamental_modes(modes)
    return Candidates(
        frequency_hz=modes.frequency_hz[index],
        shape=shape,
        mass=mass,
        significant=np.any(effective > profile.significant_fraction, axis=1),
        fundamental=np.isin(index, lowest),
        has_fundamental=len(lowest) > 0,
    )


def _findings(
    modes: Modes,
    measured: MeasuredModes,
    model: Candidates,
    found: Evaluation,
    profile: Profile,
    correct: CorrectModel,
    pairs: np.ndarray,
) -> tuple[Finding, ...]:
    passed, worst = judge(model, found, profile)
    named = [modes.name[i] for i in pairs[:, 0]]
    findings: list[Finding] = []
    for c, criterion in enumerate(profile.criteria):
        values, members = criterion_values(model, found, criterion)
        names = measured.channels if criterion.quantity is Quantity.COMAC else named
        findings.append(
            Finding(
                criterion=criterion,
                items=tuple(names[i] for i in members),
                values=values,
                worst=float(worst[c]) if len(values) else None,
                passed=bool(passed[c]),
                probability=correct.of(c),
                expected=correct.expected(c),
            )
        )
    return tuple(findings)


def unpaired(measured: MeasuredModes, pairs: np.ndarray) -> tuple[int, ...]:
    """Measured modes without a partner in the model."""
    return tuple(sorted(set(range(len(measured.frequency_hz))) - set(pairs[:, 1].tolist())))


def unmeasured(modes: Modes, measured: MeasuredModes, pairs: np.ndarray) -> tuple[int, ...]:
    """Modes of the model within the test's band that were not measured."""
    low, high = measured.frequency_hz.min(), measured.frequency_hz.max()
    partners = set(pairs[:, 0].tolist())
    return tuple(
        i
        for i, hz in enumerate(modes.frequency_hz)
        if low <= hz <= high and modes.kind[i] != "rigid" and i not in partners
    )


def _warnings(
    modes: Modes,
    measured: MeasuredModes,
    profile: Profile,
    findings: tuple[Finding, ...],
    pairs: np.ndarray,
    unpaired: tuple[int, ...],
    unmeasured: tuple[int, ...],
) -> tuple[str, ...]:
    remarks: list[str] = []
    recalled = sum(c.recalled for c in profile.criteria)
    if recalled:
        remarks.append(f"{recalled} of {len(profile.criteria)} limits of {profile.name} are {RECALLED}")
    remarks += [f"{called(measured, j)} has no partner in the model" for j in unpaired]
    remarks += not_measured(modes, unmeasured)
    remarks += below_the_test(modes, measured, pairs[:, 0])
    remarks += not_judged(modes, profile, [f.criterion for f in findings if not f.items])
    return tuple(remarks)
