"""Where a search for a rest state ended, and what counts as rest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from middeck.structure.assembly.energy import Assembly
from middeck.structure.elements.frames import Configuration

# Largest imbalance that counts as rest, over `imbalance_scale`.
TOLERANCE = 1e-9
# And where Newton's undamped step moves nothing by more than `UNMOVED` of what has moved since drawn:
# rounding is what is left, in a support of 1e12 N/m 1e-7 of a weight.
ROUNDED = 1e-6
UNMOVED = 1e-12
# Least damping [1/s^2]: a thousandth of a slow pendulum's omega^2 neither holds nor hurries anything.
LEAST_DAMPING = 1e-3
# And of the largest omega^2, whose rounding is 1e-16 of it.
NEUTRAL = 1e-12
DAMPING_STEP = 4.0
# Beyond any omega^2 of a structure: what is still indefinite has no mass.
MOST_DAMPING = 1e20
# Largest `deformation` in one step: what the second-order chart follows well.
LONGEST_STEP = 0.5


class Settled(NamedTuple):
    """Where Newton ended, and (load factor, residual, damping) of every iteration on the way.

    The residual counts as rest below ``enough``. ``followed`` says that it is the branch of the drawn state.
    """

    config: Configuration
    assembly: Assembly
    residual: float
    enough: float
    history: tuple[tuple[float, float, float], ...]
    stable: bool
    followed: bool = False


def holding(K: sp.csr_array, M: sp.csr_array) -> sp.csr_array:
    """K with so much more stiffness that rounding drives no motion that nothing holds.

    It is `LEAST_DAMPING` of the mass, or less in an article so large and soft that this would hold it.
    """
    k, m = np.abs(K.diagonal()), M.diagonal()
    fastest = float((k[m > 0.0] / m[m > 0.0]).max(initial=0.0))
    return sp.csr_array(K + min(LEAST_DAMPING, NEUTRAL * fastest or LEAST_DAMPING) * M)
