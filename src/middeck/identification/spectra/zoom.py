"""The DFT of a whole record on the lines of a band, read block by block: exact, in the memory of those lines.

With n k = (n^2 + k^2 - (k - n)^2)/2 the lines of a block are a convolution (Bluestein 1970), and lines of all
blocks add up with the phase of each block's start. Phases are reduced modulo the record's length as integers,
so that a record of 1e9 samples loses no digits to them.
"""

from __future__ import annotations

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float, Int

from middeck.errors import DataError
from middeck.identification.model.refused_data import Swing, check_swing, widen
from middeck.signals.record import RecordStream

# Numbers that are held: 32 MB; windows and models of them take some ten times as much.
MOST = 1 << 21
SHORTEST = 1 << 12


def zoomed_lines(
    stream: RecordStream, first: int, count: int
) -> Complex[np.ndarray, "line experiment channel"]:
    """Lines ``first`` and on of the DFT of all samples of each experiment; inputs, then outputs.

    Raises `DataError` for more lines than may be held, and for a channel that is constant or not finite.

    >>> from middeck.signals.ports import Port
    >>> from middeck.signals.record import Record, stream_record
    >>> u, y = np.random.default_rng(0).standard_normal((2, 1, 1, 9000, 1))
    >>> stream = stream_record(Record(sample_hz=1.0, u=u, y=y, inputs=(Port("u", ""),), outputs=(Port("y",
    ...     ""),), periodic=False))
    >>> bool(np.allclose(zoomed_lines(stream, 700, 50)[:, 0, 0], np.fft.rfft(u[0, 0, :, 0])[700:750]))
    True
    """
    channels = len(stream.inputs) + len(stream.outputs)
    _check_size(stream, count, channels)
    block = max(count, SHORTEST)
    zoom = _Zoom(stream.samples, first, count, min(block, stream.samples))
    lines = np.zeros((count, stream.experiments, channels), dtype=complex)
    swing: Swing | None = None
    for experiment in range(stream.experiments):
        start = 0
        for u, y in stream.blocks(block, experiment):
            z = np.concatenate([u, y], axis=1)
            swing = widen(swing, z)
            lines[:, experiment] += zoom.of_block(z, start)
            start += len(z)
    check_swing(swing, stream)
    return lines


def _check_size(stream: RecordStream, count: int, channels: int) -> None:
    held = stream.experiments * channels
    if count * held <= MOST:
        return
    widest = MOST // held * stream.sample_hz / stream.samples
    raise DataError(
        f"the band has {count} lines of {held} channels and experiments, more than are held at once ({MOST})",
        hint=f"a band_hz of at most {widest:.3g} Hz at a time; or h1, which holds some segments, or periods, "
        "which hold one",
    )


class _Zoom:
    """Factors that all blocks share."""

    def __init__(self, samples: int, first: int, count: int, block: int) -> None:
        self.samples, self.lines = samples, first + np.arange(count)
        self.size = _fast_size(block + count - 1)
        n = np.arange(max(block, count))
        chirp = np.exp(-1j * np.pi * _modulo(n, n, 2 * samples) / samples)
        self.before = chirp[:block] * self._turn(n[:block], first)
        self.after = chirp[:count]
        kernel = np.zeros(self.size, dtype=complex)
        kernel[:count] = chirp[:count].conj()
        kernel[self.size - block + 1 :] = chirp[1:block][::-1].conj()
        self.kernel = np.asarray(scipy.fft.fft(kernel))[:, None]

    def of_block(
        self, z: Float[np.ndarray, "sample channel"], start: int
    ) -> Complex[np.ndarray, "line channel"]:
        turned = scipy.fft.fft(z * self.before[: len(z), None], self.size, axis=0)
        found = np.asarray(scipy.fft.ifft(turned * self.kernel, axis=0))[: len(self.lines)]
        return found * (self.after * self._turn(self.lines, start))[:, None]

    def _turn(self, n: Int[np.ndarray, " number"], times: int) -> Complex[np.ndarray, " number"]:
        return np.exp(-2j * np.pi * _modulo(n, times, self.samples) / self.samples)


def _fast_size(least: int) -> int:
    """A length of nothing but twos and one factor up to seven, for a quick transform."""
    return min(k << max(0, (-(-least // k) - 1).bit_length()) for k in (1, 3, 5, 7))


def _modulo(n: np.ndarray, times: np.ndarray | int, modulus: int) -> np.ndarray:
    """n times ``times``, as integers of 64 bits: records of up to 3e9 samples."""
    return n.astype(np.int64) * times % modulus
