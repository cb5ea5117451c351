"""Proofs of stability and growth, and rms, of many loops at once by squaring.

M = (A - p I)^-1 (A + p I) has its eigenvalues within the unit circle exactly where A has its own in the left
half plane, and A X + X A' + B B' = 0 is X = M X M' + 2 p (A - p I)^-1 B B' (A - p I)^-T (Smith 1968, SIAM J.
Appl. Math. 16). Squaring M doubles the terms of X with products of matrices alone, several times quicker
than the iterations of an eigenvalue. A norm of a power below one proves stability, a trace above the number
of states growth.

X is summed where a loop is proved stable, from the powers kept until then. It is not needed to the end: where
a power P is small, c X c' = sum c P^j Y P'^j c' with the Y so far, and a few rows c P^j are cheap. Rows v and
v A of fixed v tell the residual v (A X + X A' + B B') v' in the same way.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.control.riccati.lyapunov import solve_lyapunov
from middeck.control.robust.verification.single_loop import EPS, relative_error
from middeck.systems.poles.stability import GROWTH_LIMIT
from middeck.systems.state_space.balancing import balance

SQUARINGS = 24
"""A pole that decays by 1e-6 of p or more is proved stable."""
SMALL = 0.3
"""Norm of a power of M below one: it proves stability, and few terms are left of X."""
SHIFT = 1e-6
"""Decay of the first loop, over its size, that is lent to it for its units."""
UNITS = 2
"""Times that units are sought anew."""
LEFT = 1e-16
"""Square of the norm of the power from which on the terms of X are left out."""
PROBES = 3
"""Vectors v of the residual."""
GROWN = 2.0
"""Trace of a power of M, over the number of states: above one, an eigenvalue is."""
LOST = 1e140
"""Norm of a power of M beyond which its square may overflow."""
DOUBT = 0.1
"""Growth by rounding, over all squarings, up to which a proof is one."""
WELL = 1e6
"""Condition of a block up to which the inverse of the whole is made from its own."""


def find_units(A: Float[np.ndarray, "state state"]) -> Float[np.ndarray, " state"]:
    """Units of the states, powers of two, in which powers of M hardly grow before they fall.

    Each state is as much excited as it is seen, if noise and sensor are those of the units: the sum of
    |M^i|^2, twice the trace of either Gramian over p, is least there. From the first loop for all: exact.
    """
    balanced, unit = balance(A)
    growth = float(np.real(np.linalg.eigvals(balanced)).max())
    lent = max(0.0, growth + SHIFT * float(np.linalg.norm(balanced, 2)))
    moved = balanced - lent * np.eye(len(A))
    for _ in range(UNITS):
        excited, seen = (np.diag(solve_lyapunov(M, np.eye(len(A)))) for M in (moved.T, moved))
        with np.errstate(all="ignore"):
            own = np.exp2(np.round(np.log2(excited / seen) / 4.0))
        if not (np.isfinite(own) & (own > 0.0)).all():
            break
        moved, unit = moved * (own / own[:, None]), unit * own
    return unit


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


class Way(NamedTuple):
    """What all loops share: p, the most squarings, (A - p I)^-1 of their last states alone, and probes.

    The last states are those whose block of A is that of the first loop in all, as a compensator's.
    """

    pole: float
    most: int
    last: np.ndarray
    probes: np.ndarray


def share_way(A: np.ndarray, scale: np.ndarray) -> Way:
    """What all loops ``A`` share in the units ``scale``."""
    n, pole = A.shape[1], _middle(np.linalg.eigvals(A[0]))
    most = int(np.clip(np.log2(pole / GROWTH_LIMIT) - 3.0, 0, SQUARINGS))
    unlike = np.argwhere((A[0] != A).any(axis=0)).min(axis=1)
    first = max(int(unlike.max(initial=-1)) + 1, n // 2)
    block = (A[0] * (scale / scale[:, None]))[first:, first:] - pole * np.eye(n - first)
    apart = bool(len(block)) and np.linalg.cond(block) < WELL
    return Way(pole, most, np.linalg.inv(block) if apart else np.zeros((0, 0)), _probes(n))


class Found(NamedTuple):
    """Which loops are proved stable and which to grow; of the proved, rms, their errors, and residuals."""

    proved: np.ndarray
    grown: np.ndarray
    rms: np.ndarray
    error: np.ndarray
    residual: np.ndarray


def square_loops(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, way: Way, room: np.ndarray, wide: np.ndarray
) -> Found:
    """Inverses of all loops at once, then loop by loop, so that its few powers stay in the cache.

    ``room`` holds a matrix for each power and four more, ``wide`` three for each loop: memory that is asked
    for anew costs as much as the products.
    """
    count, n = A.shape[:2]
    proved, grown = np.zeros((2, count), bool)
    try:
        inverse, feigned = _invert(A, way, wide)
    except np.linalg.LinAlgError:  # a pole at p
        nothing = np.full(C.shape[:2], np.inf)
        return Found(proved, grown, nothing, nothing, np.full(count, np.nan))
    columns, seen = np.sqrt(2.0 * way.pole) * (inverse @ B), np.sqrt(2.0 * way.pole) * (C @ inverse)
    start = np.multiply(inverse, 2.0 * way.pole, out=wide[2])
    start[:, range(n), range(n)] += 1.0
    square, reach = np.zeros((2, *C.shape[:2]))
    gap, size = np.zeros((count, PROBES)), np.zeros(count)
    with np.errstate(over="ignore", invalid="ignore"):
        for i, lost in enumerate(feigned.tolist()):
            powers, verdict = _square(start[i], lost, way.most, room[4:])
            grown[i], proved[i] = verdict < 0, verdict > 0
            if proved[i] and B.shape[2]:
                total = _summed(powers[:-1], columns[i], room)
                square[i], gap[i] = _seen(powers[-1], total, C[i], A[i], way.probes)
                reach[i], size[i] = _reach(powers, seen[i]), _norm(total)
    driven = way.probes @ B
    lost = _sizes(2.0 * gap + np.vecdot(driven, driven))
    whole = 2.0 * _sizes(A) * size + _sizes(B.swapaxes(1, 2) @ B)
    wrong = lost[:, None] * reach + EPS * np.vecdot(C, C) * size[:, None]
    residual = np.divide(lost, whole, out=np.zeros(count), where=whole != 0.0)
    # A sum that is zero to the bit has no terms: the output sees nothing of what is driven.
    error = np.where(square == 0.0, 0.0, relative_error(wrong, square))
    known = proved[:, None]
    return Found(
        proved,
        grown,
        np.where(known, np.sqrt(np.maximum(square, 0.0)), np.inf),
        np.where(known, error, np.inf),
        np.where(proved, residual, np.nan),
    )


def _square(M: np.ndarray, feigned: float, most: int, room: np.ndarray) -> tuple[list[np.ndarray], int]:
    """Powers of M down to a small one, and 1 where it is proved stable, -1 to grow, 0 where neither is."""
    n, powers, peak = len(M), [M], 1.0
    while True:
        power, k = powers[-1], len(powers) - 1
        size = _norm(power)
        peak = max(peak, size)
        if size < SMALL:
            return powers, int(feigned * peak * peak * 3.0 * 2.0**k < DOUBT)
        if size > GROWN * math.sqrt(n):  # no trace is more than n^1/2 of the norm
            trace = abs(float(power.trace()))
            if trace > GROWN * n and feigned * 2.0**k * size * size < DOUBT * trace * trace:
                return powers, -1
        if k == most or not size < LOST:
            return powers, 0
        powers.append(np.dot(power, power, out=room[k]))


def _invert(A: np.ndarray, way: Way, wide: np.ndarray) -> tuple[np.ndarray, Float[np.ndarray, " loop"]]:
    """(A - p I)^-1; by how much rounding has changed M, as `PROBES` vectors see it, twice."""
    n = A.shape[1]
    moved, inverse = wide[:2]
    np.copyto(moved, A)
    moved[:, range(n), range(n)] -= way.pole
    if len(way.last):
        _invert_parts(moved, way.last, inverse)
    else:
        np.copyto(inverse, np.linalg.inv(moved))
    columns = way.probes.T
    gap = inverse @ (moved @ (inverse @ columns) - columns)
    return inverse, EPS * n + 4.0 * way.pole * _sizes(gap) / np.sqrt(PROBES)


def _invert_parts(S: np.ndarray, last: np.ndarray, out: np.ndarray) -> None:
    """``out`` = S^-1 by the Schur complement of the last block, whose inverse is ``last``."""
    first = S.shape[1] - len(last)
    own, rest = slice(None, first), slice(first, None)
    across, down = S[:, own, rest] @ last, last @ S[:, rest, own]
    inverse = np.linalg.inv(S[:, own, own] - across @ S[:, rest, own])
    out[:, own, own] = inverse
    np.matmul(-inverse, across, out=out[:, own, rest])
    np.matmul(-down, inverse, out=out[:, rest, own])
    np.matmul(down, -out[:, own, rest], out=out[:, rest, rest])
    out[:, rest, rest] += last


def _seen(
    power: np.ndarray, total: np.ndarray, C: np.ndarray, A: np.ndarray, probes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """c X c' of each row of C, v X A' v' of each probe v; X sums P^j Y P'^j of a small P, Y = ``total``."""
    n, outputs, last = len(A), len(C), len(C) + len(probes)
    terms = math.ceil(math.log(LEFT) / (2.0 * math.log(max(_norm(power), EPS))))
    rows = np.empty((terms, last + len(probes), n))
    rows[0, :outputs], rows[0, outputs:last], rows[0, last:] = C, probes, probes @ A
    for j in range(1, terms):
        np.dot(rows[j - 1], power, out=rows[j])
    half = (rows.reshape(-1, n) @ total).reshape(rows.shape)
    square = np.vecdot(half[:, :outputs], rows[:, :outputs]).sum(axis=0)
    return square, np.vecdot(half[:, outputs:last], rows[:, last:]).sum(axis=0)


def _summed(powers: list[np.ndarray], columns: np.ndarray, room: np.ndarray) -> np.ndarray:
    """Sum of M^i Y Y' M'^i over i below 2^len(powers): columns M^i Y while these are few, then X itself."""
    n, w = columns.shape
    few = max(0, min(len(powers), int(np.log2(n / w)) + 1))
    wide = np.empty((n, w * 2**few))
    wide[:, :w] = columns
    for power in powers[:few]:
        np.matmul(power, wide[:, :w], out=wide[:, w : 2 * w])
        w *= 2
    total, half, more, power_t = room[:4]
    np.dot(wide, wide.T, out=total)
    for power in powers[few:]:
        np.dot(power, total, out=half)
        power_t[:] = power.T  # products with a transposed matrix take twice as long as with its copy
        np.dot(half, power_t, out=more)
        total += more
    return total


def _reach(powers: list[np.ndarray], rows: np.ndarray) -> Float[np.ndarray, " output"]:
    """About the sum of |c M^i|^2 over all i, of each row c, from every third power."""
    total = np.vecdot(rows, rows)
    for k in range(0, len(powers), 3):
        moved = rows @ powers[k]
        total += 7.0 * 2.0**k * np.vecdot(moved, moved)
    return total


def _probes(n: int) -> Float[np.ndarray, "probe state"]:
    """Vectors of signs without a pattern that a structure could share (fractional parts of n^2 / sqrt 2)."""
    k = np.arange(1.0, PROBES * n + 1.0)
    return np.where((k * k / np.sqrt(2.0)) % 1.0 < 0.5, -1.0, 1.0).reshape(PROBES, n)


def _sizes(M: np.ndarray) -> Float[np.ndarray, " loop"]:
    """Frobenius norms."""
    flat = M.reshape(len(M), -1)
    return np.sqrt(np.vecdot(flat, flat))


def _norm(M: np.ndarray) -> float:
    """Frobenius norm."""
    flat = M.ravel()
    return math.sqrt(flat.dot(flat))
