"""The linear-quadratic regulator of a design model (Kwakernaak and Sivan 1972, chapter 3)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.lqg.design_model import LQGProblem, append_integrals, require_finite_cost, weigh_effort
from middeck.control.riccati.continuous import RiccatiSolution, solve_riccati
from middeck.values import record


@record
class Regulator:
    """Gain and Riccati solution on the states of the model, then its integrals; ``R`` weights u."""

    solution: RiccatiSolution
    R: Float[np.ndarray, "u u"]


def design_regulator(model: LQGProblem, authority: float) -> Regulator:
    """Minimise E[z'z + u'Ru] on the states of ``model`` and its integrals."""
    require_finite_cost(model)
    A, B = append_integrals(model.A, model.control, model.C2, model.D22, model.integral)
    C, D, plain = weigh_effort(model, authority)
    n, count = len(model.A), len(model.integral)
    Q, S = np.zeros((n + count, n + count)), np.zeros((n + count, B.shape[1]))
    Q[:n, :n], S[:n] = C.T @ C, C.T @ D
    Q[n:, n:] = np.diag(model.integral_weight**2)
    R = D.T @ D + np.diag(plain)
    solution = solve_riccati(
        A,
        B,
        Q,
        R,
        S,
        names=(*model.names, *model.integral_names),
        complaint="no control input in u reaches it",
    )
    return Regulator(solution, R)
