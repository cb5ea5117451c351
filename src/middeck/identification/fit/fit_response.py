"""Fit a measurement model to a frequency response: start, race, refine, check."""

from __future__ import annotations

import contextlib
import dataclasses
from typing import Literal, get_args

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.arguments import named_kinds
from middeck.errors import DataError, FitError
from middeck.identification.fit.coupling_instead import (
    ROUNDS,
    STEPS,
    CouplingTrial,
    coupling_instead,
    coupling_terms,
    spare_modes,
    without_coupling,
)
from middeck.identification.fit.fit_result import FitResult, marked
from middeck.identification.fit.fitted_model import model_of, structure_of
from middeck.identification.fit.missing_delay import name_missing_delay
from middeck.identification.fit.mode_trust import (
    Standing,
    beside_one_line,
    checked_covariance,
    standing_of,
    standing_of_delays,
    warnings_on_delays,
    warnings_on_one_line,
    warnings_on_phase,
    warnings_on_standing,
    with_doubt,
)
from middeck.identification.fit.modes_that_stand_for_delay import stands_for_delay
from middeck.identification.fit.poles_beyond_the_band import PolesInstead, poles_instead, true_modes
from middeck.identification.fit.second_modes import second_modes, warnings_on_second_modes
from middeck.identification.fit.undeclared_hold import chosen_hold
from middeck.identification.fit.unneeded_modes import length_of, parted, tidied, without_modes
from middeck.identification.model.fit_options import (
    OF_PATHS,
    Constants,
    Delay,
    FitOptions,
    decided,
    may_be_of_paths,
)
from middeck.identification.model.measurement_model import MeasurementModel, model_response
from middeck.identification.model.refused_data import check_logarithms, check_response, check_word
from middeck.identification.model.steady_simulation import folded_modes, folded_response
from middeck.identification.order.best_start import leaves_noise, model_error, race, spread_to_follow
from middeck.identification.order.order_choice import description_length
from middeck.identification.order.outside_band import choose_order
from middeck.identification.order.recommended_order import count_unknowns
from middeck.identification.problem.data import Data, data_of
from middeck.identification.search.fit_warnings import (
    LEFT,
    refuse_failed,
    warnings_on_deviations,
    warnings_on_model,
    warnings_on_record,
    words_on_terms_beyond,
)
from middeck.identification.search.leading_outputs import causal_delay, refuse_a_lead, warnings_on_leads
from middeck.identification.search.likelihood import likelihood_polish
from middeck.identification.search.refine_and_reweigh import Polished, logarithmic_polish, polish, settle
from middeck.identification.spectra.excess_variance import (
    INDEPENDENT,
    ExcessVariance,
    by_output,
    excess_share,
    line_degrees,
    spread_of,
)
from middeck.identification.uncertainty.covariance import ModelCovariance, estimate_covariance
from middeck.identification.uncertainty.lacking_terms import (
    NOTHING,
    TOLD,
    Lacking,
    LackingTerm,
    response_lacks,
    response_scores,
)
from middeck.identification.uncertainty.model_unknowns import ModelStructure
from middeck.identification.uncertainty.parameter_deviations import uncertainty_of
from middeck.systems.plants.response import FrequencyResponse
from middeck.systems.sampling.zero_order_hold import hold_response, release_hold
from middeck.values import record, require_kind

Cost = Literal["weighted", "likelihood", "logarithmic"]
# Share of half the rate from which on a hold is unlike a delay: it takes 10 % of the magnitude there.
WIDE = 0.5


@record
class ModelAlone:
    """A fitted model without its covariance: which parts were free, ``error`` and ``order_reason``."""

    model: MeasurementModel
    structure: ModelStructure
    error: Float[np.ndarray, " output"]
    order_reason: str


