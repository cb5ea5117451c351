"""Bounds of matrix norms that rounding cannot undo.

A product of matrices with n terms a sum errs by at most n u / (1 - n u) times the product of magnitudes, in
any order of summation (Higham 2002, section 3.5). A Cholesky factorisation in floating point that ends proves
its matrix positive definite but for a shift of at most (n + 1) u / (1 - 2 (n + 1) u) times the trace (Rump
2006, BIT Numerical Mathematics 46).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.systems.state_space.balancing import balance

UNIT = 2.0**-53
SPARE = 1.0 + 1e-6
"""For the few roundings of the bounds themselves."""


def rounding_of_sums(terms: int) -> float:
    """Relative error of sums of ``terms`` products.

    >>> rounding_of_sums(100) > 100 * UNIT
    True
    """
    return terms * UNIT / (1.0 - terms * UNIT) * SPARE


def frobenius(matrix: Float[np.ndarray, "row column"]) -> float:
    """An upper bound of the Frobenius norm, hence of the largest singular value."""
    # The sum of n^2 squares, and its root.
    return float(np.sqrt(np.sum(matrix * matrix))) * (1.0 + rounding_of_sums(matrix.size + 2))


def is_below(matrix: Float[np.ndarray, "row column"], bound: float) -> bool:
    """Whether the largest singular value is proved to lie below ``bound``.

    >>> is_below(np.eye(3), 1.0), is_below(np.eye(3), 1.0 + 1e-12)
    (False, True)
    """
    rows, n = matrix.shape
    if n == 0:
        return bound > 0.0
    if not (bound > 0.0 and np.isfinite(matrix).all()):
        return False
    square = bound * bound
    shift = SPARE * (
        rounding_of_sums(rows) * frobenius(matrix) ** 2  # of the product below
        + rounding_of_sums(2 * (n + 1)) * n * square  # of the factorisation
        + 4.0 * UNIT * square  # of what is put into it
    )
    shifted = (square - shift) * np.eye(n) - matrix.T @ matrix
    return _factors(shifted)


def is_positive(matrix: Float[np.ndarray, "row row"], error: Float[np.ndarray, "row row"]) -> bool:
    """Whether a symmetric matrix within ``error`` of ``matrix``, entry by entry, is proved positive definite.

    >>> is_positive(np.eye(2), 0.1 * np.ones((2, 2))), is_positive(np.eye(2), np.ones((2, 2)))
    (True, False)
    """
    if not np.isfinite(matrix).all():
        return False
    n = len(matrix)
    trace = float(np.sum(np.abs(np.diag(matrix))))
    shift = SPARE * (frobenius(error) + rounding_of_sums(2 * (n + 2)) * trace)
    return _factors(0.5 * (matrix + matrix.T) - shift * np.eye(n))


def bound_norm(matrix: Float[np.ndarray, "row column"]) -> float:
    """A proved upper bound of the largest singular value, close to it.

    >>> bool(2.0 < bound_norm(np.diag([2.0, 1.0])) < 2.0 + 1e-12)
    True
    """
    if not np.isfinite(matrix).all():
        return np.inf
    near = float(np.linalg.norm(matrix, 2)) if matrix.size else 0.0
    slack = 16.0 * matrix.shape[1] * rounding_of_sums(max(1, *matrix.shape))
    bound = near * (1.0 + slack) + np.finfo(float).tiny
    return bound if is_below(matrix, bound) else frobenius(matrix)


def _factors(symmetric: np.ndarray) -> bool:
    try:
        np.linalg.cholesky(symmetric)
    except np.linalg.LinAlgError:
        return False
    return True


def is_proved_to_grow(
    A: Float[np.ndarray, "state state"], size: Float[np.ndarray, "state state"], error: float
) -> bool:
    """Whether every matrix within ``error`` times ``size`` of ``A``, entry by entry, has a growing motion.

    A P with A' P A < P and x' P x < 0 for one x proves it: along that motion x' P x falls from below zero
    (Lyapunov's theorem of instability; LaSalle 1976, "The Stability of Dynamical Systems").

    >>> one = np.ones((1, 1))
    >>> is_proved_to_grow(1.01 * one, one, 1e-12), is_proved_to_grow(0.99 * one, one, 1e-12)
    (True, False)
    """
    balanced, units = balance(A)
    size = size * units / units[:, None]
    values, vectors = np.linalg.eig(balanced)
    if not np.abs(values).max(initial=0.0) > 1.0:
        return False
    lead = vectors[:, np.argmax(np.abs(values))]
    x = max(np.real(lead), np.imag(lead), key=lambda part: float(np.linalg.norm(part)))
    try:
        solved = np.asarray(sla.solve_discrete_lyapunov(balanced.T, np.eye(len(A))))
    except np.linalg.LinAlgError:
        return False
    P = 0.5 * (solved + solved.T)
    terms = rounding_of_sums(2 * len(A) + 8)
    magnitude, worth = np.abs(P), np.abs(balanced) + error * size
    lost = terms * (worth.T @ magnitude @ worth + magnitude)
    moved = error * (size.T @ magnitude @ worth + worth.T @ magnitude @ size)
    falls = is_positive(P - balanced.T @ P @ balanced, lost + moved)
    return falls and float(x @ P @ x) < -terms * float(np.abs(x) @ magnitude @ np.abs(x))
