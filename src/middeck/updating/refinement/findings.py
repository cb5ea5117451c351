"""Uncertainty after a refinement, in words: unknowns not seen, and disagreement of model and test."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from middeck.errors import ConfigError, NumericalError
from middeck.structure.correlation.assurance import modal_assurance
from middeck.structure.correlation.unit_slips import warnings_on_survey_units
from middeck.structure.model.article import JointState
from middeck.updating.refinement.bayesian_estimate import errors_shown
from middeck.updating.refinement.contradictions import CONTRADICT
from middeck.updating.refinement.fixed_inertias import INERTIA, LARGER, FixedInertias, fixed_inertias
from middeck.updating.refinement.model_errors import HALF, sorts_of
from middeck.updating.refinement.other_frequencies import other_frequencies
from middeck.updating.refinement.other_pairs import other_pairs
from middeck.updating.refinement.problem import MODAL, MODES, STATIC
from middeck.updating.refinement.refine import Refined, off_the_rest, problem_of
from middeck.updating.refinement.repeated_tests import repeated_tests
from middeck.updating.refinement.wrong_channels import wrong_channels
from middeck.updating.refinement.wrong_readings import wrong_readings
from middeck.updating.residuals.damping_rows import log_std, shifted_by_losses
from middeck.updating.residuals.pairing import WINDOW, at_channels
from middeck.updating.residuals.surveys import Compared, left_open

# Share of the prior standard deviation: an unknown that keeps this much was not determined.
KEPT = 0.9
# Prior deviations: an unknown that ends farther away is where the prior said that it is not.
FAR = 2.5
# Component of a direction below which a parameter is not named.
PART = 0.35
# A model error this many times the noise of the test counts.
ABOVE = 2.0
# Deviations: a response that is off by more has a model error that was not stated.
MISSED = 1.5
# Stated deviations by which losses, which are not compared, may move a frequency without a word.
SHIFTED = 1.0
# Assurance from which on two shapes are one.
SAME = 0.9
# Pairs of close modes that are named.
NAMED = 3


def unseen(refined: Refined) -> tuple[str, ...]:
    """Unknowns that the surveys hardly determine."""
    return tuple(
        u.name
        for u, std in zip(refined.unknowns, refined.estimate.x_std, strict=True)
        if std > KEPT * u.spread
    )


def together(refined: Refined) -> tuple[tuple[str, ...], ...]:
    """Groups of unknowns whose sum alone the surveys determine, by their shares in directions not seen."""
    alone = set(unseen(refined))
    groups: dict[tuple[str, ...], None] = {}
    for gain, direction in zip(refined.estimate.gain, refined.estimate.direction, strict=True):
        named = [u.name for u, part in zip(refined.unknowns, direction, strict=True) if abs(part) > PART]
        if gain < 1.0 and len(named) > 1 and not alone.intersection(named):
            groups[tuple(named)] = None
    return tuple(groups)


def findings(refined: Refined) -> tuple[str, ...]:
    """A sentence for each warning before the refined article is used."""
    return (
        *(
            f"{c.survey.name}: {warning}"
            for c in refined.compared
            for warning in warnings_on_survey_units(c.modes, c.survey.measured)
        ),
        *_of_the_search(refined),
        *repeated_tests([c.survey for c in refined.compared], [c.test for c in refined.statics]),
        *_of_contradictions(refined),
        *_of_unknowns(refined),
        *_of_the_model(refined),
        *(warning for c in refined.compared for warning in _of_unpaired(c)),
        *(f"{c.survey.name}: {warning}" for c in refined.compared for warning in c.survey.measured.warnings),
        *_of_responses(refined),
        *_of_damping(refined),
        *other_frequencies(refined),
        *(_mixing(c, some) for c in refined.compared if (some := left_open(c))),
        *_of_other_pairs(refined),
        *(warning for c in refined.compared for warning in wrong_channels(c)),
        *wrong_readings(refined),
    )


def _of_unpaired(c: Compared) -> Iterator[str]:
    measured, free = c.survey.measured, c.free
    alike = modal_assurance(at_channels(free, measured), measured.shape) if measured.node else None
    for j in c.unpaired:
        hz = measured.frequency_hz[j]
        none = "has no partner by its frequency" if alike is None else "resembles none of the model's"
        mode = f"{c.survey.name}: the measured mode of {hz:.4g} Hz {none}"
        i = 0 if alike is None else int(np.argmax(np.where(free.omega > 0.0, alike[:, j], 0.0)))
        ours = free.frequency_hz[i]
        if alike is not None and alike[i, j] > SAME and max(hz / ours, ours / hz) > WINDOW:
            yield (
                f"{mode} within a factor of {WINDOW:g} in frequency and was left out: its shape is that of "
                f"the mode of {ours:.4g} Hz. Are frequencies in Hz, and of this article in this environment?"
            )
        else:
            yield f"{mode} and was left out"


def _of_other_pairs(refined: Refined) -> Iterator[str]:
    several = itertools.groupby(other_pairs(refined), lambda pair: pair.survey)
    shaped = {c.survey.name for c in refined.compared if c.survey.measured.node}
    for survey, (first, *more) in several:
        advice = "Shapes at more channels" if survey in shaped else "Measured shapes"
        others = f" (so may {len(more)} more of its modes be others)" if more else ""
        yield (
            f"{survey}: the measured mode of {first.measured_hz:.4g} Hz was taken for the model's of "
            f"{first.paired_hz:.4g} Hz and may as well be that of {first.other_hz:.4g} Hz{others}: shapes do "
            f"not distinguish them, the priors allow either, and if it is, {first.unknown} is wrong by "
            f"{first.off:.2g} of its standard deviations. {advice}, the missing modes, or narrower spreads "
            "would decide"
        )


def _mixing(compared: Compared, some: Sequence[tuple[float, float]]) -> str:
    named = ", ".join(f"{a:.4g} and {b:.4g} Hz" for a, b in some[:NAMED])
    more = f" and {len(some) - NAMED} more pairs" if len(some) > NAMED else ""
    return (
        f"{compared.survey.name}: the model's modes at {named}{more} are close, and no measured shape "
        "distinguishes them: another set of unknowns may fit as well"
    )


def _of_the_search(refined: Refined) -> Iterator[str]:
    if not refined.converged:
        yield (
            f"the refinement did not converge: its last step moved an unknown by {refined.history[-1]:.2g} "
            "standard deviations; narrower spreads or fewer unknowns may help"
        )
    pairs = sum(len(c.pairs) for c in refined.compared)
    readings = sum(len(c.value) for c in refined.statics)
    if pairs + readings < len(refined.unknowns):
        beside = f" and {readings} static readings" if readings else ""
        yield (
            f"{pairs} measured modes{beside} for {len(refined.unknowns)} unknowns: the values of most "
            "follow from their priors; measure more modes, other gimbal angles or added masses"
        )


def _of_contradictions(refined: Refined) -> Iterator[str]:
    """Surveys whose deviations `refine` widened, and by what each is off the article of all."""
    by = max((float(c.std[0] / c.survey.std[c.pairs[0, 1]]) for c in refined.compared), default=1.0)
    if by > CONTRADICT:
        bare = any(not c.survey.measured.node for c in refined.compared)
        pairing = ", or were modes taken for others, which shapes would show" if bare else ""
        means = [f"{name} by {100.0 * off:+.2g} %" for name, off in off_the_rest(refined)]
        yield (
            "the surveys contradict one another: their frequencies differ from those of any one article by "
            f"{by:.1f} times their standard deviations, on average {', '.join(means)}; these were widened by "
            "this factor. Did the article change between the tests, is a set-up not as stated, a clock off"
            f"{pairing}?"
        )


def _of_unknowns(refined: Refined) -> Iterator[str]:
    for unknown, x in zip(refined.unknowns, refined.estimate.x, strict=True):
        if abs(x) > FAR * unknown.spread:
            yield (
                f"{unknown.name} ends {abs(x) / unknown.spread:.1f} standard deviations from its prior: is "
                "the prior right, or does it make up for something that the model lacks?"
            )
    if names := unseen(refined):
        yield f"the tests do not determine {', '.join(names)}"
    for group in together(refined):
        yield f"the tests determine a combination of {' and '.join(group)}, but not each of them"
    if fixed := fixed_inertias(refined):
        yield _warn_of_inertias(fixed)


def _warn_of_inertias(fixed: FixedInertias) -> str:
    bodies = ", ".join(fixed.bodies[:NAMED]) + ", ..." * (len(fixed.bodies) > NAMED)
    reasons = ["the tests would fit better"] * fixed.fits
    if fixed.larger > LARGER:
        reasons.append(f"the deviation of {fixed.determined} would be {fixed.larger:.2g} times larger")
    return (
        f"{', '.join(fixed.unknowns)}: a mass is moved and the inertia of the same body ({bodies}) is not, "
        f"as if that were known exactly; were it in proportion, {' and '.join(reasons)}. Add "
        f"{fixed.bodies[0]}{INERTIA}* and the like to the parameters of the unknown of the mass, unless the "
        "inertia is known better than the mass"
    )


def _of_the_model(refined: Refined) -> Iterator[str]:
    problem = problem_of(refined, refined.compared, refined.statics, refined.fields)
    tau = np.where(errors_shown(problem, refined.estimate.tau), refined.estimate.tau, 0.0)
    if refined.compared:
        noise = float(np.median(np.concatenate([c.std[: len(c.pairs)] for c in refined.compared])))
        stated = float(np.median(np.concatenate([c.survey.std[c.pairs[:, 1]] for c in refined.compared])))
        seen = {int(k) for c in refined.compared for k in sorts_of(c.modes, c.pairs[:, 0])}
        for k in sorted(seen):
            sort, size = MODES[k], tau[k]
            if size > ABOVE * noise:
                yield (
                    f"no unknowns near their priors fit the {sort} modes better than {100.0 * size:.2g} %,"
                    " where the test states "
                    f"{100.0 * stated:.2g} %: a model error, which the predicted intervals include"
                )
    shown, std = refined.shear
    if -shown > ABOVE * std:
        yield (
            f"the frequencies show {shown:.2g} +- {std:.2g} times the effect of shear flexibility and mesh "
            "refinement, which the model lacks; it cannot be negative: another error shifts all modes one way"
        )
    if shown > ABOVE * std:
        yield (
            f"the frequencies show {shown:.2g} +- {std:.2g} times the effect of shear flexibility and mesh "
            "refinement, which the model lacks (1: shear of tubes, infinitely many elements); predictions "
            "include it, but members with a shear stiffness, or more elements, would be better"
        )
    if refined.statics:
        yield from _of_statics(refined, *tau[MODAL : MODAL + len(STATIC)].tolist())


def _of_responses(refined: Refined) -> Iterator[str]:
    for c in refined.compared:
        if c.survey.friction and c.survey.response is not None:
            yield (
                f"{c.survey.name}: the response is compared with shapes of joints that swing freely; a "
                "joint that sticks makes others: leave the response out, or take friction out of the record "
                "before the fit (identify --friction)"
            )
    for r in refined.responses:
        if r.miss > MISSED:
            yield (
                f"{r.survey}: the response is off by {r.magnitude_db:.2g} dB and "
                f"{r.phase_deg:.2g} deg, {r.miss:.1f} times what noise and the stated model error "
                "explain: its weight is reduced by that factor"
            )
        for zero in r.lost:
            yield (
                f"{r.survey}: the model has no anti-resonance from {zero.input} to {zero.output} near "
                f"{zero.frequency_hz:.4g} Hz: the measured one was left out"
            )


def _of_damping(refined: Refined) -> Iterator[str]:
    with_losses = {d.survey.name for d in refined.damped}
    yield from (
        warning for c in refined.compared if c.survey.name not in with_losses for warning in _of_undamped(c)
    )
    if not refined.damped:
        return
    several = [d for d in refined.damped if len(d.pairs)]
    by = max((float(d.std[0] / log_std(d.survey)[d.pairs[0, 1]]) for d in several), default=1.0)
    if by > CONTRADICT:
        yield (
            "the surveys contradict one another in damping: their ratios differ from those of any one "
            f"article by {by:.1f} times their standard deviations; these were widened by this factor. Was "
            "one test taken at another amplitude? Friction makes damping depend on it"
        )
    for d in refined.damped:
        if d.left_out:
            hz = ", ".join(f"{f:.4g}" for f in d.survey.measured.frequency_hz[list(d.left_out)])
            yield (
                f"{d.survey.name}: the damping ratios of the modes of {hz} Hz are zero, not stated or not "
                "determined, and were left out"
            )
        yield from (
            f"{d.survey.name}: mode {d.modes.name[i]!r} shares {100.0 * (1.0 - d.likeness[k]):.0f} % of its "
            "complex shape with its neighbours: damping and frequency are those of the complex mode, and "
            "which mode is which is uncertain"
            for k, i in enumerate(d.pairs[:, 0])
            if d.likeness[k] < HALF
        )
    if joints := ", ".join(f.joint for f in refined.friction()):
        yield f"predicted modes are of the article without the friction of joints: {joints}"
        yield from (warning for c in refined.compared for warning in _of_joints_taken_for_free(c, refined))
    if not several:
        return
    size, known = refined.estimate.tau[-1], np.median(np.concatenate([d.std for d in several]))
    problem = problem_of(refined, refined.compared, refined.statics, refined.fields)
    if size > ABOVE * known and errors_shown(problem, refined.estimate.tau)[-1]:
        yield (
            f"no unknowns fit the damping ratios better than {100.0 * size:.2g} %, where the test states "
            f"{100.0 * known:.2g} %: a model error, which the predicted intervals include"
        )


def _of_joints_taken_for_free(c: Compared, refined: Refined) -> Iterator[str]:
    """Joints that move in this survey, and of which others alone state friction."""
    stated = {f.joint for f in c.survey.friction}
    moving = [
        joint.name
        for joint in c.modes.equilibrium.model.structure.joints
        if joint.state not in (JointState.LOCKED, JointState.DRIVEN)
    ]
    others = [f.joint for f in refined.friction() if f.joint in moving and f.joint not in stated]
    if others:
        yield (
            f"{c.survey.name}: was measured without friction of {', '.join(others)}, by what it states. If "
            "friction was not taken out of its record, slip torques are wrong: state the friction, with the "
            "amplitude of the joint in each mode"
        )


def _of_undamped(c: Compared) -> Iterator[str]:
    """Frequencies that losses move, as measured, and that were compared with undamped ones."""
    cure = (
        "state the measured damping ratios and make the losses unknowns (damping.*), which compares complex "
        "modes, or state larger deviations of the frequencies"
    )
    try:
        off = shifted_by_losses(c)
    except (ConfigError, NumericalError) as error:
        yield f"{c.survey.name}: undamped modes are compared, and {error.what}: {cure}"
        return
    stated, hz = (part[c.pairs[:, 1]] for part in (c.survey.std, c.survey.measured.frequency_hz))
    some = np.flatnonzero(np.abs(off) > SHIFTED * stated)
    if len(some):
        worst = some[np.argmax(np.abs(off[some]) / stated[some])]
        more = f", and those of {len(some) - 1} more by more than theirs" if len(some) > 1 else ""
        yield (
            f"{c.survey.name}: dampers and loss factors move the frequency of the mode of {hz[worst]:.4g} Hz "
            f"by {100.0 * off[worst]:+.2g} %, {abs(off[worst]) / stated[worst]:.2g} of its stated deviations"
            f"{more}; it was compared with that of the undamped mode: {cure}"
        )


def _of_statics(refined: Refined, shared: float, own: float) -> Iterator[str]:
    noise = float(np.median(np.concatenate([c.std for c in refined.statics])))
    if shared > ABOVE * noise:
        yield (
            f"deflections under load differ from the refined model by {100.0 * shared:.2g} %, where the "
            f"gauges state {100.0 * noise:.2g} %: a model error, common to load cases that strain the same "
            "members, which the predicted intervals include"
        )
    if own > ABOVE * noise:
        yield (
            f"static readings scatter by {100.0 * own:.2g} %, where the gauges state {100.0 * noise:.2g} %: "
            "an error of the rig or of the model, which the predicted intervals include"
        )