@named_kinds
def fit_response(
    measured: FrequencyResponse,
    *,
    states: int | None = None,
    sample_hz: float | None = None,
    constants: Constants | None = None,
    delay: bool | Delay | None = None,
    direct: bool | None = None,
    residuals: bool = False,
    full_rank: bool = False,
    rigid: int = 0,
    integrators: int = 0,
    relative_degree: Literal[0, 1, 2] | None = None,
    cost: Cost = "weighted",
) -> FitResult:
    """Fit common poles, residues and delays to a measured response.

    Stable by construction and real. The weights are the measured variance, averaged over neighbouring
    lines, plus the variance that the model cannot follow (`weights`); the starts are subspace models of
    several sizes, of which the likeliest after a short refinement is refined to the end.

    Args:
        measured: Response with its variance (`estimate_response`). For held inputs (``hold_s``) a
            continuous model describes the system behind the hold, which is divided out; the response folded
            back from beyond half the rate is subtracted by a first fit.
        states: Order of the model without its delays: two for each pair of poles and each rigid mode, one for
            each integrator; with ``full_rank`` the poles, each counted once. By default the order of the
            minimum description length (`order`), which takes longer.
        sample_hz: Give the sampling rate to fit a sampled model, right when the inputs were held and the band
            comes near half the rate; by default the model is continuous.
        constants: "real": each residue is that of a mode driven by a force and seen as a displacement
            (relative degree two), which makes a delay identifiable; the default in continuous time.
            "complex": any residue; the default where the unit of an output is that of a rate or an
            acceleration, and all there is for a sampled model.
        delay: Whether each "output" (or True), each "path" or all of them in "common" have a delay; by
            default each output, with real constants only, or each path where no order is given either and
            that describes the data in fewer words. Complex constants take up a short delay themselves,
            so that the two are confounded: the result then warns.
        direct: Whether there is a constant term, which also stands for modes above the band; by default with
            complex constants, or where the recommended order would else have poles outside the band.
        residuals: Whether terms for the modes outside the band are fitted beside the states: 1/s^2 for those
            below, a constant for those above (Ewins 2000, sec. 4.2). Continuous models only. They are tried,
            too, where the recommended order would else have poles there and ``direct`` is not given.
        full_rank: Residues of any rank, as vector fitting has them, rather than rank one: for modes too close
            to be distinguished, and for what is no modal model.
        rigid: Number of free rigid-body modes phi psi / s^2 of the article: part of the plant, unlike the
            residual term of modes below the band.
        integrators: Number of single poles at zero, phi psi / s: a wheel, or a free body, seen by its
            rate. Not beside rigid modes.
        relative_degree: Relative degree of every path: 0, a constant term; 1, none; 2, none, and complex
            residues that add up to zero, so that the response falls with 1/s^2, as that of any structure
            from force to displacement.
        cost: "weighted" least squares on the complex response, by the variance that comes with it (the total
            one, noise and nonlinear distortion, where `estimate_response` knows it). "likelihood": by its
            covariance, noise that outputs share and noise of the inputs included. "logarithmic": on log
            magnitude and phase (the 1993 paper's), which follows the antiresonances as closely as the peaks.

    Raises `ConfigError` for options that exclude each other; `DataError` if there are too few lines to choose
    an order by, if a variance is negative or not finite, or, for the logarithmic cost, if a line is exactly
    zero; `FitError` if the response is constant, all noise or too short for so many states, if an output
    leads its input, or if no start could be refined.
    """
    require_kind(measured, FrequencyResponse, "response", "estimate_response(record)")
    asked = FitOptions(
        states=states,
        sample_hz=sample_hz,
        constants=constants,
        delay=delay,
        direct=direct,
        residuals=residuals,
        full_rank=full_rank,
        rigid=rigid,
        integrators=integrators,
        relative_degree=relative_degree,
    )
    return fit_asked(measured, asked, cost)


