"""Tests whether the residual of a record's fit grows with the response.

Blows that scatter, a clipped or nonlinear sensor and a wrong model leave most where the response is large.
The whitened residual is therefore tested for a variance that grows with the response (Breusch and Pagan
1979), studentised (Koenker 1981) against heavy tails of the noise. Short noise of an input, such as that of a
blow under its window, causes free motion that fades with the response; where it is known, the score leaves it
out.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.identification.problem.data import Data
from middeck.identification.record_fit.refine_record import RecordRun
from middeck.identification.record_fit.residual_tests import Heard, signals, without_transients
from middeck.identification.record_fit.sensor_or_force_noise import noise_variance
from middeck.signals.record import Record

# Blocks of samples, as many as there are lines over this, so that each has some degrees of freedom.
LINES_PER_BLOCK = 4
# Score of a residual that grows with the response above which it is no noise: noise passes it once in 4000,
# if its power were normal over blocks.
GROWS = 3.5
# Least share of what is left that noise of constant size is taken to be.
LEAST = 0.05


def growth_score(data: Data, run: RecordRun, heard: Heard) -> Float[np.ndarray, " output"]:
    """Score of each output: standard normal for constant noise beside input noise (``heard``)."""
    r = run.residual(data)
    size = np.sqrt(noise_variance(r, driven=data.driven))
    noise = without_transients(heard, data, run, size)
    return np.array([_score(r[o] / size[o], data.H[o] - r[o], noise[o], data) for o in range(len(r))])


def _score(white: np.ndarray, response: np.ndarray, heard: np.ndarray, data: Data) -> float:
    left, moves, parts = (_power(data, x) for x in (white, response, heard))
    expected = np.sum(parts, axis=0) / max(len(parts), 1) * np.ones_like(left)
    expected += max(float(np.mean(left - expected)), LEAST * float(left.mean()))
    left, moves = left / expected, moves / expected
    left, moves = left - left.mean(), moves - moves.mean()
    scale = np.mean(left**2) * np.sum(moves**2)
    if len(parts):  # each is more or less in all the blocks of one experiment
        scale += np.sum(np.var(parts @ (moves / expected).T, axis=0))
    return float(np.sum(left * moves) / np.sqrt(scale)) if scale > 0.0 else 0.0


def _power(data: Data, spectra: np.ndarray) -> Float[np.ndarray, "column block"]:
    """Mean square in each block of time."""
    x, blocks = signals(data, spectra) ** 2, max(len(data.s) // LINES_PER_BLOCK, 2)
    edges = np.linspace(0, x.shape[1], blocks + 1).astype(int)[:-1]
    return np.add.reduceat(x, edges, axis=1) / np.diff(np.append(edges, x.shape[1]))


def warnings_on_growth(record: Record, score: np.ndarray) -> list[str]:
    """Warnings for outputs whose residual is larger while they move more."""
    return [
        f"output {port.name}: the residual grows with the response ({z:.0f} standard deviations of noise), "
        "so it is not noise: blows that scatter, a sensor that clips, a nonlinear article or a wrong "
        "model; the stated standard deviations are too small"
        for port, z in zip(record.outputs, score, strict=True)
        if z >= GROWS
    ]
