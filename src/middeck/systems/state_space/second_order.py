"""Sums of second-order terms on the imaginary axis, in real arithmetic.

A mode, or a pair of conjugate poles, is (r0 + r1 s + r2 s^2) / (s^2 + d s + k). At s = j omega its
denominator is two real numbers, one reciprocal serves all ports, and the sum over modes is one real matrix
product: a tenth of the time of complex division and products.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

LINES = 256
"""Lines processed at once: a hundred modes then fit the cache."""


def sum_second_order(
    omega: Float[np.ndarray, " line"],
    damping: Float[np.ndarray, " mode"],
    stiffness: Float[np.ndarray, " mode"],
    residues: tuple[Float[np.ndarray, "mode port"], ...],
) -> Complex[np.ndarray, "line port"]:
    """The sum over modes of (r0 + r1 s + ...) / (s^2 + damping s + stiffness) at s = j ``omega``.

    ``residues``: up to three, of 1, s and s^2.

    >>> sum_second_order(np.array([1.0]), np.zeros(1), np.array([3.0]), (np.eye(1), np.eye(1)))
    array([[0.5+0.5j]])
    """
    ports, stacked = residues[0].shape[1], np.hstack(residues)
    H = np.empty((len(omega), ports), dtype=complex)
    for first in range(0, len(omega), LINES):
        w = omega[first : first + LINES, None]
        real, imaginary = stiffness - w**2, damping * w
        size = real**2
        size += imaginary**2
        size = 1.0 / size
        real *= size
        imaginary *= size
        product = np.concatenate([real, imaginary]) @ stacked
        over, under = np.split(product[: len(w)], len(residues), axis=1), product[len(w) :]
        under = np.split(-under, len(residues), axis=1)
        # (over + j under) times 1, j w, -w^2.
        real, imaginary = over[0], under[0]
        if len(residues) > 1:
            real, imaginary = real - w * under[1], imaginary + w * over[1]
        if len(residues) > 2:
            real, imaginary = real - w**2 * over[2], imaginary - w**2 * under[2]
        H[first : first + LINES] = real + 1j * imaginary
    return H
