"""Roots of a loop with exact delays, from the poles of an approximation and the light modes themselves."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.loop.feedback_loop import FeedbackLoop, Halves
from middeck.control.analysis.stability.crowded_roots import Ring, find_crowd, holds_one
from middeck.systems.plants.plant import remove_delays
from middeck.systems.poles.rounding import poles_with_rounding

LIGHT = 0.1
"""Damping ratio below which a pole needs a good approximation at its own frequency."""
NEWTON_STEPS = 12
UNMOVED, BESIDE, NEAR = 1e-9, 1e-8, 1e-5
"""Relative shift by the loop below which a mode's root is found from its open pole, to first order; below
which it is where Newton's method ends at no root, as it does on a pole only known to such a shift; and
how far from the pole an eigenvalue of the loop may then be, which errs more than the mode moves."""
CIRCLE = np.exp(2j * np.pi * np.arange(16) / 16.0)
"""Directions of a mean that keeps the constant term, to the 16th power of the relative radius."""
ON_ROOT = 1e-2
"""|f| at a root beside |f| a thousandth of the way to the next pole: within 1e-5 of that way. Beside a mode
that the loop hardly moves |f| is rounding so near: there a tenth of the way, where Newton's method rests."""
ONE_ROOT, TWO_STARTS = 1e-8, 1e-6
RESTS = 1e-7
"""Relative distance below which the root beside an open pole counts as one already known."""
ROUNDINGS = 10.0
"""Uncertainties of a pole by rounding within which f is not distinguished from f without that pole."""
NEAREST_AXIS = 12
"""Roots followed to the exact delay beside those that are counted."""


def follow_roots(
    halves: Halves, near: np.ndarray, open_poles: np.ndarray, rounding: np.ndarray, reach: float
) -> tuple[Complex[np.ndarray, " root"], Complex[np.ndarray, " root"]]:
    """Roots of the loop, from the poles ``near`` them and the light open poles; and the poles that led to
    none.

    ``rounding`` of each open pole (`find_open_poles`). The latter lead to no root, or lie too far left to be
    followed. Where Newton's method loses a root that counts, a ring may hold all that crowd there.
    """
    upper = near[np.imag(near) >= 0.0]
    upper = upper[np.argsort(-np.real(upper), kind="stable")]
    count = int(np.sum(np.real(upper) > -reach)) + NEAREST_AXIS
    light = open_poles[is_light(open_poles) & (np.abs(open_poles) > 1e-3 * reach)]
    # Start beside the pole, where everything is finite.
    start = np.concatenate([upper[:count], light + 1e-6 * np.abs(light)])
    roots, is_root = _newton(halves, start, open_poles, rounding, reach)
    own = np.arange(len(start)) < len(upper[:count])
    kept = _once(roots, start, own, is_root)
    found, left = roots[kept], start[own & ~is_root]
    lost = np.setdiff1d(np.flatnonzero(own & (np.real(start) > -reach)), kept)
    rings: list[Ring] = []
    for each in start[lost]:
        if any(ring.holds(each) for ring in rings):
            continue
        crowd = find_crowd(lambda s: _determinant(halves, s), each, with_conjugates(upper), open_poles)
        if crowd is not None:
            ring, inside = crowd
            rings.append(ring)
            found = np.append(found[~ring.holds(found)], inside[np.imag(inside) >= 0.0])
            left = left[~ring.holds(left)]
    return with_conjugates(found), with_conjugates(np.append(left, upper[count:]))


def keep_certain(halves: Halves, roots: np.ndarray, open_poles: np.ndarray) -> Complex[np.ndarray, " root"]:
    """The ``roots`` that decay, and of those that grow the ones that a circle right of the axis holds.

    One turn of the determinant around it proves that there is a root, whatever others were overlooked.
    """
    upper = roots[np.imag(roots) >= 0.0]
    kept = []
    for k, s in enumerate(upper):
        others = np.concatenate([open_poles, np.conj(upper[np.imag(upper) > 0.0]), np.delete(upper, k)])
        radius = 0.5 * float(min(s.real, np.abs(others - s).min(initial=np.inf)))
        if s.real <= 0.0 or (radius > 0.0 and holds_one(lambda at: _determinant(halves, at), s, radius)):
            kept.append(s)
    return with_conjugates(np.array(kept, dtype=complex))


def with_conjugates(upper: np.ndarray) -> Complex[np.ndarray, " root"]:
    """``upper`` and real roots, followed by the conjugates of ``upper``."""
    return np.concatenate([upper, np.conj(upper[np.imag(upper) > 0.0])])


def _once(roots: np.ndarray, start: np.ndarray, own: np.ndarray, is_root: np.ndarray) -> list[int]:
    """Numbers of distinct roots; a root is kept twice where two poles of the approximation coincide."""
    kept: list[int] = []
    for i in np.flatnonzero(is_root):
        size = np.abs(roots[i])
        close = ONE_ROOT if own[i] else RESTS
        same = [k for k in kept if np.abs(roots[k] - roots[i]) <= close * size]
        apart = [np.abs(start[k] - start[i]) > TWO_STARTS * size for k in same]
        if not same or (own[i] and not any(apart)):
            kept.append(int(i))
    return kept


def find_open_poles(loop: FeedbackLoop) -> tuple[Complex[np.ndarray, " pole"], Float[np.ndarray, " pole"]]:
    """Poles of plant and compensator, and their shifts by rounding of the entries of the matrices."""
    parts = [poles_with_rounding(A) for A in (remove_delays(loop.plant).system.A, loop.law.A) if len(A)]
    values, rounding = zip((np.zeros(0, dtype=complex), np.zeros(0)), *parts, strict=True)
    return np.concatenate(values), np.concatenate(rounding)


