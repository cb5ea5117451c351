"""Stability and rms of one closed loop, by eigenvalues and Bartels and Stewart (1972, Comm. ACM 15)."""

from __future__ import annotations

from typing import cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.control.riccati.lyapunov import solve_triangular
from middeck.control.robust.verification.batch import row_rms
from middeck.systems.poles.stability import all_decay, growth_rates, none_grows
from middeck.systems.poles.verdict import is_open
from middeck.systems.state_space.balancing import balance
from middeck.systems.state_space.statespace import StateSpace

EPS = float(np.finfo(float).eps)
TOLERATED = 1e-4
"""Relative error up to which an rms is used: a thousandth of a decibel."""


def measure_one(
    A: Float[np.ndarray, "state state"], B: Float[np.ndarray, "state w"], C: Float[np.ndarray, "z state"]
) -> tuple[bool, np.ndarray, np.ndarray, float]:
    """Stability, rms of the outputs, their errors, and the residual, as in `ManyLoops`.

    Where rounding leaves stability open (`is_open`) the loop counts as unstable, with a residual of ``inf``.
    An output lost in the rounding of others is computed again, in units of the states' rms.
    """
    system = StateSpace(A, B, C, np.zeros((len(C), B.shape[1])))
    rates, lost = growth_rates(system), np.full(len(C), np.inf)
    if is_open(system):
        return False, lost, lost, np.inf
    if not all_decay(rates):
        return none_grows(rates), lost, lost, np.nan
    if not B.shape[1]:
        return True, np.zeros(len(C)), np.zeros(len(C)), 0.0
    scale = balance(A)[1]
    rms, error, residual, size = _in_units(A, B, C, scale)
    if (error > TOLERATED).any():
        unit = np.exp2(np.round(np.log2(np.fmax(size, EPS * size.max())))) * scale
        other = _in_units(A, B, C, unit)
        better = other[1] < error
        rms, error = np.where(better, other[0], rms), np.where(better, other[1], error)
    return True, rms, error, residual


def _in_units(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, unit: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Rms and error of outputs, residual, and rms of the states in these units."""
    F, G, H = A * (unit / unit[:, None]), B / unit[:, None], C * unit
    T, U = cast("tuple[np.ndarray, np.ndarray]", sla.schur(F))
    turned = U.T @ G
    X = U @ solve_triangular(T, turned @ turned.T, transposed=False) @ U.T
    gap, sizes = F @ X, [float(np.linalg.norm(M)) for M in (F, X, G @ G.T)]
    lost = float(np.linalg.norm(gap + gap.T + G @ G.T))
    whole = 2.0 * sizes[0] * sizes[1] + sizes[2]
    rms = row_rms(H[None], X[None])[0]
    seen = np.array([np.trace(solve_triangular(T, np.outer(h, h), transposed=True)) for h in H @ U])
    seen = np.where(seen >= 0.0, seen, np.inf)  # a trace below zero is rounding alone
    wrong = lost * seen + EPS * np.vecdot(H, H) * sizes[1]
    return rms, relative_error(wrong, rms**2), lost / whole if whole else 0.0, np.sqrt(np.abs(np.diag(X)))


def relative_error(wrong: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Relative error of a root, from that of its square."""
    return np.divide(wrong, 2.0 * square, out=np.where(wrong != 0.0, np.inf, 0.0), where=square > 0.0)
