"""A law in modal blocks: fewer operations, and every mode's pole readable in its coefficients."""

import numpy as np

from middeck.realtime.package.core import Core
from middeck.systems.state_space.balancing import balance

CONDITION = 1e6
"""Of the eigenvectors: beyond it, modal form would lose more than ten of sixteen digits."""


def to_modal(core: Core) -> Core | None:
    """``core`` in modal blocks, one for each pair of conjugate poles; None where the poles are too close.

    Each state is scaled so that what reaches it and what it gives are of one size, as far as both are there.
    Poles that nearly coincide have eigenvectors that nearly do, and no modal form of any use.

    >>> into, out = [[0.0], [1.0]], [[1.0, 0.0]]
    >>> core = Core(A=[[0.9, 0.1], [-0.1, 0.9]], B=into, C=out, D=[[0.0]], E=into, pairs=None)
    >>> to_modal(core).A.tolist()
    [[0.9, 0.1], [-0.1, 0.9]]
    """
    n = len(core.A)
    if n == 0:
        return Core(A=core.A, B=core.B, C=core.C, D=core.D, E=core.E, pairs=0)
    balanced, scale = balance(core.A)
    poles, vectors = np.linalg.eig(balanced)  # vectors of norm one
    if not np.linalg.cond(vectors) < CONDITION:
        return None
    growth, turn = np.real(poles), np.imag(poles)
    upper, alone = np.flatnonzero(turn > 0.0), np.flatnonzero(turn == 0.0)
    upper = upper[np.argsort(np.abs(np.angle(poles[upper])), kind="stable")]
    T = np.column_stack([np.real(vectors[:, upper]), np.imag(vectors[:, upper]), np.real(vectors[:, alone])])
    B, E = (np.linalg.solve(T, M / scale[:, None]) for M in (core.B, core.E))
    C = (core.C * scale) @ T
    p = len(upper)
    A = np.diag(growth[np.concatenate([upper, upper, alone])])
    first = np.arange(p)
    A[first, first + p], A[first + p, first] = turn[upper], -turn[upper]
    size = _scales(np.hstack([B, E]), C, p)
    return Core(A=A, B=B / size[:, None], C=C * size, D=core.D, E=E / size[:, None], pairs=p)


def _scales(B: np.ndarray, C: np.ndarray, pairs: int) -> np.ndarray:
    """A power of two for each block, so that its rows of B and columns of C have one largest number."""
    n = len(B)
    blocks = [*([i, i + pairs] for i in range(pairs)), *([i] for i in range(2 * pairs, n))]
    scales = np.ones(n)
    for block in blocks:
        into, out = np.abs(B[block]).max(initial=0.0), np.abs(C[:, block]).max(initial=0.0)
        if into > 0.0 and out > 0.0:
            scales[block] = 2.0 ** np.round(0.5 * (np.log2(into) - np.log2(out)))
    return scales
