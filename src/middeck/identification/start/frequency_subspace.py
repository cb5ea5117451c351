"""Poles, and how they show at the outputs, from a frequency-domain subspace; nothing to tune.

McKelvey, Akcay and Ljung (1996), algorithm 2: on the lines q_k of the unit circle, G_k stacked with the
powers of q_k spans the observability matrix once the same powers of the input are projected out. A
continuous response is mapped to the unit circle first, q = (a + s)/(a - s), with `a` in the middle of the
band on a logarithmic scale, which spreads decades of modes over the circle. Poles outside are reflected.

If there are too many modes, the one whose loss matters least is dropped until the number of states is right.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.identification.problem.data import Data


def block_rows(data: Data, order: int, factor: float) -> int:
    """Block rows of a subspace: a multiple of the least, but no more than the lines allow."""
    outputs, lines, inputs = data.H.shape
    least = -(-order // outputs) + 1
    return min(int(np.ceil(factor * least)), 2 * lines * inputs // (inputs + outputs) - 1)


def subspace_poles(
    data: Data, period_s: float, orders: Sequence[int], rows: int
) -> Iterator[Complex[np.ndarray, " state"]]:
    """Stable poles [rad/s] of the subspace models of some orders; none where the lines are too few."""
    for A, _, a in _realised(data, period_s, orders, rows):
        yield _to_plane(np.linalg.eigvals(A), a, period_s)


def subspace_modes(
    data: Data, period_s: float, *, states: int, rows: int
) -> tuple[Complex[np.ndarray, " state"], Complex[np.ndarray, "output state"]] | None:
    """Poles and output vectors of the subspace model; None where the lines are too few for its size."""
    for A, C, a in _realised(data, period_s, [states], rows):
        z, shapes = np.linalg.eig(A)
        return _to_plane(z, a, period_s), (C @ shapes) / _output_levels(data)[:, None]
    return None


def _realised(
    data: Data, period_s: float, orders: Sequence[int], rows: int
) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """A and C of several orders, and the scale of the map, from one factorisation of so many block rows."""
    outputs = data.H.shape[0]
    possible = [states for states in orders if states <= (rows - 1) * outputs]
    if not possible:
        return
    q, a = _circle(data.s, period_s)
    whole = _observability(data, q, rows)
    for states in possible:
        basis = whole[:, :states]
        yield np.linalg.lstsq(basis[:-outputs], basis[outputs:], rcond=None)[0], basis[:outputs], a


def _output_levels(data: Data) -> Float[np.ndarray, " output"]:
    return np.sqrt(np.mean(data.weight**2, axis=(1, 2)))


def _circle(s: np.ndarray, period_s: float) -> tuple[np.ndarray, float]:
    if period_s:
        return np.exp(s * period_s), 0.0
    omega = np.imag(s)
    a = float(np.sqrt(omega[0] * omega[-1]))
    return (a + s) / (a - s), a


def _observability(data: Data, q: np.ndarray, rows: int) -> Float[np.ndarray, "row column"]:
    outputs, _, inputs = data.H.shape
    # One weight for each output and one for each line: the column space stays common.
    weight = np.sqrt(np.mean(data.weight**2, axis=2))
    level = _output_levels(data)
    line = np.sqrt(np.mean((weight / level[:, None]) ** 2, axis=0))
    powers = q[None] ** np.arange(rows)[:, None] * line
    G = (powers[:, None, :, None] * (level[:, None, None] * data.H)[None]).reshape(rows * outputs, -1)
    U = np.einsum("rk,ij->rikj", powers, np.eye(inputs)).reshape(rows * inputs, -1)
    stacked = np.vstack([np.hstack([U.real, U.imag]), np.hstack([G.real, G.imag])])
    triangle = np.asarray(np.linalg.qr(stacked.T, mode="r")).T
    return np.linalg.svd(triangle[rows * inputs :, rows * inputs : len(stacked)])[0]


def _to_plane(z: np.ndarray, a: float, period_s: float) -> Complex[np.ndarray, " state"]:
    z = reflected(z)
    return np.log(z) / period_s if period_s else a * (z - 1.0) / (z + 1.0)


def reflected(
    z: Complex[np.ndarray, " state"], centre: float = 1e-6, rim: float = 1e-6
) -> Complex[np.ndarray, " state"]:
    """Reflected into the unit circle, and kept off it and off its centre, where a pole has no finite decay.

    >>> reflected(np.array([2.0j, 1.0, 0.0]), 1e-3, 1e-3).tolist()
    [0.5j, (0.999+0j), (0.001+0j)]
    """
    size = np.abs(z)
    inside = np.clip(np.where(size > 1.0, 1.0 / np.maximum(size, 1.0), size), centre, 1.0 - rim)
    return (np.where(size > 0.0, z / np.where(size > 0.0, size, 1.0), 1.0) * inside).astype(complex)


def prune(
    A: Float[np.ndarray, "number column"],
    y: Float[np.ndarray, "number target"],
    blocks: Sequence[Sequence[int] | Int[np.ndarray, " own"]],
    states: Sequence[int],
    wanted: int,
) -> list[int] | None:
    """Backward elimination, exact for least squares of ``y`` on the columns of ``A``.

    Args:
        blocks, states: The columns of each mode and the states it counts for. Columns of no mode are always
            kept.
        wanted: States to keep; None is returned where the modes do not add up to that.
    """
    size = np.linalg.norm(A, axis=0)
    scaled = A / np.where(size > 0.0, size, 1.0)
    gram, right = scaled.T @ scaled, scaled.T @ y
    of_modes = {int(c) for block in blocks for c in block}
    free = [c for c in range(A.shape[1]) if c not in of_modes]
    kept = list(range(len(blocks)))
    while (left := sum(states[m] for m in kept) - wanted) > 0:
        missed = _missed(gram, right, [blocks[m] for m in kept], free)
        # Cost for each state: a real pole is half a pair.
        each = [
            miss / states[m] if states[m] <= left else np.inf for m, miss in zip(kept, missed, strict=True)
        ]
        if not each or not np.isfinite(min(each)):
            return None
        kept.pop(int(np.argmin(each)))
    return kept if left == 0 else None


def _missed(
    gram: np.ndarray,
    right: np.ndarray,
    blocks: Sequence[Sequence[int] | Int[np.ndarray, " own"]],
    free: Sequence[int],
) -> Float[np.ndarray, " block"]:
    """Rise of the squares without each block, the others solved for again."""
    columns = [int(c) for block in blocks for c in block] + list(free)
    inverse = np.linalg.pinv(gram[np.ix_(columns, columns)], hermitian=True)
    x = inverse @ right[columns]
    sizes = np.array([len(block) for block in blocks])
    first = np.cumsum(sizes) - sizes
    missed = np.zeros(len(blocks))
    # All blocks of one size at once.
    for size in set(sizes.tolist()):
        own = first[sizes == size, None] + np.arange(size)
        among = np.linalg.pinv(inverse[own[:, :, None], own[:, None]], hermitian=True)
        missed[sizes == size] = np.sum(x[own] * (among @ x[own]), axis=(1, 2))
    return missed
