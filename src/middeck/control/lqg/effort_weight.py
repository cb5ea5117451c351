"""How dear control effort is: its weight in the cost is one over the authority."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.control.lqg.design_model import LQGProblem


class Weighed(NamedTuple):
    """The cost: squares of the rows C x + D u (performance, shaped inputs), and of u by ``plain``."""

    C: Float[np.ndarray, "row state"]
    D: Float[np.ndarray, "row u"]
    plain: Float[np.ndarray, " u"]


def weigh_effort(model: LQGProblem, authority: float) -> Weighed:
    """The cost at this authority."""
    effort = 1.0 / np.sqrt(authority)
    return Weighed(
        np.vstack([model.C1, effort * model.shaped]),
        np.vstack([model.D12, effort * model.shaped_through]),
        model.plain / authority,
    )
