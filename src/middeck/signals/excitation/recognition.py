"""The excitation of a record: kind, period, lines; and the record cut into its steady periods."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.errors import DataError
from middeck.signals.excitation.classification import name_kind
from middeck.signals.excitation.driven_band import driven_band
from middeck.signals.excitation.repetition import Repetition, blocks_of, find_repetition
from middeck.signals.excitation.signal import line_power
from middeck.signals.record import Record
from middeck.values import record

# As in the estimate of a response: 80 dB below the strongest line is not excited, nor is what stands less
# than 20 dB above the scatter of the periods.
FAINTEST = 1e-8
CLEAR_OF_NOISE = 100.0
# A period is steady when it differs from the last by no more than twice the power of what two later ones
# differ by: a transient below that is below the noise.
STEADY = 2.0


@record(kw_only=True)
class Recognised:
    """Kind and properties of an input signal.

    Attributes:
        kind: "multisine", "swept sine", "stepped sine", "binary", "noise" (repeated or not), "burst random",
            "sine" or "silence".
        what: One sentence, for a report.
        period: Samples after which the input repeats; None if it does not within the record.
        periods: Whole periods in each experiment, counted from its end; zero if it does not repeat.
        offset: Samples before the first of them.
        steady_from: First of these periods from which inputs and outputs repeat; zero where only inputs were
            given.
        scatter: Power of the input that is not repeated, as a share of what is: its sensor's noise. None
            without.
        lines: Excited lines, as multiples of the sampling rate over the period (or over the record).
        band_hz: First and last of them.
        crest_factor: Peak over rms of each input, that of the worst experiment.
        odd: Whether only odd lines are excited: the second half of each period is minus the first.
        orthogonality: Largest rms correlation over the lines between two inputs in successive experiments, as
            many as inputs; 0 is orthogonal. None for one input or fewer experiments than inputs.
    """

    kind: str
    what: str
    period: int | None
    periods: int
    offset: int
    steady_from: int
    scatter: float | None
    lines: np.ndarray
    band_hz: tuple[float, float]
    crest_factor: Float[np.ndarray, " input"]
    odd: bool
    orthogonality: float | None


def recognise_excitation(measured: Record) -> Recognised:
    """Kind, period and lines of the inputs of ``measured``, from their samples alone.

    Periods are found up to half a record, or a whole record for signals with odd lines only (`repetition`). A
    period that is no whole number of samples is not recognised. A record that is cut into periods already is
    read as the one run that it was.

    Raises `DataError` for samples that are not finite.

    >>> from middeck.signals.ports import Port
    >>> u = np.tile(np.random.default_rng(0).standard_normal(50), 3)[None, None, :, None]
    >>> run = Record(sample_hz=10.0, u=u, y=2.0 * u, inputs=(Port("u", "N"),), outputs=(Port("y", "m"),),
    ...     periodic=False)
    >>> found = recognise_excitation(run)
    >>> found.period, found.periods, found.steady_from
    (50, 3, 0)
    """
    u, y = (x.reshape(len(x), -1, x.shape[3]) for x in (measured.u, measured.y))
    if not (np.isfinite(u).all() and np.isfinite(y).all()):
        raise DataError("samples are not finite", hint="cut the record before the gap, or repair the channel")
    found = find_repetition(u)
    if found is None or found.period > u.shape[1]:
        return _not_repeated(u, measured.sample_hz)
    return _repeated(u, y, found, measured.sample_hz)


def _not_repeated(u: np.ndarray, sample_hz: float) -> Recognised:
    power = line_power(u - u.mean(axis=1, keepdims=True)).sum(axis=1)
    lines = np.flatnonzero(power > FAINTEST * power.max()) if power.any() else np.zeros(0, dtype=int)
    band = driven_band(u, sample_hz)
    kind = name_kind(u, None)
    return Recognised(
        kind=kind,
        what=f"{kind}, not repeated within the record" if kind != "silence" else "silence",
        period=None,
        periods=0,
        offset=0,
        steady_from=0,
        scatter=None,
        lines=lines,
        band_hz=band,
        crest_factor=_crest(u),
        odd=False,
        orthogonality=_orthogonality(np.fft.rfft(u, axis=1), lines),
    )


def _repeated(u: np.ndarray, y: np.ndarray, found: Repetition, sample_hz: float) -> Recognised:
    period = found.period
    blocks = blocks_of(u, period, 1)
    steady_from = _steady_from(blocks, blocks_of(y, period, 1))
    steady = blocks[:, steady_from:]
    mean = steady.mean(axis=1)
    centred = mean - mean.mean(axis=1, keepdims=True)
    power = line_power(centred).sum(axis=1)
    noise = line_power((steady - mean[:, None]).reshape(-1, period, u.shape[2])).sum(axis=1)
    lines = np.flatnonzero((power > FAINTEST * power.max()) & (power > CLEAR_OF_NOISE * np.median(noise)))
    odd = bool(len(lines)) and float(power[::2].sum()) <= max(1e-6, found.scatter) * float(power.sum())
    lines = lines[lines % 2 == 1] if odd else lines
    kind = name_kind(centred, lines, noise_rms=np.sqrt(found.scatter / steady.shape[1]))
    band = _band(lines if kind == "multisine" else _main_lines(power, lines), period, sample_hz)
    called = "signal of uneven lines" if kind == "noise" else kind
    many = "s" if blocks.shape[1] > 1 else ""
    what = f"{called}, {blocks.shape[1]} period{many} of {period} samples ({period / sample_hz:.6g} s)"
    what += f", {'odd lines' if odd else 'lines'} from {band[0]:.6g} to {band[1]:.6g} Hz"
    return Recognised(
        kind=kind,
        what=what,
        period=period,
        periods=blocks.shape[1],
        offset=u.shape[1] - blocks.shape[1] * period,
        steady_from=steady_from,
        scatter=found.scatter,
        lines=lines,
        band_hz=band,
        crest_factor=_crest(mean),
        odd=odd,
        orthogonality=_orthogonality(np.fft.rfft(centred, axis=1), lines),
    )


def cut_periods(measured: Record, found: Recognised | None = None) -> Record:
    """``measured`` as the whole steady periods that it holds, found in its own input.

    What comes before the first steady period is left out. A record that says it is periodic is returned as
    it is. Raises `DataError` if the input does not repeat.
    """
    if measured.periodic:
        return measured
    found = recognise_excitation(measured) if found is None else found
    if found.period is None:
        raise DataError(
            f"the input does not repeat: {found.what}",
            hint="excite with a periodic signal, or estimate the response from the whole record",
        )
    u, y = (
        blocks_of(x.reshape(len(x), -1, x.shape[3]), found.period, 1)[:, found.steady_from :]
        for x in (measured.u, measured.y)
    )
    return dataclasses.replace(measured, u=u, y=y, periodic=True)


def _steady_from(u: np.ndarray, y: np.ndarray) -> int:
    """First block from which all differ from the last as little as the later ones do."""
    both = np.concatenate([u, y], axis=3)
    size = np.sqrt(np.mean(both**2, axis=(0, 1, 2)))
    both = both / np.where(size > 0.0, size, 1.0)
    away = np.mean((both[:, :-1] - both[:, -1:]) ** 2, axis=(0, 2, 3))
    if len(away) < 2:  # two periods: nothing distinguishes a transient from noise
        return 0
    unsettled = np.flatnonzero(away > STEADY * away[-1] + 1e-12)
    return int(unsettled[-1]) + 1 if len(unsettled) else 0


def _main_lines(power: Float[np.ndarray, " line"], lines: np.ndarray) -> np.ndarray:
    """The lines that hold all but a hundredth of the power, half of it at each end."""
    if not len(lines):
        return lines
    reached = np.cumsum(power[lines]) / np.sum(power[lines])
    return lines[(reached >= 0.005) & (np.concatenate([[0.0], reached[:-1]]) <= 0.995)]


def _band(lines: np.ndarray, samples: int, sample_hz: float) -> tuple[float, float]:
    if not len(lines):
        return 0.0, 0.0
    return float(lines[0] * sample_hz / samples), float(lines[-1] * sample_hz / samples)


def _crest(u: np.ndarray) -> Float[np.ndarray, " input"]:
    rms = np.sqrt(np.mean(u**2, axis=1))
    return (np.abs(u).max(axis=1) / np.where(rms > 0.0, rms, np.inf)).max(axis=0)


def _orthogonality(U: np.ndarray, lines: np.ndarray) -> float | None:
    experiments, _, inputs = U.shape
    if inputs < 2 or experiments < inputs or not len(lines):
        return None
    worst = 0.0
    for first in range(0, experiments - inputs + 1, inputs):
        block = U[first : first + inputs, lines].transpose(1, 0, 2)
        gram = np.swapaxes(block.conj(), 1, 2) @ block
        size = np.sqrt(np.real(np.einsum("kii->ki", gram)))
        cross = np.abs(gram) / np.maximum(size[:, :, None] * size[:, None, :], np.finfo(float).tiny)
        each = np.sqrt(np.mean(cross**2, axis=0))
        worst = max(worst, float(np.max(each - np.diag(np.diag(each)))))
    return worst
