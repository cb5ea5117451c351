"""Sines in an output that no input has: mains, their harmonics, machines nearby.

A mode narrower than a quarter of a line does not decay within the record, and may look the same.
"""

from __future__ import annotations

import numpy as np
import scipy.ndimage
from jaxtyping import Complex, Float

from middeck.identification.faults.equal_runs import FaultDraft, fault
from middeck.signals.excitation.repetition import find_repetition
from middeck.signals.ports import Port
from middeck.signals.record import Record

# Lines of a sine seen through a Hann window, and of those beside it, on each side.
LOBE, BESIDE = 4, 12
# Times the median of the lines beside it that a sine has in power. The median of noise is ln 2 of its mean:
# of a million lines of noise the largest is 20 medians.
ABOVE = 200.0
# Share of the power of its lines that is no sine of constant size. The motion of a mode changes through the
# record: of one as narrow as a line a tenth to a half is no such sine.
UNLIKE = 0.01
# A sine that loses so much of its amplitude through the record is a mode that rings, but where noise may have
# made that: four deviations, times the square root of its power over that of the lines beside it.
FALLS, CHANCE = 0.05, 24.0
# Places between two lines at which a sine is tried.
BETWEEN, STEP = np.linspace(-0.6, 0.6, 49), 1e-3
# Share of what an output has above the lines beside it that an input may have there.
DRIVEN = 0.03
# Share of the output's rms from which a sine is reported, and from which it is serious.
TOLD, SERIOUS = 0.01, 0.1
MOST = 8
FEWEST_SAMPLES = 512
# Mains are held within so much of their frequency, in any grid that a test hall is likely to be on.
MAINS_HZ, MAINS_WITHIN = (50.0, 60.0), 0.005


def find_hum(record: Record) -> list[tuple[FaultDraft, Port, int]]:
    """Sines of each output and experiment, but for harmonics of excitation that repeats."""
    inputs = record.u.reshape(len(record.u), -1, record.u.shape[3])
    samples = inputs.shape[1]
    if samples < FEWEST_SAMPLES:
        return []
    again = None if record.periodic else find_repetition(inputs)
    period = record.u.shape[2] if record.periodic else samples if again is None else again.period
    middle = np.abs(np.arange(samples // 2 + 1) % (samples / period) - 0.5 * samples / period)
    free = middle < 0.5 * samples / period - LOBE - 2 if period < samples else middle >= 0.0
    found: list[tuple[FaultDraft, Port, int]] = []
    for e, u in enumerate(inputs):
        driven = np.max([_above(np.abs(spectrum_of(x)) ** 2) for x in u.T], axis=0)
        # Lines near a harmonic are not free; the input there shows nothing of those beside.
        beside = scipy.ndimage.maximum_filter1d(np.where(free, driven, 0.0), 2 * LOBE + 1)
        for o, port in enumerate(record.outputs):
            spectrum = spectrum_of(record.y[e, ..., o].ravel())
            what = _sines(spectrum, np.where(free, beside, np.inf), record.sample_hz / samples)
            found += [] if what is None else [(what, port, e)]
    return found


def spectrum_of(x: Float[np.ndarray, " sample"]) -> Complex[np.ndarray, " line"]:
    """Through a Hann window."""
    return np.fft.rfft((x - x.mean()) * np.hanning(len(x) + 1)[:-1])


def _above(power: Float[np.ndarray, " line"]) -> Float[np.ndarray, " line"]:
    """Power over the median of the lines beside."""
    around = np.abs(np.arange(-BESIDE, BESIDE + 1)) > LOBE
    beside = scipy.ndimage.median_filter(power, footprint=around, mode="mirror")
    return power / np.maximum(beside, np.finfo(float).eps ** 2 * power.max())


def _sine(x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    """Lines of a sine ``x`` lines away, through a Hann window."""
    one = np.abs(np.abs(x) - 1.0) < 1e-9
    return np.where(one, 0.5, np.sinc(x) / np.where(one, 1.0, 1.0 - x**2))


def _unlike_and_fall(spectrum: Complex[np.ndarray, " line"], k: int) -> tuple[float, float]:
    """Share of the power around line k that the best constant sine leaves, and the sine's fall.

    The fall is its loss of amplitude from the beginning of the record to the end, relative to the mean. A
    change of frequency adds the derivative of the sine's lines in phase with them, a fall in quadrature.
    """
    lines = spectrum[k - LOBE : k + LOBE + 1] * (-1.0) ** np.arange(2 * LOBE + 1)
    x = np.arange(-LOBE, LOBE + 1) - BETWEEN[:, None]
    told = _sine(x) @ lines / np.sum(_sine(x) ** 2, axis=1)
    power = np.abs(told) ** 2 * np.sum(_sine(x) ** 2, axis=1)
    best = int(np.argmax(power))
    slope = (_sine(x[best] + STEP) - _sine(x[best] - STEP)) / (2.0 * STEP)
    fall = -2.0 * np.pi * np.imag(slope @ (lines / told[best])) / float(slope @ slope)
    return 1.0 - float(power[best] / np.sum(np.abs(lines) ** 2)), float(fall)


def _sines(
    spectrum: Complex[np.ndarray, " line"], driven: Float[np.ndarray, " line"], step_hz: float
) -> FaultDraft | None:
    power, lines = np.abs(spectrum) ** 2, np.arange(len(spectrum))
    above = _above(power)
    sine = (power == scipy.ndimage.maximum_filter1d(power, 2 * LOBE + 1)) & (above > ABOVE)
    sine &= (driven < DRIVEN * above) & (lines > BESIDE) & (lines < len(power) - BESIDE)
    places, steady = list[str](), [0.0]
    for k in np.flatnonzero(sine):
        lobe = slice(k - LOBE, k + LOBE + 1)
        share = float(np.sqrt(np.sum(power[lobe]) / np.sum(power)))
        unlike, fall = _unlike_and_fall(spectrum, int(k))
        if unlike < UNLIKE and share > TOLD and len(places) < MOST:
            hz = step_hz * float(np.sum(lines[lobe] * power[lobe]) / np.sum(power[lobe]))
            decays = fall > max(FALLS, CHANCE / np.sqrt(above[k]))
            how = f", falling by {fall:.0%} of its mean" if decays else ""
            places.append(f"{hz:.6g} Hz ({name_line(hz, step_hz)}, {share:.0%} of the rms{how})")
            steady += [] if decays else [share]
    if not places:
        return None
    return fault(
        "hum",
        f"has sines that no input makes (or modes that hardly decay in the record): {', '.join(places)}",
        "if the structure rings there by itself, nothing; else ground and shield the sensor. A fit of "
        "samples, not of a response, has the sines beside its modes",
        severity="serious" if max(steady) > SERIOUS else "note",
    )


def name_line(hz: float, deviation_hz: float) -> str:
    """Name a line after the mains and its harmonics, within half a per cent.

    >>> name_line(150.2, 0.01), name_line(43.0, 0.01), name_line(59.98, 0.01)
    ('harmonic 3 of mains 50 Hz', 'steady line', 'mains 60 Hz')
    """
    for mains in MAINS_HZ:
        order = max(round(hz / mains), 1)
        if abs(hz - order * mains) <= MAINS_WITHIN * order * mains + deviation_hz:
            return f"mains {mains:g} Hz" if order == 1 else f"harmonic {order} of mains {mains:g} Hz"
    return "steady line"
