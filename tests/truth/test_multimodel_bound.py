"""The bound on the frozen multi-model case, against Riccati equations solved by SciPy."""

import multimodel_reference as case
import numpy as np
import pytest
import scipy.linalg as sla

from middeck.control.law.compensator import Compensator
from middeck.control.law.uncertainty import finished_plants
from middeck.control.noise import measure_noise_rms
from middeck.control.robust.designs.multimodel import design_multimodel
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.updating.promise.performance_bound import bound_db, bound_worst

PADE = 8


@pytest.fixture(scope="module")
def law() -> Compensator:
    return design_multimodel(case.reference_plant(), case.WEIGHTS, case.AUTHORITY, uncertainty=case.TOGETHER)


def three() -> tuple[Plant, ...]:
    return finished_plants(case.reference_plant(), case.TOGETHER, np.array([[-1.0], [0.0], [1.0]]))


def least_cost(plant: Plant, rho: float) -> float:
    """E[z^2 + rho u^2] of the best linear law: tr(P B1 B1') + tr(Y K' rho K) (Kwakernaak and Sivan 1972)."""
    near = approximate_delays(plant, PADE).system
    A, (B1, B2), (C1, C2) = near.A, near.B.T[:, :, None], near.C[:, None, :]
    P = sla.solve_continuous_are(A, B2, C1.T @ C1, np.array([[rho]]))
    Y = sla.solve_continuous_are(A.T, C2.T, B1 @ B1.T, np.array([[1e-6]]))
    K = B2.T @ P / rho
    return float(np.trace(P @ B1 @ B1.T) + rho * np.trace(K @ Y @ K.T))


def test_the_law_of_three_models_is_within_a_decibel_of_what_no_law_passes(law: Compensator):
    found = bound_worst(three(), law, case.WEIGHTS)
    assert found.draws == 3
    assert 0.0 < found.worst_db - found.no_linear_law_below_db < 1.0


def test_the_bound_is_the_best_of_riccati_costs(law: Compensator):
    """rms^2 >= least cost - rho effort^2, the largest over a dense grid of rho; within the flatness of it."""
    plants = three()
    for plant, (own, least) in zip(plants, bound_db(plants, law, case.WEIGHTS), strict=True):
        system = remove_delays(plant).system
        B1 = system.B[:, :1]
        alone = np.sqrt(system.C[0] @ sla.solve_continuous_lyapunov(system.A, -B1 @ B1.T) @ system.C[0])
        came = measure_noise_rms(plant, law, case.WEIGHTS)
        assert own == pytest.approx(20.0 * np.log10(came.rms / alone), abs=1e-6)
        squares = [least_cost(plant, rho) - rho * came.control_rms**2 for rho in np.geomspace(1e-3, 1e-1, 81)]
        assert least == pytest.approx(10.0 * np.log10(max(squares) / alone**2), abs=2e-3)