def is_light(poles: np.ndarray) -> np.ndarray:
    """Whether each pole is an upper one that oscillates with little damping."""
    return (np.imag(poles) > 0.0) & (np.abs(np.real(poles)) < LIGHT * np.abs(poles))


def _newton(
    halves: Halves, start: np.ndarray, open_poles: np.ndarray, rounding: np.ndarray, reach: float
) -> tuple[Complex[np.ndarray, " root"], np.ndarray]:
    """Newton's method on f(s) times all (s - p), which has no poles: end points, and which are roots.

    A mode that the loop does not move is a root of this product, though not of f (`_beside_pole`).
    """
    size = np.maximum(np.abs(start), 1e-3 * reach)
    shift = np.abs(start[:, None] - open_poles).min(axis=1, initial=np.inf) / size
    unmoved = shift <= UNMOVED
    s, real = start.copy(), np.imag(start) == 0.0
    s[unmoved], _ = _beside_pole(halves, s[unmoved], open_poles, rounding, 2.0 * UNMOVED)
    on_root = rests = np.zeros(len(s), dtype=bool)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            # Differences over a thousandth of the way to the next pole err by 1e-6 of the slope.
            away = s[:, None] - open_poles
            way = np.abs(away).min(axis=1, initial=np.inf)
            h = 1e-3 * np.where(np.isfinite(way), way, size)
            middle, left, right = _determinant(halves, np.concatenate([s, s - h, s + h])).reshape(3, -1)
            on_root = _vanishes(middle, left, right)
            step = middle / ((right - left) / (2.0 * h) + middle * np.sum(1.0 / away, axis=1))
            rests = np.abs(step) <= 0.1 * ONE_ROOT * size
            s = np.where(np.isfinite(step) & ~unmoved, s - step, s)
            s = np.where(real, np.real(s) + 0.0j, s)
            if np.all(rests | unmoved):
                break
        h = 0.1 * np.abs(s[:, None] - open_poles).min(axis=1, initial=np.inf)
        rests &= _vanishes(*_determinant(halves, np.concatenate([s, s - h, s + h])).reshape(3, -1))
    is_root = unmoved | on_root | rests
    lost = ~is_root & (shift <= NEAR)
    s[lost], is_root[lost] = _beside_pole(halves, start[lost], open_poles, rounding, BESIDE)
    s = np.where(real, np.real(s) + 0.0j, s)
    return np.where(np.imag(s) < 0.0, np.conj(s), s), is_root


def _beside_pole(
    halves: Halves, near: np.ndarray, open_poles: np.ndarray, rounding: np.ndarray, most: float
) -> tuple[Complex[np.ndarray, " root"], np.ndarray]:
    """The root of f = r / (s - p) + c + d (s - p) beside each pole p that is ``near``; and whether it is one.

    More exact than an eigenvalue of the whole loop, whose rounding may exceed the mode's damping. A
    compensator that moves neither a mode nor its estimate has two roots beside the pole, which an eigenvalue
    splits by the root of its rounding: the nearer is taken. Returns ``near`` unchanged where other poles are
    too close, or so close that the pole may lie beside the circle, f then being that of a mode no port
    observes; and where a single root is further than ``most`` of the pole and belongs to another: a copy of
    the mode that no port observes stays on the pole.
    """
    if not len(near):
        return near, np.zeros(0, dtype=bool)
    nearest = np.argmin(np.abs(near[:, None] - open_poles), axis=1)
    pole = open_poles[nearest]
    others = np.abs(pole[:, None] - open_poles)
    others[np.arange(len(near)), nearest] = np.inf
    h = 0.1 * np.minimum(others.min(axis=1), np.abs(pole))
    with np.errstate(all="ignore"):
        there = _determinant(halves, (pole[:, None] + h[:, None] * CIRCLE).ravel()).reshape(-1, len(CIRCLE))
        r, c, d = (np.mean(there * CIRCLE**k, axis=1) for k in (1, 0, -1))
        half = np.sqrt(c**2 - 4.0 * r * d)
        larger = -0.5 * (c + np.where(np.real(np.conj(c) * half) < 0.0, -half, half))
        both = h * np.array([r / larger, larger / d])
        moved = np.where(np.abs(pole + both[1] - near) < np.abs(pole + both[0] - near), both[1], both[0])
        pair = np.abs(both).max(axis=0) < NEAR * np.abs(pole)
    clear = np.isfinite(moved) & (np.abs(moved) < np.where(pair, NEAR, most) * np.abs(pole))
    clear &= (100.0 * np.abs(moved) < h) & (ROUNDINGS * rounding[nearest] < h)
    return np.where(clear, pole + np.where(clear, moved, 0.0), near), clear


def _vanishes(middle: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    beside = np.maximum(np.abs(left), np.abs(right))
    return np.isfinite(beside) & (np.abs(middle) <= ON_ROOT * beside)


def _determinant(halves: Halves, s: np.ndarray) -> Complex[np.ndarray, " point"]:
    G, K = halves(s)
    loop = np.eye(K.shape[1]) - K @ G
    finite = np.isfinite(loop).all(axis=(1, 2))
    value = np.full(len(s), np.nan + 0.0j)
    value[finite] = np.linalg.det(loop[finite])
    return value
