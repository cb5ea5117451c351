"""Remove the modes and sines that a fit of a record does not need.

Orders are compared after a few steps of refinement, so that a mode of the final model may be noise. It is
removed if that shortens the description (Rissanen 1978). A pole that does not decay within the record and
that no input drives (hum, unbalance) is replaced by a sine: a linear term of each output and experiment,
whose amplitude and phase vary as a parabola in time.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
import scipy.ndimage
import scipy.stats
from jaxtyping import Bool, Complex, Float

from middeck.identification.faults.hum import name_line
from middeck.identification.fit.fitted_model import model_of
from middeck.identification.fit.mode_trust import SteadyLine
from middeck.identification.fit.unneeded_modes import (
    CLEARLY,
    DOUBTFUL,
    NOTHING,
    mode_significance,
    own_lines,
    pairs_of,
    shed,
    stay_near,
    with_split,
    without_modes,
)
from middeck.identification.problem.data import Data
from middeck.identification.problem.unknowns_layout import Start
from middeck.identification.record_fit.missed_modes import grown
from middeck.identification.record_fit.record_covariance import record_covariance
from middeck.identification.record_fit.record_order import record_length, record_unknowns
from middeck.identification.record_fit.reduced_record import has_many_outputs
from middeck.identification.record_fit.refine_record import RecordRun, Weighting, refine_record
from middeck.identification.record_fit.residual_tests import Heard, heard_of
from middeck.identification.record_fit.second_mode import chance_of_no_second
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.parameter_deviations import uncertainty_of
from middeck.signals.excitation.driven_band import floor_variance
from middeck.signals.record import Record
from middeck.values import record as frozen

# A pole that loses less than this share of its motion over the record may be a sine.
STEADY = 0.5
# Rounds of noise and search, and steps of each.
ROUNDS, STEPS = 3, 20
# Steps that decide whether the rest is worth its time.
FIRST_STEPS = 4
# A line of the residual that stands so many times above those beside it (median) may be a sine: of n lines
# of noise the largest is ln n means of it, or ln n / ln 2 medians.
LINE_ABOVE, BESIDE = 15.0, 15
MOST_LINES = 8
# Powers of 1 / (s - pole) by which modes beside one differ from it, and times what chance makes them gain.
ORDERS, CHANCE = (1, 2, 3), 2.0
# Pairs that are nearer to each other than this share of their decay rate are one pole; and the least fall of
# the description that a search from elsewhere counts.
TWINS, WORTH = 0.1, 1.0
# Chance by which one mode of a clean record is likelier as two (Wilks 1938), and by which what it leaves has
# the form that a second one would leave: under forces that shake the article one is likelier as two, too; and
# the same where inputs are known to have noise, of which their parts at rest tell little more than the size.
BY_CHANCE, OF_FORM, OF_NOISE = 3e-4, 0.01, 1e-4
# Power left on driven lines over that of silent ones, from which it is distortion.
DISTORTED = 2.0
# Powers of time in the amplitude.
POWERS = 3


@frozen(kw_only=True)
class Tidied:
    """A tidied fit: data with their steady lines, the model, and those lines.

    ``as_two`` has the modes [Hz] that two would describe better, where the order that was asked for has none
    to give up; ``perhaps_two`` those that are likelier as two than chance explains, but not shorter.
    """

    data: Data
    run: RecordRun
    lines: tuple[SteadyLine, ...]
    as_two: tuple[float, ...] = ()
    perhaps_two: tuple[float, ...] = ()
    input_noise: Float[np.ndarray, "part sample input"] | None = None

    @property
    def of_forces(self) -> bool:
        """Whether inputs are known to have noise, so that a residual at a peak need not be a second mode."""
        return self.input_noise is not None

    def heard(self, record: Record) -> Heard:
        """Responses to the noise of inputs that is known."""
        return heard_of(record, self.data, self.run, self.input_noise)


def tidied(
    record: Record,
    data: Data,
    run: RecordRun,
    *,
    sampled: bool,
    input_noise: Float[np.ndarray, "part sample input"] | None = None,
) -> Tidied:
    """The model without the sines and modes that do not belong to it, as far as that shortens it.

    A sampled model keeps its modes: its poles stand for delays and filters, too, and its order was judged by
    how it simulates.
    """
    state = _without_sines(record, Tidied(data=data, run=run, lines=(), input_noise=input_noise))
    if not sampled:
        state = shed(state, functools.partial(_significance, record), functools.partial(_without, record))
        state = state if state.of_forces else _with_twins_apart(state)
        state = _with_modes_in_two(record, state)
    found = _with_hidden_lines(record, state)
    if len(found.lines) == len(state.lines) or not found.perhaps_two:
        return found
    # A sine beside a mode is likelier as a second one, too.
    return _with_modes_in_two(record, dataclasses.replace(found, perhaps_two=()))


def with_sines_beside(record: Record, state: Tidied) -> Tidied:
    """A model of the order asked for and the sines beside it; none where that lacks a mode.

    A mode that the model lacks stands above the lines beside it, too, but the inputs drive it.
    """
    found = _with_hidden_lines(record, state)
    return state if found.lines and _lacks_a_mode(record, state, found) else found


def _lacks_a_mode(record: Record, state: Tidied, with_sines: Tidied) -> bool:
    """Whether a pair more, which the inputs drive, is the shorter description in the place of sines.

    At the peak of what is left, or in the mode beside the sine, which two nearer than their widths leave.
    """
    run, omega = state.run, 2.0 * np.pi * with_sines.lines[0].hz
    start = grown(state.data, run.layout.options.sized(run.layout.states + 2), run)
    split = with_split(run.start, _nearest(run, omega)) if run.layout.pairs else None
    tried = [_refined(state, each) for each in (start, split) if each is not None]
    more = min((each for each in tried if each is not None), key=_length, default=None)
    if more is None or _length(more) > _length(with_sines):
        return False
    return bool(_significance(record, more)[_nearest(more.run, omega)] >= DOUBTFUL)


def _nearest(run: RecordRun, omega: float) -> int:
    """The pair nearest to ``omega`` [rad/s]."""
    return int(np.argmin(np.abs(np.imag(pairs_of(run)) - omega)))


def with_modes_as_two(record: Record, state: Tidied) -> Tidied:
    """A continuous model of the order asked for, its least needed mode given up for one that is two."""
    state = state if state.of_forces else _with_twins_apart(state)
    data, run = state.data, state.run
    for m in range(run.layout.pairs):
        two = _in_two(state, m)
        if two is None or not _is_shorter(record, state, two, m):
            if two is not None and stay_near(pairs_of(two.run), pairs_of(run), m):
                state = _with_mark(record, state, two, m)
            continue
        significance = _significance(record, two)
        significance[m : m + 2] = np.inf
        significance[two.run.layout.pairs :] = np.inf
        least = np.arange(len(significance)) == np.argmin(significance)
        better = None
        if significance[least][0] < np.inf:
            start = without_modes(two.run.start, least)
            better = _better(state, data, start, (), by=CLEARLY, kind=two.run.weighting)
        if better is not None:
            return better
        state = dataclasses.replace(state, as_two=(*state.as_two, _mode_hz(state, m)))
    return state


def covariance_of(record: Record, state: Tidied) -> ModelCovariance:
    """Covariance of the unknowns of the state's model."""
    run = state.run
    return record_covariance(run, state.data, model_of(run, record.inputs, record.outputs))[0]


