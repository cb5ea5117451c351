"""Fit a measurement model to a frequency response: start, race, refine, check."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, FitError
from middeck.identification.checks import check_response
from middeck.identification.doubts import causal_delay, doubts_of_model, doubts_of_record
from middeck.identification.exchange import exchanges
from middeck.identification.measurement_model import MeasurementModel, model_response
from middeck.identification.order import OrderChoice, choose, description_length, is_settled, sizes
from middeck.identification.polish import Polished, logarithmic_polish, polish
from middeck.identification.refine import Data
from middeck.identification.start import Options, Start, starts
from middeck.identification.terms import shapes, unpack
from middeck.identification.uncertainty import Uncertainty, bound
from middeck.identification.weights import Spread, spread_of
from middeck.systems.response import FrequencyResponse
from middeck.values import record

# The starts are compared on lines that hold about so many numbers; the best is then refined on all.
RACE_NUMBERS = 5000
RACE_STEPS = 40
# Exchanges are tried when more than this share of the variance is not the measured one, and one counts when
# it gains more likelihood than rounding and an unsettled search may.
WORTH_EXCHANGE = 0.1
EXCHANGE_GAIN = 1.0
# The start is weighted as if the model left this share of the response's rms.
FIRST_EXCESS = 0.03


@record
class FitResult:
    """A fitted model and how good it is.

    Parameters
    ----------
    model:
        The measurement model.
    cost:
        Mean of |weight times residual|^2: one where the model leaves what its weights expect.
    error:
        Relative complex error of each output on the fitted lines, sqrt(sum |E - H|^2 / sum |H|^2).
    excess:
        Standard deviation of each output's response that the model leaves beyond the measured variance;
        zero for a model that explains its data.
    uncertainty:
        Standard deviations of frequencies, damping and delays.
    history:
        Cost of each step of the last search, in that search's weights.
    order_reason:
        Why the model has the order it has.
    warnings:
        What the user should know; empty if nothing.
    """

    model: MeasurementModel
    cost: float
    error: Float[np.ndarray, " output"]
    excess: Float[np.ndarray, " output"]
    uncertainty: Uncertainty
    history: Float[np.ndarray, " step"]
    order_reason: str
    warnings: tuple[str, ...]


def fit_response(
    measured: FrequencyResponse,
    *,
    states: int | None = None,
    sample_hz: float | None = None,
    constants: Literal["real", "complex"] | None = None,
    delay: bool | None = None,
    direct: bool | None = None,
    residuals: bool = False,
    cost: Literal["weighted", "logarithmic"] = "weighted",
) -> FitResult:
    """Fit common poles, rank-one residues and delays to a measured response.

    Stable by construction and real. The weights are the measured variance, averaged over neighbouring
    lines, plus the variance that the model cannot follow (`weights`); the starts are subspace models of
    several sizes, of which the likeliest after a short refinement is refined to the end.

    Parameters
    ----------
    measured:
        Response with its variance (`estimate_response`).
    states:
        Order of the model without its delays: two for each pair of poles. By default the order of the
        shortest description (`order`), which takes longer.
    sample_hz:
        Give the sampling rate to fit a sampled model, right when the inputs were held and the band comes
        near half the rate; by default the model is continuous.
    constants:
        "real": each residue is that of a mode driven by a force and seen as a displacement (relative
        degree two), which makes a delay identifiable; the default in continuous time. "complex": any
        residue; the default, and all there is, for a sampled model.
    delay:
        Whether each output has a delay; by default with real constants only. Complex constants take up a
        short delay themselves, so that the two are confounded: the result then warns.
    direct:
        Whether there is a constant term, which also stands for modes above the band; by default with
        complex constants only.
    residuals:
        Whether terms for the modes outside the band are fitted beside the states: 1/s^2 for those below,
        a constant for those above (Ewins 2000, sec. 4.2). Continuous models only.
    cost:
        "weighted" least squares on the complex response, or "logarithmic": on log magnitude and phase
        (the 1993 paper's), which follows the antiresonances as closely as the peaks.

    Raises
    ------
    ConfigError
        For options that exclude each other.
    FitError
        If the response is constant, all noise or too short for so many states, if an output leads its
        input, or if no start could be refined.
    """
    options = _options(
        measured, 2 if states is None else states, sample_hz, constants, delay, direct, residuals
    )
    check_response(measured, _unknowns(measured, options))
    if cost == "logarithmic" and measured.variance is None:
        raise FitError(
            "the logarithmic cost needs the variance of the response, and one period has none",
            hint="record two periods or more, or take cost 'weighted'",
        )
    spread = spread_of(measured, relative=cost == "logarithmic")
    data = _first_data(measured, spread)
    reason = f"{states} states were asked for"
    if states is None:
        choice = _recommend(measured, data, spread, options)
        options, reason = dataclasses.replace(options, states=choice.states), choice.reason
    best = _race(data, spread, options)
    best = polish(data, Start(best.layout, best.refined.theta), spread, steps=200, rounds=5) or best
    if cost == "logarithmic":
        best = logarithmic_polish(data, best, spread)
    return _result(measured, options, best, spread, reason)


def _recommend(measured: FrequencyResponse, data: Data, spread: Spread, options: Options) -> OrderChoice:
    """The order of the shortest description, each order raced as a fit would be."""
    part, _ = _some_lines(data, spread)
    tried: list[int] = []
    length: list[float] = []
    for states in sizes():
        sized = dataclasses.replace(options, states=states)
        unknowns = _unknowns(measured, sized)
        if 2 * unknowns > part.H.size:
            break
        try:
            run = _race(data, spread, sized)
        except FitError:
            continue
        tried.append(states)
        length.append(description_length(run.likelihood, unknowns, 2 * part.H.size))
        if is_settled(length):
            break
    if not tried:
        raise FitError("no order could be fitted", hint="a wider band or a longer period")
    return choose(tried, length)


def _options(
    measured: FrequencyResponse,
    states: int,
    sample_hz: float | None,
    constants: str | None,
    delay: bool | None,
    direct: bool | None,
    residuals: bool,
) -> Options:
    real = (constants or ("real" if sample_hz is None else "complex")) == "real"
    if states < 1:
        raise ConfigError(f"a model of {states} states cannot be fitted", hint="one state or more")
    if real and states % 2:
        raise ConfigError(
            f"{states} states are no whole number of modes", hint="an even number, or constants='complex'"
        )
    if sample_hz is not None and (real or delay or residuals):
        raise ConfigError(
            "a sampled model has complex constants, no separate delay and no residual terms",
            hint="leave out constants, delay and residuals, or sample_hz",
        )
    if sample_hz is not None and measured.frequency_hz[-1] >= 0.5 * sample_hz:
        raise ConfigError(
            f"the response reaches {measured.frequency_hz[-1]:.6g} Hz, beyond half of {sample_hz:.6g} Hz"
        )
    with_delay = real if delay is None else delay
    period_s = 0.0 if sample_hz is None else 1.0 / sample_hz
    with_direct = residuals or (not real if direct is None else direct)
    return Options(states, real, with_delay, residuals, with_direct, period_s)


def _unknowns(measured: FrequencyResponse, options: Options) -> int:
    """Unknowns if all poles are pairs."""
    _, outputs, inputs = measured.H.shape
    each = 1 if options.real_constants else 2
    per_pair = 2 + each * (inputs - 1) + each * outputs
    return (
        -(-options.states // 2) * per_pair
        + outputs * options.with_delay
        + outputs * inputs * (options.with_lower + options.with_direct)
    )


def _first_data(measured: FrequencyResponse, spread: Spread) -> Data:
    weight = 1.0 / np.sqrt(spread.at(FIRST_EXCESS**2))
    return Data(2j * np.pi * measured.frequency_hz, np.moveaxis(measured.H, 0, 1), weight)


def _race(data: Data, spread: Spread, options: Options) -> Polished:
    """The likeliest of the starts, each refined for a while on some of the lines, then its exchanges."""
    part, some = _some_lines(data, spread)
    best: Polished | None = None
    for start in starts(data, options):
        run = polish(part, start, some, steps=RACE_STEPS, rounds=3)
        if run is not None and (best is None or run.likelihood < best.likelihood):
            best = run
    if best is None:
        raise FitError(
            f"no start for {options.states} states could be refined",
            hint="fewer states, a wider band or a longer period",
        )
    return _exchange(part, some, options, best)


def _exchange(part: Data, spread: Spread, options: Options, best: Polished) -> Polished:
    """Exchange modes as long as that pays; a model that leaves no excess has nothing to gain."""
    while _model_error(best, spread) > WORTH_EXCHANGE:
        runs = (
            polish(part, start, spread, steps=RACE_STEPS, rounds=3)
            for start in exchanges(part, options, best, spread)
        )
        better = (run for run in runs if run is not None and run.likelihood < best.likelihood - EXCHANGE_GAIN)
        found = next(better, None)
        if found is None:
            return best
        best = found
    return best


def _model_error(best: Polished, spread: Spread) -> float:
    """Part of the variance behind the weights that is not the measured one."""
    return float(best.share * np.mean(spread.size / spread.at(best.share)))


def _some_lines(data: Data, spread: Spread) -> tuple[Data, Spread]:
    some = slice(None, None, max(1, data.H.size // RACE_NUMBERS))
    return Data(data.s[some], data.H[:, some], data.weight[:, some]), Spread(
        spread.variance[:, some], spread.size[:, some]
    )


def _result(
    measured: FrequencyResponse, options: Options, best: Polished, spread: Spread, reason: str
) -> FitResult:
    sample_hz = 1.0 / options.period_s if options.period_s else None
    point = unpack(best.layout, best.refined.theta)
    c = np.array([shapes(best.layout, point, x) for x in best.refined.step.linear])
    lower, direct = _constant_terms(best)
    uncertainty = bound(best.layout, best.refined.theta, best.gram)
    delay_s, warnings = causal_delay(measured, point.delay_s, uncertainty)
    model = MeasurementModel(
        point.poles, c, point.b, direct, lower, delay_s, measured.inputs, measured.outputs, sample_hz
    )
    r = np.abs(model_response(model, measured.frequency_hz) - measured.H) ** 2
    if not np.isfinite(r).all():
        raise FitError("the fitted response is not finite", hint="fewer states")
    error = np.sqrt(np.sum(r, axis=(0, 2)) / np.sum(np.abs(measured.H) ** 2, axis=(0, 2)))
    if not best.refined.converged:
        warnings.append(f"the search had not settled after {len(best.refined.history)} steps")
    if options.with_delay and not options.real_constants:
        warnings.append("the delay is confounded with the complex residues: only their sum is certain")
    warnings += doubts_of_record(measured)
    warnings += doubts_of_model(measured, error, _model_error(best, spread), best.share)
    return FitResult(
        model,
        2.0 * best.refined.step.cost / r.size,
        error,
        np.sqrt(best.share * np.mean(np.abs(measured.H) ** 2, axis=(0, 2))),
        uncertainty,
        np.array(best.refined.history),
        reason,
        tuple(warnings),
    )


def _constant_terms(best: Polished) -> tuple[np.ndarray, np.ndarray]:
    layout, linear = best.layout, best.refined.step.linear
    none = np.zeros((layout.outputs, layout.inputs))
    direct = linear[:, -layout.inputs :] if layout.with_direct else none
    end = layout.columns - layout.inputs * layout.with_direct
    return (linear[:, end - layout.inputs : end] if layout.with_lower else none), direct
