"""The response of an impact test: blows windowed, averaged, with their coherence.

The force window leaves the pulse and takes out the noise of the rest. The exponential window exp(-t / tau),
on force and response alike, makes a response that rings beyond its block end within it. It multiplies both
signals by the same, so that the windowed response is H(s + 1 / tau), exactly: every pole is moved by
-1 / tau, and can be moved back (`without_window`; Fladung and Rost 1997; Ewins 2000, section 3.7).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Bool, Complex, Float

from middeck.errors import DataError
from middeck.identification.impact.before_blows import before_blows
from middeck.identification.impact.blows import BEFORE, Blow, locate_blows
from middeck.identification.impact.coupled_force import SLOPE, released_force
from middeck.identification.spectra.averages import Spectra
from middeck.identification.spectra.coherence import ordinary_coherence
from middeck.identification.spectra.h1_h2_hv import spectra_response
from middeck.identification.spectra.variance_of_lines import ResponseScatter, trusted
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record as frozen

# Share of the response's first rms that the window leaves of it at the end: at most, and over the relative
# deviation of a peak, as no scatter shows what is cut off alike in all blows. Lines of a peak, over its top.
END, END_OF_NOISE, PEAK = 1e-3, 0.05, 0.5
# Lines are of use down to this share of the force's largest power (20 dB).
USEFUL = 0.01
# Parts of a record, of which the quietest tells the level at rest; parts of the force at rest that are kept.
PARTS, KEPT = 16, 64
# Batches of the quietest part, whose means tell the variance of its level.
BATCHES = 8
# Coherence below which a line is reported.
INCOHERENT = 0.9


@frozen(kw_only=True)
class ImpactTest:
    """Averaged response of an impact test.

    Attributes:
        response: Response of the windowed signals, H(s + 1/window_s), with its variance over blows.
        coherence: Share of the response explained by the force at each line and output, over the good
            blows.
        blocks: The good blows under the force window alone, each an experiment.
        before: Outputs before the ``led`` blocks, for a fit of samples.
        led: The blocks that have something before them; the others are of blows that came as a record began.
        rest: Force where nothing struck, as long under the window of a blow: noise as it is in blocks.
        window_s: Time constant tau of the exponential window [s]; infinite without.
        blows: All blows, the rejected ones with the reason.
        warnings: Warnings in words; empty for none.
    """

    response: FrequencyResponse
    coherence: Float[np.ndarray, "line output"]
    blocks: Record
    before: Float[np.ndarray, "led lead output"]
    led: tuple[int, ...]
    rest: Float[np.ndarray, "part sample"]
    window_s: float
    blows: tuple[Blow, ...]
    warnings: tuple[str, ...]


def average_blows(
    record: Record,
    *,
    ratio: Literal["h1", "h2"] = "h1",
    window_s: float | None = None,
    band_hz: tuple[float, float] | None = None,
    blow_s: float | None = None,
) -> ImpactTest:
    """The averaged response to the good blows of a record, each in a block of its own.

    Args:
        record: One input, the force; one or several experiments, of one blow or several each.
        ratio: "h1" where the responses are noisy, "h2" where the force is (and at resonances).
        window_s: Time constant of the exponential window [s]; infinity for none. By default the longest that
            leaves a thousandth of the response at the end of a block, and less than noise makes of its
            peaks, none where it has decayed so far.
        band_hz: Lines to keep; by default up to where the force falls 20 dB below its largest power.
        blow_s: As of `locate_blows`.

    Raises `ConfigError` if the record has several inputs, or is periodic; `DataError` if fewer than two good
    blows are left.
    """
    blows = locate_blows(record, blow_s=blow_s)
    record, tau_s = _released(record, blows)
    good = [b for b in blows if not b.rejected]
    if len(good) < 2:
        reasons = "; ".join(dict.fromkeys(b.rejected for b in blows if b.rejected)) or "one blow"
        raise DataError(
            f"{len(good)} of {len(blows)} blows are good, two are needed: {reasons}",
            hint="strike again, once a block, at rest; fit_record takes a record of any blows as it is",
        )
    size = min(b.last - b.first for b in good)
    u, y = (x.reshape(len(x), -1, x.shape[3]) for x in (record.u, record.y))
    struck = [(u[b.experiment, b.first : b.first + size, 0], _force_window(size, b)) for b in good]
    force = np.stack([(x - np.median(x)) * window for x, window in struck])
    levels = [_at_rest(x)[0] for x in y]
    doubt = np.max([_at_rest(x)[1] for x in y], axis=0)
    y = y - np.array(levels)[:, None]
    answer = np.stack([y[b.experiment, b.first : b.first + size] for b in good])
    blocks = Record(
        sample_hz=record.sample_hz,
        u=force[:, None, :, None],
        y=answer[:, None],
        inputs=record.inputs,
        outputs=record.outputs,
        periodic=False,
        held=record.held,
    )
    tau = _time_constant(blocks, END) if window_s is None else window_s
    spectra = _spectra(blocks, tau)
    band_hz = _useful(spectra) if band_hz is None else band_hz
    found = spectra_response(spectra, ratio, band_hz=band_hz)
    if window_s is None:
        tau = _time_constant(blocks, min(END, END_OF_NOISE * _noise_of_peaks(found)))
        spectra = _spectra(blocks, tau)
        found = spectra_response(spectra, ratio, band_hz=band_hz)
    kept = np.isin(spectra.frequency_hz, found.frequency_hz)
    scatter = _with_level(_by_each_blow(found, blocks, kept, tau), blocks, kept, tau, doubt)
    variance, covariance = trusted(scatter)
    response = FrequencyResponse(
        frequency_hz=found.frequency_hz,
        H=found.H,
        inputs=record.inputs,
        outputs=record.outputs,
        variance=variance,
        covariance=covariance,
        alike=lines_alike(size, record.sample_hz, tau),
    )
    coherence = ordinary_coherence(spectra)[kept, :, 0]
    before, led = before_blows(y, good, blows, size)
    return ImpactTest(
        response=response,
        coherence=coherence,
        blocks=blocks,
        before=before,
        led=led,
        rest=_at_rest_under(struck, -(-KEPT // len(good)) * len(good)),
        window_s=float(tau),
        blows=blows,
        warnings=(
            *_warnings(record, coherence, blows),
            *_of_leads(record, [b for k, b in enumerate(good) if k not in led]),
            *_of_coupling(record, tau_s),
        ),
    )


def _released(record: Record, blows: Sequence[Blow]) -> tuple[Record, float]:
    """The record with the force before an AC-coupled sensor, and the sensor's time constant [s]."""
    found = released_force(record.u.reshape(len(record.u), -1), blows, record.sample_hz)
    return dataclasses.replace(record, u=found.force.reshape(record.u.shape)), found.tau_s