def fit_asked(measured: FrequencyResponse, asked: FitOptions, cost: Cost = "weighted") -> FitResult:
    """`fit_response` with its options as one value.

    The hold of the inputs is divided out. A first fit gives what sampling folds back, some thousandths of the
    response at an eighth of the rate, which is subtracted before a second fit. If the order is given, the
    second fit starts from the first, and from all other starts only if that leaves more than noise. Commands
    that may have been held are fitted both ways where `_asks_for_hold`.
    """
    hold_s = measured.hold_s
    if asked.sample_hz is not None:
        return fit_lines(measured, asked, cost)
    if hold_s:
        return marked(_result(_behind_hold(measured, hold_s, asked, cost)), hold_s)
    run = _searched(measured, asked, cost)
    fit, perhaps_s = marked(_result(run), hold_s), measured.perhaps_held_s
    if hold_s is None and perhaps_s and cost == "weighted" and _asks_for_hold(run, fit, perhaps_s):
        with contextlib.suppress(FitError):
            return _held_or_not(run, fit, _behind_hold(measured, perhaps_s, asked, cost), perhaps_s)
    return fit


def _held_or_not(run: _Searched, fit: FitResult, behind: _Searched, hold_s: float) -> FitResult:
    """The fit, or that ``behind`` the hold, by their description of the response with the hold in it."""
    hold = np.log(np.abs(hold_response(run.measured.frequency_hz, hold_s)) ** 2).sum()
    shorter = _length(run) - _length(behind, float(hold) * run.measured.H[0].size)
    return chosen_hold(fit, marked(_result(behind), hold_s), shorter, hold_s)


def _behind_hold(measured: FrequencyResponse, hold_s: float, asked: FitOptions, cost: Cost) -> _Searched:
    """The search behind the hold, less what a first model folds back."""
    held = dataclasses.replace(measured, hold_s=hold_s)
    first = _searched(release_hold(held), asked, cost)
    (_, model), last_hz = _causal(first), float(measured.frequency_hz[-1])
    kept = folded_modes(model, last_hz, real=structure_of(first.best.layout).real_constants)
    folded = folded_response(model, measured.frequency_hz, 1.0 / hold_s, kept)
    alone = dataclasses.replace(held, H=measured.H - folded)
    return _searched(release_hold(alone), asked, cost, first.best)


def _asks_for_hold(run: _Searched, fit: FitResult, hold_s: float) -> bool:
    """Whether a hold is looked for: the fit has warnings, or lines that reach far (`WIDE`) and allow a hold.

    They do not if the share of a hold in what is left is below one by more deviations than chance. Elsewhere
    a hold is as good as half a period of delay, which the model keeps; a model without delay is not asked:
    half a period of another delay would look like a hold.
    """
    delayed = run.best.layout.options.delay_of is not None
    if not delayed or fit.warnings:
        return delayed
    if run.measured.frequency_hz[-1] * hold_s < 0.5 * WIDE:
        return False
    term = [LackingTerm(kind="hold", rate_hz=1.0 / hold_s)]
    found = response_scores(term, fit.covariance, run.measured, run.followed.at(run.best.share))
    z, share = float(found.z[0]), float(found.value[0])
    return z == 0.0 or 1.0 - share <= TOLD * abs(share / z)


def _length(run: _Searched, scaled: float = 0.0) -> float:
    """Description length; ``scaled`` is the logarithm of a factor that was taken out of all variances."""
    r, spread = run.best.residual(run.data), run.spread
    v = spread.at(excess_share(r, spread))
    likelihood = float(np.sum(np.log(v) + np.abs(r) ** 2 / v)) + scaled
    return description_length(likelihood, run.best.layout.unknowns, 2 * r.size, spread.alike)


def fit_lines(measured: FrequencyResponse, asked: FitOptions, cost: Cost = "weighted") -> FitResult:
    """Fit a response as it is, whatever its inputs did between samples."""
    return _result(_searched(measured, asked, cost))


def fit_model(measured: FrequencyResponse, asked: FitOptions) -> ModelAlone:
    """`fit_lines` without standard deviations and warnings, which take long."""
    run = _searched(measured, asked, "weighted")
    _, model = _causal(run)
    error = _errors(measured, model_response(model, measured.frequency_hz) - measured.H)
    refuse_failed(measured, error)
    return ModelAlone(model, structure_of(run.best.layout), error, run.reason)


