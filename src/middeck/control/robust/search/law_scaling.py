"""Scaling of a law's states and free entries to similar size and effect on the cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.control.h2.closed_cost import Law, LawCost
from middeck.control.h2.generalized_plant import GeneralizedPlant
from middeck.control.h2.law_form import Free


def even_scale(costs: Sequence[LawCost], integrals: int = 0) -> Float[np.ndarray, " law"]:
    """Scales that equalise covariance and cost of each state except integrals (the diagonal of balancing)."""
    X, P = _diagonals(costs)
    scale = (X / P) ** 0.25
    scale[len(scale) - integrals :] = 1.0
    return scale


def _diagonals(costs: Sequence[LawCost]) -> tuple[np.ndarray, np.ndarray]:
    diagonals: list[np.ndarray] = []
    for name in ("covariance", "worth"):
        mean = np.mean([np.diag(getattr(cost, name)) for cost in costs], axis=0)
        # A state without drive or without effect keeps a size: 1e-6 of the largest in amplitude.
        diagonals.append(np.maximum(mean, max(1e-12 * float(mean.max(initial=0.0)), 1e-300)))
    return diagonals[0], diagonals[1]


def parameter_scale(
    law: Law, free: Free, costs: Sequence[LawCost], even: np.ndarray, models: Sequence[GeneralizedPlant]
) -> Float[np.ndarray, " parameter"]:
    """Step of each free entry for about the same change of the cost.

    An entry A_ij makes x_j drive x_i: its second derivative is about P_ii X_jj times how long x_j lasts, and
    for B and C the noise of a measurement and the price of an input are added.
    """
    covariance, worth = _diagonals(costs)
    X, P = covariance / even**2, worth * even**2
    values = np.abs(np.linalg.eigvals(law.A))
    lasting = 1.0 / max(float(np.median(values)), 1e-300)
    y = np.mean([np.asarray(c.measured) for c in costs], axis=0) * lasting
    u = np.mean([np.asarray(c.pushed) for c in costs], axis=0) * lasting
    noise = np.mean([np.sum(m.D21**2, axis=1) for m in models], axis=0)
    price = np.mean([np.sum(m.D12**2, axis=0) for m in models], axis=0)
    curvature = (
        np.outer(P, X * lasting)[free.A],
        np.outer(P, noise + y)[free.B],
        np.outer(price + u, X)[free.C],
    )
    return 1.0 / np.sqrt(np.maximum(np.concatenate(curvature), 1e-300))