def _of_leads(record: Record, bare: Sequence[Blow]) -> list[str]:
    if not bare:
        return []
    at = ", ".join(f"{b.struck / record.sample_hz:.4g} s" for b in bare)
    return [
        f"struck too soon to tell their response from free motion before it: blows at {at}; a fit of samples "
        "leaves them out, the average does not; record longer before a blow"
    ]


def _of_coupling(record: Record, tau_s: float) -> list[str]:
    if np.isinf(tau_s):
        return []
    return [
        f"input {record.inputs[0].name}: AC-coupled, as ICP (IEPE) sensors and charge amplifiers are: after "
        f"each blow it reads less than nothing, with a time constant of {tau_s:.3g} s; this was taken out. "
        "Compare it with the data sheet; responses with such sensors are not corrected"
    ]


def _force_window(size: int, blow: Blow) -> Float[np.ndarray, " sample"]:
    """One for the pulse and as much again, or to the last push, a slope of half a cosine, then zero."""
    last = min(max(2 * blow.pulse_end - blow.struck, blow.force_end), blow.last) - blow.first + SLOPE
    slope = 0.5 * (1.0 + np.cos(np.pi * np.arange(1, SLOPE + 1) / (SLOPE + 1)))
    return np.concatenate([np.ones(last), slope, np.zeros(max(size - last - SLOPE, 0))])[:size]


