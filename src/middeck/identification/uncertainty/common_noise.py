"""Noise that the entries of a response have in common, and the covariance of a fit that did not weigh it.

A disturbance of the article is in all outputs, noise of a measured input in all that it drives. A fit with
one weight for each entry stays unbiased, but its covariance is A^-1 B A^-1 with

    B = 1/2 sum over lines of Re sum_ab conj(J_a) w_a^2 V_ab w_b^2 J_b^T,   V_ab = E[r_a conj(r_b)].
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.spectra.excess_variance import averaged
from middeck.identification.uncertainty.response_derivatives import EntrySlopes, combined
from middeck.systems.plants.response import FrequencyResponse

# Mean square coherence of independent noise is one over its degrees of freedom: what is twice that is common.
COMMON = 2.0
# Lines taken together: as many as keep the derivatives of all entries within some megabytes.
CHUNK = 64
# Inputs are orthogonal where their powers are, up to rounding.
SAME = 1e-6


def common_noise(measured: FrequencyResponse, degrees: float) -> Complex[np.ndarray, "line a b"] | None:
    """Correlation of the noise of all entries, output by output; None where it is not significant.

    The covariance of the outputs is averaged over neighbouring lines, like the variances; ``degrees`` are the
    complex degrees of freedom of the average.
    """
    if measured.covariance is None:
        return None
    between = _normalised(averaged(measured.covariance.outputs))
    inputs = _normalised(measured.covariance.inverse_power)
    if not _is_common(between, degrees):
        between = np.broadcast_to(np.eye(between.shape[1], dtype=complex), between.shape)
        if np.abs(inputs - np.eye(inputs.shape[1])).max() < SAME:
            return None
    entries = between.shape[1] * inputs.shape[1]
    return np.einsum("kop,kij->koipj", between, inputs).reshape(len(between), entries, entries)


def _is_common(between: np.ndarray, degrees: float) -> bool:
    """Whether the outputs' noise is significantly correlated; the inputs' powers are known, not estimated."""
    outputs = between.shape[1]
    if outputs < 2:
        return False
    off = np.sum(np.mean(np.abs(between) ** 2, axis=0)) - outputs
    return float(off) / (outputs * (outputs - 1)) > COMMON / max(degrees, 1.0)


def _normalised(raw: np.ndarray) -> Complex[np.ndarray, "line a a"]:
    scale = np.sqrt(np.maximum(np.real(np.linalg.diagonal(raw)), np.finfo(float).tiny))
    return raw / scale[:, :, None] / scale[:, None, :]


def common_scores(
    entries: Iterable[EntrySlopes],
    W: Float[np.ndarray, "unknown direction"],
    correlation: Complex[np.ndarray, "line a b"],
    assumed: Float[np.ndarray, "a line"],
    noise: Float[np.ndarray, "a line"],
) -> Float[np.ndarray, "direction direction"]:
    """W^T B W of the B above; what was assumed beyond the measured noise is independent between entries."""
    each = list(entries)
    spread = np.zeros((W.shape[1], W.shape[1]))
    for first in range(0, assumed.shape[1], CHUNK):
        some = slice(first, first + CHUNK)
        size = np.sqrt(noise[:, some]).T
        joint = correlation[some] * size[:, :, None] * size[:, None, :]
        own = np.arange(len(each))
        joint[:, own, own] = assumed[:, some].T
        power, direction = np.linalg.eigh(joint)
        root = direction * np.sqrt(np.maximum(power, 0.0))[:, None, :] / assumed[:, some].T[:, :, None]
        along = np.stack([combined(W[entry.place].T, entry.by[:, some]) for entry in each], axis=2)
        scores = np.swapaxes(along, 0, 1).conj() @ root
        flat = np.ascontiguousarray(np.swapaxes(scores, 0, 1)).reshape(len(spread), -1).view(float)
        spread += 0.5 * (flat @ flat.T)
    return spread
