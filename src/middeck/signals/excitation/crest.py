"""Phases that make a multisine compact: more power for the same peak.

The norms (mean |u|^2p)^(1/2p) are minimised for rising p, each from the last phases (Guillaume, Schoukens,
Pintelon and Kollar 1991), starting from Schroeder's (1970). A gradient costs one transform: thousands of
lines take a second. Among so many minima a change of the last digit, as by another processor, would lead to
another one; the norm is therefore taken at phases rounded to a millionth of a radian, and its slopes are
rounded.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.optimize
from jaxtyping import Float

POWERS = (2, 4, 8, 16, 32, 64, 128)
STEPS = 60  # of each power: later ones gain less than a per cent
# Decimals of phases, of slopes by them (about one over the lines) and of the norm's logarithm.
OF_PHASE, OF_SLOPE, OF_NORM = 6, 9, 12


def schroeder_phases(amplitude: Float[np.ndarray, " line"]) -> Float[np.ndarray, " line"]:
    """phi_k = -2 pi sum_{j<k} (k - j) p_j with p the share of power (Schroeder 1970, eq. 11)."""
    share = amplitude**2 / np.sum(amplitude**2)
    before = np.append(0.0, np.cumsum(share[:-1]))
    phases: np.ndarray = np.cumsum(before)
    return -2.0 * np.pi * phases


def compact_phases(
    lines: np.ndarray,
    amplitude: Float[np.ndarray, " line"],
    samples: int,
    start: Float[np.ndarray, " line"],
    rotations: Float[np.ndarray, " experiment"],
) -> Float[np.ndarray, " line"]:
    """Phases of a small peak, for all experiments at once: each turns all lines by its own angle."""
    # A turn by pi changes a sign and no peak.
    distinct = np.unique(np.round(np.mod(rotations, np.pi), 9) % np.round(np.pi, 9))
    scale = np.sqrt(0.5 * np.sum(amplitude**2))
    phases = np.mod(start, 2.0 * np.pi)
    for p in POWERS:
        found: Any = scipy.optimize.minimize(
            _log_norm,
            phases,
            args=(lines, amplitude / scale, samples, distinct, p),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": STEPS},
        )
        phases = np.round(np.asarray(found.x), OF_PHASE)
    return phases


def _log_norm(
    phases: np.ndarray, lines: np.ndarray, amplitude: np.ndarray, samples: int, turns: np.ndarray, p: int
) -> tuple[float, np.ndarray]:
    """log of the norm of order 2p of all turned signals together, and its gradient by the phases."""
    spectrum = np.zeros((len(turns), samples // 2 + 1), dtype=complex)
    rotated = np.exp(1j * (np.round(phases, OF_PHASE) + turns[:, None]))
    spectrum[:, lines] = 0.5 * samples * amplitude * rotated
    u = np.fft.irfft(spectrum, samples, axis=1)
    largest = np.abs(u).max()
    power = (u / largest) ** (2 * p)
    total = float(np.sum(power))
    # d log norm / du = u^(2p-1) / sum u^2p; du_t / dphi_k = -A_k sin(2 pi k t / N + phi_k).
    slope = np.fft.rfft(power / np.where(u == 0.0, 1.0, u), axis=1)[:, lines] / total
    gradient = -amplitude * np.sum(np.imag(rotated * slope.conj()), axis=0)
    norm = float(np.log(largest) + np.log(total / u.size) / (2 * p))
    return round(norm, OF_NORM), np.round(gradient, OF_SLOPE)
