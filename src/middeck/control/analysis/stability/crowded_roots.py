"""Roots that rounding does not tell apart, from a ring around all of them.

Rounding splits a double root by its own square root, and what lies on an open pole is a simple zero beside
it: Newton's method rests nowhere near. Number and sums of powers of the roots in a ring go by the determinant
on the ring alone, where it is known (Delves and Lyness 1967, Math. Comp. 21, "A numerical method for locating
the zeros of an analytic function").
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy.cluster.hierarchy as hierarchy
from jaxtyping import Complex, Float

from middeck.values import record

POINTS = 64
RING = np.exp(2j * np.pi * np.arange(POINTS) / POINTS)
STEP = 1.0
"""Largest change of phase [rad] from point to point that tells how often a ring is turned."""
APART = 4.0
"""Distance of the next start or pole from the middle of a ring, beside that of the farthest in it."""
MEMBERS = 16
"""Most starts and poles in a ring."""
ROUNDINGS = 10.0
"""Roundings of sums of powers within which a root may be on the other side of the axis."""


@record
class Ring:
    """A circle in the s plane."""

    middle: complex
    radius: float

    def holds(self, s: np.ndarray) -> np.ndarray:
        """Which points are inside."""
        return np.abs(s - self.middle) < self.radius


def find_crowded(
    determinant: Callable[[np.ndarray], np.ndarray], lost: complex, starts: np.ndarray, open_poles: np.ndarray
) -> tuple[Ring, Complex[np.ndarray, " root"]] | None:
    """The narrowest ring around the start ``lost`` that holds as many roots as ``starts``, and these roots;
    None without one. ``starts`` and ``open_poles`` with their conjugates."""
    for ring in _rings(lost, np.concatenate([starts, open_poles])):
        count = int(np.sum(ring.holds(starts)))
        roots = _roots_in(ring, determinant, open_poles[ring.holds(open_poles)], count)
        if roots is not None:
            return ring, roots
    return None


def _rings(lost: complex, points: np.ndarray) -> Iterator[Ring]:
    """Rings around ever more of ``points``, wherever the next is well apart from them."""
    near = points[np.argsort(np.abs(points - lost), kind="stable")][: 4 * MEMBERS]
    links = hierarchy.linkage(np.column_stack([np.real(near), np.imag(near)]), "single")
    groups = [np.array([k]) for k in range(len(near))]
    for first, second in links[:, :2].astype(int):
        groups.append(np.concatenate([groups[first], groups[second]]))
    for group in (g for g in groups if 0 in g and 1 < len(g) <= MEMBERS):
        middle = complex(np.mean(near[group]))
        if np.conj(lost) in near[group]:
            middle = complex(middle.real)
        extent = float(np.abs(near[group] - middle).max())
        gap = float(np.abs(np.delete(near, group) - middle).min(initial=np.inf))
        if APART * extent < gap < np.inf:
            yield Ring(middle, max(np.sqrt(extent * gap), gap / APART))


def _roots_in(
    ring: Ring, determinant: Callable[[np.ndarray], np.ndarray], poles: np.ndarray, count: int
) -> Complex[np.ndarray, " root"] | None:
    """The roots in a ring if they are ``count`` and none may be on either side of the axis."""
    s = ring.middle + ring.radius * RING
    with np.errstate(all="ignore"):
        f = determinant(s) * np.prod((s[:, None] - poles) / ring.radius, axis=1) / RING**count
        steps = np.angle(np.roll(f, -1) / f)
    if not np.all(np.abs(steps) < STEP) or abs(np.sum(steps)) > 1.0:
        return None
    # log f: harmonics in 1 / (s - middle) are sums of powers of the roots, those of the highest order
    # rounding.
    phase = np.concatenate([[0.0], np.cumsum(steps[:-1])])
    harmonics = np.fft.fft(np.log(np.abs(f)) + 1j * phase) / POINTS
    sums = -np.arange(1, count + 1) * harmonics[:-count - 1 : -1]
    rounding = ROUNDINGS * np.abs(harmonics[3 * POINTS // 8 : 5 * POINTS // 8]).max()
    polynomial = _polynomial(sums if ring.middle.imag else np.real(sums) + 0.0j)
    roots = ring.middle + ring.radius * np.roots(polynomial if ring.middle.imag else np.real(polynomial))
    moved = ring.radius * rounding ** (1.0 / count)
    return roots if np.all(np.abs(np.real(roots)) > moved) else None


def _polynomial(sums: np.ndarray) -> Complex[np.ndarray, " coefficient"]:
    """The monic polynomial of which the powers of the roots have these sums (Newton's identities)."""
    coefficients = [1.0 + 0.0j]
    for k in range(1, len(sums) + 1):
        coefficients.append(-np.dot(coefficients[::-1], sums[:k]) / k)
    return np.array(coefficients)
