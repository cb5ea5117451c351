"""Blows that were sampled without a filter: what they have beyond half the sampling rate is folded back.

A continuous fit takes inputs as band-limited between samples. That a blow is not, its own spectrum tells: a
filter leaves nothing of it at half the rate, where an unfiltered pulse of a few samples has some per cent. A
signal that goes on has noise there, and tells nothing.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.signals.record import Record

# Of the largest sample, what is a blow; samples beside it that belong to it; and the most of a record that
# blows are.
BLOW, BESIDE, SPARSE = 0.02, 8, 0.2
# Lines below half the rate, and what may be left there of the largest line: so much of it folds back. Blows
# behind a filter that ends at half the rate had 0.26 % at most of 120, blows of 2 to 6 samples without one
# 0.5 % at least of 40.
TOP, FOLDED = 0.02, 0.004
# The noise of the force, from where no blow is, counts twice before anything is said.
CLEAR = 2.0


def folded_share(record: Record) -> Float[np.ndarray, " input"]:
    """Of each input, what is left at half the rate of its largest line; zero for one that is no blows."""
    u = record.u.reshape(len(record.u), -1, record.u.shape[3])
    return np.array([max(_share(x) for x in u[..., i]) for i in range(u.shape[2])])


def _share(x: Float[np.ndarray, " sample"]) -> float:
    force = x - np.median(x)
    on = np.abs(force) > BLOW * np.abs(force).max()
    beside = np.convolve(on, np.ones(2 * BESIDE + 1), "same") > 0.0
    if np.mean(on) > SPARSE:
        return 0.0
    power = np.abs(np.fft.rfft(np.where(beside, force, 0.0))) ** 2
    noise = float(np.mean(force[~beside] ** 2) * np.sum(beside)) if not beside.all() else 0.0
    top = float(np.mean(power[int((1.0 - TOP) * len(power)) :])) - CLEAR * noise
    return float(np.sqrt(max(top, 0.0) / power.max()))
