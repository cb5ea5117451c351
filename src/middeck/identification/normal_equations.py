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
    """Some outputs: linear unknowns, cost, gradient and Gram matrix by theta."""

    linear: Float[np.ndarray, "output column"]
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


class _Heard(NamedTuple):
    """Weighted data ``y``, and how the response of each path is heard in them; Gram blocks of the paths.

    A path is an output and an input, numbered output by output. ``by`` is [line, path, column], or
    [line, path] where each path has a column of its own.
    """

    y: Complex[np.ndarray, "line column"]
    by: np.ndarray
    blocks: list[Block]

    def sum(self, path: Complex[np.ndarray, "line path"]) -> Complex[np.ndarray, "line column"]:
        """What the responses of all paths add to the weighted data."""
        return self.by * path if self.by.ndim == 2 else np.einsum("lak,la->lk", self.by, path)

    def back(self, v: Complex[np.ndarray, "line column"]) -> Complex[np.ndarray, "line path"]:
        """The adjoint of `sum`."""
        return self.by.conj() * v if self.by.ndim == 2 else np.einsum("lak,lk->la", self.by.conj(), v)


def _heard_by_one(data: Data, terms: Terms, shared: Functions, output: int) -> _Heard:
    w, late = data.weight[output], late_of(data, terms, output)
    y = w * data.H[output]
    if data.drive is None:
        blocks = [(i, i, shared.gram(w[:, i] ** 2)) for i in range(w.shape[1])]
        return _Heard(y, w * late, blocks)
    # A delay common to all inputs is in none of their products, and would but round them to complex.
    heard = data.drive if late.shape[1] == 1 else data.drive * late[:, :, None]
    by = w[:, None, :] * data.drive * late[:, :, None]
    return _Heard(y, by, _blocks(shared, w[:, None, :] * heard))


def _heard_by_all(data: Data, terms: Terms, shared: Functions, mix: np.ndarray) -> _Heard:
    outputs, lines, columns = data.H.shape
    drive = np.eye(columns, dtype=complex)[None] if data.drive is None else data.drive
    late = np.stack([late_of(data, terms, o) for o in range(outputs)])
    heard = np.broadcast_to(late[:, :, :, None] * drive, (outputs, lines, *drive.shape[1:]))
    by = np.einsum("qlk,lqo,olik->loiqk", data.weight, mix, heard).reshape(lines, -1, outputs * columns)
    y = np.einsum("qlk,lqo,olk->lqk", data.weight, mix, data.H).reshape(lines, -1)
    return _Heard(y, by, _blocks(shared, by))


def _blocks(shared: Functions, by: Complex[np.ndarray, "line path column"]) -> list[Block]:
    found: list[Block] = []
    for i in range(by.shape[1]):
        found.append((i, i, shared.gram(np.sum(np.abs(by[:, i]) ** 2, axis=1))))
        for j in range(i):
            M = shared.gram(np.einsum("lk,lk->l", by[:, i].conj(), by[:, j]))
            found += [(i, j, M), (j, i, M.T)]
    return found


def solve_normal(
    layout: Layout, data: Data, terms: Terms, shared: Functions, output: int | None = None
) -> Solved | None:
    """One output, or all together where they are mixed; None where the condition is too bad."""
    if data.mix is None and output is not None:
        outputs, of = [output], _heard_by_one(data, terms, shared, output)
    else:
        mix = np.eye(layout.outputs)[None] if data.mix is None else data.mix
        outputs, of = list(range(layout.outputs)), _heard_by_all(data, terms, shared, mix)
    columns, tied = column_factors(layout, terms.point), Tied(layout, terms.point)
    free = tied.free(columns.reshape(len(columns), -1)).reshape(-1, *columns.shape[1:])
    free = _placed(free, len(outputs))
    solve = _Normal.of(_inner(of.blocks, free, free))
    if solve is None:
        return None
    x, left = np.zeros((len(outputs), layout.columns)), of.y
    path = np.zeros((len(data.s), len(outputs) * layout.inputs), dtype=complex)
    for _ in range(2):  # the second time is the correction
        y = solve(np.tensordot(free, _on_functions(shared, of, left), axes=2))
        x = x + np.array([tied.whole(of_output) for of_output in y.reshape(len(outputs), -1)])
        path = (np.tensordot(x, columns, axes=1).reshape(path.shape[1], -1) @ shared.values).T
        left = of.y - of.sum(path)
    slopes = [slope_factors(layout, terms.point, terms.parts, one) + tied.moved(one, columns) for one in x]
    G = np.concatenate(slopes, axis=1)
    late, late_place = _delay_slopes(layout, of, -data.s[:, None] * path, outputs)
    on_late = np.array([_on_functions(shared, of, v) for v in late]).reshape(len(late), *G.shape[1:])
    with_late = np.tensordot(G, on_late, axes=([1, 2], [1, 2]))
    gram = np.block([[_inner(of.blocks, G, G), with_late], [with_late.T, _products(late, late)]])
    cross = np.vstack([_inner(of.blocks, G, free), np.tensordot(on_late, free, axes=([1, 2], [1, 2]))])
    on_left = np.tensordot(G, _on_functions(shared, of, left), axes=2)
    place = np.concatenate([np.arange(len(G)), len(G) + late_place])
    gradient, whole = np.zeros(layout.size), np.zeros((layout.size, layout.size))
    gradient[place] = -np.concatenate([on_left, _products(late, left[None])[:, 0]])
    whole[np.ix_(place, place)] = solve.without(gram, cross)
    return Solved(x, 0.5 * float(np.sum(np.abs(left) ** 2)), gradient, whole)


def _placed(factors: np.ndarray, outputs: int) -> Float[np.ndarray, "row path function"]:
    """The same factors for each output in turn, each in its own paths."""
    rows, inputs, size = factors.shape
    found = np.zeros((outputs, rows, outputs, inputs, size))
    for o in range(outputs):
        found[o, :, o] = factors
    return found.reshape(outputs * rows, outputs * inputs, size)


def _inner(blocks: list[Block], A: np.ndarray, B: np.ndarray) -> Float[np.ndarray, "row other"]:
    """Inner products of rows by their factors [row, input, function]; most have no part in most inputs."""
    found = np.zeros((len(A), len(B)))
    for i, j, M in blocks:
        a, b = (np.flatnonzero(X.any(axis=1)) for X in (A[:, i], B[:, j]))
        found[np.ix_(a, b)] += A[a, i] @ M @ B[b, j].T
    return found


def _on_functions(
    shared: Functions, of: _Heard, v: Complex[np.ndarray, "line column"]
) -> Float[np.ndarray, "input function"]:
    """Inner products of weighted data with each function in each input."""
    return shared.products(of.back(v))


def _products(A: np.ndarray, B: np.ndarray) -> Float[np.ndarray, "row other"]:
    return as_real(A) @ as_real(B).T


def _delay_slopes(
    layout: Layout, of: _Heard, rate: Complex[np.ndarray, "line path"], outputs: list[int]
) -> tuple[Complex[np.ndarray, "delay line column"], np.ndarray]:
    """Weighted slopes by the delays of these outputs, and their places among all delays."""
    if not layout.with_delay:
        return np.zeros((0, *of.y.shape), dtype=complex), np.zeros(0, dtype=int)
    each = np.repeat(np.array(outputs), layout.inputs)
    if layout.delay_of == "path":
        each = each * layout.inputs + np.tile(np.arange(layout.inputs), len(outputs))
    place = np.zeros_like(each) if layout.delay_of == "common" else each
    different = np.unique(place)
    return np.stack([of.sum(rate * (place == k)) for k in different]), different


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
