"""The Kalman filter of a plant (Kwakernaak and Sivan 1972, chapter 4)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.lqg.weights import LQGWeights, require_size
from middeck.control.partition import partition_modes
from middeck.control.riccati import RiccatiSolution, solve_riccati
from middeck.systems.plant import Plant, name_states, subsystem
from middeck.values import record


@record
class KalmanFilter:
    """The stationary filter of a plant; the same at every control authority.

    ``gain`` is L in xhat' = A xhat + B u + L (y - yhat), ``solution`` that of the dual Riccati equation
    (its X is the error covariance), ``inert`` names the modes left out of the design.
    """

    gain: Float[np.ndarray, "state y"]
    solution: RiccatiSolution
    inert: tuple[str, ...]


def design_filter(plant: Plant, weights: LQGWeights) -> KalmanFilter:
    """The Kalman filter of ``plant``; give it to `design_lqg` in a sweep over authority.

    Raises `NotStabilisableError` naming the modes that do not decay and that no measurement sees, or that
    lie on the axis without process noise.
    """
    part = partition_modes(plant)
    active, names = part.active, name_states(part.active)
    noise = subsystem(active, weights.disturbed, active.y)
    require_size("sensor intensities", len(weights.sensor), active.y)
    V = weights.process
    solution = solve_riccati(
        noise.A.T,
        noise.C.T,
        noise.B @ V @ noise.B.T,
        np.diag(weights.sensor) + noise.D @ V @ noise.D.T,
        noise.B @ V @ noise.D.T,
        names=names,
        complaint="no measurement in y sees it",
    )
    return KalmanFilter(solution.gain.T, solution, part.inert)
