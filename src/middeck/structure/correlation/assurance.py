"""Similarity of two sets of shapes: MAC, COMAC, orthogonality in a mass metric, phase collinearity.

Shapes are columns over common channels, real or complex, of any scale and phase from mode to mode; all
measures are Hermitian, so that for real shapes they are the familiar ones.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex, Float

Shapes = Complex[np.ndarray, "channel mode"] | Float[np.ndarray, "channel mode"]


def modal_assurance(a: Shapes, b: Shapes) -> Float[np.ndarray, "a b"]:
    """MAC after Allemang and Brown 1982: |a^H b|^2 / (a^H a  b^H b).

    >>> modal_assurance(np.eye(2), np.array([[3.0, 1.0], [0.0, 1.0]])).round(3).tolist()
    [[1.0, 0.5], [0.0, 0.5]]
    """
    size = np.outer(np.sum(np.abs(a) ** 2, axis=0), np.sum(np.abs(b) ** 2, axis=0))
    return _over(np.abs(a.conj().T @ b) ** 2, size)


def coordinate_assurance(a: Shapes, b: Shapes) -> Float[np.ndarray, " channel"]:
    """COMAC after Lieven and Ewins 1988: of each channel |sum a b*|^2 / (sum |a|^2  sum |b|^2) over pairs.

    Column r of ``b`` is paired with column r of ``a`` and is first brought to its scale and phase by least
    squares, as the sum over modes depends on both. Where a channel rests on both sides it is 1.
    """
    b = b * _over(np.sum(b.conj() * a, axis=0), np.sum(np.abs(b) ** 2, axis=0))
    joint = np.abs(np.sum(a * b.conj(), axis=1)) ** 2
    size = np.sum(np.abs(a) ** 2, axis=1) * np.sum(np.abs(b) ** 2, axis=1)
    still = ~np.any(a, axis=1) & ~np.any(b, axis=1)
    return np.where(still, 1.0, _over(joint, size))


def orthogonality(
    a: Shapes, b: Shapes, mass: Float[np.ndarray, "channel channel"]
) -> Float[np.ndarray, "a b"]:
    """|a^H M b| with every shape of unit generalised mass in M, the reduced mass matrix."""
    size = np.outer(_generalised_mass(a, mass), _generalised_mass(b, mass))
    return _over(np.abs(a.conj().T @ mass @ b), np.sqrt(size))


def phase_collinearity(shapes: Shapes) -> Float[np.ndarray, " mode"]:
    """1 for a real shape of any phase, 0 for a travelling one (Pappa, Elliott and Schenk 1993)."""
    re, im = np.real(shapes), np.imag(shapes)
    xx, yy, xy = np.sum(re**2, axis=0), np.sum(im**2, axis=0), np.sum(re * im, axis=0)
    return ((xx - yy) ** 2 + 4.0 * xy**2) / (xx + yy) ** 2


def nearest_basis(a: Float[np.ndarray, "channel mode"], b: Shapes) -> Float[np.ndarray, "channel mode"]:
    """The modes ``a`` of one frequency in the basis that is nearest to ``b``.

    The turn is the orthogonal factor of the coordinates of ``b`` in ``a``, each of unit length; ``b`` may be
    fewer (Schönemann 1966). Where ``a`` are dependent at the channels it stays.
    """
    if not b.shape[1] or np.linalg.matrix_rank(a) < a.shape[1]:
        return a
    turned = b * np.exp(-0.5j * np.angle(np.sum(b * b, axis=0)))  # as real as it can be
    c = np.linalg.lstsq(a, np.real(turned), rcond=None)[0]
    left, _, right = np.linalg.svd(c / np.maximum(np.linalg.norm(c, axis=0), np.finfo(float).tiny))
    return a @ left @ sla.block_diag(right, np.eye(len(left) - len(right)))


def largest_other(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, " n"]:
    """Largest off-diagonal entry in the row or the column of each diagonal one; 0 for a single one."""
    off = matrix - np.diag(np.diag(matrix))
    return np.maximum(off.max(axis=0, initial=0.0), off.max(axis=1, initial=0.0))


def _generalised_mass(a: Shapes, mass: np.ndarray) -> np.ndarray:
    # The mass of a SEREP is semi-definite: rounding may leave -1e-17 where there is none.
    return np.maximum(np.sum(np.real(np.conj(a) * (mass @ a)), axis=0), 0.0)


def _over(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """The quotient, 0 where there is nothing to divide by."""
    return part / np.where(whole > 0.0, whole, np.inf)
