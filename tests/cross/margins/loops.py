"""The loops of the comparison: return ratios L as matrices, without a delay."""

from __future__ import annotations

import numpy as np

OMEGA, ZETA = np.array([2.0, 9.0, 30.0]), np.array([0.01, 0.02, 0.01])


def structure(psi: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, ...]:
    """Three modes with states (q, q')."""
    A, B, C = np.zeros((6, 6)), np.zeros((6, psi.shape[1])), np.zeros((len(phi), 6))
    for k, (w, z) in enumerate(zip(OMEGA, ZETA, strict=True)):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0.0, 1.0], [-(w**2), -2.0 * z * w]]
        B[2 * k + 1], C[:, 2 * k] = psi[k], phi[:, k]
    return A, B, C, np.zeros((len(phi), psi.shape[1]))


def rates(psi: np.ndarray, phi: np.ndarray, *lags: float) -> tuple[np.ndarray, ...]:
    """Rates of the structure, each input behind lags of gain one."""
    A, B, C, D = structure(psi, phi)
    seen = np.zeros_like(C)
    seen[:, 1::2] = C[:, ::2]
    for lag in lags:
        n, m = B.shape
        A = np.block([[A, B], [np.zeros((m, n)), -lag * np.eye(m)]])
        B = np.vstack([np.zeros((n, m)), lag * np.eye(m)])
        seen = np.hstack([seen, np.zeros((len(seen), m))])
    return A, B, seen, D


def single() -> tuple[np.ndarray, ...]:
    """Two lags take the third mode beyond half a turn."""
    return rates(np.array([[0.3], [0.6], [0.8]]), np.array([[1.0, 1.2, 0.9]]), 12.0, 60.0)


def double() -> tuple[np.ndarray, ...]:
    """Two inputs and outputs that are not symmetric."""
    psi = 0.4 * np.array([[2.0, 0.3], [1.0, -2.0], [0.5, 1.5]])
    return rates(psi, np.array([[1.0, 0.6, 0.4], [0.2, -1.1, 1.0]]), 20.0)
