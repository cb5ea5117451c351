"""Stability and rms of many perturbed closed loops, by squaring instead of eigenvalues.

What the squaring (`middeck.control.robust.verification.squaring`) does not prove, or leaves with too large a
residual or error, is decided loop by loop, as one loop alone is.
"""

from __future__ import annotations

import warnings

import numpy as np
from jaxtyping import Bool, Float

from middeck.control.h2.closed_cost import Law
from middeck.control.robust.verification.single_loop import TOLERATED, measure_one
from middeck.control.robust.verification.squaring import find_units, share_way, square_loops
from middeck.errors import ConfigError
from middeck.systems.poles.verdict import CURE, OPEN
from middeck.systems.state_space.balancing import balance
from middeck.values import record

AT_ONCE = 16
"""Loops that are inverted together."""
FEW = 3
"""Loops for which no better units are sought than balanced ones."""
TRUSTED = 1e-11
"""Relative residual up to which X is used."""


@record(kw_only=True)
class ManyLoops:
    """Outcomes of many loops.

    Attributes:
        stable: Stability of each, as `middeck.systems.poles.stability.is_stable` decides.
        rms: Rms of outputs under white noise of unit intensity on each input, (C X C')^1/2; ``inf`` where a
            pole does not decay.
        error: Relative error of each rms, about |A X + X A' + B B'| trace(O) / (2 rms^2) with the
            observability Gramian O of this output, and the rounding of c X c'. From one on no digit is known.
        residual: |A X + X A' + B B'| / (2 |A| |X| + |B B'|), Frobenius norms, the first as a few fixed
            vectors see it, of all but the last, small terms of X; ``nan`` where the rms is infinite, ``inf``
            where rounding leaves stability open.
        alone: Loops that were decided one by one.
    """

    stable: Bool[np.ndarray, " loop"]
    rms: Float[np.ndarray, "loop output"]
    error: Float[np.ndarray, "loop output"]
    residual: Float[np.ndarray, " loop"]
    alone: Bool[np.ndarray, " loop"]


def close_many(
    A: Float[np.ndarray, "loop state state"],
    inputs: tuple[Float[np.ndarray, "loop state w"], Float[np.ndarray, "loop state u"]],
    outputs: tuple[Float[np.ndarray, "loop z state"], Float[np.ndarray, "loop y state"]],
    law: Law,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C from w to z of plants (columns w, u, rows z, y) under one compensator u = K y."""
    count, n, m = len(A), A.shape[1], len(law.A)
    closed = np.empty((count, n + m, n + m))
    closed[:, :n, :n], closed[:, n:, n:] = A, law.A
    closed[:, :n, n:], closed[:, n:, :n] = inputs[1] @ law.C, law.B @ outputs[1]
    B = np.concatenate([inputs[0], np.zeros((count, m, inputs[0].shape[2]))], axis=1)
    return closed, B, np.concatenate([outputs[0], np.zeros((count, outputs[0].shape[1], m))], axis=2)


def decide_many(A: Float[np.ndarray, "loop state state"]) -> Bool[np.ndarray, " loop"]:
    """Stability of each loop, as `middeck.systems.poles.stability.is_stable` decides it.

    >>> decide_many(np.array([[[-1.0]], [[1.0]], [[0.0]]]))
    array([ True, False,  True])
    """
    empty = np.zeros((len(A), A.shape[1], 0))
    return measure_many(A, empty, np.swapaxes(empty, 1, 2)).stable


def measure_many(
    A: Float[np.ndarray, "loop state state"],
    B: Float[np.ndarray, "loop state w"],
    C: Float[np.ndarray, "loop z state"],
) -> ManyLoops:
    """Stability and rms of loops x' = A x + B w, z = C x; w is white, of unit two-sided intensity.

    Warns (`UserWarning`) where rounding leaves stability open: the loop then counts as unstable. Raises
    `ConfigError` for stacks that do not fit each other or are not finite.
    """
    _check(A, B, C)
    count, n = A.shape[:2]
    stable, alone = np.ones(count, bool), np.zeros(count, bool)
    rms, error, residual = np.zeros((count, C.shape[1])), np.zeros((count, C.shape[1])), np.zeros(count)
    if not count or not n:
        return ManyLoops(stable=stable, rms=rms, error=error, residual=residual, alone=alone)
    scale = find_units(A[0]) if count > FEW else balance(A[0])[1]
    turned, way = scale / scale[:, None], share_way(A, scale)
    room, wide = np.empty((2 + way.most, n, n)), np.empty((3, min(count, AT_ONCE), n, n))
    for first in range(0, count, AT_ONCE):
        part = slice(first, first + AT_ONCE)
        few = np.multiply(A[part], turned, out=wide[2, : len(A[part])])
        found = square_loops(few, B[part] / scale[:, None], C[part] * scale, way, room, wide[:2, : len(few)])
        known = (found.residual <= TRUSTED) & (found.error <= TOLERATED).all(axis=1)
        alone[part] = ~found.grown & ~(found.proved & known)
        rms[part], error[part], residual[part] = found.rms, found.error, found.residual
        stable[part] = ~found.grown
    for i in np.flatnonzero(alone):
        stable[i], rms[i], error[i], residual[i] = measure_one(A[i], B[i], C[i])
    if undecided := int(np.isinf(residual).sum()):
        warnings.warn(
            f"stability of {undecided} of {count} loops is undecided, and counts as lost: {OPEN}; {CURE}, "
            "would decide",
            stacklevel=2,
        )
    return ManyLoops(stable=stable, rms=rms, error=error, residual=residual, alone=alone)


def _check(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> None:
    stacks = {"A": A, "B": B, "C": C}
    fits = all(M.ndim == 3 and len(M) == len(A) for M in stacks.values())
    if not fits or not A.shape[1] == A.shape[2] == B.shape[1] == C.shape[2]:
        shapes = ", ".join(f"{k} {M.shape}" for k, M in stacks.items())
        raise ConfigError(f"stacks of {shapes}", hint="A (loop, n, n), B (loop, n, w), C (loop, z, n)")
    if not all(np.isfinite(M).all() for M in stacks.values()):
        raise ConfigError(
            "a stack of loops holds a number that is not finite",
            hint="drop unstable or failed designs from the stack first",
        )
