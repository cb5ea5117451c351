"""Repeated frequencies: groups of modes whose basis is arbitrary."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

# Modes whose omega^2 differ by less, relative to the larger, have one frequency: any basis of theirs will do.
REPEATED = 1e-6


def repeated(lam: Float[np.ndarray, " mode"]) -> list[Int[np.ndarray, " member"]]:
    """Indices of the modes of each frequency that several have; ``lam`` is omega^2 in any order."""
    ascending = np.argsort(lam, kind="stable")
    size = np.abs(lam[ascending])
    apart = np.diff(lam[ascending]) > REPEATED * np.maximum(size[1:], size[:-1])
    return [c for c in np.split(ascending, np.flatnonzero(apart) + 1) if len(c) > 1]
