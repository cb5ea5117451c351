"""Whole steady periods: no leakage, no window, and noise apart from what repeats."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.checks import Swing, check_swing, widen
from middeck.identification.spectra.lines import FAINTEST, in_band, refuse_silence, solve_lines
from middeck.identification.spectra.scatter import ResponseScatter, variance_of
from middeck.systems.record import RecordStream
from middeck.values import record as frozen

# An excited line stands 20 dB above the scatter of the periods: a measured input has noise between its lines.
CLEAR_OF_NOISE = 100.0


@frozen
class PeriodMoments:
    """Mean and scatter of the spectra z = (u, y) over the periods of each experiment.

    Parameters
    ----------
    periods:
        In each experiment.
    mean:
        Average over periods.
    scatter:
        Sum over periods and experiments of (z - mean)(z - mean)^H.
    """

    frequency_hz: Float[np.ndarray, " line"]
    periods: int
    inputs: int
    mean: Complex[np.ndarray, "line experiment channel"]
    scatter: Complex[np.ndarray, "line channel channel"]


def period_moments(stream: RecordStream, *, keep: np.ndarray | None = None) -> PeriodMoments:
    """The moments of all periods, read one by one; only the lines ``keep`` if that is given.

    Sums are updated about the running mean (Welford 1962), so that noise far below the signal is not lost.
    """
    assert stream.period is not None
    frequency = np.fft.rfftfreq(stream.period, 1.0 / stream.sample_hz)
    keep = np.ones(len(frequency), dtype=bool) if keep is None else keep
    channels = len(stream.inputs) + len(stream.outputs)
    mean = np.zeros((np.sum(keep), stream.experiments, channels), dtype=complex)
    scatter = np.zeros((np.sum(keep), channels, channels), dtype=complex)
    swing: Swing | None = None
    for e in range(stream.experiments):
        for p, (u, y) in enumerate(stream.blocks(stream.period, e)):
            z = np.concatenate([u, y], axis=1)
            swing = widen(swing, z)
            z = np.fft.rfft(z, axis=0)[keep]
            step = z - mean[:, e]
            mean[:, e] += step / (p + 1)
            if p:
                scatter += step[:, :, None] * step.conj()[:, None, :] * (p / (p + 1))
    check_swing(swing, stream)
    return PeriodMoments(frequency[keep], stream.samples // stream.period, len(stream.inputs), mean, scatter)


def scatter_of_periods(stream: RecordStream, band_hz: tuple[float, float] | None) -> ResponseScatter:
    """H = Y U^H (U U^H)^-1 of the period averages, with its noise and total variance."""
    assert stream.period is not None
    frequency = np.fft.rfftfreq(stream.period, 1.0 / stream.sample_hz)
    moments = period_moments(stream)
    excited = _excited(moments)
    keep = excited & in_band(frequency, band_hz)
    refuse_silence(keep, band_hz)
    U, Y = np.split(moments.mean[keep], [moments.inputs], axis=2)
    H, inverse_power = solve_lines(U, Y, frequency[keep])
    noise = _noise(moments, H, keep)
    experiments = U.shape[1]
    # What each experiment's average leaves beside the common response.
    left = Y - np.einsum("koi,kei->keo", H, U)
    free = experiments - moments.inputs
    total = np.einsum("keo,kep->kop", left, left.conj()) / free if free > 0 else None
    return ResponseScatter(
        frequency[keep],
        H,
        None if noise is None else variance_of(noise, inverse_power),
        None if total is None else variance_of(total, inverse_power),
        None if noise is None else np.full(len(H), float(experiments * (moments.periods - 1))),
        None if total is None else np.full(len(H), float(free)),
        noise,
        total,
        inverse_power,
    )


def _noise(moments: PeriodMoments, H: np.ndarray, keep: np.ndarray) -> np.ndarray | None:
    """Covariance of a period average of y - H u: the noise of measured inputs is in it too."""
    if moments.periods < 2:
        return None
    lines, outputs, _ = H.shape
    beside = np.concatenate([-H, np.broadcast_to(np.eye(outputs), (lines, outputs, outputs))], axis=2)
    left = beside @ moments.scatter[keep] @ np.swapaxes(beside.conj(), 1, 2)
    return left / (moments.mean.shape[1] * (moments.periods - 1) * moments.periods)


def _excited(moments: PeriodMoments) -> np.ndarray:
    power = np.sum(np.abs(moments.mean[:, :, : moments.inputs]) ** 2, axis=(1, 2))
    excited = power > FAINTEST**2 * power[1:].max()
    if moments.periods > 1:
        diagonal = np.real(np.einsum("kzz->kz", moments.scatter))[:, : moments.inputs]
        scatter = np.sum(diagonal, axis=1) / (moments.periods * (moments.periods - 1))
        excited &= power > CLEAR_OF_NOISE * scatter
    return excited
