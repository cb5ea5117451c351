"""When a tracker is not to be trusted: its innovations say so.

If the model holds, what an output brings that was not foreseen is white and as large as stated (Mehra 1970).
The means of its products at lags 0 to 16 are kept with a memory of a thousand samples.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

WATCHED = 16  # lags: half a cycle of a mode at a thirtieth of the rate
MEMORY = 1024  # samples
# Standard deviations by which a mean may be off: once in a million for one of them.
LIMIT = 5.0


def is_trusted(products: Float[np.ndarray, " lag"], weight: float, outputs: int) -> bool:
    """Whether size and whiteness are those of chance; True before anything can be said."""
    if weight < 0.1:
        return True
    means = products / weight
    # Samples of even weight that scatter as much, (sum w)^2 / sum w^2: 2 M in the end.
    count = 2.0 * MEMORY * outputs * weight / (2.0 - weight)
    size = (means[0] - 1.0) / np.sqrt(2.0 / count)
    white = count * np.sum((means[1:] / max(means[0], np.finfo(float).tiny)) ** 2)
    return bool(abs(size) < LIMIT and (white - WATCHED) < LIMIT * np.sqrt(2.0 * WATCHED))
