"""Fit a model to one long record directly: its Fourier transform, with a transient that shares the poles.

fitted = fit_record(record, states=10, band_hz=(0.1, 60.0))
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import warnings
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError, FitError
from middeck.identification.fit.fit_response import FitResult, ModelAlone, fit_model, marked
from middeck.identification.fit.fitted_model import model_of, structure_of
from middeck.identification.fit.mode_trust import (
    checked_covariance,
    standing_of,
    standing_of_delays,
    warnings_on_lines,
    warnings_on_phase,
    warnings_on_standing,
)
from middeck.identification.fit.poles_beyond_the_band import UNDECIDED
from middeck.identification.fit.undeclared_hold import (
    BY_HALF,
    perhaps_held,
    steps_as_not_held,
    taken_as_held,
    turned_as_if_held,
)
from middeck.identification.fit.unneeded_modes import DOUBTFUL, mode_significance
from middeck.identification.model.fit_options import (
    OF_PATHS,
    Constants,
    Delay,
    FitOptions,
    decided,
    may_be_of_paths,
    usual_constants,
)
from middeck.identification.model.measurement_model import MeasurementModel, model_response, natural_hz
from middeck.identification.model.refused_data import check_record, check_word
from middeck.identification.model.unstable_article import refuse_growth
from middeck.identification.order.recommended_order import count_unknowns
from middeck.identification.problem.data import Data, Transient
from middeck.identification.problem.residual_and_slopes import residual_of
from middeck.identification.record_fit import folded_blows, residual_growth, residual_tests
from middeck.identification.record_fit.behind_hold import First, Made, fit_behind_hold
from middeck.identification.record_fit.continuous_fit import fit_continuous
from middeck.identification.record_fit.coupling_of_records import coupling_of_record
from middeck.identification.record_fit.delays_for_poles import DelaysInstead, delays_instead
from middeck.identification.record_fit.poles_for_delay import poles_instead
from middeck.identification.record_fit.record_covariance import record_covariance
from middeck.identification.record_fit.record_order import choose_record, record_length
from middeck.identification.record_fit.record_spectra import (
    record_data,
    with_one_input,
    without_drift,
    without_trend,
)
from middeck.identification.record_fit.record_terms import (
    lacks_samples_before,
    record_lacks,
    record_scores,
)
from middeck.identification.record_fit.refine_record import LIGHTEST, WEIGHTINGS, RecordRun, Weighting
from middeck.identification.record_fit.sensor_or_force_noise import negative_log_likelihood, noise_variance
from middeck.identification.record_fit.undeclared_hold import (
    IN_STEPS,
    NYQUIST,
    TRIED,
    given_as_commands,
    turned_by_half,
    without_hold,
)
from middeck.identification.record_fit.unlike_blows import score_of_unlike_blows, warnings_on_unlike
from middeck.identification.record_fit.unneeded_modes_and_sines import (
    Tidied,
    tidied,
    with_modes_as_two,
    with_sines_beside,
)
from middeck.identification.record_fit.warnings_on_two_modes import (
    modes_perhaps_two,
    warnings_on_perhaps_two,
    warnings_on_two,
)
from middeck.identification.search.fit_warnings import warnings_on_deviations, words_on_terms_beyond
from middeck.identification.search.leading_outputs import causal_delay, warnings_on_leads
from middeck.identification.spectra.estimate import as_periods, estimate_response
from middeck.identification.uncertainty.lacking_terms import LackingTerm
from middeck.identification.uncertainty.parameter_deviations import uncertainty_of
from middeck.signals.excitation.driven_band import driven_band, floor_variance, folded_power
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse
from middeck.systems.sampling.zero_order_hold import release_inputs
from middeck.values import require_kind

# A model worth using explains nine tenths of the output.
LEFT = 0.1
# Above this share of the sampling rate a held input is weakened by more than 2.5 % (sin(x)/x, x = pi/8): a
# continuous model would take that for dynamics.
HELD_ABOVE = 1.0 / 8.0
# Deviations by which noise of an input may move an unknown before a warning.
MOVED = 1.0
# A decay rate over the least of the search that may be that, and lines between a mode and a sine that
# may be its own.
HARDLY, BESIDE = 1.5, 2.0
# What a continuous model behind a hold may leave, over what a sampled one with doubts does, each over the
# outputs on its own lines: some unknowns more, and lines near half the rate, are worth a percent.
AS_WELL = 1.03
# Outputs of which a second fit takes seconds.
FEW_OUTPUTS = 6
UP_TO_HALF = "sampled, as the inputs drive all up to half the rate; "
HELD_AND_LATE = (
    "behind a hold, as the inputs drive all up to half the rate, and with a delay, for which a sampled model "
    "needs poles that the data do not tell; "
)


@named_kinds
def fit_record(
    record: Record,
    *,
    states: int | None = None,
    sampled: bool | None = None,
    band_hz: tuple[float, float] | None = None,
    constants: Constants | None = None,
    delay: bool | Delay | None = None,
    direct: bool | None = None,
    residuals: bool = False,
    full_rank: bool = False,
    rigid: int = 0,
    integrators: int = 0,
    relative_degree: Literal[0, 1, 2] | None = None,
    weighting: Weighting | None = None,
    tell: Callable[[str], None] = lambda _: None,
    input_noise: Float[np.ndarray, "part sample input"] | None = None,
) -> FitResult:
    """Fit common poles, residues and delays to the samples of a record that need not be periodic.

    The spectra of all lines are fitted, each experiment with a free transient of the model's own poles, so
    that nothing leaks and no window is needed; an offset and a ramp of any channel are part of it. The noise
    on each line is estimated from what is left.

    Args:
        record: One or several experiments; periods, also of an input that is found to repeat, are taken as
            one run of samples. Where it says that its inputs were ``held``, a continuous model is of what is
            behind the hold: that is divided out, and what is folded back from beyond half the rate is taken
            off by a first fit. Where it does not say, and a model of band-limited inputs leaves doubts, they
            are taken as held if that is the shorter description and leaves none (``hold_s`` of the model);
            if it is hardly the shorter one, a warning says so. Inputs in steps, and those that drive all
            frequencies up to half the rate, are taken as held unless that is clearly the longer one; so are
            those that seem to turn residues of rates by half a sample, with a warning where it is longer.
        states: Order of the model without its delays. By default that of the minimum description length:
            of the record, or for a continuous model of a long one, of an estimated response.
        sampled: A sampled model, right for held inputs; or a continuous one, whose inputs are band-limited
            between samples. By default sampled where the inputs drive all frequencies up to half the rate, as
            no band-limited ones do, and neither the band nor an option asks for a continuous model; unless it
            leaves doubts that a continuous one behind the hold, with a delay, does not.
        band_hz: Lines to fit: by default those of the band that the inputs drive, and all of a sampled model.
        constants, delay, direct, residuals, full_rank, rigid, integrators, relative_degree: As for
            `fit_response`.
        weighting: "flat": the error of the simulation is least. "output": by the noise of sensors, "motion":
            by forces that shake the article as the inputs do. By default the likelier of the last two, or of
            a sampled model those that simulate samples held out best.
        tell: Called with some words on the next step, as often as that changes.
        input_noise: Noise of the inputs alone, in their units: parts as long as an experiment, from where
            nothing drives them. Deviations count it.

    Raises `ConfigError` for options that exclude each other; `DataError` if a channel is constant or not
    finite; `FitError` if the record is shorter than the unknowns, if it is described no worse as noise alone
    (the delay may be longer than the record), if an output leads its input, or if no start could be refined.
    """
    require_kind(record, Record, "record", "load_record(path)")
    asked = FitOptions(
        states=states,
        constants=constants,
        delay=delay,
        direct=direct,
        residuals=residuals,
        full_rank=full_rank,
        rigid=rigid,
        integrators=integrators,
        relative_degree=relative_degree,
    )
    return fit_samples(
        record,
        asked,
        sampled=sampled,
        band_hz=band_hz,
        weighting=weighting,
        tell=tell,
        input_noise=input_noise,
    )


def fit_samples(
    record: Record,
    asked: FitOptions,
    *,
    sampled: bool | None = None,
    band_hz: tuple[float, float] | None = None,
    weighting: Weighting | None = None,
    tell: Callable[[str], None] = lambda _: None,
    input_noise: Float[np.ndarray, "part sample input"] | None = None,
) -> FitResult:
    """`fit_record` with its options as one value."""
    check_record(record)
    check_word("weighting", weighting, WEIGHTINGS)
    refuse_growth(record)
    record = record if record.periodic or input_noise is not None else as_periods(record)
    _, periods, samples, inputs = record.u.shape
    if input_noise is not None and input_noise.shape[1:] != (periods * samples, inputs):
        raise ConfigError(
            f"input_noise has the shape {input_noise.shape}",
            hint=f"(parts, {periods * samples}, {inputs}): samples of an experiment, inputs",
        )
    band_hz = below_half_rate(band_hz, record.sample_hz)
    fit = functools.partial(
        _fit_of_kind, asked=asked, band_hz=band_hz, weighting=weighting, tell=tell, input_noise=input_noise
    )
    if sampled is not None or asked.only_continuous or not is_held(record, band_hz):
        return fit(record, sampled=bool(sampled))
    found = fit(record, sampled=True)
    with_delay = _with_a_delay(fit, found, record, asked)
    if with_delay is not None:
        return with_delay
    return dataclasses.replace(found, order_reason=UP_TO_HALF + found.order_reason)


def _fit_of_kind(
    record: Record,
    *,
    sampled: bool,
    asked: FitOptions,
    band_hz: tuple[float, float] | None,
    weighting: Weighting | None,
    tell: Callable[[str], None],
    input_noise: Float[np.ndarray, "part sample input"] | None,
) -> FitResult:
    """The fit of a sampled model, or of a continuous one, behind the hold if the inputs have one."""
    given, periods = record, record.u.shape[1]
    asked = dataclasses.replace(asked, sample_hz=record.sample_hz if sampled else None)
    trend = not (asked.residuals or asked.at_zero)  # inputs may have one, as outputs may
    if record.periodic and periods > 1:
        record, trend = with_one_input(record, level=trend), False  # no ramp repeats
    degree = 2 if asked.residuals or asked.rigid else 1
    record = without_drift(record) if sampled else without_trend(record, inputs=trend, degree=degree)
    if band_hz is None and not sampled:
        inputs = record.u.reshape(len(record.u), -1, record.u.shape[3])
        band_hz = driven_band(inputs, record.sample_hz)
    search = functools.partial(
        _searched,
        band_hz=band_hz,
        asked=asked,
        weighting=weighting,
        input_noise=input_noise,
        tell=tell,
    )
    fit = functools.partial(_fit, search, input_noise=input_noise)
    if sampled:
        return fit(given, record).fit
    assert band_hz is not None  # sampled models alone leave it open
    if record.held:
        first = _first(search, given, release_inputs(record))
        return fit_behind_hold(fit, given, record, first, band_hz[1]).fit
    made = fit(given, record)
    why = given_as_commands(given) if record.held is None else ""
    # Whoever struck a hammer measured its force: behind a hold only where the residual has its form.
    if not why and record.held is None and input_noise is None:
        why = BY_HALF if turned_by_half(made.fit, record.sample_hz) else ""
    asks = made.hold > TRIED or (made.fit.warnings and input_noise is None)
    if why or (record.held is None and asks):
        tell("the inputs as held ones")
        held = (dataclasses.replace(one, held=True) for one in (given, record))
        with contextlib.suppress(FitError):
            behind = without_hold(made.fit.model, record.sample_hz)
            first = First(behind, made.fit.covariance.structure.real_constants)
            other = fit_behind_hold(fit, *held, first, band_hz[1])
            # Poles that stand for a delay follow it better behind a hold, whose half period is a part of it.
            shorter = min(made.length, made.with_delays) - other.length
            if shorter > (-UNDECIDED if why else UNDECIDED):
                return taken_as_held(made.fit, other.fit, shorter, why, record.sample_hz)
            if why not in {IN_STEPS, BY_HALF}:
                return perhaps_held(made.fit, shorter, record.sample_hz)
        if why == IN_STEPS:
            return steps_as_not_held(made.fit, record.sample_hz)
        if why == BY_HALF:
            return turned_as_if_held(made.fit, record.sample_hz)
    return marked(made.fit, None if record.held is None else 0.0)


def _with_a_delay(
    fit: Callable[..., FitResult], found: FitResult, given: Record, asked: FitOptions
) -> FitResult | None:
    """A continuous model behind the hold in the place of a sampled one with doubts; None if it has any.

    A sampled model has poles for a delay, which no data tell from poles far beyond half the rate. Rates have
    complex constants, which are confounded with a delay.
    """
    late = (asked.constants or usual_constants(given.outputs, None)) == "real" and asked.delay is not False
    if not (found.warnings and late) or len(given.outputs) > FEW_OUTPUTS:
        return None
    with contextlib.suppress(FitError):
        other = fit(dataclasses.replace(given, held=True), sampled=False)
        if not other.warnings and np.all(other.error <= AS_WELL * found.error):
            return dataclasses.replace(other, order_reason=HELD_AND_LATE + other.order_reason)
    return None


class _Found(NamedTuple):
    """The end of a search, without unneeded modes, and the reason for its order."""

    data: Data
    run: RecordRun
    fitted: Tidied
    reason: str


_Search = Callable[[Record, Record], _Found]


def _fit(
    search: _Search,
    measured: Record,
    record: Record,
    *,
    input_noise: Float[np.ndarray, "part sample input"] | None,
) -> Made:
    """The fit of a record without drift, whose inputs are taken as they are; ``measured`` has its faults."""
    data, run, fitted, reason = search(measured, record)
    with residual_tests.named_cause(measured):
        both = (data, run), (fitted.data, fitted.run)
        heard = [residual_tests.heard_of(record, *of, input_noise) for of in both]
        grown = [residual_growth.growth_score(*of, made) for of, made in zip(both, heard, strict=True)]
        score = np.maximum(*grown)
        instead = delays_instead(record, fitted.data, fitted.run)
        found = _result(measured, record, fitted, reason, score, heard[1], input_noise, instead)
        return Made(
            fit=found,
            length=record_length(fitted.data, fitted.run),
            hold=_hold_score(record, fitted, found, heard[1]),
            with_delays=instead.length,
        )


def _hold_score(record: Record, fitted: Tidied, found: FitResult, heard: residual_tests.Heard) -> float:
    """Deviations by which a hold of the inputs, less its delay, is lacking."""
    if record.held is not None or found.model.sample_hz is not None:
        return 0.0
    term = [LackingTerm(kind="hold", rate_hz=record.sample_hz)]
    return float(record_scores(term, fitted.run, fitted.data, found.covariance, heard).z[0])


def _first(search: _Search, measured: Record, record: Record) -> First:
    """The model of `_fit` alone."""
    fitted = search(measured, record).fitted
    with residual_tests.named_cause(measured):
        model = _causal(record, fitted)[2]
    return First(model, structure_of(fitted.run.layout).real_constants)


def _searched(
    measured: Record,
    record: Record,
    *,
    band_hz: tuple[float, float] | None,
    asked: FitOptions,
    weighting: Weighting | None,
    input_noise: Float[np.ndarray, "part sample input"] | None,
    tell: Callable[[str], None],
) -> _Found:
    sampled, states = asked.sample_hz is not None, asked.states
    data = record_data(record, band_hz, whole=sampled)
    lines = _lines(record, data, np.zeros((len(data.s), len(record.outputs), len(record.inputs)), complex))
    options = decided(lines, asked)
    _check_length(data, lines, options)
    with residual_tests.named_cause(measured):
        if sampled:
            run, reason = choose_record(
                record, options, band_hz, states=states, weighting=weighting, tell=tell
            )
        else:
            chosen = functools.partial(
                _continuous, record, data, lines, asked, weighting=weighting, tell=tell
            )
            data, run, reason = chosen(options)
            if may_be_of_paths(options, asked) and len(record.inputs) > 1 and _lacks(record, data, run):
                tell("a delay of each path")
                data, run, reason = _shorter((data, run, reason), chosen, options)
        if not sampled:
            tell("modes that are none, or two")
        if states is None:
            fitted = tidied(record, data, run, sampled=sampled, input_noise=input_noise)
        else:
            fitted = Tidied(data=data, run=run, lines=(), input_noise=input_noise)
            fitted = with_sines_beside(record, fitted)
            fitted = fitted if sampled else with_modes_as_two(record, fitted)
        return _Found(data, run, fitted, reason)


def _continuous(
    record: Record,
    data: Data,
    lines: FrequencyResponse,
    asked: FitOptions,
    options: FitOptions,
    *,
    weighting: Weighting | None,
    tell: Callable[[str], None],
) -> tuple[Data, RecordRun, str]:
    local = functools.partial(_local_fit, record, lines, dataclasses.replace(asked, delay=options.delay))
    return fit_continuous(record, data, options, local, states=asked.states, weighting=weighting, tell=tell)


def _lacks(record: Record, data: Data, run: RecordRun) -> bool:
    """Whether a continuous model lacks a delay or a filter, or has modes that may be noise in its place."""
    covariance = record_covariance(run, data, model_of(run, record.inputs, record.outputs))[0]
    spent = mode_significance(covariance).min(initial=np.inf) < DOUBTFUL
    return bool(spent or record_lacks(run, data, covariance).said)


def _shorter(
    one: tuple[Data, RecordRun, str],
    chosen: Callable[[FitOptions], tuple[Data, RecordRun, str]],
    options: FitOptions,
) -> tuple[Data, RecordRun, str]:
    """The fit with a delay of each path, where that describes the record in fewer words."""
    with contextlib.suppress(FitError):
        data, run, reason = chosen(dataclasses.replace(options, delay="path"))
        if record_length(data, run) < record_length(*one[:2]):
            return data, run, f"{reason}; {OF_PATHS}"
    return one


def below_half_rate(band_hz: tuple[float, float] | None, sample_hz: float) -> tuple[float, float] | None:
    """The band, cut at half the rate, with a warning where it ends beyond (but not for infinity)."""
    if band_hz is None or not band_hz[0] < 0.5 * sample_hz < band_hz[1]:
        return band_hz
    if band_hz[1] < np.inf:
        warnings.warn(
            f"a record at {sample_hz:g} Hz tells nothing above {0.5 * sample_hz:g} Hz: the band, up to "
            f"{band_hz[1]:g} Hz, is fitted up to there",
            stacklevel=5,
        )
    return band_hz[0], 0.5 * sample_hz


def is_held(record: Record, band_hz: tuple[float, float] | None) -> bool:
    """Whether inputs are as strong near half the rate as elsewhere, and the lines to fit reach far.

    Inputs sampled behind a filter are weak there: strong ones were given sample by sample, and held.
    """
    rate = record.sample_hz
    if band_hz is not None and band_hz[1] <= HELD_ABOVE * rate:
        return False
    inputs = record.u.reshape(len(record.u), -1, record.u.shape[3])
    return driven_band(inputs, rate)[1] >= NYQUIST * 0.5 * rate


def _check_length(data: Data, lines: FrequencyResponse, options: FitOptions) -> None:
    """Raise `FitError` for as many unknowns as numbers, the terms that follow the ends included."""
    assert data.transient is not None
    outputs, _, experiments = data.H.shape
    end = 0 if options.period_s else 1
    degree = 2 if options.residuals or options.rigid else 1
    free = Transient(data.period_s, end, end).drift_and_edges(data.s, degree)
    unknowns = count_unknowns(lines, options) + outputs * experiments * (options.moving + len(free))
    if unknowns >= 2 * data.H.size:
        raise FitError(
            f"{unknowns} unknowns, transients and free ends among them, cannot be fitted to "
            f"{2 * data.H.size} numbers, two on each line of each output",
            hint="fewer states, a longer record, or a wider band",
        )


def _lines(record: Record, data: Data, H: np.ndarray) -> FrequencyResponse:
    """A response on the lines that are fitted."""
    f = data.omega / (2.0 * np.pi)
    return FrequencyResponse(
        frequency_hz=f, H=H, inputs=record.inputs, outputs=record.outputs, variance=np.zeros(H.shape)
    )


def _local_fit(record: Record, lines: FrequencyResponse, asked: FitOptions) -> ModelAlone:
    """A fit of a local estimate of the response.

    Polynomials are fast, but do not follow a resonance narrower than their few lines: rational models tell
    an order, and start a record too short for polynomials.
    """
    band_hz = float(lines.frequency_hz[0]), float(lines.frequency_hz[-1])
    fit = functools.partial(fit_model, asked=asked)
    with warnings.catch_warnings():  # noise of inputs: the fit of the samples counts it itself
        warnings.simplefilter("ignore")
        if asked.states is not None:
            with contextlib.suppress(FitError):
                return fit(estimate_response(record, band_hz=band_hz, method="local polynomial"))
        return fit(estimate_response(record, band_hz=band_hz, method="local rational"))


def _result(
    measured: Record,
    record: Record,
    fit: Tidied,
    reason: str,
    score: np.ndarray,
    heard: residual_tests.Heard,
    input_noise: Float[np.ndarray, "part sample input"] | None,
    instead: DelaysInstead,
) -> FitResult:
    data, run = fit.data, fit.run
    found = run.refined
    r = residual_of(run.layout, data, found.theta, found.step.linear)
    fitted, lines, model = _causal(record, fit)
    noise, folded = _input_variance(measured), np.zeros(data.U.shape[:2])
    if not measured.held and fitted.sample_hz is None and data.driven is None:
        inputs = record.u.reshape(len(record.u), -1, record.u.shape[3])
        folded = folded_power(inputs, data.omega / (np.pi * record.sample_hz))
    power = np.maximum(noise, folded)
    found_covariance, moves = record_covariance(run, data, fitted, input_noise, power)
    covariance = checked_covariance(found_covariance)
    uncertainty = uncertainty_of(covariance)
    said = warnings_on_leads(lines, fitted.delay_s, uncertainty)
    error = np.sqrt(np.sum(np.abs(r) ** 2, axis=(1, 2)) / np.sum(np.abs(data.H) ** 2, axis=(1, 2)))
    said += [
        *_doubts(run, record, error),
        *_warnings_on_inputs(record, power.mean(axis=0), folded.mean(axis=0) > noise, moves),
    ]
    said += warnings_on_deviations(lines, covariance, of_samples=True)
    if fitted.sample_hz:
        lacks = lacks_samples_before(record, run, data, covariance, heard)
    else:
        lacks = record_lacks(run, data, covariance, heard)
    wrong = [*residual_growth.warnings_on_growth(record, score), *_undamped(lines, model, fit)]
    wrong += warnings_on_unlike(score_of_unlike_blows(measured, record, data, run, found_covariance, heard))
    wrong += warnings_on_two(fit)
    if model.sample_hz is None:
        ends = float(lines.frequency_hz[0]), float(lines.frequency_hz[-1])
        wrong += folded_blows.warnings_on_folding(record, covariance, ends)
    leads = (fitted.delay_s < 0.0) & (uncertainty.delay_s > 0.0)
    lead = np.divide(-fitted.delay_s, uncertainty.delay_s, out=np.zeros(len(leads)), where=leads)
    phase = instead.poles, instead.delay_s
    late = bool(len(instead.poles))
    wrong += residual_tests.causes_of(measured, data, run, lead, error, heard, late=late)
    said += [
        *lacks.said,
        *wrong,
        *residual_tests.warnings_on_level(measured, data, run, heard),
        *residual_tests.warnings_on_wander(record, data, run, error),
        *warnings_on_lines(fit.lines),
        *warnings_on_perhaps_two(fit),
    ]
    doubted = [*phase[0], *lacks.modes, *modes_perhaps_two(fit, model)]
    alone, standing = (
        standing_of(lines, covariance, holds=holds, doubted=doubted)
        for holds, doubted in ((True, phase[0]), (not wrong, doubted))
    )
    coupled = [] if lacks.said else coupling_of_record(data, run, fitted, alone, heard)
    if coupled:
        said += coupled
        standing = standing_of(lines, covariance, holds=False, doubted=doubted)
    poles = poles_instead(data, run, fitted, alone) if covariance.structure.with_delay else None
    if poles is not None:
        said.append(poles.doubt())
        if poles.shorter:
            standing = standing_of(lines, covariance, holds=False, doubted=phase[0])
    said += [*warnings_on_phase(model, *phase), *warnings_on_standing(covariance, standing)]
    return FitResult(
        model=model,
        cost=float(np.mean(np.abs(r) ** 2 / run.variance)),
        error=error,
        excess=np.zeros(len(error)),
        uncertainty=uncertainty,
        covariance=dataclasses.replace(covariance, model=model),
        history=np.array(found.history),
        order_reason=reason + words_on_terms_beyond(lines, covariance),
        warnings=tuple(said),
        standing=standing,
        lines=fit.lines,
        delay_standing=standing_of_delays(
            lines, covariance, holds=not (wrong or lacks.said or coupled) and poles is None
        ),
    )


def _causal(record: Record, fit: Tidied) -> tuple[MeasurementModel, FrequencyResponse, MeasurementModel]:
    """The model with its leads, its response, and the model without them; refused where it is none."""
    data, run = fit.data, fit.run
    _refuse_noise(data, run)
    fitted = model_of(run, record.inputs, record.outputs)
    lines = _lines(record, data, model_response(fitted, data.omega / (2.0 * np.pi)))
    if not np.isfinite(lines.H).all():
        raise FitError("the fitted response is not finite", hint="fewer states")
    return fitted, lines, dataclasses.replace(fitted, delay_s=causal_delay(lines, fitted.delay_s))


def _undamped(lines: FrequencyResponse, model: MeasurementModel, fit: Tidied) -> list[str]:
    """Warnings for modes that do not decay within the record, or that have a steady sine beside them."""
    f = natural_hz(model)
    apart = lines.frequency_hz[1] - lines.frequency_hz[0] if len(f) and len(lines.frequency_hz) > 1 else 0.0
    sines = np.array([line.hz for line in fit.lines])
    within = model.is_pair & (f >= lines.frequency_hz[0]) & (f <= lines.frequency_hz[-1])
    steady = -np.real(model.poles) < HARDLY * LIGHTEST * apart
    beside = np.any(np.abs(sines - f[:, None]) < BESIDE * apart, axis=1)
    why = {
        True: "undamped or unstable, which cannot be fitted: it does not decay within the record",
        False: "a steady sine was fitted beside it, nearer than the record tells the two apart",
    }
    return [
        f"mode at {f[m]:.4g} Hz: {why[bool(steady[m])]}; the stated standard deviations are too small"
        for m in np.flatnonzero(within & (steady | beside))
    ]


def _doubts(run: RecordRun, record: Record, error: np.ndarray) -> list[str]:
    """A search that did not end, and outputs that are mostly left."""
    steps = len(run.refined.history)
    found = [] if run.refined.converged else [f"the search had not settled after {steps} steps"]
    return found + [
        f"output {port.name}: noise and what the model lacks are {left:.0%} of the output"
        for port, left in zip(record.outputs, error, strict=True)
        if left > LEFT
    ]


def _input_variance(record: Record) -> Float[np.ndarray, " input"]:
    """Variance of the noise of measured inputs: the part that does not repeat, or the spectrum's floor."""
    periods = record.u.shape[1]
    if record.periodic and periods > 1:
        level = record.u - record.u.mean(axis=2, keepdims=True)  # drift moves all periods alike
        scatter = level - level.mean(axis=1, keepdims=True)
        return np.mean(scatter**2, axis=(0, 1, 2)) * periods / (periods - 1)
    return floor_variance(record.u.reshape(len(record.u), -1, record.u.shape[3]))


