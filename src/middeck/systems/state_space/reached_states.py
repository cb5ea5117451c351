"""States that others drive, by the zeros of A."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float


def reached_states(
    A: Float[np.ndarray, "state state"], first: Bool[np.ndarray, " state"]
) -> Bool[np.ndarray, " state"]:
    """The states ``first`` and all that they drive; with A', those that drive them.

    >>> reached_states(np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([True, False]))
    array([ True,  True])
    """
    moves, reached = A != 0.0, first
    for _ in range(len(A)):
        reached = reached | np.any(moves[:, reached], axis=1)
    return reached
