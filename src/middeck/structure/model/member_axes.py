"""Own axes of members: the direction that stands in for one that nobody gave."""

import numpy as np
from jaxtyping import Float


def default_up(along: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """World y, or world x for a member within eight degrees of upright.

    >>> default_up(np.array([0.0, 2.0, 0.0])).tolist()
    [1.0, 0.0, 0.0]
    """
    upright = abs(along[1]) > 0.99 * np.linalg.norm(along)
    return np.array([1.0, 0.0, 0.0] if upright else [0.0, 1.0, 0.0])
