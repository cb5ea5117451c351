"""Averaged power and cross spectra: of windowed segments (Welch 1967), or of bare whole periods."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Complex, Float
from numpy.lib.stride_tricks import sliding_window_view

from middeck.errors import DataError
from middeck.identification.model.refused_data import Swing, check_record, check_swing, widen
from middeck.identification.spectra.variance_of_lines import ResponseScatter
from middeck.signals.ports import Port
from middeck.signals.record import Campaign, Record, RecordStream, stream_record
from middeck.values import record as frozen

# Default number of segments, of half overlap, into which a record is cut.
SEGMENTS = 16
SHORTEST = 16
# Samples read at once, or one segment where that is longer.
AT_ONCE = 1 << 15
# Half-power width, in widths of the window, below which the window makes the peak: a resonance three of them
# wide is seen 5 % too low and 12 % too wide (its decay under the autocorrelation of a Hann window).
WIDTHS_IN_PEAK = 3.0
# A peak stands this far above its own variance; noise has peaks too.
CLEAR_OF_NOISE = 25.0


@frozen(kw_only=True)
class Spectra:
    """Power and cross spectra, two-sided [unit^2/Hz].

    Attributes:
        S_uu, S_yu, S_yy: Averages of U U^H, Y U^H and Y Y^H.
        averages: Number of independent spectra; overlapping segments count for less than their number.
        window_hz: Equivalent noise bandwidth of the window [Hz]: what is narrower is smeared. Zero for whole
            periods.
    """

    frequency_hz: Float[np.ndarray, " line"]
    S_uu: Complex[np.ndarray, "line input input"]
    S_yu: Complex[np.ndarray, "line output input"]
    S_yy: Complex[np.ndarray, "line output output"]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    averages: float
    window_hz: float


def estimate_spectra(
    record: Record | RecordStream | Campaign,
    *,
    segment: int | None = None,
) -> Spectra:
    """Spectra of a record, its experiments averaged; whole periods are segments of their own, unwindowed.

    Welch's segments (Hann's window, half overlapped, the mean of each removed) are for pictures: a window of
    length T smears whatever is narrower than some 1.5/T. At 1 % damping the response is 10 to 40 % wrong near
    resonance with any usual length; that of local models, or of whole periods, is not.

    Args:
        record: Record in memory or longer than it: segments are summed as read. Records of a campaign may
            differ in length.
        segment: Samples of a segment; by default the power of two that leaves at least 16. A periodic record
            is cut into its periods, whatever this says.

    Raises `DataError` if a channel is constant or not finite, or a segment is longer than the record.

    >>> rng = np.random.default_rng(0)
    >>> u = rng.standard_normal((1, 1, 4096, 1))
    >>> S = estimate_spectra(Record(sample_hz=10.0, u=u, y=2 * u, inputs=(Port("u", "V"),),
    ...     outputs=(Port("y", "m"),), periodic=False))
    >>> len(S.frequency_hz), round(float(np.mean(S.S_uu.real)) * 10.0, 1)   # two-sided: sum S df = variance
    (129, 1.0)
    """
    streams = [checked_stream(r) for r in (record.records if isinstance(record, Campaign) else (record,))]
    first = streams[0]
    size, hop, taper = _cut(streams, segment)
    periodic = first.period is not None
    total = np.zeros((size // 2 + 1,) + 2 * (len(first.inputs) + len(first.outputs),), dtype=complex)
    segments, averages = 0, 0.0
    for stream in streams:
        more, number = _sum(stream, size, hop, taper, centred=not periodic)
        total += more
        segments += number
        each = number // stream.experiments
        averages += number if periodic else stream.experiments * _worth(each, taper, hop)
    S = total / (segments * first.sample_hz * np.sum(taper**2))
    i = len(first.inputs)
    return Spectra(
        frequency_hz=np.fft.rfftfreq(size, 1.0 / first.sample_hz),
        S_uu=S[:, :i, :i],
        S_yu=S[:, i:, :i],
        S_yy=S[:, i:, i:],
        inputs=first.inputs,
        outputs=first.outputs,
        averages=averages,
        window_hz=0.0 if periodic else float(first.sample_hz * np.sum(taper**2) / np.sum(taper) ** 2),
    )


def _cut(streams: list[RecordStream], segment: int | None) -> tuple[int, int, Float[np.ndarray, " sample"]]:
    """Samples of a segment, samples from one to the next, and the window; of periods, without one."""
    periods = {stream.period for stream in streams}
    if len(periods) > 1:
        raise DataError(
            f"the records have other periods than the first: {', '.join(map(str, periods))} samples",
            hint="records of one period, or say that none is periodic",
        )
    period = streams[0].period
    if period is not None:
        return period, period, np.ones(period)
    shortest = min(stream.samples for stream in streams)
    from scipy.signal import get_window  # a second of import that whole periods need not wait for

    size = max(SHORTEST, 2 ** int(np.log2(2 * shortest / (SEGMENTS + 1)))) if segment is None else segment
    if not SHORTEST <= size <= shortest:
        raise DataError(
            f"segments of {size} samples do not fit {shortest} samples",
            hint=f"{SHORTEST} to {shortest} samples",
        )
    return size, size // 2, np.asarray(get_window("hann", size))


def checked_stream(record: Record | RecordStream) -> RecordStream:
    """The record as a stream; one in memory is checked first."""
    if isinstance(record, RecordStream):
        return record
    check_record(record)
    return stream_record(record)


def _sum(
    stream: RecordStream, size: int, hop: int, taper: np.ndarray, *, centred: bool
) -> tuple[Complex[np.ndarray, "line channel channel"], int]:
    """Sum of z z^H over all segments, and their number."""
    channels = len(stream.inputs) + len(stream.outputs)
    total = np.zeros((size // 2 + 1, channels, channels), dtype=complex)
    number = 0
    swing: Swing | None = None
    for experiment in range(stream.experiments):
        for z in _segments(stream, experiment, size, hop):
            swing = widen(swing, z.reshape(-1, channels))
            level = z.mean(axis=1, keepdims=True) if centred else 0.0
            Z = np.fft.rfft((z - level) * taper[:, None], axis=1).transpose(1, 2, 0)
            total += Z @ Z.conj().mT
            number += len(z)
    check_swing(swing, stream)
    return total, number


def _segments(
    stream: RecordStream, experiment: int, size: int, hop: int
) -> Iterator[Float[np.ndarray, "segment sample channel"]]:
    """Some segments at a time, each ``hop`` samples after the one before."""
    held = np.empty((0, len(stream.inputs) + len(stream.outputs)))
    for u, y in stream.blocks(max(size, hop * (AT_ONCE // hop)), experiment):
        held = np.concatenate([held, np.concatenate([u, y], axis=1)])
        if len(held) >= size:
            segments = sliding_window_view(held, size, axis=0)[::hop].swapaxes(1, 2)
            yield segments
            held = held[hop * len(segments) :]


def _worth(segments: int, taper: Float[np.ndarray, " sample"], hop: int) -> float:
    """Independent averages among overlapping segments of noise (Welch 1967)."""
    power = np.sum(taper**2)
    shifts = range(1, min(segments, -(-len(taper) // hop)))
    shared = sum(
        (1.0 - m / segments) * (np.sum(taper[m * hop :] * taper[: -m * hop]) / power) ** 2 for m in shifts
    )
    return segments / (1.0 + 2.0 * float(shared))


def warnings_on_window(found: ResponseScatter, spectra: Spectra) -> list[str]:
    """Peaks of a response that are as narrow as the window it was seen through; none for whole periods.

    >>> from middeck.identification.spectra.h1_h2_hv import spectra_response
    >>> from middeck.signals.ports import Port
    >>> from middeck.signals.record import Record
    >>> from scipy.signal import lfilter
    >>> u = np.random.default_rng(0).standard_normal((1, 1, 65536, 1))
    >>> y = lfilter([1.0], [1.0, -1.9, 0.9975], u, axis=2)          # a mode 1 % of the sampling rate wide
    >>> S = estimate_spectra(Record(sample_hz=1.0, u=u, y=y, inputs=(Port("u", ""),), outputs=(Port("y",
    ...     ""),), periodic=False))
    >>> len(warnings_on_window(spectra_response(S), S))
    1
    """
    if spectra.window_hz == 0.0:
        return []
    size = np.sqrt(np.sum(np.abs(found.H) ** 2, axis=(1, 2)))
    noise = np.zeros(len(size)) if found.total is None else np.sum(found.total, axis=(1, 2))
    inner = size[1:-1]
    peaks = 1 + np.flatnonzero((inner > size[:-2]) & (inner >= size[2:]))
    return [
        f"the peak at {found.frequency_hz[k]:.4g} Hz is as narrow as the window ({spectra.window_hz:.2g} Hz):"
        " its height and damping are the window's; use longer segments or a local model"
        for k in peaks
        if size[k] ** 2 > CLEAR_OF_NOISE * noise[k]
        and _half_power_hz(found.frequency_hz, size, int(k)) < WIDTHS_IN_PEAK * spectra.window_hz
    ]


def _half_power_hz(frequency: np.ndarray, size: np.ndarray, peak: int) -> float:
    """Width at 3 dB below the peak; infinite if a side never falls so far before it rises above the peak."""
    width = 0.0
    for side in (range(peak, -1, -1), range(peak, len(size))):
        ends = [k for k in side if size[k] < size[peak] / np.sqrt(2.0) or size[k] > size[peak]]
        if not ends or size[ends[0]] > size[peak]:
            return np.inf
        width += abs(frequency[ends[0]] - frequency[peak])
    return float(width)
