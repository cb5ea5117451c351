"""Whole steady periods: no leakage, no window, and noise separated from the repeated part."""

from __future__ import annotations

import numpy as np
import scipy.ndimage
from jaxtyping import Complex, Float, Int

from middeck.identification.model.refused_data import Swing, check_swing, widen
from middeck.identification.spectra.excited_lines import FAINTEST, in_band, refuse_silence, solve_lines
from middeck.identification.spectra.start_up import StartUp
from middeck.identification.spectra.variance_of_lines import ResponseScatter, variance_of
from middeck.signals.record import RecordStream
from middeck.values import record as frozen

# An excited line stands 20 dB above the scatter of the periods: a measured input has noise between its lines.
CLEAR_OF_NOISE = 100.0
# Silent odd lines that a level of distortion is averaged over.
NEAREST = 8
# Lines sorted by power fall by 10 dB at once from the last designed one to what an actuator distorts.
CLIFF = 10.0
# Degrees of freedom of the noise where free motion was taken out of the periods.
POOLED_DOF = 12.0
# Share of an input by which its periods differ if it is a command.
DIGITS = 1e-9


@frozen(kw_only=True)
class PeriodMoments:
    """Mean and scatter of the spectra z = (u, y) over the periods of each experiment.

    Attributes:
        periods: Number of periods in each experiment.
        mean: Average over periods.
        scatter: Sum over periods and experiments of (z - mean)(z - mean)^H.
    """

    frequency_hz: Float[np.ndarray, " line"]
    periods: int
    inputs: int
    mean: Complex[np.ndarray, "line experiment channel"]
    scatter: Complex[np.ndarray, "line channel channel"]


def period_moments(stream: RecordStream) -> PeriodMoments:
    """The moments of all periods, read one by one.

    Sums are updated about the running mean (Welford 1962), so that noise far below the signal is not lost.
    """
    assert stream.period is not None
    frequency = np.fft.rfftfreq(stream.period, 1.0 / stream.sample_hz)
    channels = len(stream.inputs) + len(stream.outputs)
    mean = np.zeros((len(frequency), stream.experiments, channels), dtype=complex)
    scatter = np.zeros((len(frequency), channels, channels), dtype=complex)
    swing: Swing | None = None
    for e in range(stream.experiments):
        for p, (u, y) in enumerate(stream.blocks(stream.period, e)):
            z = np.concatenate([u, y], axis=1)
            swing = widen(swing, z)
            step = np.fft.rfft(z, axis=0) - mean[:, e]
            mean[:, e] += step / (p + 1)
            if p:
                scatter += step[:, :, None] * step.conj()[:, None, :] * (p / (p + 1))
    check_swing(swing, stream)
    return PeriodMoments(
        frequency_hz=frequency,
        periods=stream.samples // stream.period,
        inputs=len(stream.inputs),
        mean=mean,
        scatter=scatter,
    )


def scatter_of_periods(
    stream: RecordStream, band_hz: tuple[float, float] | None, started: StartUp | None = None
) -> ResponseScatter:
    """H = Y U^H (U U^H)^-1 of the period averages, with its noise and total variance.

    ``started``: what was taken out of the outputs before, and is not exactly known.
    """
    assert stream.period is not None
    frequency = np.fft.rfftfreq(stream.period, 1.0 / stream.sample_hz)
    moments = period_moments(stream)
    excited = excited_lines(moments)
    keep = excited & in_band(frequency, band_hz)
    refuse_silence(keep, band_hz)
    U, Y = np.split(moments.mean[keep], [moments.inputs], axis=2)
    H, inverse_power = solve_lines(U, Y, frequency[keep])
    noise = _noise(moments, H, keep)
    total, dof = _total(moments, H, keep)
    noise_dof = float(U.shape[1] * (moments.periods - 1))
    if started is not None and (started.what or started.unknown.any()):
        added = started.covariance(keep)
        if noise is not None:
            noise, noise_dof = _pooled(noise, noise_dof)
        noise, total = (None if x is None else x + added for x in (noise, total))
    return ResponseScatter(
        frequency_hz=frequency[keep],
        H=H,
        noise=None if noise is None else variance_of(noise, inverse_power),
        total=None if total is None else variance_of(total, inverse_power),
        noise_dof=None if noise is None else np.full(len(H), noise_dof),
        total_dof=None if total is None else np.full(len(H), float(dof)),
        noise_covariance=noise,
        total_covariance=total,
        inverse_power=inverse_power,
        commanded=_repeats(moments),
    )


def _repeats(moments: PeriodMoments) -> bool:
    """Whether all periods of each input are equal to the last digits."""
    apart = np.einsum("kcc->c", np.real(moments.scatter))[: moments.inputs]
    power = np.sum(np.abs(moments.mean[:, :, : moments.inputs]) ** 2, axis=(0, 1))
    return moments.periods > 1 and bool(np.all(apart <= DIGITS**2 * power))


