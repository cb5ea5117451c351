"""Fit a measurement model to a frequency response: start, race, refine, check."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, FitError
from middeck.identification.checks import check_response
from middeck.identification.doubts import causal_delay, doubts_of_model, doubts_of_record
from middeck.identification.measurement_model import MeasurementModel, model_response
from middeck.identification.polish import Polished, logarithmic_polish, polish
from middeck.identification.race import count_unknowns, model_error, race, recommend_states
from middeck.identification.refine import Data
from middeck.identification.start import Options, Start
from middeck.identification.terms import shapes, unpack
from middeck.identification.uncertainty import Uncertainty, bound
from middeck.identification.weights import Spread, spread_of
from middeck.systems.response import FrequencyResponse
from middeck.values import record

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
    check_response(measured, count_unknowns(measured, options))
    if cost == "logarithmic" and measured.variance is None:
        raise FitError(
            "the logarithmic cost needs the variance of the response, and one period has none",
            hint="record two periods or more, or take cost 'weighted'",
        )
    spread = spread_of(measured, relative=cost == "logarithmic")
    data = _first_data(measured, spread)
    reason = f"{states} states were asked for"
    if states is None:
        choice = recommend_states(measured, data, spread, options)
        options, reason = dataclasses.replace(options, states=choice.states), choice.reason
    best = race(data, spread, options)
    best = polish(data, Start(best.layout, best.refined.theta), spread, steps=200, rounds=5) or best
    if cost == "logarithmic":
        best = logarithmic_polish(data, best, spread)
    return _result(measured, options, best, spread, reason)


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


def _first_data(measured: FrequencyResponse, spread: Spread) -> Data:
    weight = 1.0 / np.sqrt(spread.at(FIRST_EXCESS**2))
    return Data(2j * np.pi * measured.frequency_hz, np.moveaxis(measured.H, 0, 1), weight)


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
    warnings += doubts_of_model(measured, error, model_error(best, spread), best.share)
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
