"""Records of loops with sliders by their lines, half a step off zero: the samples repeat with the other sign.

What noise and the sliders' held torques make of the performance is found on the lines of the plan's band: in
time no output is needed but the joints' angles.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.joints.sliding_loops import held_gain
from middeck.updating.promise.slip_loops import LINES_AT_ONCE, SlipPoles
from middeck.updating.promise.slip_time import SlipTime


def sample_lines(
    time: SlipTime, lines: slice, amplitude: Complex[np.ndarray, "output line"]
) -> Float[np.ndarray, "output sample"]:
    """Samples of a record that has ``amplitude`` on its ``lines``, zero on others."""
    spectrum = np.zeros((len(amplitude), time.samples), dtype=complex)
    spectrum[:, lines] = amplitude
    return np.real(np.conj(_half_turns(time.samples)) * np.fft.ifft(spectrum, norm="forward"))


def mean_squares(
    time: SlipTime,
    lines: slice,
    form: SlipPoles,
    free: Complex[np.ndarray, "output record line"],
    torque: Float[np.ndarray, "record joint sample"],
    ends: Complex[np.ndarray, "record pole"],
) -> Float[np.ndarray, "2 record"]:
    """Mean square of all outputs together on ``lines``, with friction, then without.

    Held torques m move the state x of a pole by x' = g x + b m. On these lines z^samples = -1, and the sum of
    x' z^-k over the record is (b m(z) + g ``ends``)/(1 - g/z).

    Args:
        form: The loop's poles; its reads have no row but those of the outputs.
        free: Amplitudes without friction, on the first of the lines; zero on the others.
        ends: State before the record and that behind it, summed.
    """
    samples, joints = time.samples, len(form.drives)
    number, half = np.arange(samples)[lines], _half_turns(samples)
    moved = np.empty((*torque.shape[:2], len(number)), dtype=complex)
    for found, held in zip(moved, torque, strict=True):
        found[:] = np.fft.fft(half * held, norm="forward")[:, lines]
    grown = np.exp(form.poles / time.sample_hz)
    given = np.concatenate([held_gain(form.poles, form.drives, 1.0 / time.sample_hz), grown * ends / samples])
    reads = 0.5 * form.reads[:, None] * given
    # The real part, by each pole and its conjugate.
    reads, grown = (np.concatenate([x, np.conj(x)], axis=-1) for x in (reads, grown))
    # Each line counts for its conjugate too; the last of an odd number of samples is its own.
    times = np.where(2 * number + 1 == samples, 1.0, 2.0)
    square = np.zeros(len(torque))
    for first in range(0, len(number), LINES_AT_ONCE):
        piece = slice(first, first + LINES_AT_ONCE)
        back = np.exp(-2j * np.pi * (number[piece] + 0.5) / samples)
        answer = reads @ (1.0 / (1.0 - grown[:, None] * back))
        made = -answer[:, joints:] - np.einsum("ojl,rjl->orl", answer[:, :joints], moved[:, :, piece])
        own = free[:, :, piece]
        made[:, :, : own.shape[2]] += 0.5 * own
        square += np.sum(np.abs(made) ** 2 * times[piece], axis=(0, 2))
    return np.array([square, 0.5 * np.sum(np.abs(free) ** 2, axis=(0, 2))])


def _half_turns(samples: int) -> Complex[np.ndarray, " sample"]:
    return np.exp(-1j * np.pi * np.arange(samples) / samples)
