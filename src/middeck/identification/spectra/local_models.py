"""A response from any record, free of leakage: local models whose window and kind the data choose."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from middeck.errors import DataError
from middeck.identification.spectra import local_fit
from middeck.identification.spectra.excited_lines import (
    FAINTEST,
    WORST_CONDITION,
    in_band,
    refuse_alike,
    refuse_silence,
)
from middeck.identification.spectra.variance_of_lines import ResponseScatter
from middeck.identification.spectra.zoom import zoomed_lines
from middeck.signals.record import Record, RecordStream

# Rows of a window for each unknown, from the narrowest that leaves a few to judge by, to where a response of
# 1 % damping bends too much for any gain in noise.
ROWS_POLYNOMIAL = (1.5, 3.0, 5.0, 8.0, 13.0, 20.0)
ROWS_RATIONAL = (1.8, 3.0, 5.0, 8.0)
# A denominator is taken where it halves the error of prediction: where it does not, noise in its regressors
# would bias the response and flatter its variance.
PAYS = 2.0
# Prediction is judged at every fourth line (neighbouring windows share most lines), averaged over +-20 lines.
JUDGED = 4
AVERAGED = 20
# Amplitude on the weaker side of a line, of the strongest within half a window, below which the line lies
# beyond an edge of the drive: of noise no line has less, leakage from the third line beyond on. It falls with
# the cube of the distance, and REACH halves out it is fainter than FAINTEST.
EDGE, REACH = 0.01, 4
# Amplitude of the inputs about a line that no transient has, as a share of all and of that of TYPICAL lines
# (a quantile), below which the ends of the band may say nothing: a sweep is there when a record begins and
# ends, and turns from line to line no more than a motion that decays. Of noise, one line in 1e8 has so
# little. A sweep that is followed by rest has little of it, and is estimated well: lost are lines whose
# deviation is this share of the largest response.
SMOOTH, TYPICAL, LOST = 0.2, 0.9, 0.1
# Of the models that predict as well within a factor, those that are further apart than so many deviations
# add the square of their distance to the variance: they are no narrower than half the window, or none that
# the method takes. Prediction of the outputs says less about the response where the inputs turn evenly from
# line to line, as sweeps do and no noise: there fewer deviations count. EVENLY is the length of the mean of
# the second turns, each of length one, over the lines that prediction is averaged over (of noise 0.16, of
# sweeps 0.9).
AS_WELL, APART, EVENLY, APART_EVENLY = 2.5, 3.0, 0.6, 1.5


def scatter_of_local_models(
    record: Record | RecordStream,
    band_hz: tuple[float, float] | None,
    *,
    rational: bool,
    excited: Bool[np.ndarray, " line"] | None = None,
) -> ResponseScatter:
    """The response at all lines that are excited, each from the local model that predicts best there.

    ``excited`` marks the lines of a period; those of other records are found. Only the lines of the band are
    held of a stream (`zoomed_lines`).
    """
    experiments, inputs, stride = _shape(record)
    polynomials = _models(ROWS_POLYNOMIAL, experiments, inputs, stride, rational=False)
    rationals = _models(ROWS_RATIONAL, experiments, inputs, stride, rational=True)
    narrowest, widest = polynomials[0], max(m.half for m in (*polynomials, *rationals))
    U, Y, numbers, step_hz = (
        _spectra(record) if isinstance(record, Record) else _band_spectra(record, band_hz, widest)
    )
    frequency = numbers * step_hz
    if 2 * narrowest.half + 1 > len(U):
        raise DataError(
            f"{len(U)} lines are too few for a local model of {2 * narrowest.half + 1}",
            hint="a longer record, or whole steady periods of a repeated signal",
        )
    wanted = in_band(np.concatenate([[0.0, step_hz], frequency, [np.inf]]), band_hz)[2:-1]
    wanted &= numbers % stride == 0
    if excited is not None:
        # Line k of a period is line k stride of all periods together.
        wanted &= excited[numbers // stride]
    lines = np.flatnonzero(wanted)
    if excited is None:
        # Whole periods have no leakage.
        lines = lines[_between_driven(U, lines, narrowest.half)]
    excited, share = _excited(U, lines, narrowest.half, frequency, band_hz)
    told, lines = _between_ends(share)[excited], lines[excited]
    models = [m for m in (*polynomials, *rationals) if 2 * m.half + 1 <= len(U)]
    # In units of each channel's largest line, so that no sum of squares leaves the range of numbers.
    sizes = by_input, by_output = np.abs(U).max(axis=(0, 1)), np.abs(Y).max(axis=(0, 1))
    scaled = U / by_input, Y / by_output
    evenly = _turn_evenly(U, stride)[lines]
    choice, apart = _choice(*scaled, lines, models, np.where(evenly, APART_EVENLY, APART), rational=rational)
    found = _by_choice(*scaled, frequency, lines, models, choice)
    assert found.total is not None
    found = dataclasses.replace(found, total=found.total + apart)
    return _in_units(_some_lines(found, _without_lost_ends(found, told)), *sizes, stride)


Lines = tuple[np.ndarray, np.ndarray, Int[np.ndarray, " line"], float]


def _shape(record: Record | RecordStream) -> tuple[int, int, int]:
    """Experiments, inputs, and of how many lines of the whole record one is excited."""
    if isinstance(record, Record):
        experiments, periods = record.u.shape[:2]
        return experiments, record.u.shape[3], periods if record.periodic else 1
    periods = record.samples // record.period if record.period else 1
    return record.experiments, len(record.inputs), periods


def _spectra(record: Record) -> Lines:
    """Spectra of all samples of each experiment without zero and Nyquist, and their numbers."""
    experiments, periods, samples, _ = record.u.shape
    total = periods * samples
    U, Y = (
        np.fft.rfft(x.reshape(experiments, total, -1), axis=1).transpose(1, 0, 2)[1 : (total + 1) // 2]
        for x in (record.u, record.y)
    )
    return U, Y, np.arange(1, (total + 1) // 2), 1.0 / (total * (1.0 / record.sample_hz))


def _band_spectra(stream: RecordStream, band_hz: tuple[float, float] | None, margin: int) -> Lines:
    """The same of a band, and of as many lines on each side as the windows at its edges take."""
    last = (stream.samples + 1) // 2 - 1
    low, high = (0.0, np.inf) if band_hz is None else band_hz
    step_hz = 1.0 / (stream.samples * (1.0 / stream.sample_hz))
    first = int(np.clip(np.floor(low / step_hz) - margin, 1, max(last, 1)))
    end = int(np.clip(np.ceil(min(high, stream.sample_hz) / step_hz) + margin, first, max(last, 1)))
    z = zoomed_lines(stream, first, end + 1 - first)
    inputs = len(stream.inputs)
    return z[:, :, :inputs], z[:, :, inputs:], np.arange(first, end + 1), step_hz


def _models(
    rows: tuple[float, ...], experiments: int, inputs: int, stride: int, *, rational: bool
) -> list[local_fit.LocalModel]:
    needed = local_fit.unknowns(experiments, inputs) / experiments
    return [local_fit.LocalModel(int(np.ceil(0.5 * share * needed)) * stride, rational) for share in rows]


def _excited(
    U: np.ndarray, lines: np.ndarray, half: int, frequency: np.ndarray, band_hz: tuple[float, float] | None
) -> tuple[Bool[np.ndarray, " line"], Float[np.ndarray, " line"]]:
    """Lines where the inputs do more than a transient could, and the share of their power that none has.

    Refuses inputs that are alike there.
    """
    refuse_silence(np.ones(len(lines), dtype=bool), band_hz)
    rows, own, x = local_fit.window_rows(len(U), lines, half)
    Q = local_fit.transient_basis(x, own, None)
    window = np.moveaxis(U[rows], 1, 3)
    rough = local_fit.beside(Q, window.reshape(len(lines), -1, 2 * half + 1)).reshape(window.shape)
    power = np.linalg.eigvalsh(np.sum(rough @ rough.conj().mT, axis=1))
    raw = np.convolve(np.sum(np.abs(U) ** 2, axis=(1, 2)), np.ones(2 * half + 1), mode="valid")
    excited = power[:, -1] > FAINTEST**2 * raw.max()
    whole = np.sum(np.abs(window) ** 2, axis=(1, 2, 3))
    share = np.sum(np.abs(rough) ** 2, axis=(1, 2, 3)) / np.where(whole > 0.0, whole, 1.0)
    if not excited.any():
        raise DataError(
            "the inputs' spectra are as smooth as a transient: no local model can tell the two apart",
            hint="random or repeated excitation; a blow from rest to rest is one whole period of a periodic "
            "record",
        )
    refuse_alike(excited & (power[:, 0] * WORST_CONDITION**2 <= power[:, -1]), frequency[lines])
    return excited, share


def _between_ends(share: Float[np.ndarray, " line"]) -> Bool[np.ndarray, " line"]:
    """Lines from the first to the last with enough of the ``share`` of the inputs that no transient has."""
    told = np.flatnonzero(share >= SMOOTH**2 * np.quantile(share, TYPICAL))
    return _between(told, len(share))


def _turn_evenly(U: Complex[np.ndarray, "line experiment input"], stride: int) -> Bool[np.ndarray, " line"]:
    """Lines about which the inputs turn by much the same more from each excited line to the next."""
    turn = U[stride:] * U[:-stride].conj()
    bend = turn[stride:] * turn[:-stride].conj()
    unit = bend / np.maximum(np.abs(bend), np.finfo(float).tiny)
    unit = np.concatenate([unit[:1].repeat(stride, 0), unit, unit[-1:].repeat(stride, 0)])
    parts = unit.reshape(len(unit), -1)
    mean = np.hypot(*(uniform_filter1d(x, 2 * AVERAGED + 1, axis=0) for x in (parts.real, parts.imag)))
    return np.all(mean > EVENLY, axis=1)


def _between(places: np.ndarray, count: int) -> Bool[np.ndarray, " line"]:
    line = np.arange(count)
    return (line >= places[0]) & (line <= places[-1])


def _without_lost_ends(found: ResponseScatter, told: Bool[np.ndarray, " line"]) -> Bool[np.ndarray, " line"]:
    """Lines but for the smooth ends of the band, as far in as a line of theirs is lost for every output."""
    assert found.total is not None
    if told.all() or not told.any():
        return np.ones(len(told), dtype=bool)
    largest = np.abs(found.H[told]).max(axis=0)
    lost = np.all(np.any(found.total > (LOST * largest) ** 2, axis=2), axis=1) & ~told
    first, last = np.flatnonzero(told)[[0, -1]]
    place = np.arange(len(told))
    low, high = np.flatnonzero(lost & (place < first)), np.flatnonzero(lost & (place > last))
    return (place > low.max(initial=-1)) & (place < high.min(initial=len(told)))


def _some_lines(found: ResponseScatter, kept: Bool[np.ndarray, " line"]) -> ResponseScatter:
    fields = ((field.name, getattr(found, field.name)) for field in dataclasses.fields(found))
    return dataclasses.replace(found, **{name: x[kept] for name, x in fields if isinstance(x, np.ndarray)})


def _between_driven(U: np.ndarray, lines: np.ndarray, half: int) -> Bool[np.ndarray, " line"]:
    """Whether the inputs drive lines on both sides of each line; the line itself counts with either side.

    A window that is driven on one side only does not determine the response in its middle.
    """
    # What leaks into a band may stand beyond it.
    places = np.union1d(lines, np.arange(0, len(U), half))
    sides: list[np.ndarray] = []
    for start in (places - half, places):
        first = np.clip(start, 0, len(U) - half - 1)
        rows = first[:, None] + np.arange(half + 1)
        Q = local_fit.transient_basis((rows - places[:, None]) / half, places - first, None)
        window = np.moveaxis(U[rows], 1, 3).reshape(len(places), -1, half + 1)
        sides.append(np.sum(np.abs(local_fit.beside(Q, window)) ** 2, axis=(1, 2)))
    weaker, stronger = np.zeros(len(U)), np.zeros(len(U))
    weaker[places], stronger[places] = np.minimum(*sides), np.maximum(*sides)
    leaked = [maximum_filter1d(stronger, 2 * halves * half + 1) / halves**6 for halves in range(1, REACH + 1)]
    return weaker[lines] > EDGE**2 * np.max(leaked, axis=0)[lines]


def _choice(
    U: np.ndarray,
    Y: np.ndarray,
    lines: Int[np.ndarray, " estimate"],
    models: list[local_fit.LocalModel],
    apart: Float[np.ndarray, " estimate"],
    *,
    rational: bool,
) -> tuple[Int[np.ndarray, " estimate"], Float[np.ndarray, "estimate output input"]]:
    """Index of the model that predicts best around each line, and the variance that the others add.

    Models that predict as well and differ by more than ``apart`` deviations add to it. All outputs count by
    the factor of their error. Without ``rational``, models with a denominator are not chosen, but show by how
    much polynomials flatten a resonance.
    """
    judged = lines[::JUDGED]
    width = 2 * AVERAGED + 1
    scores: list[np.ndarray] = []
    told: list[tuple[np.ndarray, np.ndarray]] = []
    for model in models:
        fit = local_fit.fit_windows(U, Y, judged, model)
        average = _moving_mean(fit.prediction, -(-width // (2 * JUDGED)))
        scores.append(np.mean(np.log(average + np.finfo(float).tiny), axis=1))
        told.append((fit.H, fit.variance))
    pays = np.log(PAYS) if rational else np.inf
    penalty = np.array([pays if m.rational else 0.0 for m in models])
    best = np.argmin(np.array(scores) + penalty[:, None], axis=0)
    wide = np.array([2 * m.half for m in models])[:, None] >= np.array([m.half for m in models])[best]
    wide |= np.isinf(penalty)[:, None]
    as_well = (np.array(scores) < np.min(scores, axis=0) + np.log(AS_WELL)) & wide
    more = _apart(told, as_well, best, apart[::JUDGED])
    place = np.minimum((np.arange(len(lines)) + JUDGED // 2) // JUDGED, len(judged) - 1)
    return best[place], more[place]


def _apart(
    told: list[tuple[np.ndarray, np.ndarray]],
    as_well: Bool[np.ndarray, "model line"],
    best: Int[np.ndarray, " line"],
    apart: Float[np.ndarray, " line"],
) -> Float[np.ndarray, "line output input"]:
    """Largest square of the distance to a model that predicts as well, less what its deviation allows."""
    H, variance = (np.array(x) for x in zip(*told, strict=True))
    off = np.abs(H - H[best, np.arange(len(best))]) ** 2 - apart[:, None, None] ** 2 * variance
    return np.max(np.where(as_well[:, :, None, None], off, 0.0), axis=0, initial=0.0)


def _moving_mean(x: Float[np.ndarray, "line output"], half: int) -> Float[np.ndarray, "line output"]:
    """Mean over at most ``half`` lines on each side; positive sums only, so that none cancels."""
    total = np.zeros_like(x)
    count = np.zeros((len(x), 1))
    for shift in range(-min(half, len(x) - 1), min(half, len(x) - 1) + 1):
        into = slice(max(0, -shift), len(x) - max(0, shift))
        total[into] += x[max(0, shift) : len(x) - max(0, -shift)]
        count[into] += 1.0
    return total / count


def _in_units(
    found: ResponseScatter,
    by_input: Float[np.ndarray, " input"],
    by_output: Float[np.ndarray, " output"],
    stride: int,
) -> ResponseScatter:
    assert found.total is not None
    assert found.total_covariance is not None
    assert found.line_inverse_power is not None
    gain = by_output[:, None] / by_input
    return dataclasses.replace(
        found,
        H=found.H * gain,
        total=found.total * gain**2,
        total_covariance=found.total_covariance * np.outer(by_output, by_output),
        inverse_power=found.inverse_power / np.outer(by_input, by_input),
        # Only every stride-th line of a window is excited: their mean power is larger by that factor.
        line_inverse_power=found.line_inverse_power / (stride * np.outer(by_input, by_input)),
    )


def _by_choice(
    U: Complex[np.ndarray, "line experiment input"],
    Y: Complex[np.ndarray, "line experiment output"],
    frequency: np.ndarray,
    lines: np.ndarray,
    models: list[local_fit.LocalModel],
    choice: np.ndarray,
) -> ResponseScatter:
    experiments, inputs = U.shape[1:]
    outputs = Y.shape[2]
    H = np.empty((len(lines), outputs, inputs), dtype=complex)
    total = np.empty((len(lines), outputs, inputs))
    dof = np.empty(len(lines))
    covariance = np.empty((len(lines), outputs, outputs), dtype=complex)
    inverse_power, of_line = np.empty((2, len(lines), inputs, inputs), dtype=complex)
    taken = [int(k) for k in np.unique(choice)]
    kinds = {
        k: local_fit.both_kinds(U, Y, lines[choice == k], models[k]) for k in taken if models[k].rational
    }
    odds = local_fit.odds_of_forces(kinds.values())
    for k in taken:
        here = choice == k
        found = kinds[k].likelier(odds) if k in kinds else local_fit.fit_windows(U, Y, lines[here], models[k])
        H[here], total[here] = found.H, found.variance
        covariance[here], inverse_power[here] = found.covariance, found.inverse_power
        of_line[here] = found.line_inverse_power
        dof[here] = local_fit.freedom(models[k], experiments, inputs, outputs)
    return ResponseScatter(
        frequency_hz=frequency[lines],
        H=H,
        total=total,
        total_dof=dof,
        total_covariance=covariance,
        inverse_power=inverse_power,
        line_inverse_power=of_line,
    )
