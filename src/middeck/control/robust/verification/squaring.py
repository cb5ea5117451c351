"""Proofs of stability and growth, and rms, of many loops at once by squaring.

M = (A - p I)^-1 (A + p I) has its eigenvalues within the unit circle exactly where A has its own in the left
half plane, and A X + X A' + B B' = 0 is X = M X M' + 2 p (A - p I)^-1 B B' (A - p I)^-T (Smith 1968, SIAM J.
Appl. Math. 16). Squaring M doubles the terms of X with products of matrices alone, several times quicker
than the iterations of an eigenvalue. A norm of a power below one proves stability, a trace above the number
of states growth; the trace of the next power needs no product.

X is summed where a loop is proved stable, from the powers kept until then. It is not needed to the end: where
a power P is small, c X c' = sum c P^j Y P'^j c' with the Y so far, and a few rows c P^j are cheap. The sum so
far and one term more, Z = Y + P Y P', has the equation A Z + Z A' + B B' = P^2 B B' P'^2, whose error rows v
and v A of fixed v tell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.control.riccati.lyapunov import solve_lyapunov
from middeck.control.robust.verification.shifted_inverses import SharedFactors, find_parts, invert_turned
from middeck.control.robust.verification.single_loop import EPS, relative_error
from middeck.systems.poles.stability import GROWTH_LIMIT
from middeck.systems.state_space.balancing import balance
from middeck.values import record

multiply = sla.get_blas_funcs("gemm", dtype="d")
"""a b (or a b') of matrices stored by columns, added to c if ``beta`` is one, without a copy."""
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
FEIGNED = 1e-11
"""Rounding of M beyond which an inverse is made anew, with pivots across the parts."""


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
    """Values that all loops share: p, the most squarings, the parts of (A - p I)^-1 if any, and probes."""

    pole: float
    most: int
    parts: SharedFactors | None
    probes: np.ndarray


def share_way(A: np.ndarray, scale: np.ndarray) -> Way:
    """The values that all loops ``A`` share in the units ``scale``."""
    pole = _middle(np.linalg.eigvals(A[0]))
    most = int(np.clip(np.log2(pole / GROWTH_LIMIT) - 3.0, 0, SQUARINGS))
    return Way(pole, most, find_parts(A, scale, pole), _probes(A.shape[1]))


@record(kw_only=True)
class RmsProof:
    """Loops proved stable, and proved to grow; rms of the former, their errors, and residuals."""

    proved: np.ndarray
    grown: np.ndarray
    rms: np.ndarray
    error: np.ndarray
    residual: np.ndarray


def square_loops(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, way: Way, room: np.ndarray, wide: np.ndarray
) -> RmsProof:
    """Inverses of all loops at once, then loop by loop, so that its few powers stay in the cache.

    ``room`` holds a matrix for each power and two more, ``wide`` two for each loop: memory that is asked
    for anew costs as much as the products.
    """
    count, n = A.shape[:2]
    proved, grown = np.zeros((2, count), bool)
    try:
        turned, feigned = _invert(A, way, wide)
    except np.linalg.LinAlgError:  # a pole at p
        nothing = np.full(C.shape[:2], np.inf)
        return RmsProof(
            proved=proved, grown=grown, rms=nothing, error=nothing, residual=np.full(count, np.nan)
        )
    inverse, root = turned.swapaxes(1, 2), math.sqrt(2.0 * way.pole)
    columns, seen = root * (inverse @ B), root * (C @ inverse)
    turned *= 2.0 * way.pole
    turned[:, range(n), range(n)] += 1.0
    stores = [M.T for M in room]
    square, reach = np.zeros((2, *C.shape[:2]))
    gap, size = np.zeros((count, PROBES)), np.zeros(count)
    with np.errstate(over="ignore", invalid="ignore"):
        for i, lost in enumerate(feigned.tolist()):
            powers, verdict = _square(turned[i].T, lost, way.most, stores[2:])
            grown[i], proved[i] = verdict < 0, verdict > 0
            if proved[i] and B.shape[2]:
                total = _summed(powers[:-1], columns[i], stores)
                square[i] = _seen(powers[-1], total, C[i])
                gap[i] = _gap(powers[-1], total, A[i], B[i], way.probes)
                reach[i], size[i] = _reach(powers, seen[i]), _norm(total)
    lost = _sizes(gap)
    whole = 2.0 * _sizes(A) * size + _sizes(B.swapaxes(1, 2) @ B)
    wrong = lost[:, None] * reach + EPS * np.vecdot(C, C) * size[:, None]
    residual = np.divide(lost, whole, out=np.zeros(count), where=whole != 0.0)
    # A sum that is zero to the bit has no terms: the output sees nothing of what is driven.
    error = np.where(square == 0.0, 0.0, relative_error(wrong, square))
    known = proved[:, None]
    return RmsProof(
        proved=proved,
        grown=grown,
        rms=np.where(known, np.sqrt(np.maximum(square, 0.0)), np.inf),
        error=np.where(known, error, np.inf),
        residual=np.where(proved, residual, np.nan),
    )


def _square(
    M: np.ndarray, feigned: float, most: int, stores: list[np.ndarray]
) -> tuple[list[np.ndarray], int]:
    """Powers of M down to a small one, and 1 where it is proved stable, -1 to grow, 0 where neither is."""
    powers, peak, enough, trace = [M], 1.0, GROWN * len(M), 0.0
    while True:
        power, k = powers[-1], len(powers) - 1
        size = _norm(power)
        most_trace = size * size  # largest trace of the next power
        peak = max(peak, size)
        if size < SMALL:
            return powers, int(feigned * peak * peak * 3.0 * 2.0**k < DOUBT)
        if trace > enough and feigned * 2.0**k * most_trace < DOUBT * trace * trace:
            return powers, -1
        if most_trace > enough:
            trace = abs(float(power.ravel().dot(power.ravel("K"))))
            if trace > enough and feigned * 2.0 ** (k + 1) * most_trace * most_trace < DOUBT * trace * trace:
                return powers, -1
        if k == most or not size < LOST:
            return powers, 0
        powers.append(multiply(1.0, power, power, c=stores[k], overwrite_c=1))


def _invert(A: np.ndarray, way: Way, wide: np.ndarray) -> tuple[np.ndarray, Float[np.ndarray, " loop"]]:
    """(A - p I)^-T; by how much rounding has changed M, as `PROBES` vectors see it, twice."""
    n = A.shape[1]
    moved, turned = wide
    np.copyto(moved, A)
    moved[:, range(n), range(n)] -= way.pole
    anew = np.ones(len(A), bool)
    if way.parts is not None:
        with np.errstate(all="ignore"):  # a part may have a pole at p
            invert_turned(moved, way.parts, turned)
        feigned = _feigned(moved, turned, way)
        anew = ~(feigned < FEIGNED)
    if anew.any():
        turned[anew] = np.linalg.inv(moved[anew]).swapaxes(1, 2)
        feigned = _feigned(moved, turned, way)
    return turned, feigned


def _feigned(moved: np.ndarray, turned: np.ndarray, way: Way) -> Float[np.ndarray, " loop"]:
    """Twice the change of M by rounding, as `PROBES` vectors see it."""
    inverse, columns = turned.swapaxes(1, 2), way.probes.T
    gap = inverse @ (moved @ (inverse @ columns) - columns)
    return EPS * moved.shape[1] + 4.0 * way.pole * _sizes(gap) / math.sqrt(PROBES)


def _seen(power: np.ndarray, total: np.ndarray, C: np.ndarray) -> Float[np.ndarray, " output"]:
    """c X c' of each row of C; X sums P^j Y P'^j of a small P, Y = ``total``."""
    terms = math.ceil(math.log(LEFT) / (2.0 * math.log(max(_norm(power), EPS))))
    rows = np.empty((terms, *C.shape))
    rows[0] = C
    for j in range(1, terms):
        np.dot(rows[j - 1], power, out=rows[j])
    half = (rows.reshape(-1, len(power)) @ total).reshape(rows.shape)
    return np.vecdot(half, rows).sum(axis=0)


def _gap(
    power: np.ndarray, total: np.ndarray, A: np.ndarray, B: np.ndarray, probes: np.ndarray
) -> Float[np.ndarray, " probe"]:
    """v (A Z + Z A' + B B' - P^2 B B' P'^2) v' of each probe v; Z = Y + P Y P', Y = ``total``."""
    first = np.concatenate([probes, probes @ A])
    second = first @ power
    half = np.concatenate([first[:PROBES], second[:PROBES]]) @ total
    crossed = np.vecdot(half, np.concatenate([first[PROBES:], second[PROBES:]])).reshape(2, -1).sum(axis=0)
    driven, left = probes @ B, second[:PROBES] @ power @ B
    return 2.0 * crossed + np.vecdot(driven, driven) - np.vecdot(left, left)


def _summed(powers: list[np.ndarray], columns: np.ndarray, stores: list[np.ndarray]) -> np.ndarray:
    """Sum of M^i Y Y' M'^i over i below 2^len(powers): columns M^i Y while these are few, then X itself."""
    n, w = columns.shape
    few = max(0, min(len(powers), int(np.log2(n / w)) + 1))
    wide = np.empty((w * 2**few, n))
    wide[:w] = columns.T
    for power in powers[:few]:
        np.dot(wide[:w], power.T, out=wide[w : 2 * w])
        w *= 2
    total = multiply(1.0, wide.T, wide.T, c=stores[0], trans_b=1, overwrite_c=1)
    for power in powers[few:]:
        half = multiply(1.0, power, total, c=stores[1], trans_b=1, overwrite_c=1)
        total = multiply(1.0, half, power, beta=1.0, c=total, trans_b=1, overwrite_c=1)
    return total


def _reach(powers: list[np.ndarray], rows: np.ndarray) -> Float[np.ndarray, " output"]:
    """About the sum of |c M^i|^2 over all i, of each row c, from every third power."""
    total = np.vecdot(rows, rows)
    for k in range(0, len(powers), 3):
        moved = rows.dot(powers[k])
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
    flat = M.ravel("K")
    return math.sqrt(flat.dot(flat))