def _pooled(covariance: np.ndarray, dof: float) -> tuple[np.ndarray, float]:
    """Averaged over neighbouring lines until it has some degrees of freedom.

    A motion that was fitted to few periods has followed some of their noise.
    """
    half = int(np.ceil(0.5 * (POOLED_DOF / dof - 1.0)))
    if half < 1:
        return covariance, dof
    width = 2 * half + 1
    smooth = scipy.ndimage.uniform_filter1d(covariance, width, axis=0, mode="nearest")
    return smooth, dof * width


def _noise(moments: PeriodMoments, H: np.ndarray, keep: np.ndarray) -> np.ndarray | None:
    """Covariance of a period average of y - H u: the noise of measured inputs is in it too."""
    if moments.periods < 2:
        return None
    lines, outputs, _ = H.shape
    beside = np.concatenate([-H, np.broadcast_to(np.eye(outputs), (lines, outputs, outputs))], axis=2)
    left = beside @ moments.scatter[keep] @ beside.conj().mT
    return left / (moments.mean.shape[1] * (moments.periods - 1) * moments.periods)


def _total(
    moments: PeriodMoments, H: np.ndarray, keep: np.ndarray
) -> tuple[Complex[np.ndarray, "line output output"] | None, int]:
    """Covariance of an experiment's averaged output about the response, and its degrees of freedom.

    From experiments where there are more than inputs. Otherwise from silent odd lines, where there are any:
    odd distortion and noise are as large there as on the excited lines nearby (Pintelon and Schoukens 2012,
    section 4.3.1), and even distortion misses both.
    """
    U, Y = np.split(moments.mean, [moments.inputs], axis=2)
    experiments = U.shape[1]
    free = experiments - moments.inputs
    if free > 0:
        left = Y[keep] - np.einsum("koi,kei->keo", H, U[keep])
        return np.einsum("keo,kep->kop", left, left.conj()) / free, free
    excited = designed_lines(moments)
    silent = silent_odd_lines(excited)
    if len(silent) < NEAREST:
        return None, 0
    left = silent_outputs(moments, excited, silent)
    power = np.einsum("keo,kep->kop", left, left.conj()) / experiments
    wanted = np.flatnonzero(keep)
    first = np.clip(np.searchsorted(silent, wanted) - NEAREST // 2, 0, len(silent) - NEAREST)
    return power[first[:, None] + np.arange(NEAREST)].mean(axis=1), NEAREST * experiments


def silent_odd_lines(excited: np.ndarray) -> Int[np.ndarray, " silent"]:
    """Silent odd lines between the excited ones of an odd multisine; none of any other."""
    lines = np.flatnonzero(excited)
    if not len(lines) or (lines % 2 == 0).any():
        return np.zeros(0, dtype=int)
    between = np.arange(lines[0], lines[-1] + 1, 2)
    return between[~excited[between]]


def silent_outputs(
    moments: PeriodMoments, excited: np.ndarray, lines: Int[np.ndarray, " line"]
) -> Complex[np.ndarray, "line experiment output"]:
    """Y - H U with H drawn between excited lines: an actuator's own distortion is input."""
    U, Y = np.split(moments.mean, [moments.inputs], axis=2)
    known = np.flatnonzero(excited)
    H, _ = solve_lines(U[known], Y[known], moments.frequency_hz[known])
    flat = H.reshape(len(known), -1)
    between = np.stack([np.interp(lines, known, h) for h in flat.T], axis=1)
    return Y[lines] - np.einsum("koi,kei->keo", between.reshape(len(lines), *H.shape[1:]), U[lines])


def excited_lines(moments: PeriodMoments) -> np.ndarray:
    """Whether each line is excited; in a measured input, lines of noise are not."""
    power = _input_power(moments)
    excited = power > FAINTEST**2 * power[1:].max()
    if moments.periods > 1:
        diagonal = np.real(np.linalg.diagonal(moments.scatter))[:, : moments.inputs]
        scatter = np.sum(diagonal, axis=1) / (moments.periods * (moments.periods - 1))
        excited &= power > CLEAR_OF_NOISE * scatter
    return excited


def designed_lines(moments: PeriodMoments) -> np.ndarray:
    """The excited lines that a signal was designed to have: its actuator's distortion is far below them."""
    excited = excited_lines(moments)
    power = np.where(excited, _input_power(moments), 0.0)
    falling = np.sort(power)[::-1]
    cliffs = np.flatnonzero(falling[:-1] > CLIFF * falling[1:])
    # All that is not excited is zero: there is a cliff unless all lines are excited.
    return excited if not len(cliffs) else power >= falling[cliffs[0]]


def _input_power(moments: PeriodMoments) -> Float[np.ndarray, " line"]:
    return np.sum(np.abs(moments.mean[:, :, : moments.inputs]) ** 2, axis=(1, 2))
