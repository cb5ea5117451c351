"""Inner products of a model's columns and slopes from the Gram matrices of few functions (`factors`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.fit.data import Data
from middeck.identification.fit.design import Terms, late_of
from middeck.identification.fit.factors import functions
from middeck.identification.fit.layout import Layout
from middeck.identification.fit.own_transients import as_real


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


class Heard(NamedTuple):
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


def heard_by_one(data: Data, terms: Terms, shared: Functions, output: int) -> Heard:
    """The data of one output, which errs alone."""
    w, late = data.weight[output], late_of(data, terms, output)
    y = w * data.H[output]
    if data.drive is None:
        blocks = [(i, i, shared.gram(w[:, i] ** 2)) for i in range(w.shape[1])]
        return Heard(y, w * late, blocks)
    # A delay common to all inputs is in none of their products, and would but round them to complex.
    heard = data.drive if late.shape[1] == 1 else data.drive * late[:, :, None]
    by = w[:, None, :] * data.drive * late[:, :, None]
    return Heard(y, by, _blocks(shared, w[:, None, :] * heard))


def heard_by_all(data: Data, terms: Terms, shared: Functions, mix: np.ndarray) -> Heard:
    """The data of all outputs, combined by ``mix`` [line, output, output]."""
    outputs, lines, columns = data.H.shape
    drive = np.eye(columns, dtype=complex)[None] if data.drive is None else data.drive
    late = np.stack([late_of(data, terms, o) for o in range(outputs)])
    heard = np.broadcast_to(late[:, :, :, None] * drive, (outputs, lines, *drive.shape[1:]))
    by = np.einsum("qlk,lqo,olik->loiqk", data.weight, mix, heard).reshape(lines, -1, outputs * columns)
    y = np.einsum("qlk,lqo,olk->lqk", data.weight, mix, data.H).reshape(lines, -1)
    return Heard(y, by, _blocks(shared, by))


def _blocks(shared: Functions, by: Complex[np.ndarray, "line path column"]) -> list[Block]:
    found: list[Block] = []
    for i in range(by.shape[1]):
        found.append((i, i, shared.gram(np.sum(np.abs(by[:, i]) ** 2, axis=1))))
        for j in range(i):
            M = shared.gram(np.einsum("lk,lk->l", by[:, i].conj(), by[:, j]))
            found += [(i, j, M), (j, i, M.T)]
    return found


def inner(blocks: list[Block], A: np.ndarray, B: np.ndarray) -> Float[np.ndarray, "row other"]:
    """Inner products of rows by their factors [row, input, function]; most have no part in most inputs."""
    found = np.zeros((len(A), len(B)))
    for i, j, M in blocks:
        a, b = (np.flatnonzero(X.any(axis=1)) for X in (A[:, i], B[:, j]))
        found[np.ix_(a, b)] += A[a, i] @ M @ B[b, j].T
    return found


def on_functions(
    shared: Functions, of: Heard, v: Complex[np.ndarray, "line column"]
) -> Float[np.ndarray, "input function"]:
    """Inner products of weighted data with each function in each input."""
    return shared.products(of.back(v))


def products(A: np.ndarray, B: np.ndarray) -> Float[np.ndarray, "row other"]:
    """Inner products of rows [row, line, column] as they are."""
    return as_real(A) @ as_real(B).T
