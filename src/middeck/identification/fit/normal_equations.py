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

from middeck.identification.fit.data import Data
from middeck.identification.fit.design import Terms
from middeck.identification.fit.factors import column_factors, slope_factors
from middeck.identification.fit.gram_blocks import (
    Functions,
    Heard,
    heard_by_all,
    heard_by_one,
    inner,
    on_functions,
    products,
)
from middeck.identification.fit.layout import Layout
from middeck.identification.fit.ties import Tied

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


def solve_normal(
    layout: Layout, data: Data, terms: Terms, shared: Functions, output: int | None = None
) -> Solved | None:
    """One output, or all together where they are mixed; None where the condition is too bad."""
    if data.mix is None and output is not None:
        outputs, of = [output], heard_by_one(data, terms, shared, output)
    else:
        mix = np.eye(layout.outputs)[None] if data.mix is None else data.mix
        outputs, of = list(range(layout.outputs)), heard_by_all(data, terms, shared, mix)
    columns, tied = column_factors(layout, terms.point), Tied(layout, terms.point)
    free = tied.free(columns.reshape(len(columns), -1)).reshape(-1, *columns.shape[1:])
    free = _placed(free, len(outputs))
    solve = _Normal.of(inner(of.blocks, free, free))
    if solve is None:
        return None
    x, left = np.zeros((len(outputs), layout.columns)), of.y
    path = np.zeros((len(data.s), len(outputs) * layout.inputs), dtype=complex)
    for _ in range(2):  # the second time is the correction
        y = solve(np.tensordot(free, on_functions(shared, of, left), axes=2))
        x = x + np.array([tied.whole(of_output) for of_output in y.reshape(len(outputs), -1)])
        path = (np.tensordot(x, columns, axes=1).reshape(path.shape[1], -1) @ shared.values).T
        left = of.y - of.sum(path)
    slopes = [slope_factors(layout, terms.point, terms.parts, one) + tied.moved(one, columns) for one in x]
    late, late_place = _delay_slopes(layout, of, -data.s[:, None] * path, outputs)
    G = np.concatenate(slopes, axis=1)
    gradient, gram = _by_theta(shared, of, solve, free, G, late, left)
    place = np.concatenate([np.arange(len(G)), len(G) + late_place])
    whole = Solved(
        x, 0.5 * float(np.sum(np.abs(left) ** 2)), np.zeros(layout.size), np.zeros((layout.size, layout.size))
    )
    whole.gradient[place] = gradient
    whole.gram[np.ix_(place, place)] = gram
    return whole


def _by_theta(
    shared: Functions,
    of: Heard,
    solve: _Normal,
    free: np.ndarray,
    G: np.ndarray,
    late: Complex[np.ndarray, "delay line column"],
    left: Complex[np.ndarray, "line column"],
) -> tuple[np.ndarray, np.ndarray]:
    """Gradient and Gram matrix by theta: of slopes ``G`` by their factors, then of delays line by line."""
    on_late = np.array([on_functions(shared, of, v) for v in late]).reshape(len(late), *G.shape[1:])
    with_late = np.tensordot(G, on_late, axes=([1, 2], [1, 2]))
    gram = np.block([[inner(of.blocks, G, G), with_late], [with_late.T, products(late, late)]])
    cross = np.vstack([inner(of.blocks, G, free), np.tensordot(on_late, free, axes=([1, 2], [1, 2]))])
    on_left = np.tensordot(G, on_functions(shared, of, left), axes=2)
    gradient = -np.concatenate([on_left, products(late, left[None])[:, 0]])
    return gradient, solve.without(gram, cross)


def _placed(factors: np.ndarray, outputs: int) -> Float[np.ndarray, "row path function"]:
    """The same factors for each output in turn, each in its own paths."""
    rows, inputs, size = factors.shape
    found = np.zeros((outputs, rows, outputs, inputs, size))
    for o in range(outputs):
        found[o, :, o] = factors
    return found.reshape(outputs * rows, outputs * inputs, size)


def _delay_slopes(
    layout: Layout, of: Heard, rate: Complex[np.ndarray, "line path"], outputs: list[int]
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
