"""One evaluation of the fit from small Gram matrices: the numbers of a QR factorisation with less work.

All columns and slopes of an output are real combinations of few `basis_functions`. Their inner products need
the Gram matrices of these functions only, one for each weight, as sums over the lines (`cauchy`). Normal
equations square the condition; but the residual is formed explicitly, corrects the solution until it is
orthogonal to the columns (corrected seminormal equations, Bjorck 1987) and gives the gradient. Only the Gram
matrix of theta, which merely steers the search, has the squared condition's rounding. Where that is too large
(`WORST`, `SKEW`), or the residual itself is rounding (`Solved.rounding`), the caller takes another way.
Residues of relative degree two add up to zero on each path: a linear constraint.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float, Int

from middeck.identification.problem.basis_functions import column_factors, slope_factors
from middeck.identification.problem.gram_blocks import Functions, Weighted, on_functions
from middeck.identification.problem.residual_and_slopes import Terms
from middeck.identification.problem.terms import linear_of_terms
from middeck.identification.problem.unknowns_layout import Layout, Point


class ZeroSum:
    """Linear unknowns x of an output under the constraint C x = 0, at one theta."""

    def __init__(self, layout: Layout, point: Point) -> None:
        self._layout = layout
        self._C = _ties(layout, point)
        # Orthonormal: what is free is as well conditioned as all was.
        self._free = np.linalg.svd(self._C)[2][len(self._C) :] if len(self._C) else None

    def free(self, rows: Float[np.ndarray, "column number"]) -> Float[np.ndarray, "free number"]:
        """The columns' combinations that are free."""
        return rows if self._free is None else self._free @ rows

    def whole(self, y: Float[np.ndarray, " free"]) -> Float[np.ndarray, " column"]:
        """x from the factors of those combinations."""
        return y if self._free is None else y @ self._free

    def moved(self, x: Float[np.ndarray, " column"], rows: np.ndarray) -> np.ndarray | float:
        """Shift of x on ``rows`` [column, ...] that keeps its constraint as theta moves (delays apart).

        Its free part is projected out later, so that any such move will do.
        """
        if self._free is None:
            return 0.0
        return np.tensordot(-_tie_slopes(self._layout, x) @ np.linalg.pinv(self._C).T, rows, axes=1)


def _ties(layout: Layout, point: Point) -> Float[np.ndarray, "tie column"]:
    """The constraints as a matrix on the linear unknowns of an output: the sum of residues of each path."""
    if not layout.options.zero_sum:
        return np.zeros((0, layout.columns))
    C = np.zeros((layout.inputs, layout.columns))
    pairs = layout.pairs * layout.copies
    b = point.b[:pairs]
    C[:, 0 : 2 * pairs : 2] = 2.0 * np.real(b).T
    C[:, 1 : 2 * pairs : 2] = -2.0 * np.imag(b).T
    C[:, 2 * pairs : layout.mode_columns] = np.real(point.b[pairs:]).T
    return C


def _tie_slopes(layout: Layout, x: Float[np.ndarray, " column"]) -> Float[np.ndarray, "unknown tie"]:
    """Derivative of `_ties` times ``x`` by theta: only b is in it."""
    found = np.zeros((layout.size - layout.delays[0] * layout.delays[1], layout.inputs))
    c = linear_of_terms(layout, x)
    for k, (m, i, part) in enumerate(layout.free_b):
        weight = 2.0 if layout.pair[m] else 1.0
        found[len(layout.pair) + layout.pairs + k, i] = weight * (-c[m].imag if part else c[m].real)
    return found


# Smallest pivot of the scaled normal equations: below it a correction gains less than four digits.
WORST = 1e-12
# Solutions are corrected up to so many times, until the residual's cosine with the columns is so small, and
# given up beyond so large a one; beside that, rounding leaves a share of the data.
CORRECTIONS, ORTHOGONAL, SKEW, OF_DATA = 3, 1e-11, 1e-8, 1e-15
# What of theta's Gram matrix is rounding of the projection.
ROUNDING = 1e-14


@dataclass(frozen=True, kw_only=True, eq=False)
class Solved:
    """Some outputs: linear unknowns, cost, gradient and Gram matrix by theta; their weighted residual.

    ``rounding``: of the residual, in its units, which are deviations where weights are one over them.
    """

    linear: Float[np.ndarray, "output column"]
    cost: float
    gradient: Float[np.ndarray, " unknown"]
    gram: Float[np.ndarray, "unknown unknown"]
    left: Complex[np.ndarray, "output column line"] | None = None
    rounding: float = 0.0


