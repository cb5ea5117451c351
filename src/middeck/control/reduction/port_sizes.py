"""Systems with their ports in units of typical sizes, in which gains of unlike ports compare, and back."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.systems.state_space.statespace import StateSpace

Sizes = Float[np.ndarray, " port"]


def in_sizes(system: StateSpace, input_size: Sizes, output_size: Sizes) -> StateSpace:
    """The system with its ports scaled to their sizes."""
    u, y = input_size, output_size[:, None]
    return StateSpace(system.A, system.B * u, system.C / y, system.D * u / y)


def out_of_sizes(system: StateSpace, input_size: Sizes, output_size: Sizes) -> StateSpace:
    """The system with its ports scaled back to their units."""
    return in_sizes(system, 1.0 / input_size, 1.0 / output_size)