def _at_rest_under(
    struck: Sequence[tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]]], most: int
) -> Float[np.ndarray, "part sample"]:
    """The force after the blows, in parts as long as the window of each in turn, under it.

    Rest shorter than a window is joined, and used again: blocks that have none of a window's length have as
    much noise of the force as others.
    """
    rest = np.concatenate([(x - np.median(x))[np.flatnonzero(window)[-1] + 1 :] for x, window in struck])
    if not len(rest):
        return np.zeros((0, len(struck[0][0])))
    longest = max(int(np.count_nonzero(window)) for _, window in struck)
    count = min(max(len(rest) // longest, 1), most)
    parts = np.resize(rest, (count, longest))
    windows = np.stack([struck[k % len(struck)][1] for k in range(count)])
    found = np.zeros(windows.shape)
    found[:, :longest] = parts * windows[:, :longest]
    return found


def _at_rest(
    x: Float[np.ndarray, "sample channel"],
) -> tuple[Float[np.ndarray, " channel"], Float[np.ndarray, " channel"]]:
    """Level of each channel where it moves least, and the variance of that, by means of batches.

    What rings within a batch hardly moves its mean; ringing that is left makes the variance too large, not
    too small.
    """
    parts = np.array_split(x, PARTS)
    least = np.argmin([p.var(axis=0) for p in parts], axis=0)
    found = [parts[k][:, c] for c, k in enumerate(least)]
    batches = [np.array([b.mean() for b in np.array_split(p, min(BATCHES, len(p)))]) for p in found]
    return np.array([p.mean() for p in found]), np.array([b.var() / max(len(b) - 1, 1) for b in batches])


def _time_constant(blocks: Record, end: float) -> float:
    """The longest that leaves the share ``end`` of the response at the end of a block [s]."""
    answer, size = blocks.y, blocks.y.shape[2]
    part = max(size // 8, 1)
    early, late = (
        np.sqrt(np.mean(x**2, axis=(0, 1, 2))) for x in (answer[:, :, :part], answer[:, :, -part:])
    )
    left = float(np.max(late / early))
    return np.inf if left <= end else size / blocks.sample_hz / np.log(left / end)


def _noise_of_peaks(found: ResponseScatter) -> float:
    """Relative deviation of the response at its highest peak, of the output that has least."""
    assert found.total is not None  # blows are averages
    size = np.abs(found.H)
    peak = size >= PEAK * size.max(axis=0)
    return float(np.sqrt(np.min(np.mean(found.total, axis=0, where=peak) / np.max(size**2, axis=0))))


def windowed_spectra(
    x: Float[np.ndarray, "block sample channel"], sample_hz: float, window_s: float
) -> Complex[np.ndarray, "block line channel"]:
    """Spectra of each block under exp(-t / window_s)."""
    return np.fft.rfft(x * exponential_window(x.shape[1], sample_hz, window_s)[:, None], axis=1)


def exponential_window(size: int, sample_hz: float, window_s: float) -> Float[np.ndarray, " sample"]:
    """The exponential window, one where the pulse begins."""
    return np.exp(-(np.arange(size) - BEFORE) / (sample_hz * window_s))


def lines_alike(size: int, sample_hz: float, window_s: float) -> float:
    """Number of lines of white noise under the window that count as one independent line.

    Two lines correlate as the Fourier transform of the window's square, at their distance: the sum of its
    squared size, by Parseval's theorem, is that of the window's fourth power.
    """
    power = exponential_window(size, sample_hz, window_s) ** 2
    return float(size * np.sum(power**2) / np.sum(power) ** 2)


def _spectra(blocks: Record, window_s: float) -> Spectra:
    U, Y = (windowed_spectra(x[:, 0], blocks.sample_hz, window_s) for x in (blocks.u, blocks.y))
    count, size = len(U), blocks.u.shape[2]
    scale = 1.0 / (count * size * blocks.sample_hz)
    return Spectra(
        frequency_hz=np.fft.rfftfreq(size, 1.0 / blocks.sample_hz),
        S_uu=scale * np.einsum("eki,ekj->kij", U, U.conj()),
        S_yu=scale * np.einsum("eko,eki->koi", Y, U.conj()),
        S_yy=scale * np.einsum("eko,ekp->kop", Y, Y.conj()),
        inputs=blocks.inputs,
        outputs=blocks.outputs,
        averages=float(count),
        window_hz=0.0,
    )


def _by_each_blow(
    found: ResponseScatter, blocks: Record, kept: Bool[np.ndarray, " line"], window_s: float
) -> ResponseScatter:
    """The scatter with the variance from each blow's residual and leverage: blows may differ in noise.

    Of n alike blows the same as what all leave over n - 1 (MacKinnon and White 1985, HC2).
    """
    U, Y = (windowed_spectra(x[:, 0], blocks.sample_hz, window_s)[:, kept] for x in (blocks.u, blocks.y))
    share = np.abs(U) ** 2 / np.sum(np.abs(U) ** 2, axis=0)
    left = np.abs(Y - found.H[:, :, 0] * U) ** 2
    own = np.sum(left * share / (1.0 - share), axis=0)
    times = own * (len(U) - 1.0) / np.sum(left, axis=0)
    more = np.sqrt(times)
    assert found.total is not None  # blows are averages
    assert found.total_covariance is not None
    return dataclasses.replace(
        found,
        total=found.total * times[:, :, None],
        total_covariance=found.total_covariance * more[:, :, None] * more[:, None, :],
    )


def _with_level(
    found: ResponseScatter,
    blocks: Record,
    kept: Bool[np.ndarray, " line"],
    window_s: float,
    level: Float[np.ndarray, " output"],
) -> ResponseScatter:
    """The scatter with what the variance of a ``level`` adds: all blows have it, so that none shows it."""
    U = windowed_spectra(blocks.u[:, 0], blocks.sample_hz, window_s)[:, kept, 0]
    ones = windowed_spectra(np.ones((1, blocks.u.shape[2], 1)), blocks.sample_hz, window_s)[0, kept]
    by = ones[:, 0] * np.sum(U.conj(), axis=0) / np.sum(np.abs(U) ** 2, axis=0)
    more = (np.abs(by)[:, None] ** 2 * level)[:, :, None]
    assert found.total is not None  # blows are averages
    assert found.total_covariance is not None
    # That of the outputs' noise, of which the response has as much as the inputs' power leaves.
    of_noise = more / np.real(found.inverse_power)
    return dataclasses.replace(
        found,
        total=found.total + more,
        total_covariance=found.total_covariance + of_noise * np.eye(len(level)),
    )


def _useful(spectra: Spectra) -> tuple[float, float]:
    power = np.real(spectra.S_uu[:, 0, 0])[1:]
    above = power > USEFUL * power.max()
    last = len(above) if above.all() else max(int(np.argmin(above)), 2)
    return float(spectra.frequency_hz[1]), float(spectra.frequency_hz[last])


def _warnings(record: Record, coherence: np.ndarray, blows: tuple[Blow, ...]) -> list[str]:
    good = sum(not b.rejected for b in blows)
    found = [f"{len(blows) - good} of {len(blows)} blows were rejected"] if good < len(blows) else []
    still = sorted(set(range(len(record.u))) - {b.experiment for b in blows})
    if still:
        found.append(f"no blow in experiment {', '.join(map(str, still))}: its force has no peak")
    for o, port in enumerate(record.outputs):
        share = float(np.mean(coherence[:, o] < INCOHERENT))
        if share > 0.5:
            found.append(
                f"output {port.name}: the coherence is below {INCOHERENT} on {share:.0%} of the lines: blows "
                "that differ, or noise"
            )
    return found
