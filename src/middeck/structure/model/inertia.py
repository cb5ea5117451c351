"""The moments of inertia that a body can have: no principal one exceeds the sum of the two others."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

ROUNDING = 1e-9
"""Of the largest: flat bodies have equality."""


def impossible_moments(inertia: Float[np.ndarray, "3 3"]) -> tuple[float, float, float] | None:
    """The principal moments, ascending, where no body has them; else None.

    >>> impossible_moments(np.diag([1.0, 1.0, 3.0]))
    (1.0, 1.0, 3.0)
    """
    a, b, c = np.linalg.eigvalsh(inertia).tolist()
    return (a, b, c) if a + b < c * (1.0 - ROUNDING) else None
