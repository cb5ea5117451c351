"""Linear-quadratic Gaussian design (Kwakernaak and Sivan 1972, chapters 3 to 5)."""

from __future__ import annotations

import numpy as np

from middeck.control.compensator import Compensator, driven_ports, measured_ports
from middeck.control.lqg.estimator import KalmanFilter, design_filter
from middeck.control.lqg.regulator import design_regulator
from middeck.control.lqg.weights import LQGWeights
from middeck.control.partition import partition_modes
from middeck.control.riccati import RiccatiSolution
from middeck.errors import ConfigError
from middeck.systems.plant import Plant, subsystem
from middeck.systems.statespace import StateSpace
from middeck.values import record


@record
class LQGCompensator(Compensator):
    """A compensator that knows how it was made.

    Parameters
    ----------
    authority:
        1/rho.
    regulator, estimator:
        The two Riccati solutions: residuals, regulator poles and filter poles.
    cost:
        The minimum of E[z' W^2 z + rho u' diag(input) u] on the design plant, white noise unlimited in band.
    inert:
        Modes of the plant left out because no port reaches or sees them.
    """

    authority: float
    regulator: RiccatiSolution
    estimator: RiccatiSolution
    cost: float
    inert: tuple[str, ...]


def design_lqg(
    plant: Plant, weights: LQGWeights, authority: float, *, kalman: KalmanFilter | None = None
) -> LQGCompensator:
    """The compensator that minimises E[z' W^2 z + rho u' diag(input) u], rho = 1/authority.

    Modes that no port reaches or sees are set aside by name and listed in ``inert``. Direct terms from u to
    z, and from any input to y, are part of the design; one from process noise to z is refused, for it makes
    the cost infinite. Raises `NotStabilisableError` naming the modes that cannot be held and `ConfigError`
    for weights that do not fit the plant.
    """
    if not authority > 0.0:
        raise ConfigError(f"authority is {authority}; it must be positive")
    part = partition_modes(plant)
    active = part.active
    kalman = design_filter(plant, weights) if kalman is None else kalman
    regulator = design_regulator(active, weights, authority)
    control = subsystem(active, active.u, active.y)
    K, L = regulator.gain, kalman.gain
    law = StateSpace(
        control.A - control.B @ K - L @ control.C + L @ control.D @ K,
        L,
        -K,
        np.zeros((len(active.u), len(active.y))),
    )
    noise = subsystem(active, weights.disturbed, active.z)
    cost = np.sum(regulator.X * (noise.B @ weights.process @ noise.B.T))
    rho_R = np.diag(weights.input) / authority
    cost += np.sum((K @ kalman.solution.X) * (rho_R @ K))
    ports = measured_ports(active), driven_ports(active)
    return LQGCompensator(law, *ports, authority, regulator, kalman.solution, float(cost), part.inert)
