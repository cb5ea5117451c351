"""Stability and rms of many perturbed closed loops, by squaring instead of eigenvalues.

M = (A - p I)^-1 (A + p I) has its eigenvalues within the unit circle exactly where A has its own in the left
half plane, and A X + X A' + B B' = 0 is X = M X M' + 2 p (A - p I)^-1 B B' (A - p I)^-T (Smith 1968, SIAM J.
Appl. Math. 16). Squaring M doubles the terms of X with products of matrices alone, several times quicker
than the iterations of an eigenvalue. A norm of a power below one proves stability, a trace above the number
of states growth; what is not proved, or whose residual is too large, is decided loop by loop, as one loop
alone is.

No loop waits for another: one that is decided leaves the stack. X itself is not needed to the end: where a
power P is small, c X c' = sum c P^j Y P'^j c' with the Y so far, and a few rows c P^j are cheap. Rows v and
v A of fixed v tell the residual v (A X + X A' + B B') v' in the same way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from jaxtyping import Bool, Float

from middeck.control.h2.closed_cost import Law
from middeck.control.robust.verification.batch import row_rms
from middeck.errors import ConfigError
from middeck.systems.poles.stability import GROWTH_LIMIT, all_decay, growth_rates, none_grows
from middeck.systems.state_space.balancing import balance
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

AT_ONCE = 32
"""Loops together: their matrices of 60 states stay in the cache."""
SQUARINGS = 24
"""A pole that decays by 1e-6 of p or more is proved stable."""
SMALL = 0.1
"""Norm of a power of M below one: its third power proves stability, its eighth adds nothing to X."""
LAST = 3
"""Doublings of rows that make that eighth."""
PROBES = 3
"""Vectors v of the residual."""
GROWN = 1e3
"""Trace of a power of M, over the number of states, far above one."""
LOST = 1e140
"""Norm of a power of M beyond which its square may overflow."""
DOUBT = 0.1
"""Growth by rounding, over all squarings, up to which a proof is one."""
TRUSTED = 1e-11
"""Relative residual up to which X is used."""


@record(kw_only=True)
class ManyLoops:
    """Outcomes of many loops.

    Attributes:
        stable: As `middeck.systems.poles.stability.is_stable` decides each.
        rms: Of each output under white noise of unit intensity on each input, (C X C')^1/2; ``inf`` where a
            pole does not decay.
        residual: |A X + X A' + B B'| / (2 |A| |X| + |B B'|), Frobenius norms, the first as `PROBES` vectors
            see it; ``nan`` where the rms is infinite.
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
    turned = scale / scale[:, None]
    pole = _middle(np.linalg.eigvals(A[0]))
    for first in range(0, count, AT_ONCE):
        part = slice(first, first + AT_ONCE)
        F, G, H = A[part] * turned, B[part] / scale[:, None], C[part] * scale
        found = _squared(F, G, H, pole)
        alone[part] = ~found.grown & ~(found.proved & (found.residual <= TRUSTED))
        rms[part], residual[part], stable[part] = found.rms, found.residual, ~found.grown
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


class _Found(NamedTuple):
    """Which loops are proved stable and which to grow; of the proved, rms and relative residuals."""

    proved: np.ndarray
    grown: np.ndarray
    rms: np.ndarray
    residual: np.ndarray


def _squared(A: np.ndarray, B: np.ndarray, C: np.ndarray, p: float) -> _Found:
    count, n, eps = *A.shape[:2], float(np.finfo(float).eps)
    proved, grown = np.zeros((2, count), bool)
    found = _Found(proved, grown, np.full((count, C.shape[1]), np.inf), np.full(count, np.nan))
    shifted = A - p * np.eye(n)
    try:
        inverse = np.linalg.inv(shifted)
    except np.linalg.LinAlgError:  # a pole at p
        return found
    feigned, left = eps * _size(shifted) * _size(inverse), np.arange(count)
    power, peak = np.eye(n) + 2.0 * p * inverse, np.ones(count)
    columns, total = np.sqrt(2.0 * p) * (inverse @ B), None
    most = int(np.clip(np.log2(p / GROWTH_LIMIT) - 3.0, 0, SQUARINGS))
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(most + 1):
            size = _size(power)
            peak = np.fmax(peak, size)
            trace = np.abs(np.einsum("lii->l", power))
            kept = (size >= SMALL) & (trace <= GROWN * n) & (size < LOST)
            if not kept.all():
                grows = (trace > GROWN * n) & (feigned * 2.0**k * size**2 < DOUBT * trace**2)
                falls = ~grows & (size < SMALL)
                grown[left[grows]] = True
                proved[left[falls]] = (feigned * peak**2 * 3.0 * 2.0**k < DOUBT)[falls]
                at, sums = left[falls], _gram(columns[falls]) if total is None else total[falls]
                found.rms[at], found.residual[at] = _finish(power[falls], sums, A[at], B[at], C[at])
                kept = ~(grows | falls) & (size < LOST)
                left = left[kept]
                power, columns, feigned, peak = (x[kept] for x in (power, columns, feigned, peak))
                total = None if total is None else total[kept]
            if not len(left) or k == most:
                break
            if total is None and columns.shape[2] <= n:
                columns = np.concatenate([columns, power @ columns], axis=2)
            else:
                total = _gram(columns) if total is None else total
                total += power @ total @ _turned(power)
            power = power @ power
    return found


def _finish(
    power: np.ndarray, total: np.ndarray, A: np.ndarray, B: np.ndarray, C: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rms and residual from the sum of the terms so far and the small power that comes after them."""
    count, n, outputs = len(A), A.shape[1], C.shape[1]
    if not (count and B.shape[2]):
        return np.zeros((count, outputs)), np.zeros(count)
    probes = np.broadcast_to(_probes(n), (count, PROBES, n))
    rows = np.concatenate([C, probes, probes @ A], axis=1)
    wide = rows.shape[1]
    for step in range(LAST):
        power = power @ power if step else power
        rows = np.concatenate([rows, rows @ power], axis=1)
    by_power = count, 2**LAST, wide, n
    half, rows = (rows @ total).reshape(by_power), rows.reshape(by_power)
    square = np.einsum("lpij,lpij->li", half[:, :, :outputs], rows[:, :, :outputs])
    last = outputs + PROBES
    gap = 2.0 * np.einsum("lpij,lpij->li", half[:, :, outputs:last], rows[:, :, last:])
    driven = probes @ B
    gap += np.einsum("lij,lij->li", driven, driven)
    whole = 2.0 * _size(A) * _size(total) + _size(B.swapaxes(1, 2) @ B)
    residual = np.divide(_size(gap), whole, out=np.zeros(count), where=whole != 0.0)
    return np.sqrt(np.maximum(square, 0.0)), residual


def _probes(n: int) -> Float[np.ndarray, "probe state"]:
    """Vectors of signs without a pattern that a structure could share (fractional parts of n^2 / sqrt 2)."""
    k = np.arange(1.0, PROBES * n + 1.0)
    return np.where((k * k / np.sqrt(2.0)) % 1.0 < 0.5, -1.0, 1.0).reshape(PROBES, n)


def _size(M: np.ndarray) -> Float[np.ndarray, " loop"]:
    """Frobenius norms."""
    flat = M.reshape(len(M), -1)
    return np.sqrt(np.vecdot(flat, flat))


def _gram(M: np.ndarray) -> np.ndarray:
    return M @ _turned(M)


def _turned(M: np.ndarray) -> np.ndarray:
    """Transposed in memory: BLAS is slower on a view."""
    return np.ascontiguousarray(np.swapaxes(M, 1, 2))


def _one(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> tuple[bool, np.ndarray, float]:
    """One loop alone."""
    rates = growth_rates(StateSpace(A, B, C, np.zeros((len(C), B.shape[1]))))
    if not all_decay(rates):
        return none_grows(rates), np.full(len(C), np.inf), np.nan
    if not B.shape[1]:
        return True, np.zeros(len(C)), 0.0
    balanced, scale = balance(A)
    G = B / scale[:, None]
    Q = G @ G.T
    X = np.asarray(sla.solve_continuous_lyapunov(balanced, -Q))
    gap, sizes = balanced @ X, [float(np.linalg.norm(M)) for M in (balanced, X, Q)]
    whole = 2.0 * sizes[0] * sizes[1] + sizes[2]
    residual = float(np.linalg.norm(gap + gap.T + Q)) / whole if whole else 0.0
    return True, row_rms((C * scale)[None], X[None])[0], residual