def solve_normal(terms: Terms, shared: Functions, of: Weighted) -> Solved | None:
    """The outputs of a group; None where the condition is too bad."""
    layout = terms.layout
    columns, tied = column_factors(layout, terms.point), ZeroSum(layout, terms.point)
    free = tied.free(columns.reshape(len(columns), -1)).reshape(-1, *columns.shape[1:])
    free = _placed(free, of.outputs.shape[1])
    (products,) = of.inner(free[None])
    solve = _Normal.of(products)
    solved = None if solve is None else _solve_linear(shared, of, solve, free, columns, tied)
    if solve is None or solved is None:
        return None
    each = solved.x.reshape(-1, layout.columns)
    slopes = slope_factors(layout, terms.point, terms.parts, each)
    if layout.options.zero_sum:
        slopes += np.stack([tied.moved(one, columns) for one in each])
    late, late_place = _delay_slopes(layout, of, -terms.data.s * solved.path)
    apart = np.swapaxes(slopes.reshape(*of.outputs.shape, *slopes.shape[1:]), 1, 2)
    by_theta = _by_theta(
        shared, of, solve, free, apart.reshape(*apart.shape[:2], -1, apart.shape[-1]), late, solved
    )
    cost = 0.5 * float(np.sum(_squares(solved.left)))
    gradient, gram = _added(layout, slopes.shape[1] + late_place, *by_theta)
    terms_of = solved.x.reshape(len(solved.x), -1) * solve.lengths if not layout.options.zero_sum else 0.0
    rounding = np.finfo(float).eps * np.hypot(np.linalg.norm(terms_of), np.linalg.norm(of.y))
    return Solved(
        linear=each, cost=cost, gradient=gradient, gram=gram, left=solved.left, rounding=float(rounding)
    )


class _Linear(NamedTuple):
    """Linear unknowns [group, output, column], responses of paths, residual, and its products."""

    x: Float[np.ndarray, "group output column"]
    path: Complex[np.ndarray, "group path line"]
    left: Complex[np.ndarray, "group column line"]
    on_left: Float[np.ndarray, "group path function"]


def _solve_linear(
    shared: Functions, of: Weighted, solve: _Normal, free: np.ndarray, columns: np.ndarray, tied: ZeroSum
) -> _Linear | None:
    """The least-squares solution; None if iterations leave the residual not orthogonal to the columns."""
    groups, each = of.outputs.shape
    rounding = OF_DATA * np.sqrt(_squares(of.y))
    found = _Linear(np.zeros((groups, each, len(columns))), of.y, of.y, on_functions(shared, of, of.y))
    skew = rest = np.zeros(groups)
    for _ in range(1 + CORRECTIONS):
        y = solve(np.tensordot(found.on_left, free, axes=([1, 2], [1, 2])))
        x = found.x + tied.whole(y.reshape(groups * each, -1)).reshape(found.x.shape)
        responses = np.tensordot(x, columns, axes=1).reshape(-1, columns.shape[-1]) @ shared.real
        path = responses.view(complex).reshape(groups, -1, of.y.shape[2])
        left = of.y - of.sum(path)
        found = _Linear(x, path, left, on_functions(shared, of, left))
        skew = solve.cosines(np.tensordot(found.on_left, free, axes=([1, 2], [1, 2])))
        rest = np.sqrt(_squares(left))
        if np.all(skew <= ORTHOGONAL * rest + rounding):
            break
    return found if np.all(skew <= SKEW * rest + 10.0 * rounding) else None