def _without_sines(record: Record, state: Tidied) -> Tidied:
    """Poles that do not decay are given up for sines, the least damped first."""
    length_s = state.data.length_s
    tried: list[float] = []
    while True:
        poles = pairs_of(state.run)
        steady = [m for m in _steady(state) if not _among(float(np.imag(poles[m])), tried, length_s)]
        if not steady or len(state.lines) >= MOST_LINES or len(state.run.layout.pair) < 2:
            return state
        tried.append(float(np.imag(poles[steady[0]])))
        state = _as_line(record, state, steady[0]) or state


def _steady(state: Tidied) -> list[int]:
    """Poles in the band that do not decay within the record, the least damped first."""
    poles, omega = pairs_of(state.run), state.data.omega
    decay = -np.real(poles) * state.data.length_s
    within = (np.imag(poles) >= omega[0]) & (np.imag(poles) <= omega[-1]) & (decay < STEADY)
    return [int(m) for m in np.argsort(decay) if within[m]]


def _as_line(record: Record, state: Tidied, m: int) -> Tidied | None:
    run = state.run
    return _better(
        state,
        with_line(state.data, float(pairs_of(run)[m].imag)),
        without_modes(run.start, np.arange(len(run.layout.pair)) == m),
        (*state.lines, *_lines_at(record, state, [m])),
    )


