"""Second-order contribution of the unknowns to a prediction, beyond the linear estimate (`curvature`)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.updating.refinement.problem import linear_problem
from middeck.updating.refinement.refine import Refined


def bend_of(
    refined: Refined,
    root: Float[np.ndarray, "mode both"],
    curvature: Float[np.ndarray, "mode unknown unknown"],
) -> Float[np.ndarray, "2 mode"]:
    """Mean and deviation of the second-order part of predicted ln f, from ``root`` and ``curvature``.

    Tests that are bent themselves move the estimate: what a prediction shares with them cancels. Nothing
    where friction of joints gives each measured mode an article of its own.
    """
    if any(c.survey.friction for c in refined.compared):
        return np.zeros((2, len(root)))
    found, unknowns = refined.estimate, refined.unknowns
    spread = np.array([u.spread for u in unknowns])
    tests = refined.compared, refined.statics, refined.fields
    problem = linear_problem(*tests, np.zeros(len(spread)), spread, refined.responses, refined.damped)
    noise = problem.std**2 + problem.rest * found.tau[problem.row_sort] ** 2
    gain = root @ found.root.T @ (np.hstack([problem.J, problem.S]).T / noise)
    left, row = curvature, 0
    for one, bent in zip(refined.compared, refined.bent_tests, strict=True):
        left = left - np.tensordot(gain[:, row : row + len(bent)], bent, 1)
        row += len(one.residual)
    own = found.root[: len(unknowns)]
    quadratic = np.einsum("ap,mab,bq->mpq", own, left, own, optimize=True)
    mean = 0.5 * np.trace(quadratic, axis1=1, axis2=2)
    return np.array([mean, np.sqrt(0.5 * np.sum(quadratic**2, axis=(1, 2)))])
