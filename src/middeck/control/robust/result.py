"""What every robust design returns, and how it got there."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.law.compensator import Compensator
from middeck.values import record


@record(kw_only=True)
class Stage:
    """One leg of the way to a design.

    Parameters
    ----------
    size:
        Of the perturbations, from 0 (the nominal model) to 1; of sensitivity weighting the strength tried.
    authority_ratio:
        Authority over the one asked for.
    discount:
        Decay [rad/s] lent to all states while the law does not yet stabilise.
    cost:
        At the end of the leg.
    evaluations:
        Of the cost and its gradient, all models each time.
    """

    size: float
    authority_ratio: float
    discount: float
    cost: float
    evaluations: int


@record(kw_only=True)
class RobustCompensator(Compensator):
    """A compensator made for more than one plant.

    Parameters
    ----------
    authority:
        1/rho.
    order:
        Free states; fixed filters and integrals have theirs beside.
    cost:
        What was minimised: the mean or the maximum over the models, a bound, or a weighted cost.
    costs:
        E[z' W^2 z + rho u' R u] on each design model, the nominal one first; ``inf`` where unstable. With a
        `Shaping`, of what its filters and integrals make of them.
    gradient:
        Norm of the gradient over the cost where the method descends, in coordinates of unit size; the largest
        relative residual where it solves Riccati equations.
    history:
        The legs of the way.
    inert:
        Modes of the nominal plant that no port reaches or sees.
    """

    authority: float
    order: int
    cost: float
    costs: Float[np.ndarray, " model"]
    gradient: float
    history: tuple[Stage, ...]
    inert: tuple[str, ...]