def _lines_at(record: Record, state: Tidied, modes: Sequence[int]) -> list[SteadyLine]:
    """Lines in the place of modes that do not decay."""
    of, poles = uncertainty_of(covariance_of(record, state)).natural_hz, pairs_of(state.run)
    of = np.minimum(of, 1.0 / state.data.length_s)  # a pole that hardly moves the response has no deviation
    both = [(float(poles[m].imag) / (2.0 * np.pi), float(of[m])) for m in modes]
    return [SteadyLine(hz, deviation_hz, name_line(hz, deviation_hz)) for hz, deviation_hz in both]


def _without(record: Record, state: Tidied, dropped: Bool[np.ndarray, " mode"]) -> Tidied | None:
    """The fit without some modes, or with their free motion alone, which no input drives.

    The free motion of a pole that does not decay is a sine, and is named as one.
    """
    run = state.run
    start = without_modes(run.start, dropped)
    fewer = _better(state, state.data, start, state.lines)
    if fewer is not None:
        return fewer
    poles = run.start.point.poles
    steady = [m for m in _steady(state) if dropped[m]]
    lines = (*state.lines, *_lines_at(record, state, steady)) if steady else state.lines
    return _better(state, with_free_motion(state.data, poles[dropped]), start, lines)


def _with_modes_in_two(record: Record, state: Tidied) -> Tidied:
    """Modes in two where that is clearly shorter, and a mark on those where it is only likelier.

    No mark beside a distortion that repeats with its signal (`_leaves_noise`).
    """
    m = 0
    while m < state.run.layout.pairs:
        two = _in_two(state, m)
        if two is not None and not stay_near(pairs_of(two.run), pairs_of(state.run), m):
            two = None
        if two is not None and _is_shorter(record, state, two, m):
            state, m = two, m + 1
        elif two is not None and _leaves_noise(two):
            state = _with_mark(record, state, two, m)
        m += 1
    return state


def _in_two(state: Tidied, m: int) -> Tidied | None:
    """The fit with mode ``m`` split in two; None where it is not to be had, or not worth its time.

    One mode in the place of two leaves most at their peak, as noise of forces does, so that such noise was
    the likelier kind: the two are also tried with noise of sensors.
    """
    start = with_split(state.run.start, m)
    if has_many_outputs(state.data) and not (_leaves_more(state, m) and _promises(state, start)):
        return None
    found = _refined(state, start)
    if state.run.weighting != "motion" or state.of_forces:
        return found
    other = _refined(state, start, "output")
    if found is None or other is None:
        return found or other
    by = CLEARLY if _length(found) + CLEARLY < _length(state) else 0.0
    return other if _length(other) + by < _length(found) else found


def _is_shorter(record: Record, state: Tidied, two: Tidied, m: int) -> bool:
    """Whether mode ``m`` in two is clearly shorter; beside noise of forces or distortion, none doubtful."""
    if _length(two) + CLEARLY > _length(state):
        return False
    least = DOUBTFUL if state.of_forces or not _leaves_noise(two) else NOTHING
    return bool(_significance(record, two)[m : m + 2].min() >= least)


def _over_silent(state: Tidied) -> Float[np.ndarray, "output line"]:
    """Power left on each driven line over that of the silent ones beside it, summed over experiments."""
    driven, at = state.data.driven, np.arange(len(state.data.s))
    assert driven is not None
    left, noise = np.sum(np.abs(state.run.residual(state.data)) ** 2, axis=2), state.run.variance.mean(axis=2)
    silent = np.array([np.interp(at[driven], at[~driven], v[~driven]) for v in noise])
    return left[:, driven] / silent


def _leaves_noise(state: Tidied) -> bool:
    """Whether lines that inputs drive have hardly more left than silent ones beside them.

    What they have more is a distortion that repeats with its signal, which has the form of a second mode.
    """
    if state.data.driven is None:
        return True
    experiments = state.data.H.shape[2]
    return bool(np.all(_over_silent(state).mean(axis=1) < DISTORTED * experiments))


def _gained(state: Tidied, two: Tidied) -> float:
    """Twice the log likelihood that a second mode brings; on driven lines by the noise of silent ones.

    Few driven lines give a variance that follows what two modes leave.
    """
    gained = 2.0 * (state.run.likelihood - two.run.likelihood)
    if state.data.driven is None:
        return gained
    return min(gained, 2.0 * float(np.sum(_over_silent(state) - _over_silent(two))))


