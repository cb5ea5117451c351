"""Inner products of a model's columns and slopes from the Gram matrices of few functions (`basis_functions`).

Outputs or experiments that err alone are each a group of their own, all evaluated at once; a group of several
outputs stands for those that err together. A path is an output and an input.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.identification.problem.basis_functions import functions
from middeck.identification.problem.cauchy import cauchy_gram, close_twins
from middeck.identification.problem.data import Data
from middeck.identification.problem.residual_and_slopes import Terms

# Weights whose Gram matrices are formed together: more would fill the memory.
TOGETHER = 64
Gram = Float[np.ndarray, "function function"]


class Functions:
    """The functions at one theta, and their Gram matrices: from sums (`cauchy`), or line by line."""

    def __init__(self, terms: Terms, *, from_sums: bool = True) -> None:
        self._layout, self._terms, self._from_sums = terms.layout, terms, from_sums
        self.values = functions(terms.layout, terms.parts, terms.data.s)
        self.real = self.values.view(float)

    def grams(self, weight: np.ndarray) -> Float[np.ndarray, "weight function function"]:
        """Re sum conj(f) weight g over the lines, for each ``weight`` [weight, line], real or complex."""
        if not self._from_sums:
            return np.stack([self._by_lines(w) for w in weight])
        return np.concatenate(
            [self._by_sums(weight[k : k + TOGETHER]) for k in range(0, len(weight), TOGETHER)]
        )

    def _by_sums(self, weight: np.ndarray) -> Float[np.ndarray, "weight function function"]:
        known = cauchy_gram(self._layout, self._terms.point.poles, self._terms.parts, weight)
        size, last = self._of_poles, len(self.values) - 1
        found = np.zeros((len(weight), len(self.values), len(self.values)))
        found[:, :size, :size] = known[:, :-1, :-1]
        if self._layout.options.direct:
            found[:, last, :size], found[:, :size, last] = known[:, -1, :-1], known[:, :-1, -1]
            found[:, last, last] = known[:, -1, -1]
        if len(rest := self._no_sums):
            rows = self.products(weight[:, None] * self.values[rest])
            found[:, :, rest] = rows.mT
            if np.iscomplexobj(weight):
                rows = self.products(weight[:, None].conj() * self.values[rest])
            found[:, rest] = rows
        return found

    @property
    def _of_poles(self) -> int:
        kinds = 3 if self._layout.options.real_constants else 4
        return kinds * self._layout.pairs + 2 * (len(self._layout.pair) - self._layout.pairs)

    @functools.cached_property
    def _no_sums(self) -> Int[np.ndarray, " function"]:
        """1/s^2, 1/s, and differences of twins that are all but one."""
        pairs = self._layout.pairs
        close = np.flatnonzero(close_twins(self._layout, self._terms.point.poles[:pairs]))
        of_close = (
            np.arange(3 if self._layout.options.real_constants else 4)[:, None] * pairs + close
        ).ravel()
        return np.concatenate(
            [of_close, np.arange(self._of_poles, len(self.values) - bool(self._layout.options.direct))]
        )

    def _by_lines(self, weight: np.ndarray) -> Gram:
        if np.any(np.imag(weight)):
            return self.real @ (self.values * weight).view(float).T
        # numpy sees that both factors are one matrix, and does half the work.
        half = (self.values * np.sqrt(np.real(weight))).view(float)
        return half @ half.T

    def products(self, rows: Complex[np.ndarray, "... line"]) -> Float[np.ndarray, "... function"]:
        """Re sum conj(f) row over the lines."""
        # In one product: matrices of few rows each would read all functions once for each.
        flat = np.ascontiguousarray(rows).view(float).reshape(-1, self.real.shape[1])
        return (flat @ self.real.T).reshape(*rows.shape[:-1], -1)


class Alone(NamedTuple):
    """Outputs with independent errors, each input in a column of its own.

    Weighted data ``y``; factors ``by`` of each path's response in them; Gram matrices of the paths;
    the outputs of each group.
    """

    y: Complex[np.ndarray, "group path line"]
    by: Complex[np.ndarray, "group path line"]
    grams: Float[np.ndarray, "group path function function"]
    outputs: Int[np.ndarray, "group one"]

    def sum(self, path: Complex[np.ndarray, "group path line"]) -> Complex[np.ndarray, "group path line"]:
        """The sum of the responses of all paths in the weighted data."""
        return self.by * path

    def back(self, v: Complex[np.ndarray, "group path line"]) -> Complex[np.ndarray, "group path line"]:
        """The adjoint of `sum`."""
        return self.by.conj() * v

    def inner(self, *rows: np.ndarray) -> list[Float[np.ndarray, "group row other"]]:
        """Inner products of the responses of the first rows with those of themselves and of the others.

        Rows are factors [group, row, path, function], or the same for all groups.
        """
        places = [_rows_in_paths(of) for of in rows]
        found = [np.zeros((len(self.y), rows[0].shape[1], of.shape[1])) for of in rows]
        for i, own in enumerate(places[0]):
            there = [of[:, place[i], i] for of, place in zip(rows, places, strict=True)]
            left = there[0] @ self.grams[:, i]
            for products, place, right in zip(found, places, there, strict=True):
                products[:, own[:, None], place[i]] += left @ right.mT
        return found


class Together(NamedTuple):
    """One group of outputs and inputs that share columns; Gram matrices of pairs of paths."""

    y: Complex[np.ndarray, "group column line"]
    by: Complex[np.ndarray, "path column line"]
    grams: list[tuple[int, int, Gram]]
    outputs: Int[np.ndarray, "group output"]

    def sum(self, path: Complex[np.ndarray, "group path line"]) -> Complex[np.ndarray, "group column line"]:
        """The sum of the responses of all paths in the weighted data."""
        return np.einsum("akl,gal->gkl", self.by, path)

    def back(self, v: Complex[np.ndarray, "group column line"]) -> Complex[np.ndarray, "group path line"]:
        """The adjoint of `sum`."""
        return np.einsum("akl,gkl->gal", self.by.conj(), v)

    def inner(self, *rows: np.ndarray) -> list[Float[np.ndarray, "group row other"]]:
        """Inner products of the responses of the first rows with those of all rows, as in `Alone`."""
        places = [_rows_in_paths(of) for of in rows]
        found = [np.zeros((1, rows[0].shape[1], of.shape[1])) for of in rows]
        for i, j, M in self.grams:
            own = places[0][i]
            left = rows[0][:, own, i] @ M
            for products, place, of in zip(found, places, rows, strict=True):
                products[:, own[:, None], place[j]] += left @ of[:, place[j], j].mT
        return found


Weighted = Alone | Together


def _rows_in_paths(A: np.ndarray) -> list[Int[np.ndarray, " row"]]:
    """Rows that have a part in each path; most have none in most."""
    return [np.flatnonzero(rows) for rows in np.transpose(np.any(A, axis=(0, 3)))]


def weigh(terms: Terms, shared: Functions) -> list[Weighted]:
    """Weighted data and the paths that contribute to them, in groups of outputs with independent errors."""
    data, outputs = terms.data, terms.layout.outputs
    if data.mix is not None:
        return [_mixed(terms, shared, data.mix)]
    late = np.stack([terms.delay_factors(o).T for o in range(outputs)])
    if data.drive is not None:
        drive = np.moveaxis(data.drive, 0, 2)
        return [_driven(data, drive, late[o], shared, o) for o in range(outputs)]
    w, y = data.weighted
    grams = shared.grams((w**2).reshape(-1, w.shape[2]))
    return [Alone(y, w * late, grams.reshape(*w.shape[:2], *grams.shape[1:]), np.arange(len(w))[:, None])]


def _driven(data: Data, drive: np.ndarray, late: np.ndarray, shared: Functions, output: int) -> Together:
    w, y = (x[output] for x in data.weighted)
    # A delay common to all inputs is in none of their products, and would but round them to complex.
    heard = drive if len(late) == 1 else drive * late[:, None]
    return Together(y[None], w * drive * late[:, None], _blocks(shared, w * heard), np.array([[output]]))


def _mixed(terms: Terms, shared: Functions, mix: np.ndarray) -> Together:
    """The data of all outputs, combined by ``mix`` [line, output, output]."""
    data = terms.data
    outputs, lines, columns = data.H.shape
    drive = np.eye(columns, dtype=complex)[None] if data.drive is None else data.drive
    late = np.stack([terms.delay_factors(o) for o in range(outputs)])
    heard = np.broadcast_to(late[:, :, :, None] * drive, (outputs, lines, *drive.shape[1:]))
    by = np.einsum("qlk,lqo,olik->oiqkl", data.weight, mix, heard).reshape(-1, outputs * columns, lines)
    y = np.einsum("qlk,lqo,olk->qkl", data.weight, mix, data.H).reshape(1, -1, lines)
    return Together(y, by, _blocks(shared, by), np.arange(outputs)[None])


def _blocks(shared: Functions, by: Complex[np.ndarray, "path column line"]) -> list[tuple[int, int, Gram]]:
    paths = range(len(by))
    own = shared.grams(np.sum(np.abs(by) ** 2, axis=1))
    found = [(i, i, own[i]) for i in paths]
    pairs = [(i, j) for i in paths for j in range(i)]
    if not pairs:
        return found
    cross = shared.grams(np.array([np.einsum("kl,kl->l", by[i].conj(), by[j]) for i, j in pairs]))
    for (i, j), M in zip(pairs, cross, strict=True):
        found += [(i, j, M), (j, i, M.T)]
    return found


def on_functions(
    shared: Functions, of: Weighted, v: Complex[np.ndarray, "group column line"]
) -> Float[np.ndarray, "group path function"]:
    """Inner products of weighted data with each function in each path."""
    return shared.products(of.back(v))