def _added(
    layout: Layout, late_place: np.ndarray, gradients: np.ndarray, grams: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Gradient and Gram matrix of all groups; the last unknowns of each stand at ``late_place``."""
    if not late_place.size:
        return np.sum(gradients, axis=0), np.sum(grams, axis=0)
    if np.all(late_place == late_place[0]):  # as of a delay common to all: one sum, put in its place once
        gradients, grams, late_place = (
            np.sum(gradients, axis=0)[None], np.sum(grams, axis=0)[None], late_place[:1]
        )  # fmt: skip
    gradient, gram = np.zeros(layout.size), np.zeros((layout.size, layout.size))
    first = np.arange(gradients.shape[1] - late_place.shape[1])
    for one, matrix, last in zip(gradients, grams, late_place, strict=True):
        place = np.concatenate([first, last])
        gradient[place] += one
        gram[place[:, None], place] += matrix
    return gradient, gram


def _squares(v: Complex[np.ndarray, "group column line"]) -> Float[np.ndarray, " group"]:
    return np.array([np.vdot(one, one).real for one in v])


def _by_theta(
    shared: Functions,
    of: Weighted,
    solve: _Normal,
    free: np.ndarray,
    G: Float[np.ndarray, "group unknown path function"],
    late: Complex[np.ndarray, "group delay column line"],
    solved: _Linear,
) -> tuple[np.ndarray, np.ndarray]:
    """Gradient and Gram matrix by theta: of slopes ``G`` by their factors, then of delays line by line."""
    gradient = _flat(G) @ solved.on_left.reshape(len(G), -1, 1)
    gram, cross = of.inner(G, free[None])
    if late.shape[1]:
        on_late = np.stack([on_functions(shared, of, late[:, d]) for d in range(late.shape[1])], axis=1)
        with_late = _flat(G) @ _flat(on_late).mT
        rows = np.ascontiguousarray(_flat(late)).view(float)
        own = rows @ rows.mT
        gram = np.block([[gram, with_late], [with_late.mT, own]])
        cross = np.concatenate([cross, _flat(on_late) @ _flat(free[None]).mT], axis=1)
        on_rest = rows @ _flat(solved.left).view(float)[:, :, None]
        gradient = np.concatenate([gradient, on_rest], axis=1)
    # What is left is orthogonal to the columns but for rounding, of which slopes along them would make much.
    rest = solve(np.tensordot(solved.on_left, free, axes=([1, 2], [1, 2])))
    gradient -= cross @ rest[:, :, None]
    return -gradient[:, :, 0], solve.without(gram, cross)


def _flat(rows: np.ndarray) -> np.ndarray:
    """[group, row, ...] with all the rest in one axis, or [group, ...] likewise."""
    return rows.reshape(*rows.shape[: rows.ndim - 2], -1)


def _placed(factors: np.ndarray, outputs: int) -> Float[np.ndarray, "row path function"]:
    """The same factors for each output in turn, each in its own paths."""
    if outputs == 1:
        return factors
    rows, inputs, size = factors.shape
    found = np.zeros((outputs, rows, outputs, inputs, size))
    for o in range(outputs):
        found[o, :, o] = factors
    return found.reshape(outputs * rows, outputs * inputs, size)


def _delay_slopes(
    layout: Layout, of: Weighted, rate: Complex[np.ndarray, "group path line"]
) -> tuple[Complex[np.ndarray, "group delay column line"], Int[np.ndarray, "group delay"]]:
    """Weighted slopes by the delays of each group, and their places among all delays."""
    groups, paths, _ = rate.shape
    if not layout.options.delay_of:
        return np.zeros((groups, 0, *of.y.shape[1:]), dtype=complex), np.zeros((groups, 0), dtype=int)
    each = np.repeat(of.outputs, layout.inputs, axis=1)
    if layout.options.delay_of == "path":
        each = each * layout.inputs + np.arange(paths) % layout.inputs
    each = np.zeros_like(each) if layout.options.delay_of == "common" else each
    different = np.stack([np.unique(own) for own in each])
    own = different[:, :, None] == each[:, None]
    return np.stack([of.sum(rate * own[:, d, :, None]) for d in range(own.shape[1])], axis=1), different


class _Normal:
    """Cholesky factors of normal equations, scaled to a unit diagonal."""

    def __init__(self, factor: np.ndarray, size: np.ndarray) -> None:
        self._factor, self._size = factor, size

    @classmethod
    def of(cls, gram: Float[np.ndarray, "group column column"]) -> _Normal | None:
        """Scaled Cholesky factors; None if columns depend on each other up to rounding."""
        power = np.linalg.diagonal(gram)
        if not np.isfinite(gram).all() or (power <= 0.0).any():
            return None
        size = 1.0 / np.sqrt(power)
        try:
            factor = np.linalg.cholesky(gram * size[:, :, None] * size[:, None])
        except np.linalg.LinAlgError:
            return None
        return cls(factor, size) if np.linalg.diagonal(factor).min() ** 2 > WORST else None

    def __call__(self, right: Float[np.ndarray, "group column"]) -> Float[np.ndarray, "group column"]:
        """The solution."""
        solved = [_triangular(L, b, 1) for L, b in zip(self._factor, self._size * right, strict=True)]
        return self._size * [_triangular(L, b, 0) for L, b in zip(self._factor, solved, strict=True)]

    @property
    def lengths(self) -> Float[np.ndarray, "group column"]:
        """Lengths of the columns."""
        return 1.0 / self._size

    def cosines(self, products: Float[np.ndarray, "group column"]) -> Float[np.ndarray, " group"]:
        """The largest product with a column of length one."""
        return np.max(np.abs(self._size * products), axis=1, initial=0.0)

    def without(
        self, gram: Float[np.ndarray, "group row row"], cross: Float[np.ndarray, "group row column"]
    ) -> Float[np.ndarray, "group row row"]:
        """The Gram matrix of rows without their parts along the columns, to rounding."""
        right = (cross * self._size[:, None]).mT
        along = np.stack([_triangular(L, b, 1) for L, b in zip(self._factor, right, strict=True)])
        rest = gram - along.mT @ along
        own = np.arange(rest.shape[1])
        rest[:, own, own] = np.maximum(rest[:, own, own], ROUNDING * np.abs(gram[:, own, own]))
        return rest


def _triangular(factor: np.ndarray, right: np.ndarray, transposed: int) -> np.ndarray:
    """L^-1 or, not ``transposed``, L^-T of a right side: L as the library sees it is an upper triangle."""
    lapack: Any = scipy.linalg.lapack
    return lapack.dtrtrs(factor.T, right, lower=0, trans=transposed)[0]
