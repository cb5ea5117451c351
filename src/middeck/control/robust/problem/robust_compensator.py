"""Results common to all robust designs, with the stages of their search."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.law.compensator import Compensator
from middeck.values import record


@record(kw_only=True)
class Attempt:
    """One stage of the search for a design.

    Attributes:
        size: Size of the perturbations from 0 (nominal model) to 1; for sensitivity weighting the strength
            tried.
        cost: Cost at the end of the stage.
    """

    size: float
    cost: float


@record(kw_only=True)
class RobustCompensator(Compensator):
    """A compensator made for more than one plant.

    Attributes:
        authority: 1/rho.
        order: Number of free states, without those of fixed filters and integrals.
        cost: Value minimised: the mean or the maximum over the models, a bound, or a weighted cost.
        costs: E[z' W^2 z + rho u' R u] on each design model, the nominal one first; ``inf`` where unstable.
            With a `Shaping`, of what its filters and integrals make of them.
        gradient: Norm of the gradient over the cost where the method descends, in coordinates of unit size;
            the largest relative residual where it solves Riccati equations.
        history: Stages of the search.
        inert: Uncontrollable and unobservable modes of the nominal plant.
    """

    authority: float
    order: int
    cost: float
    costs: Float[np.ndarray, " model"]
    gradient: float
    history: tuple[Attempt, ...]
    inert: tuple[str, ...]
