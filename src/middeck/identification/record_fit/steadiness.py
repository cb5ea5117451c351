"""Whether what a fit of a record leaves is noise: as large while the article hardly moves as while it moves.

Noise of sensors, and forces that the inputs do not make, do not know how large the response is. Blows that
scatter, a clipped or nonlinear sensor and a wrong model leave most where the response is large. With the
residual whitened, the score of a variance that grows with the response (Breusch and Pagan 1979) tells the two
apart; its denominator is that of Koenker (1981), so that heavy tails of the noise do not count.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.identification.problem.data import Data
from middeck.identification.problem.design import residual_of
from middeck.identification.record_fit.noise import noise_variance
from middeck.identification.record_fit.search import RecordRun

# Blocks of samples, as many as there are lines over this, so that each has some degrees of freedom.
LINES_PER_BLOCK = 4


def growth_score(data: Data, run: RecordRun) -> Float[np.ndarray, " output"]:
    """Of each output, a number that is normal with unit variance for noise of constant size."""
    r = residual_of(run.layout, data, run.refined.theta, run.refined.step.linear)
    assert data.transient is not None
    v = noise_variance(r, "output", data.s, np.zeros(0, complex), data.transient.period_s)
    return np.array([_score(r[o] / np.sqrt(v[o]), data.H[o] - r[o], data.s) for o in range(len(r))])


def _score(white: np.ndarray, response: np.ndarray, s: np.ndarray) -> float:
    step = float(np.min(np.diff(np.imag(s)))) if len(s) > 1 else float(np.imag(s[0]))
    lines = np.round(np.imag(s) / step).astype(int)
    blocks = max(len(s) // LINES_PER_BLOCK, 2)
    left, moves = (_power(x, lines, blocks) for x in (white, response))
    left, moves = left - left.mean(), moves - moves.mean()
    scale = np.sqrt(np.mean(left**2) * np.sum(moves**2))
    return float(left @ moves / scale) if scale > 0.0 else 0.0


def _power(spectra: np.ndarray, lines: np.ndarray, blocks: int) -> Float[np.ndarray, " block"]:
    """Mean square in each block of time, of all experiments one after the other."""
    full = np.zeros((spectra.shape[1], lines[-1] + 1), dtype=complex)
    full[:, lines] = spectra.T
    x = np.fft.irfft(full, 2 * (lines[-1] + 1), axis=1) ** 2
    edges = np.linspace(0, x.shape[1], blocks + 1).astype(int)[:-1]
    return (np.add.reduceat(x, edges, axis=1) / np.diff(np.append(edges, x.shape[1]))).ravel()