def _with_mark(record: Record, state: Tidied, two: Tidied, m: int) -> Tidied:
    """The state with a mark on mode ``m`` where two are likelier than chance explains."""
    run, omega = state.run, state.data.omega
    if not omega[0] <= abs(pairs_of(run)[m]) <= omega[-1]:  # it stands for what lies beyond the band
        return state
    if _gained(state, two) < scipy.stats.chi2.isf(BY_CHANCE, record_unknowns(two.run) - record_unknowns(run)):
        return state
    floor = floor_variance(record.u.reshape(len(record.u), -1, record.u.shape[3]))
    heard = state.heard(record)
    chance = chance_of_no_second(run, state.data, covariance_of(record, state), m, heard, floor)
    if chance > (OF_NOISE if state.of_forces else OF_FORM):
        return state
    return dataclasses.replace(state, perhaps_two=(*state.perhaps_two, _mode_hz(state, m)))


def _mode_hz(state: Tidied, m: int) -> float:
    return float(abs(pairs_of(state.run)[m])) / (2.0 * np.pi)


def _length(state: Tidied) -> float:
    return record_length(state.data, state.run)


def _with_twins_apart(state: Tidied) -> Tidied:
    """The fit with pairs that came to one pole sought again, from one mode split in two.

    Two modes nearer than their widths have a local minimum where they are a double pole.
    """
    for m in range(state.run.layout.pairs):
        poles = pairs_of(state.run)
        away = np.where(np.arange(len(poles)) == m, np.inf, np.abs(poles - poles[m]))
        twin = int(np.argmin(away))
        if away[twin] > TWINS * abs(poles[m].real):
            continue
        alone = without_modes(state.run.start, np.arange(len(state.run.layout.pair)) == twin)
        one = refine_record(state.data, alone, "output", rounds=ROUNDS, steps=STEPS)
        if one is not None:
            start = with_split(one.start, m - (twin < m))
            state = _better(state, state.data, start, state.lines, by=WORTH, kind="output") or state
    return state


def _leaves_more(state: Tidied, m: int) -> bool:
    """Whether the residual near a mode exceeds noise: parts that follow the inputs as modes beside it would.

    Their power does not tell, as the variance of noise is that of what is left. Of chance, the ways to follow
    gain one each.
    """
    data, run = state.data, state.run
    pole = pairs_of(run)[m]
    own = own_lines(data, pole)
    beside = 1.0 / (data.s[own] - pole)
    ways = np.stack([(beside / np.abs(beside).max()) ** power for power in ORDERS])
    size = np.sqrt(run.variance[:, own])
    columns = np.einsum("pl,lie,ole->olepi", ways, data.U[own], 1.0 / size)
    outputs, lines, experiments, *each = columns.shape
    numbers, count = lines * experiments, int(np.prod(each))
    if numbers <= 2 * count:
        return True
    Q = np.linalg.qr(columns.reshape(outputs, numbers, count))[0]
    white = (run.residual(data)[:, own] / size).reshape(outputs, numbers, 1)
    alone = white - Q @ (Q.conj().mT @ white)
    left, rest = (np.sum(np.abs(x) ** 2, axis=(1, 2)) + np.finfo(float).tiny for x in (white, alone))
    return bool(np.sum(numbers * np.log(left / rest)) > CHANCE * outputs * count)


def _promises(state: Tidied, start: Start) -> bool:
    """Whether a few steps gain half of what the unknowns that ``start`` adds have to, where all take long."""
    run = state.run
    first = refine_record(state.data, start, run.weighting, rounds=1, steps=FIRST_STEPS)
    if first is None:
        return False
    gain = 2.0 * (run.likelihood - first.likelihood)
    return gain > 0.5 * (record_length(state.data, first) - record_length(state.data, run) + gain)


def _significance(record: Record, state: Tidied) -> Float[np.ndarray, " mode"]:
    """Significance of each pole of the layout."""
    covariance = covariance_of(record, state)
    found = mode_significance(covariance)
    poles = state.run.start.point.poles
    return np.array([found[covariance.model.poles == pole].max(initial=0.0) for pole in poles])


def _with_hidden_lines(record: Record, state: Tidied) -> Tidied:
    """The data with sines in the residual, where no pole was spent on them."""
    while len(state.lines) < MOST_LINES:
        omega = _highest_line(record, state)
        found = None if omega is None else _with_line_near(state, omega)
        if found is None:
            return state
        state = found
    return state


def _with_line_near(state: Tidied, omega: float) -> Tidied | None:
    """The fit with a sine near ``omega`` [rad/s], at most a line away; None if its description is longer.

    What a mode beside it took up of the sine moves the peak of the residual.
    """
    best, half = _with_line_at(state, omega), np.pi / state.data.length_s
    for way in (-half, half):
        for steps in (1, 2):
            found = _with_line_at(state, omega + steps * way)
            if found is None or (best is not None and _length(found) >= _length(best)):
                break
            best = found
    return None if best is None or _length(best) > _length(state) else best


