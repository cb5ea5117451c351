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

from collections.abc import Sequence
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
WAITS = 0.02
"""Norm down to which a loop waits for others: to part their powers takes as long as two squarings."""
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


class _Level(NamedTuple):
    """A power of M for the loops ``at``, in rising order."""

    at: np.ndarray
    power: np.ndarray

    def of(self, some: np.ndarray) -> np.ndarray:
        return self.power if len(some) == len(self.at) else self.power[np.searchsorted(self.at, some)]


class Found(NamedTuple):
    """Which loops are proved stable and which to grow; of the proved, rms, their errors, and residuals."""

    proved: np.ndarray
    grown: np.ndarray
    rms: np.ndarray
    error: np.ndarray
    residual: np.ndarray


def square_loops(A: np.ndarray, B: np.ndarray, C: np.ndarray, way: Way, room: np.ndarray) -> Found:
    """``room`` holds a matrix for each power and three more, so that no memory is asked for in the loop."""
    count, n = A.shape[:2]
    proved, grown = np.zeros((2, count), bool)
    rms, error = np.full((2, *C.shape[:2]), np.inf)
    found = Found(proved, grown, rms, error, np.full(count, np.nan))
    inverse, feigned = room[0, :count], np.zeros(count)
    try:
        feigned = _invert(A, way, inverse, room[1, :count])
    except np.linalg.LinAlgError:  # a pole at p
        return found
    ends = np.sqrt(2.0 * way.pole) * (inverse @ B), np.sqrt(2.0 * way.pole) * (C @ inverse)
    power = np.multiply(inverse, 2.0 * way.pole, out=room[3, :count])
    power[:, range(n), range(n)] += 1.0
    left, peak, levels = np.arange(count), np.ones(count), list[_Level]()
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(way.most + 1):
            levels.append(_Level(left, power))
            size, trace = _size(power), np.abs(np.trace(power, axis1=1, axis2=2))
            peak = np.fmax(peak, size)
            grows = (trace > GROWN * n) & (feigned * 2.0**k * size**2 < DOUBT * trace**2)
            falls = size < SMALL
            if not (falls | grows).all() and size.min() > WAITS:
                falls[:] = False
            if (falls | grows | ~(size < LOST)).any():
                grown[left[grows]], at = True, left[falls]
                proved[at] = (feigned * peak**2 * 3.0 * 2.0**k < DOUBT)[falls]
                if len(at):
                    own = [M if len(at) == count else M[at] for M in (A, B, C, *ends)]
                    some = _measure([level.of(at) for level in levels], own, way, room)
                    rms[at], error[at], found.residual[at] = some
                kept = ~(grows | falls) & (size < LOST)
                left, power, feigned, peak = (x[kept] for x in (left, power, feigned, peak))
            if not len(left) or k == way.most:
                break
            power = np.matmul(power, power, out=room[4 + k, : len(left)])
    return found


def _invert(A: np.ndarray, way: Way, out: np.ndarray, work: np.ndarray) -> Float[np.ndarray, " loop"]:
    """``out`` = (A - p I)^-1; by how much rounding has changed M, as `PROBES` vectors see it, twice."""
    n = A.shape[1]
    np.copyto(work, A)
    work[:, range(n), range(n)] -= way.pole
    if len(way.last):
        _invert_parts(work, way.last, out)
    else:
        np.copyto(out, np.linalg.inv(work))
    columns = way.probes.T
    gap = out @ (work @ (out @ columns) - columns)
    return EPS * n + 4.0 * way.pole * _size(gap) / np.sqrt(PROBES)


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


def _measure(
    powers: list[np.ndarray], own: Sequence[np.ndarray], way: Way, room: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rms, their relative errors and the residual, from the powers of M down to a small one.

    ``own``: A, B, C, (2 p)^1/2 (A - p I)^-1 B and (2 p)^1/2 C (A - p I)^-1 of each loop.
    """
    A, B, C, columns, seen = own
    (count, n), outputs = A.shape[:2], C.shape[1]
    if not B.shape[2]:
        return np.zeros((count, outputs)), np.zeros((count, outputs)), np.zeros(count)
    total = _summed(powers[:-1], columns, room)
    terms = int(np.ceil(np.log(LEFT) / (2.0 * np.log(_size(powers[-1]).max(initial=EPS)))))
    rows, last = np.empty((count, terms, outputs + 2 * PROBES, n)), outputs + PROBES
    rows[:, 0, :outputs], rows[:, 0, outputs:last], rows[:, 0, last:] = C, way.probes, way.probes @ A
    for j in range(1, terms):
        np.matmul(rows[:, j - 1], powers[-1], out=rows[:, j])
    half = (rows.reshape(count, -1, n) @ total).reshape(rows.shape)
    square = np.einsum("lpij,lpij->li", half[:, :, :outputs], rows[:, :, :outputs])
    gap = 2.0 * np.einsum("lpij,lpij->li", half[:, :, outputs:last], rows[:, :, last:])
    driven, size = way.probes @ B, _size(total)
    gap = _size(gap + np.vecdot(driven, driven))
    whole = 2.0 * _size(A) * size + _size(B.swapaxes(1, 2) @ B)
    wrong = gap[:, None] * _reach(powers, seen) + EPS * np.vecdot(C, C) * size[:, None]
    residual = np.divide(gap, whole, out=np.zeros(count), where=whole != 0.0)
    # A sum that is zero to the bit has no terms: the output sees nothing of what is driven.
    error = np.where(square == 0.0, 0.0, relative_error(wrong, square))
    return np.sqrt(np.maximum(square, 0.0)), error, residual


def _summed(powers: list[np.ndarray], columns: np.ndarray, room: np.ndarray) -> np.ndarray:
    """Sum of M^i Y Y' M'^i over i below 2^len(powers): columns M^i Y while these are few, then X itself."""
    count, n, w = columns.shape
    few = max(0, min(len(powers), int(np.log2(n / w)) + 1))
    wide = np.empty((count, n, w * 2**few))
    wide[:, :, :w] = columns
    for power in powers[:few]:
        np.matmul(power, wide[:, :, :w], out=wide[:, :, w : 2 * w])
        w *= 2
    total, half, more = room[:3, :count]
    np.matmul(wide, wide.swapaxes(1, 2), out=total)
    for power in powers[few:]:
        np.matmul(power, total, out=half)
        np.matmul(half, power.swapaxes(1, 2), out=more)
        total += more
    return total


def _reach(powers: list[np.ndarray], rows: np.ndarray) -> Float[np.ndarray, "loop output"]:
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


def _size(M: np.ndarray) -> Float[np.ndarray, " loop"]:
    """Frobenius norms."""
    flat = M.reshape(len(M), -1)
    return np.sqrt(np.vecdot(flat, flat))
