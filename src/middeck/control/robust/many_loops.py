"""Stability and rms of many perturbed closed loops, by squaring instead of eigenvalues.

M = (A - p I)^-1 (A + p I) has its eigenvalues within the unit circle exactly where A has its own in the left
half plane, and A X + X A' + B B' = 0 is X = M X M' + 2 p (A - p I)^-1 B B' (A - p I)^-T (Smith 1968, SIAM J.
Appl. Math. 16). Squaring M doubles the terms of X with products of matrices alone, several times quicker
than the iterations of an eigenvalue. A norm of a power below one proves stability, a trace above the number
of states growth; what is not proved, or whose residual is too large, is decided loop by loop, as one loop
alone is.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
from jaxtyping import Bool, Float

from middeck.control.h2.closed_cost import Law
from middeck.control.robust.batch import row_rms
from middeck.errors import ConfigError
from middeck.systems.balancing import balance
from middeck.systems.stability import GROWTH_LIMIT, all_decay, growth_rates, none_grows
from middeck.systems.statespace import StateSpace
from middeck.values import record

AT_ONCE = 32
"""Loops together: their matrices of 60 states stay in the cache."""
SQUARINGS = 24
"""A pole that decays by 1e-6 of p or more is proved stable."""
PROVED = 1e-3
"""Norm of a power of M far below one."""
GROWN = 1e3
"""Trace of a power of M, over the number of states, far above one."""
GONE = 1e-8
"""Norm of a power of M whose square adds nothing to X."""
DOUBT = 0.1
"""Growth by rounding, over all squarings, up to which a proof is one."""
TRUSTED = 1e-11
"""Relative residual up to which X is used."""


@record(kw_only=True)
class ManyLoops:
    """Outcomes of many loops.

    Attributes:
        stable: As `middeck.systems.stability.is_stable` decides each.
        rms: Of each output under white noise of unit intensity on each input, (C X C')^1/2; ``inf`` where a
            pole does not decay.
        residual: |A X + X A' + B B'| / (2 |A| |X| + |B B'|), Frobenius norms; ``nan`` where the rms is
            infinite.
        alone: Loops that were decided one by one.
    """

    stable: Bool[np.ndarray, " loop"]
    rms: Float[np.ndarray, "loop output"]
    residual: Float[np.ndarray, " loop"]
    alone: Bool[np.ndarray, " loop"]


def close_many(
    A: Float[np.ndarray, "loop state state"],
    inputs: tuple[Float[np.ndarray, "loop state w"], Float[np.ndarray, "loop state u"]],
    outputs: tuple[Float[np.ndarray, "loop z state"], Float[np.ndarray, "loop y state"]],
    law: Law,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C from w to z of plants (their columns w, u and rows z, y) under one law u = K y."""
    count, n, m = len(A), A.shape[1], len(law.A)
    closed = np.empty((count, n + m, n + m))
    closed[:, :n, :n], closed[:, n:, n:] = A, law.A
    closed[:, :n, n:], closed[:, n:, :n] = inputs[1] @ law.C, law.B @ outputs[1]
    B = np.concatenate([inputs[0], np.zeros((count, m, inputs[0].shape[2]))], axis=1)
    return closed, B, np.concatenate([outputs[0], np.zeros((count, outputs[0].shape[1], m))], axis=2)


def decide_many(A: Float[np.ndarray, "loop state state"]) -> Bool[np.ndarray, " loop"]:
    """Stability of each loop, as `middeck.systems.stability.is_stable` decides it.

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

    Raises `ConfigError` for stacks that do not fit each other or are not finite.
    """
    _check(A, B, C)
    count, n = A.shape[:2]
    stable, rms, residual = np.ones(count, bool), np.zeros((count, C.shape[1])), np.zeros(count)
    alone = np.zeros(count, bool)
    if not count or not n:
        return ManyLoops(stable=stable, rms=rms, residual=residual, alone=alone)
    # One scaling by powers of two for all, from the first loop: exact, whatever the others are.
    scale = balance(A[0])[1]
    pole = _middle(np.linalg.eigvals(A[0]))
    for first in range(0, count, AT_ONCE):
        part = slice(first, first + AT_ONCE)
        F, G, H = A[part] * scale / scale[:, None], B[part] / scale[:, None], C[part] * scale
        proved, grown, X = _squared(F, G, pole)
        residual[part] = np.where(grown, np.nan, _residuals(F, G, X))
        alone[part] = ~grown & (~proved | ~(residual[part] <= TRUSTED))
        rms[part] = row_rms(H, np.where((alone[part] | grown)[:, None, None], np.inf, X))
        stable[part] = ~grown
    for i in np.flatnonzero(alone):
        stable[i], rms[i], residual[i] = _one(A[i], B[i], C[i])
    return ManyLoops(stable=stable, rms=rms, residual=residual, alone=alone)


def _check(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> None:
    stacks = {"A": A, "B": B, "C": C}
    fits = all(M.ndim == 3 and len(M) == len(A) for M in stacks.values())
    if not fits or not A.shape[1] == A.shape[2] == B.shape[1] == C.shape[2]:
        shapes = ", ".join(f"{k} {M.shape}" for k, M in stacks.items())
        raise ConfigError(f"stacks of {shapes}", hint="A (loop, n, n), B (loop, n, w), C (loop, z, n)")
    if not all(np.isfinite(M).all() for M in stacks.values()):
        raise ConfigError("a stack of loops holds a number that is not finite")


def _middle(poles: np.ndarray) -> float:
    """The p of the fewest squarings for these poles."""
    size = np.abs(poles)
    top = float(size.max())
    if not top > 0.0:
        return 1.0
    decay = np.maximum(np.abs(np.real(poles)), 1e-6 * size)
    kept = size > 1e-6 * top
    tried = np.geomspace(size[kept].min(), top, 60)
    gain = (tried[:, None] * decay / (tried[:, None] + size) ** 2)[:, kept]
    return float(tried[np.argmax(gain.min(axis=1))])


def _squared(A: np.ndarray, B: np.ndarray, p: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which loops are proved stable, which to grow, and the X of all."""
    n, eps = A.shape[1], float(np.finfo(float).eps)
    shifted = A - p * np.eye(n)
    try:
        inverse = np.linalg.inv(shifted)
    except np.linalg.LinAlgError:  # a pole at p
        return np.zeros(len(A), bool), np.zeros(len(A), bool), np.zeros(A.shape)
    power = np.eye(n) + 2.0 * p * inverse
    columns, total = np.sqrt(2.0 * p) * (inverse @ B), None
    feigned = eps * np.linalg.norm(shifted, axis=(1, 2)) * np.linalg.norm(inverse, axis=(1, 2))
    size = np.linalg.norm(power, axis=(1, 2))
    peak, proved_at = np.maximum(size, 1.0), np.full(len(A), np.inf)
    grown = np.zeros(len(A), bool)
    most = int(np.clip(np.log2(p / GROWTH_LIMIT) - 3.0, 0, SQUARINGS))
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(most + 1):
            proved_at[(size < PROVED) & np.isinf(proved_at)] = 2.0**k
            trace = np.abs(np.einsum("lii->l", power))
            grown |= (trace > GROWN * n) & (feigned * 2.0**k * size**2 < DOUBT * trace**2)
            # Loops that grow keep the others waiting no longer than their own powers stay finite.
            if not np.any((size > (GONE if B.shape[2] else PROVED)) & (size < 1.0 / GONE)):
                break
            if total is None and 2 * columns.shape[2] <= n:
                columns = np.concatenate([columns, power @ columns], axis=2)
            else:
                total = columns @ np.swapaxes(columns, 1, 2) if total is None else total
                total = total + power @ total @ np.swapaxes(power, 1, 2)
            power = power @ power
            size = np.linalg.norm(power, axis=(1, 2))
            peak = np.fmax(peak, size)
        proved = feigned * peak**2 * proved_at < DOUBT
    found = columns @ np.swapaxes(columns, 1, 2) if total is None else total
    return proved & (size < GONE if B.shape[2] else True), grown & ~proved, found


def _residuals(A: np.ndarray, B: np.ndarray, X: np.ndarray) -> np.ndarray:
    if not B.shape[2]:
        return np.zeros(len(A))
    with np.errstate(over="ignore", invalid="ignore"):
        half, Q = A @ X, B @ np.swapaxes(B, 1, 2)
        sizes = [np.linalg.norm(M, axis=(1, 2)) for M in (half + np.swapaxes(half, 1, 2) + Q, A, X, Q)]
        whole = 2.0 * sizes[1] * sizes[2] + sizes[3]
        return np.divide(sizes[0], whole, out=np.zeros(len(A)), where=whole != 0.0)


def _one(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> tuple[bool, np.ndarray, float]:
    """One loop alone."""
    rates = growth_rates(StateSpace(A, B, C, np.zeros((len(C), B.shape[1]))))
    if not all_decay(rates):
        return none_grows(rates), np.full(len(C), np.inf), np.nan
    if not B.shape[1]:
        return True, np.zeros(len(C)), 0.0
    balanced, scale = balance(A)
    G = B / scale[:, None]
    X = np.asarray(sla.solve_continuous_lyapunov(balanced, -G @ G.T))
    return (
        True,
        row_rms((C * scale)[None], X[None])[0],
        float(_residuals(balanced[None], G[None], X[None])[0]),
    )
