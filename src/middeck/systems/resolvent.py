"""C (p I - A)^-1 B + D at many points p, three ways: by solving, by substitution in Schur form, by poles.

One factorisation costs as much as the answer of a few lines. For many lines A is brought to a form once, in
which a line costs n^2 (Schur: backward stable, whatever A) or n (poles, where the eigenvectors are far from
dependent). Laub 1981 (IEEE TAC 26, "Efficient multivariable frequency response computations") stops at the
Hessenberg form and solves with it line by line.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex
from scipy.sparse.csgraph import connected_components

from middeck.systems.statespace import SampledStateSpace, StateSpace

FEW_LINES = 32
"""Up to here solving is no dearer than a form."""
WELL_CONDITIONED = 1e4
"""Condition of the eigenvectors up to which a sum over poles is used: it loses four digits of sixteen, on top
of the rounding of A that any form leaves."""
SEPARATE = 1e-5
"""Change of an eigenvector up to which one step of Newton's method is enough: it squares it."""
REFINED_STATES = 400
"""Beyond, arithmetic in extended precision (no BLAS) is dearer than ten thousand substitutions."""
CHUNK_BYTES = 2**20
"""What is worked on at once: about the cache of a core."""
ROWS = 24
"""Rows of the Schur form taken by substitution before the next matrix product."""

System = StateSpace | SampledStateSpace
Resolvent = Callable[[np.ndarray], np.ndarray]


def evaluate_transfer(
    system: System, points: Complex[np.ndarray, " line"]
) -> Complex[np.ndarray, "line output input"]:
    """C (p I - A)^-1 B + D at ``points``, by the cheapest way that is as good as solving."""
    if not len(system.A):
        return np.broadcast_to(system.D.astype(complex), (len(points), *system.D.shape)).copy()
    if len(points) <= FEW_LINES:
        return by_solving(system)(points)
    balanced = balance_states(system)
    form = _refined_poles(balanced.A)
    return (by_schur_form(balanced) if form is None else by_poles(balanced, *form))(points)


def balance_states(system: System) -> StateSpace:
    """The same transfer function in states of comparable size (powers of two: nothing is rounded)."""
    A, (unit, _) = sla.matrix_balance(system.A, separate=True, permute=False)
    return StateSpace(A, system.B / unit[:, None], system.C * unit, system.D)


def by_solving(system: System) -> Resolvent:
    """A factorisation for each line."""

    def evaluate(points: np.ndarray) -> np.ndarray:
        pencil = points[:, None, None] * np.eye(len(system.A)) - system.A
        states = np.linalg.solve(pencil, np.broadcast_to(system.B, (len(points), *system.B.shape)))
        return np.asarray(system.C @ states + system.D)

    return evaluate


def by_poles(system: System, values: np.ndarray, V: np.ndarray) -> Resolvent:
    """The sum over poles, given the eigenvalues and eigenvectors of A: a reciprocal a pole and line."""
    Bv, Cv = np.linalg.solve(V.astype(complex), system.B), system.C @ V
    residues = (Bv[:, None, :] * Cv.T[:, :, None]).reshape(len(values), system.D.size)

    def evaluate(points: np.ndarray) -> np.ndarray:
        H = np.empty((len(points), system.D.size), dtype=complex)
        for some in _chunks(len(points), len(values)):
            np.matmul(1.0 / (points[some, None] - values), residues, out=H[some])
        return H.reshape(len(points), *system.D.shape) + system.D

    return evaluate


def _refined_poles(A: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Eigenvalues and eigenvectors of A as good as A itself, or None where they are too dependent.

    The rounding of LAPACK's, 1e-16 of A, is 1e-11 of the width of a mode that is light and slow beside the
    largest entry of A. One step of Newton's method takes it away, its residual in extended precision
    (Dongarra, Moler and Wilkinson 1983, SIAM J. Numer. Anal. 20, "Improving the accuracy of computed
    eigenvalues and eigenvectors"); poles that nearly coincide are parted within the space they span.
    """
    if len(A) > REFINED_STATES:
        return None
    values, V = np.linalg.eig(A)
    if np.linalg.cond(V) > WELL_CONDITIONED:
        return None
    exact = V.astype(np.clongdouble)
    left_over = (A.astype(np.longdouble) @ exact - exact * values).astype(complex)
    mixed = np.linalg.solve(V.astype(complex), left_over)
    gaps = values[None, :] - values[:, None]
    np.fill_diagonal(gaps, 1.0)
    change = mixed / np.where(gaps == 0.0, np.finfo(float).tiny, gaps)
    np.fill_diagonal(change, 0.0)
    together = ~(np.abs(change) < SEPARATE)
    return _parted(values + np.diag(mixed), V + V @ np.where(together, 0.0, change), mixed, together)


def _parted(
    values: np.ndarray, V: np.ndarray, mixed: np.ndarray, together: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Eigenvectors within each group of poles that nearly coincide; None where they are too dependent."""
    values, vectors = values.copy(), V.copy()
    count, label = connected_components(together, directed=False)
    for group in (np.flatnonzero(label == k) for k in range(count) if np.count_nonzero(label == k) > 1):
        block = mixed[np.ix_(group, group)].copy()
        np.fill_diagonal(block, values[group] - values[group[0]])
        inner, turn = np.linalg.eig(block)
        if np.linalg.cond(turn) > WELL_CONDITIONED:
            return None
        values[group], vectors[:, group] = values[group[0]] + inner, V[:, group] @ turn
    return values, vectors


def by_schur_form(system: System) -> Resolvent:
    """Back substitution in complex Schur form, many lines at once: n^2 a line, and stable."""
    T, Q = cast("tuple[np.ndarray, np.ndarray]", sla.schur(system.A, output="complex"))
    B, C = Q.conj().T @ system.B, system.C @ Q
    outputs, inputs = system.D.shape

    def evaluate(points: np.ndarray) -> np.ndarray:
        H = np.empty((len(points), outputs, inputs), dtype=complex)
        for some in _chunks(len(points), B.size):
            states = C @ _substitute(T, B, points[some])
            H[some] = np.moveaxis(states.reshape(outputs, inputs, -1), 2, 0)
        return H + system.D

    return evaluate


def _substitute(T: np.ndarray, B: np.ndarray, points: np.ndarray) -> Complex[np.ndarray, "state column"]:
    """(p I - T)^-1 B for upper triangular T, a block of rows at a time; columns: inputs, then points."""
    n, inputs = B.shape
    x = np.repeat(B, len(points), axis=1)
    resolved = np.tile(1.0 / (points - np.diag(T)[:, None]), inputs)
    for end in range(n, 0, -ROWS):
        start = max(end - ROWS, 0)
        x[start:end] += T[start:end, end:] @ x[end:]
        for i in reversed(range(start, end)):
            x[i] += T[i, i + 1 : end] @ x[i + 1 : end]
            x[i] *= resolved[i]
    return x


def _chunks(lines: int, numbers: int) -> list[slice]:
    """Lines in parts whose complex intermediate, ``numbers`` a line, stays near the processor."""
    step = max(CHUNK_BYTES // (16 * max(numbers, 1)), 1)
    return [slice(k, k + step) for k in range(0, lines, step)]
