"""Blows whose spectrum reaches beyond half the sampling rate, where it is folded back.

A continuous fit assumes band-limited inputs; the spectrum of a blow at half the rate shows if it was not. On
a line f of the fit lies what the blow has at the rate less f, which is less: a half sine, whose force begins
at once, falls as 1/f^2, and any smoother blow falls faster. Errors of several blows have a phase in common if
the centres of all lie as far from a sample.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.identification.faults.equal_runs import runs_of
from middeck.identification.fit.unneeded_modes import mode_significance
from middeck.identification.model.measurement_model import natural_hz
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.signals.record import Record

# Share of the largest sample that is a blow; samples beside it that belong to it, and as many more that fade;
# and the largest share of a record that blows fill.
BLOW, BESIDE, SPARSE = 0.02, 16, 0.2
# What may be left at half the rate of the largest line: so much of it folds back. Blows behind a filter that
# ends at half the rate had 0.27 % at most of 2000, sines of two to six samples without one 0.6 % at least.
FOLDED = 0.004
# Factor on the noise of the force before a warning, as few blows have few numbers of it;
# and what is none, as a share of the force: rounding where a force window has left nothing.
CLEAR, NOTHING = 8.0, 1e-9
# Deviations by which what folds back may move the gain of a mode in the band before a warning.
MOVED = 3.0


class _Folded(NamedTuple):
    """Blows of an input, and their spectrum at half the rate: together, less noise, and over the largest."""

    blows: list[Float[np.ndarray, " sample"]]
    top: float
    share: float


def _folded(x: Float[np.ndarray, "run sample"]) -> _Folded:
    """The blows of an input, each under a smooth window against ringing; none where it is no blows."""
    force = x - np.median(x, axis=1, keepdims=True)
    on = np.abs(force) > BLOW * np.abs(force).max()
    if np.mean(on) > SPARSE:
        return _Folded([], 0.0, 0.0)
    near = np.ones(2 * BESIDE + 1)
    slope = np.hanning(len(near) + 2)[1:-1] / (BESIDE + 1.0)
    blows, noise = list[np.ndarray](), 0.0
    for f, own in zip(force, on, strict=True):
        window = np.convolve(np.convolve(own, near)[BESIDE:-BESIDE] > 0.0, slope)[BESIDE:-BESIDE]
        blows += [window[a:b] * f[a:b] for a, b in runs_of(window > 0.0)]
        # From differences where the force window has left noise, so that a removed slope has no effect.
        step = np.diff(f) - np.median(np.diff(f))
        rest = step[(window[1:] < 0.5) & (np.abs(step) > NOTHING * np.abs(f).max())]
        noise += 0.5 * float(np.mean(rest**2)) * np.sum(window**2) if len(rest) else 0.0
    top = sum(float(b[::2].sum() - b[1::2].sum()) ** 2 for b in blows)
    largest = sum(float(np.max(np.abs(np.fft.rfft(b)) ** 2)) for b in blows)
    top = max(top - CLEAR * noise, 0.0)
    return _Folded(blows, np.sqrt(top), float(np.sqrt(top / largest)) if largest else 0.0)


def _moved(found: _Folded, covariance: ModelCovariance, band_hz: tuple[float, float], rate: float) -> float:
    """Deviations by which what folds back may move the gain of a mode in the band, the largest."""
    f, known = natural_hz(covariance.model), mode_significance(covariance)
    within = (f >= band_hz[0]) & (f <= band_hz[1])
    turn = -2j * np.pi * f[within] / rate
    power = sum(np.abs(b @ np.exp(np.outer(np.arange(len(b)), turn))) ** 2 for b in found.blows)
    back = found.top / (2.0 - 2.0 * f[within] / rate) ** 2
    each = back / np.sqrt(np.maximum(power, np.finfo(float).tiny)) * _in_phase(found.blows)
    return float(np.max(each * known[within], initial=0.0))


def _in_phase(blows: list[Float[np.ndarray, " sample"]]) -> float:
    """The share of the errors of several blows that all have in common, no less than chance leaves."""
    size = np.array([b.sum() for b in blows])
    centre = np.array([b @ np.arange(len(b)) for b in blows]) / np.where(size == 0.0, 1.0, size)
    alike = np.abs(size**2 @ np.exp(2j * np.pi * centre)) / max(np.sum(size**2), np.finfo(float).tiny)
    return float(max(alike, 1.0 / np.sqrt(max(len(blows), 1))))


def warnings_on_folding(
    record: Record, covariance: ModelCovariance | None = None, band_hz: tuple[float, float] = (0.0, np.inf)
) -> list[str]:
    """Warnings for inputs whose blows reach beyond half the sampling rate: of a fit, if it minds."""
    u = record.u.reshape(len(record.u), -1, record.u.shape[3])
    found = [_folded(u[..., i]) for i in range(u.shape[2])]
    return [
        f"input {port.name}: at half the sampling rate its blows still have {own.share:.1%} of their largest "
        "line, and the rest is folded back: no anti-alias filter, or too low a rate; the stated standard "
        "deviations are too small, most of all that of a delay; sample faster, or strike with a softer tip"
        for port, own in zip(record.inputs, found, strict=True)
        if own.share > FOLDED
        and (covariance is None or _moved(own, covariance, band_hz, record.sample_hz) > MOVED)
    ]
