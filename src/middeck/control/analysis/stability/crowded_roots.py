"""Roots that rounding makes indistinguishable, from a ring around all of them.

Rounding splits a double root by its own square root, and one on an open pole is a simple zero beside it:
Newton's method comes to rest nowhere near. Number and sums of powers of the roots in a ring follow from the
determinant on the ring, where it is known (Delves and Lyness 1967, Math. Comp. 21, "A numerical method for
locating the zeros of an analytic function").
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy.cluster.hierarchy as hierarchy
from jaxtyping import Bool, Complex

from middeck.values import record

POINTS = 64
RING = np.exp(2j * np.pi * np.arange(POINTS) / POINTS)
STEP = 1.0
"""Largest change of phase [rad] from point to point at which the turns of a ring are counted."""
APART = 4.0
"""Distance of the next start or pole from the middle of a ring, over that of the farthest inside."""
MEMBERS = 16
"""Most starts and poles in a ring."""
ROUNDINGS = 10.0
"""Roundings of sums of powers within which a root may be on the other side of the axis."""

Determinant = Callable[[np.ndarray], np.ndarray]


@record
class Ring:
    """A circle in the s plane."""

    middle: complex
    radius: float

    def holds(self, s: np.ndarray) -> Bool[np.ndarray, " point"]:
        """Whether each point is inside."""
        return np.abs(s - self.middle) < self.radius


def find_crowd(
    determinant: Determinant, lost: complex, starts: np.ndarray, open_poles: np.ndarray
) -> tuple[Ring, Complex[np.ndarray, " root"]] | None:
    """The narrowest ring around the start ``lost`` that holds as many roots as ``starts``, and these roots.

    None without such a ring. ``starts`` and ``open_poles`` contain their conjugates.
    """
    for ring in _rings(lost, np.concatenate([starts, open_poles])):
        count = int(np.sum(ring.holds(starts)))
        roots = _roots_in(ring, determinant, open_poles[ring.holds(open_poles)], count)
        if roots is not None:
            return ring, roots
    return None


def holds_one(determinant: Determinant, root: complex, radius: float) -> bool:
    """Whether a circle around ``root`` without an open pole inside holds one root, which is then certain."""
    return _roots_in(Ring(root, radius), determinant, np.zeros(0), 1) is not None


def _rings(lost: complex, points: np.ndarray) -> Iterator[Ring]:
    """Rings around ever more of ``points``, wherever the next is well apart from them."""
    near = points[np.argsort(np.abs(points - lost), kind="stable")][: 4 * MEMBERS]
    if len(near) < 2:
        return
    groups = [[k] for k in range(len(near))]
    for first, second in hierarchy.linkage(np.column_stack([near.real, near.imag]), "single")[:, :2]:
        group = groups[int(first)] + groups[int(second)]
        groups.append(group)
        if 0 not in group or len(group) > MEMBERS:
            continue
        middle = complex(np.mean(near[group]))
        if np.conj(lost) in near[group]:
            middle = complex(middle.real)  # a conjugate of each is inside
        extent = float(np.abs(near[group] - middle).max())
        gap = float(np.abs(np.delete(near, group) - middle).min(initial=np.inf))
        if APART * extent < gap < np.inf:
            yield Ring(middle, max(np.sqrt(extent * gap), gap / APART))


def _roots_in(
    ring: Ring, determinant: Determinant, poles: np.ndarray, count: int
) -> Complex[np.ndarray, " root"] | None:
    """The roots in a ring if they are ``count`` and rounding takes none across the axis."""
    s = ring.middle + ring.radius * RING
    with np.errstate(all="ignore"):
        f = determinant(s) * np.prod((s[:, None] - poles) / ring.radius, axis=1) / RING**count
        steps = np.angle(np.roll(f, -1) / f)
    if not np.all(np.abs(steps) < STEP) or round(float(np.sum(steps) / (2.0 * np.pi))):
        return None
    # Harmonics of log f in 1 / (s - middle) are sums of powers of the roots; those between are rounding.
    phase = np.append(0.0, np.cumsum(steps[:-1]))
    harmonics = np.fft.fft(np.log(np.abs(f)) + 1j * phase) / POINTS
    sums = -np.arange(1, count + 1) * harmonics[: -count - 1 : -1]
    rounding = ROUNDINGS * np.abs(harmonics[3 * POINTS // 8 : 5 * POINTS // 8]).max()
    polynomial = _polynomial(sums)
    roots = ring.middle + ring.radius * np.roots(polynomial if ring.middle.imag else np.real(polynomial))
    clear = np.abs(np.real(roots)) > ring.radius * rounding ** (1.0 / count)
    return roots if np.all(clear) else None


def _polynomial(sums: np.ndarray) -> Complex[np.ndarray, " coefficient"]:
    """The monic polynomial whose roots have these sums of powers (Newton's identities)."""
    coefficients = [1.0 + 0.0j]
    for k in range(1, len(sums) + 1):
        coefficients.append(-np.dot(coefficients[::-1], sums[:k]) / k)
    return np.array(coefficients)
