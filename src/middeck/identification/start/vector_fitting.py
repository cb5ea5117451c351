"""Poles of a response by vector fitting: relocated until the zeros of a common denominator stand still.

Gustavsen and Semlyen (1999), relaxed (Gustavsen 2006), each entry of H compressed on its own (Deschrijver,
Mrozowski, Dhaene and De Zutter 2008), all in real arithmetic. With phi_n the partial fractions of the poles
at hand, each entry of H obeys, times its weight,

    sum_n c_n phi_n + D - (sum_n d_n phi_n + d) H = 0,

d_n and d common to all entries; the zeros of sum d_n phi_n + d are the next poles. A sampled response is
fitted in q = exp(s T), where the same holds. It is no least-squares fit of H, but it moves poles across the
band in a few steps where a descent would stay in a local minimum.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from middeck.identification.problem.data import Data

# Poles that move by less than this share, all of them, stand still.
STILL = 1e-4
# A pole with a smaller share of imaginary part is real.
REAL = 1e-13
# A denominator whose constant is smaller than this share of its terms has a zero at infinity.
SMALLEST_CONSTANT = 1e-8


def relocate(
    data: Data, poles: Complex[np.ndarray, " state"], period_s: float, *, iterations: int
) -> Complex[np.ndarray, " state"]:
    """Poles after so many relocations, both of each conjugate pair, all stable.

    Args:
        data: Response and weights; every entry of H has residues of its own.
        poles: First guess [rad/s], closed under conjugation.
        period_s: Sampling period, or zero in continuous time. A sampled pole on the negative real axis has
            the imaginary part pi / T and no conjugate.
    """
    q, p = (np.exp(data.s * period_s), np.exp(poles * period_s)) if period_s else (data.s, poles)
    # Rounding leaves an imaginary part to the real ones.
    p = np.where(np.abs(np.imag(p)) <= REAL * np.abs(p), np.real(p), p)
    for _ in range(iterations):
        moved = _relocated(data, q, p, sampled=period_s > 0.0)
        if moved is None:
            break
        still, p = _stand_still(p, moved), moved
        if still:
            break
    return np.log(p.astype(complex)) / period_s if period_s else p


def _stand_still(before: np.ndarray, after: np.ndarray) -> bool:
    a, b = (np.sort_complex(x) for x in (before, after))
    return bool(np.all(np.abs(a - b) <= STILL * np.abs(b)))


def _relocated(data: Data, q: np.ndarray, poles: np.ndarray, *, sampled: bool) -> np.ndarray | None:
    upper, real = poles[np.imag(poles) > 0.0], np.real(poles[np.imag(poles) == 0.0])
    up, low = (1.0 / (q - p[:, None]) for p in (upper, upper.conj()))
    pairs = np.stack([up + low, 1j * (up - low)], axis=1).reshape(-1, len(q))
    phi = np.vstack([pairs, 1.0 / (q - real[:, None])])
    size = np.linalg.norm(phi, axis=1)
    phi = phi / size[:, None]
    rows = [
        _common_rows(phi, data.H[o, :, i], data.weight[o, :, i])
        for o in range(data.H.shape[0])
        for i in range(data.H.shape[2])
    ]
    # Relaxed: the denominator's real part has a mean of one, weighted as all entries together.
    level = np.sqrt(np.sum(np.abs(data.weight * data.H) ** 2)) / len(q)
    total = np.append(np.sum(np.real(phi), axis=1), len(q))
    A = np.vstack([*rows, level * total])
    right = np.zeros(len(A))
    right[-1] = level * len(q)
    found = np.linalg.lstsq(A, right, rcond=None)[0]
    d = found[-1]
    if not np.isfinite(found).all() or abs(d) < SMALLEST_CONSTANT * np.abs(found).max():
        return None
    return _stable(_zeros(upper, real, found[:-1] / size / d), sampled=sampled)


def _common_rows(
    phi: Complex[np.ndarray, "column line"], H: Complex[np.ndarray, " line"], weight: np.ndarray
) -> Float[np.ndarray, "row column"]:
    """Rows of one entry for d_n and d, its own residues and constant projected out."""
    own = np.vstack([phi, np.ones(len(H))]) * weight
    A = np.ascontiguousarray(np.vstack([own, -own * H])).view(float).T
    triangle = np.asarray(scipy.linalg.qr(A, mode="r", overwrite_a=True, check_finite=False)[0])
    return triangle[len(own) : 2 * len(own), len(own) :]


def _zeros(upper: np.ndarray, real: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Zeros of sum d_n phi_n + 1: eigenvalues of A - b d."""
    blocks = [np.array([[p.real, p.imag], [-p.imag, p.real]]) for p in upper] + [
        np.array([[p]]) for p in real
    ]
    b = np.concatenate([np.tile([2.0, 0.0], len(upper)), np.ones(len(real))])
    return np.linalg.eigvals(np.asarray(scipy.linalg.block_diag(*blocks)) - np.outer(b, d))


def _stable(poles: np.ndarray, *, sampled: bool) -> np.ndarray:
    """Unstable poles reflected: in the imaginary axis, or in the unit circle."""
    if not sampled:
        return -np.abs(np.real(poles)) + 1j * np.imag(poles)
    size = np.abs(poles)
    inside = np.clip(np.where(size > 1.0, 1.0 / np.maximum(size, 1.0), size), 1e-6, 1.0 - 1e-6)
    return poles * inside / np.maximum(size, 1e-300)
