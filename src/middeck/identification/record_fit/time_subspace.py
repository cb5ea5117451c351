"""Poles from samples: past and future of a record in one triangle, whatever its length.

With block rows r, a record of inputs u and outputs y is stacked in Hankel matrices of r future inputs, r past
inputs, r past outputs and r future outputs, and only the triangle L of their LQ factorisation is kept. What
the past says of the future outputs beyond what the future inputs say is spanned by the observability matrix:

    "moesp"  L32, the projection orthogonal to the future inputs (Verhaegen 1994)
    "cva"    the same in units of the future's own scatter (Larimore 1990)
    "n4sid"  the oblique projection along the future inputs (Van Overschee and De Moor 1994)

Past inputs and outputs are instruments, so that white noise leaves the poles unbiased; coloured noise adds
poles of its own, and biases those of a model without states for them. Several experiments are columns side by
side: none runs on into the next.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from middeck.values import record

Weighting = Literal["moesp", "cva", "n4sid"]
# Columns of the Hankel matrices that are compressed at a time.
CHUNK = 8192
# Directions of the past below this share of the strongest are rounding, or an input that is too smooth.
SMOOTH = 1e-8
# Bases that are kept: of a record two triangles and two weightings, which every order tried asks for.
KEPT = 8


@record
class PastFuture:
    """The triangle of one choice of block rows: future inputs, past, future outputs.

    Attributes:
        L: Lower triangle; its first ``rows * inputs`` rows are future inputs, its last ``rows * outputs``
            future outputs.
    """

    L: Float[np.ndarray, "row row"]
    inputs: int
    outputs: int
    rows: int


def compress_past(
    u: Sequence[Float[np.ndarray, "sample input"]], y: Sequence[Float[np.ndarray, "sample output"]], rows: int
) -> PastFuture | None:
    """The triangle of all experiments; None where they are too short for so many rows.

    >>> rng = np.random.default_rng(0)
    >>> compress_past([rng.standard_normal((50, 1))], [rng.standard_normal((50, 2))], 3).L.shape
    (18, 18)
    """
    inputs, outputs = u[0].shape[1], y[0].shape[1]
    height = 2 * rows * (inputs + outputs)
    if sum(max(len(x) - 2 * rows + 1, 0) for x in u) < height:
        return None
    triangle = np.zeros((0, height))
    for one, other in zip(u, y, strict=True):
        columns = len(one) - 2 * rows + 1
        for first in range(0, columns, CHUNK):
            part = slice(first, min(first + CHUNK, columns) + 2 * rows - 1)
            taller = np.vstack([triangle, _stacked(one[part], other[part], rows)])
            triangle = np.asarray(np.linalg.qr(taller, mode="r"))
    return PastFuture(triangle.T, inputs, outputs, rows)


def _stacked(u: np.ndarray, y: np.ndarray, rows: int) -> Float[np.ndarray, "column row"]:
    U, Y = _hankel(u, 2 * rows), _hankel(y, 2 * rows)
    past = rows * u.shape[1]
    return np.hstack([U[:, past:], U[:, :past], Y])


def _hankel(x: np.ndarray, rows: int) -> Float[np.ndarray, "column row"]:
    windows = np.lib.stride_tricks.sliding_window_view(x, rows, axis=0)
    return windows.transpose(0, 2, 1).reshape(len(windows), -1)


@functools.lru_cache(maxsize=KEPT)
def observability(past: PastFuture, weighting: Weighting) -> Float[np.ndarray, "row column"]:
    """A basis of the observability matrix, its strongest directions first; read-only."""
    basis = _directions(past, weighting)
    basis.setflags(write=False)
    return basis


def _directions(past: PastFuture, weighting: Weighting) -> Float[np.ndarray, "row column"]:
    first = past.rows * past.inputs
    last = len(past.L) - past.rows * past.outputs
    L21, L22 = past.L[first:last, :first], past.L[first:last, first:last]
    L32, L33 = past.L[last:, first:last], past.L[last:, last:]
    if weighting == "moesp":
        return np.linalg.svd(L32, full_matrices=False)[0]
    if weighting == "n4sid":
        oblique = L32 @ np.linalg.pinv(L22, rcond=SMOOTH) @ np.hstack([L21, L22])
        return np.linalg.svd(oblique, full_matrices=False)[0]
    size, direction = np.linalg.eigh(L32 @ L32.T + L33 @ L33.T)
    root = np.sqrt(np.maximum(size, SMOOTH * size[-1]))
    scaled = (direction / root) @ (direction.T @ L32)
    return (direction * root) @ direction.T @ np.linalg.svd(scaled, full_matrices=False)[0]


def record_poles(past: PastFuture, weighting: Weighting, states: int) -> Complex[np.ndarray, " state"] | None:
    """Poles z of the model of ``states`` states by shift invariance; None where the rows are too few."""
    if (past.rows - 1) * past.outputs < states:
        return None
    G = observability(past, weighting)[:, :states]
    A = np.linalg.lstsq(G[: -past.outputs], G[past.outputs :], rcond=None)[0]
    return np.linalg.eigvals(A).astype(complex)
