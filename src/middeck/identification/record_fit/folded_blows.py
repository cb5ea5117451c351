"""Blows whose spectrum reaches beyond half the sampling rate, where it is folded back.

A continuous fit assumes band-limited inputs; the spectrum of a blow at half the rate shows if it was not.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.identification.faults.equal_runs import runs_of
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


def _folded_share(record: Record) -> Float[np.ndarray, " input"]:
    """Spectrum of each input at half the rate over its largest line; zero for an input without blows."""
    u = record.u.reshape(len(record.u), -1, record.u.shape[3])
    return np.array([_share(u[..., i]) for i in range(u.shape[2])])


def _share(x: Float[np.ndarray, "run sample"]) -> float:
    """The share of all blows of an input together, each under a smooth window against ringing."""
    force = x - np.median(x, axis=1, keepdims=True)
    on = np.abs(force) > BLOW * np.abs(force).max()
    if np.mean(on) > SPARSE:
        return 0.0
    near = np.ones(2 * BESIDE + 1)
    slope = np.hanning(len(near) + 2)[1:-1] / (BESIDE + 1.0)
    top = largest = noise = 0.0
    for f, own in zip(force, on, strict=True):
        window = np.convolve(np.convolve(own, near)[BESIDE:-BESIDE] > 0.0, slope)[BESIDE:-BESIDE]
        for a, b in runs_of(window > 0.0):
            blow = window[a:b] * f[a:b]
            top += (blow[::2].sum() - blow[1::2].sum()) ** 2
            largest += float(np.max(np.abs(np.fft.rfft(blow)) ** 2))
        # From differences where the force window has left noise, so that a removed slope has no effect.
        step = np.diff(f) - np.median(np.diff(f))
        rest = step[(window[1:] < 0.5) & (np.abs(step) > NOTHING * np.abs(f).max())]
        noise += 0.5 * float(np.mean(rest**2)) * np.sum(window**2) if len(rest) else 0.0
    return float(np.sqrt(max(top - CLEAR * noise, 0.0) / largest)) if largest else 0.0


def warnings_on_folding(record: Record) -> list[str]:
    """Warnings for inputs whose blows reach beyond half the sampling rate."""
    return [
        f"input {port.name}: at half the sampling rate its blows still have {share:.1%} of their largest "
        "line, and the rest is folded back: no anti-alias filter, or too low a rate; the stated standard "
        "deviations are too small, most of all that of a delay; sample faster, or strike with a softer tip"
        for port, share in zip(record.inputs, _folded_share(record), strict=True)
        if share > FOLDED
    ]