@record(kw_only=True)
class _Searched:
    """The end of a search: the fitted data, the best run, its weights, and the reason for its order."""

    measured: FrequencyResponse
    data: Data
    best: Polished
    spread: ExcessVariance
    followed: ExcessVariance
    reason: str
    cost: Cost


def _searched(
    measured: FrequencyResponse, asked: FitOptions, cost: Cost, near: Polished | None = None
) -> _Searched:
    """The search from all starts or, for a given order, from a fit that is ``near``."""
    check_word("cost", cost, get_args(Cost))
    options, states = decided(measured, asked), asked.states
    check_response(measured, count_unknowns(measured, options))
    if cost == "logarithmic" and measured.variance is None:
        raise FitError(
            "the logarithmic cost needs the variance of the response, and one period has none",
            hint="record two periods or more, or take cost 'weighted'",
        )
    if cost == "logarithmic":
        check_logarithms(measured)
    if cost == "likelihood" and measured.covariance is None:
        raise FitError(
            "the likelihood needs the covariance of the response",
            hint="record two periods or more, or take cost 'weighted'",
        )
    spread = spread_of(measured, relative=cost == "logarithmic")
    data = data_of(measured, spread)
    if states is None:
        best, reason = choose_order(measured, data, spread, options, asked)
        if may_be_of_paths(options, asked) and len(measured.inputs) > 1 and not leaves_noise(best, spread):
            best, reason = _shorter(measured, data, spread, options, asked, (best, reason))
    else:
        best, reason = _of_order(data, near, spread, options), f"{states} states were asked for"
    followed = spread_to_follow(best, spread)
    best = settle(data, best, followed)
    if states is None:
        best = tidied(measured, data, best, followed)
        two = parted(data, best, spread)
        best, followed = (best, followed) if two is best else (two, spread)
    if cost == "logarithmic":
        best, followed = logarithmic_polish(data, best, spread), spread
    if cost == "likelihood" and measured.covariance is not None:
        degrees, independent = line_degrees(measured), measured.alike == INDEPENDENT
        best = likelihood_polish(data, best, measured.covariance, degrees, independent=independent)
        followed = spread
    return _Searched(
        measured=measured,
        data=data,
        best=best,
        spread=spread,
        followed=followed,
        reason=reason,
        cost=cost,
    )


def _shorter(
    measured: FrequencyResponse,
    data: Data,
    spread: ExcessVariance,
    options: FitOptions,
    asked: FitOptions,
    one: tuple[Polished, str],
) -> tuple[Polished, str]:
    """The fit with a delay of each path, where that describes the response in fewer words."""
    with contextlib.suppress(DataError, FitError):
        by_paths = dataclasses.replace(options, delay="path")
        best, reason = choose_order(measured, data, spread, by_paths, asked)
        if length_of(data, best, spread) < length_of(data, one[0], spread):
            return best, f"{reason}; {OF_PATHS}"
    return one


def _of_order(data: Data, near: Polished | None, spread: ExcessVariance, options: FitOptions) -> Polished:
    """The likeliest fit from all starts, or the one refined from ``near`` if it leaves noise or is likelier.

    If more than noise is left, a mode may represent distortion in one of several places, and rounding decides
    which one the search finds; two searches find the better place more often than one.
    """
    if near is None:
        return race(data, spread, options)
    followed = spread_to_follow(near, spread)
    again = settle(data, near, followed)
    if leaves_noise(again, spread):
        return again
    return min(again, settle(data, race(data, spread, options), followed), key=lambda run: run.likelihood)


def _causal(run: _Searched) -> tuple[MeasurementModel, MeasurementModel]:
    """The model with its leads and without; how well it is known takes long to find, and is not asked."""
    found = model_of(run.best, run.measured.inputs, run.measured.outputs)
    model = dataclasses.replace(found, delay_s=causal_delay(run.measured, found.delay_s))
    _check_finite(model, run.measured)
    refuse_a_lead(run.measured, found, model)
    return found, model


