"""Finite transmission zeros of a state space, by staircase deflation of the infinite zeros and QZ.

The pencil [A - s I, B; C, D] is scaled and its infinite zeros are deflated by orthogonal transformations with
rank decisions on singular values (Emami-Naeini and Van Dooren 1982, Automatica 18); the remaining system has
an invertible D, hence finite zeros only. Polynomial coefficients would lose close modes.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.linalg
from jaxtyping import Complex

from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, dual

# A singular value is zero below this share of the scaled pencil's norm, for each row and column of it:
# rounding of a few orthogonal transformations, with two digits to spare.
RANK = 100.0 * np.finfo(float).eps
BALANCING_SWEEPS = 6


def transmission_zeros(system: StateSpace | SampledStateSpace) -> Complex[np.ndarray, " zero"]:
    """All finite zeros [rad/s] (z-plane for a sampled system), one of each pair, ascending in size.

    Where the transfer matrix loses rank; of a pair the one of positive imaginary part stands for both. A
    system that is not minimal also gives the modes that it does not reach or does not show.

    >>> lag = StateSpace([[-1.0, 0.0], [0.0, -3.0]], [[1.0], [1.0]], [[1.0, 1.0]], [[0.0]])
    >>> transmission_zeros(lag).real.round(12)           # 1/(s + 1) + 1/(s + 3) = (2 s + 4) / ...
    array([-2.])
    """
    if not len(system.A) or not system.D.size:
        return np.zeros(0, dtype=complex)
    omega = _unit(system.A)
    scaled = balance(StateSpace(system.A / omega, system.B / omega, system.C, system.D))
    size = np.linalg.norm(np.block([[scaled.A, scaled.B], [scaled.C, scaled.D]]))
    tolerance = RANK * (len(scaled.A) + max(scaled.D.shape)) * float(size)
    full_rows = _deflate(scaled, tolerance)
    zeros = _finite(dual(_deflate(dual(full_rows), tolerance))) * omega
    one_each = zeros[np.imag(zeros) >= 0.0]
    return one_each[np.argsort(np.abs(one_each), kind="stable")]


def _unit(A: np.ndarray) -> float:
    """Typical frequency of the system: the geometric mean of its nonzero poles."""
    size = np.abs(np.linalg.eigvals(A))
    size = size[size > np.finfo(float).eps * size.max(initial=0.0)]
    return float(np.exp(np.mean(np.log(size)))) if len(size) else 1.0


def balance(system: StateSpace) -> StateSpace:
    """Rows and columns of the pencil of like size, by powers of two: states, then inputs and outputs.

    After Osborne (1960); inputs and outputs are scaled too, which leaves the zeros.
    """
    n = len(system.A)
    pencil = np.block([[system.A, system.B], [system.C, system.D]])
    own = np.diag(system.A).copy()
    np.fill_diagonal(pencil[:n, :n], 0.0)
    for _ in range(BALANCING_SWEEPS):
        moved = False
        for k in range(n):
            into, out = float(pencil[k] @ pencil[k]), float(pencil[:, k] @ pencil[:, k])
            f = 2.0 ** round(0.25 * (math.log2(out) - math.log2(into))) if into and out else 1.0
            if f != 1.0:
                pencil[k] *= f
                pencil[:, k] /= f
                moved = True
        column = _sizes(pencil[:, n:], axis=0)
        pencil[:, n:] /= column
        row = _sizes(pencil[n:], axis=1)[:, None]
        pencil[n:] /= row
        if not moved and np.all(column == 1.0) and np.all(row == 1.0):
            break
    np.fill_diagonal(pencil[:n, :n], own)
    return StateSpace(pencil[:n, :n], pencil[:n, n:], pencil[n:, :n], pencil[n:, n:])


def _sizes(matrix: np.ndarray, axis: int) -> np.ndarray:
    size = np.linalg.norm(matrix, axis=axis)
    return np.exp2(np.round(np.log2(np.where(size > 0.0, size, 1.0))))


def _deflate(system: StateSpace, tolerance: float) -> StateSpace:
    """The same finite zeros with a D of full row rank.

    Where a combination of outputs has no direct term, its states must stay at zero: they are taken out, and
    their equations of motion become outputs that must vanish in their turn.
    """
    while len(system.D):
        left, value, _ = np.linalg.svd(system.D)
        rank = int(np.sum(value > tolerance))
        if rank == len(system.D):
            break
        rows, direct = left.T @ system.C, (left.T @ system.D)[:rank]
        _, value, right = np.linalg.svd(rows[rank:])
        held = int(np.sum(value > tolerance))
        turn = np.vstack([right[held:], right[:held]]).T  # the states that must vanish come last
        a, b, c = turn.T @ system.A @ turn, turn.T @ system.B, rows[:rank] @ turn
        n = len(a) - held
        system = StateSpace(a[:n, :n], b[:n], np.vstack([c[:, :n], a[n:, :n]]), np.vstack([direct, b[n:]]))
    return system


def _finite(system: StateSpace) -> np.ndarray:
    """Eigenvalues of A - B D^-1 C without the inverse: [C D] is compressed to its columns first."""
    n = len(system.A)
    if not n:
        return np.zeros(0, dtype=complex)
    _, _, right = np.linalg.svd(np.hstack([system.C, system.D]))
    kernel = right[len(system.D) :].T
    left, mass = np.hstack([system.A, system.B]) @ kernel, kernel[:n]
    return np.asarray(scipy.linalg.eigvals(left, mass)).astype(complex)
