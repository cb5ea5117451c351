"""Leverage of each line: the share of its error that a model follows because it has seen the line."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.identification.problem.data import Data
from middeck.identification.problem.normal_equations import ZeroSum
from middeck.identification.problem.residual_and_slopes import Terms
from middeck.identification.problem.transient_projection import as_real
from middeck.identification.search.refine_and_reweigh import SearchedModel

# Directions in which unknowns of like effect change a response by a smaller share than this follow nothing.
WEAK = 1e-5


def leverage(
    data: Data, run: SearchedModel, variance: Float[np.ndarray, "output line column"]
) -> Float[np.ndarray, "output line column"]:
    """Diagonal of the hat matrix of a model of a response, mean of real and imaginary part.

    An error left over a line is that of the model fitted without it times one less this (Cook and Weisberg
    1982, section 2.2), to first order.
    """
    terms, late = Terms(run.layout, data, run.refined.theta), int(np.prod(run.layout.delays))
    tied, linear, own, slopes = ZeroSum(run.layout, terms.point), run.refined.step.linear, [], []
    for o, weight in enumerate(1.0 / np.sqrt(variance)):
        A, J = (as_real(rows * weight) for rows in (terms.columns(o), terms.slopes(linear[o], o)))
        J[: len(J) - late] += tied.moved(linear[o], A)
        Q = _directions(tied.free(A))
        own.append(np.sum(Q**2, axis=0))
        slopes.append(J - (J @ Q.T) @ Q)
    shared = _directions(np.hstack(slopes))
    return (np.concatenate(own) + np.sum(shared**2, axis=0)).reshape(*data.H.shape, 2).mean(axis=3)


def _directions(rows: Float[np.ndarray, "row number"]) -> Float[np.ndarray, "row number"]:
    """Orthogonal rows of the same span, of length one but for weak ones."""
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    _, strength, found = np.linalg.svd(rows / np.where(size > 0.0, size, 1.0), full_matrices=False)
    return found * (strength / np.hypot(strength, WEAK))[:, None]