def _warnings_on_inputs(record: Record, noise: np.ndarray, back: np.ndarray, moves: np.ndarray) -> list[str]:
    """Inputs whose ``noise``, folded ``back`` or not, moves the model by more than its other deviations."""
    rms = np.sqrt(np.mean((record.u - record.u.mean(axis=(1, 2), keepdims=True)) ** 2, axis=(0, 1, 2)))
    return [
        f"input {port.name}: noise of {share:.2g} of its rms{', folded back by sampling,' if beyond else ''} "
        f"makes gains too small, by up to {move:.1f} times what else deviations count; they count this, too. "
        "Fit the command, or a signal that repeats, or filter more steeply"
        for port, share, beyond, move in zip(record.inputs, np.sqrt(noise) / rms, back, moves, strict=True)
        if move > MOVED
    ]


def _refuse_noise(data: Data, run: RecordRun) -> None:
    """Raise `FitError` unless the model describes the record in fewer words than noise alone does.

    Description lengths 2 L + k ln n (Rissanen 1978), the noise smooth over lines in both.
    """
    at = slice(None) if data.driven is None else data.driven  # on silent lines an input is its noise
    H, r = data.H[:, at], run.residual(data)[:, at]
    alone = 2.0 * negative_log_likelihood(H, noise_variance(H))
    unknowns = run.layout.size + run.refined.step.linear.size
    model = 2.0 * negative_log_likelihood(r, noise_variance(r)) + unknowns * np.log(2.0 * H.size)
    if model >= alone:
        raise FitError(
            "a model of noise alone describes the outputs as well as this one, which the inputs drive",
            hint="check which channels are which, and that no delay is longer than the record; more states, "
            "a longer record or a larger excitation",
        )
