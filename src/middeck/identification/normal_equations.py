"""One evaluation of the fit from small Gram matrices: the same numbers as by QR, for a tenth of the work.

All columns and slopes of an output are real combinations of few functions (`factors`), so that their inner
products need one pass over the lines for each pair of inputs that differ in weight, with the functions only.
Normal equations square the condition; but the residual is formed explicitly, the solution corrected by it
(corrected seminormal equations, Bjorck 1987), and the gradient taken from it, so that only the Gram matrix of
theta itself, which no more than steers the search, has the squared condition's rounding. Where that is too
large (`WORST`), the caller takes QR.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from middeck.identification.design import Terms, late_of
from middeck.identification.factors import column_factors, functions, slope_factors
from middeck.identification.fit_data import Data
from middeck.identification.layout import Layout
from middeck.identification.own_transients import as_real
from middeck.identification.ties import Tied

# Reciprocal condition of the scaled normal equations below which QR is taken: a correction then gains less
# than four digits.
WORST = 1e-12
# What of theta's Gram matrix is rounding of the projection.
ROUNDING = 1e-14


class Solved(NamedTuple):
    """One output: linear unknowns, cost, gradient and Gram matrix by theta."""

    linear: Float[np.ndarray, " column"]
    cost: float
    gradient: Float[np.ndarray, " unknown"]
    gram: Float[np.ndarray, "unknown unknown"]


class Functions:
    """The functions at one theta, and their Gram matrices: made once for all that share a weight."""

    def __init__(self, layout: Layout, data: Data, terms: Terms) -> None:
        self.values = functions(layout, terms.parts, data.s)
        self.real = as_real(self.values[:, :, None])
        self._made: list[tuple[np.ndarray, np.ndarray]] = []

    def gram(self, weight: Complex[np.ndarray, " line"]) -> Float[np.ndarray, "function function"]:
        """Re sum conj(f) weight g over the lines."""
        for known, M in self._made:
            if np.array_equal(known, weight):
                return M
        self._made.append((weight, self._gram(weight)))
        return self._made[-1][1]

    def _gram(self, weight: np.ndarray) -> Float[np.ndarray, "function function"]:
        if np.any(np.imag(weight)):
            return self.real @ as_real((self.values * weight)[:, :, None]).T
        # numpy sees that both factors are one matrix, and does half the work.
        half = as_real((self.values * np.sqrt(np.real(weight)))[:, :, None])
        return half @ half.T

    def products(self, rows: Complex[np.ndarray, "line row"]) -> Float[np.ndarray, "row function"]:
        """Re sum conj(f) row over the lines."""
        return as_real(np.ascontiguousarray(rows.T)[:, :, None]) @ self.real.T


Block = tuple[int, int, Float[np.ndarray, "function function"]]


class _Output:
    """One output's weighted data ``y``, how each input's response is heard in them, and their Gram blocks."""

    def __init__(self, data: Data, terms: Terms, shared: Functions, output: int) -> None:
        w, late = data.weight[output], late_of(data, terms, output)
        self.y: Complex[np.ndarray, "line column"] = w * data.H[output]
        self.blocks: list[Block]
        self._alone = data.drive is None
        if data.drive is None:
            # Each input has a column of its own, so that no two of them meet.
            self._heard = w * late
            self.blocks = [(i, i, shared.gram(w[:, i] ** 2)) for i in range(w.shape[1])]
        else:
            # A delay common to all inputs is in none of their products, and would but round them to complex.
            heard = data.drive if late.shape[1] == 1 else data.drive * late[:, :, None]
            power = np.einsum("lk,lik,ljk->ijl", w**2, heard.conj(), heard)
            inputs = range(len(power))
            self._heard = w[:, None, :] * data.drive * late[:, :, None]
            self.blocks = [(i, j, shared.gram(power[i, j])) for i in inputs for j in inputs]

    def each(self, path: Complex[np.ndarray, "line input"]) -> Complex[np.ndarray, "input line column"]:
        """What the response of each path adds to the weighted data."""
        if self._alone:
            return np.einsum("lk,ki->ilk", self._heard * path, np.eye(path.shape[1]))
        return np.moveaxis(self._heard * path[:, :, None], 1, 0)

    def sum(self, path: Complex[np.ndarray, "line input"]) -> Complex[np.ndarray, "line column"]:
        """What all of them add."""
        return self._heard * path if self._alone else np.einsum("lik,li->lk", self._heard, path)

    def back(self, v: Complex[np.ndarray, "line column"]) -> Complex[np.ndarray, "line input"]:
        """The adjoint of `sum`."""
        return self._heard.conj() * v if self._alone else np.einsum("lik,lk->li", self._heard.conj(), v)


def solve_normal(layout: Layout, data: Data, terms: Terms, shared: Functions, output: int) -> Solved | None:
    """One output by normal equations; None where their condition is too bad."""
    of = _Output(data, terms, shared, output)
    columns, tied = column_factors(layout, terms.point), Tied(layout, terms.point)
    free = tied.free(columns.reshape(len(columns), -1)).reshape(-1, *columns.shape[1:])
    solve = _Normal.of(_inner(of.blocks, free, free))
    if solve is None:
        return None
    x, left = np.zeros(layout.columns), of.y
    path = np.zeros((len(data.s), layout.inputs), dtype=complex)
    for _ in range(2):  # the second time is the correction
        x = x + tied.whole(solve(np.tensordot(free, _on_functions(shared, of, left), axes=2)))
        path = (np.tensordot(x, columns, axes=1) @ shared.values).T
        left = of.y - of.sum(path)
    G = slope_factors(layout, terms.point, terms.parts, x) + tied.moved(x, columns)
    late = _delay_slopes(layout, data, of, path)
    on_late = np.array([_on_functions(shared, of, v) for v in late]).reshape(len(late), *columns.shape[1:])
    with_late = np.tensordot(G, on_late, axes=([1, 2], [1, 2]))
    gram = np.block([[_inner(of.blocks, G, G), with_late], [with_late.T, _products(late, late)]])
    cross = np.vstack([_inner(of.blocks, G, free), np.tensordot(on_late, free, axes=([1, 2], [1, 2]))])
    on_left = np.tensordot(G, _on_functions(shared, of, left), axes=2)
    gradient = -np.concatenate([on_left, _products(late, left[None])[:, 0]])
    place = np.concatenate([np.arange(len(G)), len(G) + _delay_places(layout, len(late), output)])
    whole = Solved(
        x, 0.5 * float(np.sum(np.abs(left) ** 2)), np.zeros(layout.size), np.zeros((layout.size, layout.size))
    )
    whole.gradient[place] = gradient
    whole.gram[np.ix_(place, place)] = solve.without(gram, cross)
    return whole


def _inner(blocks: list[Block], A: np.ndarray, B: np.ndarray) -> Float[np.ndarray, "row other"]:
    """Inner products of rows by their factors [row, input, function]; most have no part in most inputs."""
    found = np.zeros((len(A), len(B)))
    for i, j, M in blocks:
        a, b = (np.flatnonzero(X.any(axis=1)) for X in (A[:, i], B[:, j]))
        found[np.ix_(a, b)] += A[a, i] @ M @ B[b, j].T
    return found


def _on_functions(
    shared: Functions, of: _Output, v: Complex[np.ndarray, "line column"]
) -> Float[np.ndarray, "input function"]:
    """Inner products of weighted data with each function in each input."""
    return shared.products(of.back(v))


def _products(A: np.ndarray, B: np.ndarray) -> Float[np.ndarray, "row other"]:
    return as_real(A) @ as_real(B).T


def _delay_slopes(
    layout: Layout, data: Data, of: _Output, path: Complex[np.ndarray, "line input"]
) -> Complex[np.ndarray, "delay line column"]:
    """Weighted slopes by the delays of this output: of all its paths, or of each."""
    if not layout.with_delay:
        return np.zeros((0, *of.y.shape), dtype=complex)
    rate = -data.s[:, None] * path
    return of.each(rate) if layout.delay_of == "path" else of.sum(rate)[None]


def _delay_places(layout: Layout, count: int, output: int) -> np.ndarray:
    return np.arange(count) + (0 if layout.delay_of == "common" else count * output)


class _Normal:
    """Cholesky factor of normal equations, scaled to a unit diagonal."""

    def __init__(self, factor: np.ndarray, size: np.ndarray) -> None:
        self._factor, self._size = factor, size

    @classmethod
    def of(cls, gram: Float[np.ndarray, "column column"]) -> _Normal | None:
        """None where columns are the others but for rounding."""
        if not np.isfinite(gram).all() or (np.diag(gram) <= 0.0).any():
            return None
        size = 1.0 / np.sqrt(np.diag(gram))
        scaled = gram * size[:, None] * size
        if np.linalg.eigvalsh(scaled)[0] < WORST:
            return None
        return cls(np.linalg.cholesky(scaled), size)

    def __call__(self, right: Float[np.ndarray, " column"]) -> Float[np.ndarray, " column"]:
        """The solution."""
        y = scipy.linalg.solve_triangular(self._factor, self._size * right, lower=True)
        return self._size * scipy.linalg.solve_triangular(self._factor.T, y)

    def without(
        self, gram: Float[np.ndarray, "row row"], cross: Float[np.ndarray, "row column"]
    ) -> Float[np.ndarray, "row row"]:
        """The Gram matrix of rows without their parts along the columns, to rounding."""
        along = scipy.linalg.solve_triangular(self._factor, (cross * self._size).T, lower=True)
        rest = gram - along.T @ along
        np.fill_diagonal(rest, np.maximum(np.diag(rest), ROUNDING * np.diag(gram)))
        return rest
