"""Modes that share a frequency: derivatives are of the space that they span, not of each shape."""

from __future__ import annotations

import numpy as np

from middeck.structure.modes.solve import Modes

# Frequencies are equal when their squares differ by less than this part: far above rounding, and far below
# what any measurement tells apart.
EQUAL = 1e-6


def group_modes(modes: Modes, count: int) -> tuple[tuple[int, ...], ...]:
    """Runs of equal frequencies among the lowest ``count``; the rigid modes are one."""
    lam = modes.omega[:count] ** 2
    apart = np.flatnonzero(np.diff(lam) > EQUAL * lam[1:]) + 1
    return tuple(tuple(int(m) for m in g) for g in np.split(np.arange(count), apart) if len(g))