def _check_finite(model: MeasurementModel, measured: FrequencyResponse) -> None:
    if not np.isfinite(model_response(model, measured.frequency_hz)).all():
        raise FitError("the fitted response is not finite", hint="fewer states")


def _model_of(run: _Searched) -> tuple[MeasurementModel, ModelCovariance, list[str]]:
    """The model, the covariance of the model with its leads, and the warnings of those."""
    measured, best = run.measured, run.best
    found, model = _causal(run)
    covariance = checked_covariance(
        estimate_covariance(
            found, structure_of(best.layout), measured, assumed=run.followed.at(best.share),
            noise=run.spread.variance,
        )
    )  # fmt: skip
    return model, covariance, warnings_on_leads(measured, found.delay_s, uncertainty_of(covariance))


def _result(run: _Searched) -> FitResult:
    model, covariance, warnings = _model_of(run)
    measured, data, best, spread, followed = run.measured, run.data, run.best, run.spread, run.followed
    residual = model_response(model, measured.frequency_hz) - measured.H
    r = np.abs(residual) ** 2
    if followed is not spread:
        best = dataclasses.replace(best, share=excess_share(by_output(residual), spread))
    error = _errors(measured, residual)
    if not best.refined.converged:
        warnings.append(f"the search had not settled after {len(best.refined.history)} steps")
    warnings += warnings_on_record(measured, residual)
    excess = model_error(best, spread)
    lacks = _lacks(run, covariance)
    of_model = warnings_on_model(measured, error, excess, residual)
    doubts = [
        *lacks.said,
        *(of_model if not lacks.said or np.any(error > LEFT) else []),
    ]  # modes are what it does not lack
    warnings += doubts if lacks.said else name_missing_delay(doubts, measured, covariance, error)
    warnings += warnings_on_deviations(measured, covariance)
    phase = _pairs_for_a_delay(measured, covariance, residual, best, followed)
    beside = beside_one_line(measured, model)
    doubted = [*phase[0], *lacks.modes, *beside]
    standing = standing_of(measured, covariance, holds=not (of_model or measured.warnings), doubted=doubted)
    coupled = [] if lacks.said else _coupling_instead(run, covariance, standing)
    if coupled:
        doubts += coupled
        warnings += coupled
        standing = standing_of(measured, covariance, holds=False)
    poles = _poles_for_a_delay(measured, data, best, followed, covariance, standing)
    if poles is not None and poles.shorter:
        standing = standing_of(measured, covariance, holds=False, doubted=phase[0])
    # What all lines lack alike looks like a delay before it is most of what is left.
    noise = not doubts and (measured.variance is None or leaves_noise(best, spread))
    of_delays = standing_of_delays(
        measured, covariance, holds=noise and poles is None and not measured.warnings
    )
    if poles is not None:
        warnings.append(poles.doubt())
    elif not (noise or doubts):
        warnings += warnings_on_delays(of_delays, excess)
    two = _perhaps_two(run, covariance) if noise and poles is None else []
    standing = with_doubt(standing, model, two)
    warnings += [*warnings_on_one_line(measured, model), *warnings_on_second_modes(model, two)]
    warnings += [*warnings_on_phase(model, *phase), *warnings_on_standing(covariance, standing)]
    return FitResult(
        model=model,
        cost=2.0 * best.refined.step.cost / r.size,
        error=error,
        excess=np.sqrt(best.share * np.mean(np.abs(measured.H) ** 2, axis=(0, 2))),
        uncertainty=uncertainty_of(covariance),
        covariance=dataclasses.replace(covariance, model=model),
        history=np.array(best.refined.history),
        order_reason=run.reason + words_on_terms_beyond(measured, covariance),
        warnings=(*measured.warnings, *warnings),
        standing=standing,
        delay_standing=of_delays,
    )


