"""The linear-quadratic regulator of a plant (Kwakernaak and Sivan 1972, chapter 3)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.lqg.weights import LQGWeights, require_size
from middeck.control.riccati import RiccatiSolution, solve_riccati
from middeck.errors import ConfigError
from middeck.systems.plant import Plant, name_states, subsystem


def design_regulator(
    plant: Plant, weights: LQGWeights, authority: float, start: Float[np.ndarray, "state state"] | None = None
) -> RiccatiSolution:
    """The gain on the states of ``plant``, whose modes are all reachable or observed (`partition_modes`)."""
    names = name_states(plant)
    require_size("output weights", len(weights.output), plant.z)
    require_size("input weights", len(weights.input), plant.u)
    if np.any(subsystem(plant, weights.disturbed, plant.z).D):
        raise ConfigError(
            "process noise reaches a performance output directly: white noise makes the cost infinite",
            hint="put a filter between the noise and the output",
        )
    control = subsystem(plant, plant.u, plant.z)
    Cw, Dw = weights.output[:, None] * control.C, weights.output[:, None] * control.D
    R = Dw.T @ Dw + np.diag(weights.input) / authority
    return solve_riccati(
        control.A,
        control.B,
        Cw.T @ Cw,
        R,
        Cw.T @ Dw,
        names=names,
        complaint="no control input in u reaches it",
        start=start,
    )