def _with_line_at(state: Tidied, omega: float) -> Tidied | None:
    hz, apart = omega / (2.0 * np.pi), 1.0 / state.data.length_s
    line = SteadyLine(hz, apart, name_line(hz, apart))
    other = dataclasses.replace(state, data=with_line(state.data, omega), lines=(*state.lines, line))
    return _refined(other, state.run.start)


def _highest_line(record: Record, state: Tidied) -> float | None:
    """Line where the residual exceeds its neighbours, and noise of inputs, most; None if nowhere much."""
    run = state.run
    r = run.residual(state.data)
    power = np.mean(np.abs(r) ** 2, axis=2)
    size = min(2 * BESIDE + 1, power.shape[1])
    beside = scipy.ndimage.median_filter(power, size=(1, size), mode="reflect")
    heard = np.abs(state.heard(record)) ** 2
    beside += np.sum(heard, axis=2) / max(heard.shape[2], 1)
    above = power / np.maximum(beside, np.finfo(float).tiny)
    o, k = np.unravel_index(int(np.argmax(above)), above.shape)
    if above[o, k] < LINE_ABOVE + np.log(above.size):
        return None
    # Between the two highest lines, where the sine is (a sine's spectrum falls with the distance).
    beside_k = k + 1 if k + 1 < power.shape[1] and (k == 0 or power[o, k + 1] > power[o, k - 1]) else k - 1
    a, b, omega = np.sqrt(power[o, k]), np.sqrt(power[o, beside_k]), state.data.omega
    return float(omega[k] + (omega[beside_k] - omega[k]) * b / (a + b))


def _among(frequency: float, tried: list[float], length_s: float) -> bool:
    """Whether a sine of this frequency [rad/s], up to a quarter of a line, was tried."""
    return any(abs(frequency - omega) < 0.5 * np.pi / length_s for omega in tried)


def _better(
    state: Tidied,
    data: Data,
    start: Start,
    lines: tuple[SteadyLine, ...],
    *,
    by: float = 0.0,
    kind: Weighting | None = None,
) -> Tidied | None:
    """A model refined from ``start``, if its description is no longer, or shorter ``by`` so much.

    With noise of the state's own kind, unless another is given.
    """
    other = _refined(dataclasses.replace(state, data=data, lines=lines), start, kind)
    return None if other is None or _length(other) + by > _length(state) else other


def _refined(state: Tidied, start: Start, kind: Weighting | None = None) -> Tidied | None:
    run = refine_record(state.data, start, kind or state.run.weighting, rounds=ROUNDS, steps=STEPS)
    return None if run is None else dataclasses.replace(state, run=run)


def with_line(data: Data, omega: float) -> Data:
    """Data whose transients have a sine of ``omega`` [rad/s] in them."""
    return _with(data, _sines(data, omega))


def with_free_motion(data: Data, poles: Complex[np.ndarray, " pole"]) -> Data:
    """Data whose transients have free motion of ``poles`` [rad/s] in them, which no input is to move."""
    T = data.period_s
    series = 1.0 / (1.0 - np.exp(poles[:, None] * T) * np.exp(-data.s * T))
    mirrored = 1.0 / (1.0 - np.exp(poles.conj()[:, None] * T) * np.exp(-data.s * T))
    pair = np.imag(poles) * T % np.pi != 0.0
    return _with(data, _even(np.concatenate([series + mirrored, 1j * (series - mirrored)[pair]])))


def _with(data: Data, spectra: Complex[np.ndarray, "column line"]) -> Data:
    assert data.transient is not None
    known = data.transient.steady
    spectra = spectra if known is None else np.concatenate([known, spectra])
    return dataclasses.replace(data, transient=dataclasses.replace(data.transient, steady=spectra))


def _sines(data: Data, omega: float) -> Complex[np.ndarray, "column line"]:
    """Discrete Fourier transforms of t^k cos and t^k sin over the record, to the mean square of one."""
    count = round(data.length_s / data.period_s)
    time = np.linspace(-1.0, 1.0, count, endpoint=False)
    turning = np.exp(1j * omega * data.period_s * np.arange(count))
    parts = [x * time**k for k in range(POWERS) for x in (np.real(turning), np.imag(turning))]
    return _even(np.fft.rfft(parts, axis=1)[:, data.lines])


def _even(spectra: Complex[np.ndarray, "column line"]) -> Complex[np.ndarray, "column line"]:
    return spectra / np.sqrt(np.mean(np.abs(spectra) ** 2, axis=1, keepdims=True))