def _errors(
    measured: FrequencyResponse, residual: Complex[np.ndarray, "line output input"]
) -> Float[np.ndarray, " output"]:
    return np.sqrt(np.sum(np.abs(residual) ** 2, axis=(0, 2)) / np.sum(np.abs(measured.H) ** 2, axis=(0, 2)))


def _lacks(run: _Searched, covariance: ModelCovariance) -> Lacking:
    """A delay or a filter that the model lacks; only least squares have scores."""
    if run.cost != "weighted" or covariance.model.sample_hz is not None:
        return NOTHING
    return response_lacks(covariance, run.measured, run.followed.at(run.best.share))


def _perhaps_two(run: _Searched, covariance: ModelCovariance) -> list[int]:
    """Modes that may be two; only least squares by a known variance have scores."""
    if run.cost != "weighted" or covariance.model.sample_hz is not None or run.measured.variance is None:
        return []
    return second_modes(covariance, run.measured, run.followed.at(run.best.share))


def _coupling_instead(
    run: _Searched, covariance: ModelCovariance, standing: tuple[Standing, ...]
) -> list[str]:
    """Couplings that describe the response as shortly as the poles that may be no modes do."""
    model, measured, best = covariance.model, run.measured, run.best
    spare = spare_modes(model, standing)
    if run.cost != "weighted" or not covariance.structure.with_delay or not spare.any() or spare.all():
        return []
    start = without_modes(best.start, np.isin(best.start.point.poles, model.poles[spare]))
    if not len(start.point.poles):
        return []
    terms, s = coupling_terms(len(model.outputs)), 2j * np.pi * measured.frequency_hz

    def trial(rate: Float[np.ndarray, " output"]) -> CouplingTrial | None:
        factor = without_coupling(rate, s)
        data = dataclasses.replace(run.data, H=run.data.H * factor[:, :, None])
        found = polish(data, start, run.followed, steps=STEPS, rounds=ROUNDS)
        if found is None:
            return None
        bare = dataclasses.replace(measured, H=measured.H * factor.T[:, :, None])
        fewer = model_of(found, measured.inputs, measured.outputs)
        of = estimate_covariance(
            fewer, structure_of(found.layout), bare, assumed=run.followed.at(found.share),
            noise=run.spread.variance,
        )  # fmt: skip
        scores = response_scores(terms, of, bare, run.followed.at(found.share))
        return CouplingTrial(length_of(data, found, run.followed), scores)

    return coupling_instead(length_of(run.data, best, run.followed), trial, model)


def _pairs_for_a_delay(
    measured: FrequencyResponse,
    covariance: ModelCovariance,
    residual: Complex[np.ndarray, "line output input"],
    best: Polished,
    followed: ExcessVariance,
) -> tuple[Int[np.ndarray, " mode"], float]:
    """Pairs that stand for a delay in a model without delays."""
    if covariance.structure.with_delay:
        return np.array([], dtype=int), 0.0
    s, inputs = 2j * np.pi * measured.frequency_hz, len(measured.inputs)
    each = np.broadcast_to(np.eye(inputs), (len(s), inputs, inputs))
    weight = 1.0 / np.sqrt(followed.at(best.share))
    return stands_for_delay(covariance.model, s, each, by_output(-residual), weight)


def _poles_for_a_delay(
    measured: FrequencyResponse,
    data: Data,
    best: Polished,
    followed: ExcessVariance,
    covariance: ModelCovariance,
    standing: tuple[Standing, ...],
) -> PolesInstead | None:
    """Poles that describe as much without delays, where a fit with delays has modes that are not sound."""
    if not covariance.structure.with_delay or all(one == "sound" for one in standing):
        return None
    # Lengths compare on one spread alone: that by which ``best`` was found.
    true = [np.unique(covariance.model.poles[which]) for which in true_modes(standing)]
    return poles_instead(measured, data, best, followed, true)
