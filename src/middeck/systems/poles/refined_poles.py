"""Poles of a system and their parts of its response, as accurate as its matrices.

LAPACK's rounding, 1e-16 of the matrix, is 1e-11 of the width of a lightly damped mode that is slow beside the
largest entry. One step of Newton's method removes it if its residual is more accurate than double precision
(Dongarra, Moler and Wilkinson 1983, SIAM J. Numer. Anal. 20, "Improving the accuracy of computed eigenvalues
and eigenvectors"). Matrix products suffice for this: factors cut to 22 bits multiply and add exactly (Ozaki,
Ogita, Oishi and Rump 2012, Numer. Algorithms 59, "Error-free transformations of matrix multiplication by
using fast routines of matrix multiplication and its applications").
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from jaxtyping import Bool, Complex
from scipy.linalg import lapack
from scipy.sparse.csgraph import connected_components

from middeck.values import record

WELL_CONDITIONED = 1e5
"""Largest condition number of the eigenvectors (1-norm, ten times the 2-norm for hundreds of states); a sum
over poles loses as many digits."""
SEPARATE = 1e-5
"""Change of an eigenvector up to which one step of Newton's method suffices: the step squares the error."""
BITS, EXACT_STATES = 22, 512
"""512 products of two factors of 22 bits are summed without rounding in the 53 bits of a double."""


@record(kw_only=True)
class PoleForm:
    """C (p I - A)^-1 B = C_poles (p I - diag(values))^-1 B_poles.

    Attributes:
        values, B, C: Poles, and input and output in the coordinates of the eigenvectors.
        upper, single: Masks of the poles that represent a conjugate pair, and of real ones; the others are
            conjugates.
    """

    values: Complex[np.ndarray, " pole"]
    B: Complex[np.ndarray, "pole input"]
    C: Complex[np.ndarray, "output pole"]
    upper: Bool[np.ndarray, " pole"]
    single: Bool[np.ndarray, " pole"]


def refine_poles(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> PoleForm | None:
    """The form after one step of Newton's method; None where eigenvectors are too dependent for it.

    Nearly coincident poles are separated within the space they span. None also beyond `EXACT_STATES`.
    """
    if len(A) > EXACT_STATES:
        return None
    values, V = (np.asarray(M, dtype=complex) for M in np.linalg.eig(A))
    upper, single = np.imag(values) > 0.0, np.imag(values) == 0.0
    solved = _solve_conditioned(V, np.hstack([_left_over(A, values, V, upper | single), B]))
    if solved is None:
        return None
    mixed, Bv, Cv = solved[:, : len(A)], solved[:, len(A) :], C @ V
    gaps = values[None, :] - values[:, None]
    gaps[gaps == 0.0] = np.finfo(float).tiny
    change = mixed / gaps
    np.fill_diagonal(change, 0.0)
    together = ~(np.abs(change) < SEPARATE)
    change[together] = 0.0
    form = PoleForm(
        values=values + np.diag(mixed), B=Bv - change @ Bv, C=Cv + Cv @ change, upper=upper, single=single
    )
    return _parted(form, mixed, together) if together.any() else form


def _solve_conditioned(V: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """V^-1 right, None where V is worse conditioned than `WELL_CONDITIONED` (LAPACK's estimate, 1-norm)."""
    norm = float(np.linalg.norm(V, 1))
    tools = cast("Any", lapack)
    lu, pivots, singular = tools.zgetrf(V)
    if singular or not np.isfinite(norm) or tools.zgecon(lu, norm)[0] * WELL_CONDITIONED < 1.0:
        return None
    return np.asarray(tools.zgetrs(lu, pivots, right)[0])


def _left_over(
    A: np.ndarray, values: np.ndarray, V: np.ndarray, kept: np.ndarray
) -> Complex[np.ndarray, "state pole"]:
    """A V - V diag(values) with twenty bits beyond double precision; poles not ``kept`` are conjugates.

    The leading bits of all factors lie on common grids, so that their products and sums are exact.
    """
    grid = max(float(np.abs(A).max()), float(np.abs(values).max()))
    p, x, y = values[kept], np.real(V[:, kept]), np.imag(V[:, kept])
    A1, x1, y1 = _leading(A, grid), _leading(x, 1.0), _leading(y, 1.0)
    p1 = _leading(np.real(p), grid) + 1j * _leading(np.imag(p), grid)
    v, v1 = x + 1j * y, x1 + 1j * y1
    exact = A1 @ x1 + 1j * (A1 @ y1) - v1 * p1
    A2 = A - A1
    small = (A1 @ (x - x1) + A2 @ x) + 1j * (A1 @ (y - y1) + A2 @ y) - (v - v1) * p - v1 * (p - p1)
    left_over = np.empty(V.shape, dtype=complex)
    left_over[:, kept] = exact + small
    # LAPACK puts the pole below the axis behind its partner.
    below = np.flatnonzero(~kept)
    left_over[:, below] = np.conj(left_over[:, below - 1])
    return left_over


def _leading(M: np.ndarray, size: float) -> np.ndarray:
    """The leading `BITS` bits of numbers up to ``size``."""
    unit = 2.0 ** (np.ceil(np.log2(size)) - BITS) if size > 0.0 else 1.0
    return np.round(M / unit) * unit


def _parted(form: PoleForm, mixed: np.ndarray, together: np.ndarray) -> PoleForm | None:
    """Eigenvectors within each group of poles that nearly coincide; None where they are too dependent."""
    count, label = connected_components(together, directed=False)
    values, Bv, Cv = form.values.copy(), form.B.copy(), form.C.copy()
    size = np.bincount(label[form.upper | form.single], minlength=count)
    for group in (np.flatnonzero(label == k) for k in np.flatnonzero(size > 1)):
        block = mixed[np.ix_(group, group)].copy()
        np.fill_diagonal(block, values[group] - values[group[0]])
        inner, turn = np.linalg.eig(block)
        if np.linalg.cond(turn) > WELL_CONDITIONED:
            return None
        values[group] = values[group[0]] + inner
        Cv[:, group], Bv[group] = Cv[:, group] @ turn, np.linalg.solve(turn, Bv[group])
    return PoleForm(values=values, B=Bv, C=Cv, upper=form.upper, single=form.single)
