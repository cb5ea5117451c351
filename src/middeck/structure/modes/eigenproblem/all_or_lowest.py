"""All modes of a pair, or its lowest: whichever costs less."""

from __future__ import annotations

import scipy.sparse as sp

from middeck.structure.assembly.factorisation import order
from middeck.structure.modes.eigenproblem.eigen import Eigenpairs, Soft, solve_all, solve_lowest

SMALL = 600
"""Up to so many coordinates all modes cost less than a few."""


def all_cost_less(K: sp.csr_array, count: int = 0) -> bool:
    """Whether all modes cost less than the lowest ``count``."""
    return order(K) <= max(SMALL, 4 * count)


def solve_pairs(K: sp.csr_array, M: sp.csr_array, count: int | None, soft: Soft = None) -> Eigenpairs | None:
    """At least the lowest ``count`` modes, all for None; None where a massless motion has no stiffness."""
    if count is None or all_cost_less(K, count):
        return solve_all(K, M, soft)
    return solve_lowest(K, M, count, soft)
