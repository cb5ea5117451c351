"""Optimal compensator of one model: two Riccati equations (Kwakernaak and Sivan 1972, chapter 5)."""

import numpy as np
import scipy.linalg as sla

from middeck.control.h2.closed_cost import Law
from middeck.control.h2.generalized_plant import GeneralizedPlant
from middeck.control.h2.law_form import decouple
from middeck.control.lqg.design_model import append_integrals, join_estimator
from middeck.control.riccati.continuous import RiccatiSolution, solve_riccati
from middeck.systems.state_space.statespace import StateSpace


def solve_lqg(model: GeneralizedPlant) -> tuple[Law, RiccatiSolution, RiccatiSolution, float]:
    """The optimal `Law` with its integrals, the solutions of regulator and filter, and the cost."""
    rows, n = [row for row, _ in model.integrals], len(model.A)
    A, B = append_integrals(model.A, model.B2, model.C2, model.D22, rows)
    price = model.D12.T @ model.D12
    Q = np.asarray(sla.block_diag(model.C1.T @ model.C1, np.diag([w**2 for _, w in model.integrals])))
    S = np.vstack([model.C1.T @ model.D12, np.zeros((len(rows), len(price)))])
    regulator = solve_riccati(A, B, Q, price, S)
    estimator = solve_riccati(
        model.A.T, model.C2.T, model.B1 @ model.B1.T, model.D21 @ model.D21.T, model.B1 @ model.D21.T
    )
    K, L = regulator.gain, estimator.gain.T
    joined = join_estimator(StateSpace(model.A, model.B2, model.C2, model.D22), K, L, rows)
    law = Law(joined.A, joined.B, joined.C)
    drive = np.vstack([model.B1, model.D21[rows]])
    cost = np.sum(regulator.X * (drive @ drive.T)) + np.sum((K[:, :n] @ estimator.X) * (price @ K[:, :n]))
    return decouple(law, len(rows)), regulator, estimator, float(cost)


def lqg_law(model: GeneralizedPlant) -> Law:
    """The optimal `Law` alone."""
    return solve_lqg(model)[0]
