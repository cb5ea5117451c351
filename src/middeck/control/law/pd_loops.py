"""Local proportional-derivative loops: the inner loop that holds the rigid-body modes."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.control.law.partition import set_inert_aside
from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant, name_states
from middeck.systems.state_space.feedback import close_static
from middeck.values import record


@record
class PDLoops:
    """torque = -(kp angle + kd rate), one loop for each name, ideal sensors.

    Loop ``name`` reads the outputs ``name`` [rad] and ``name_rate`` [rad/s] and drives the input ``name``.

    Attributes:
        kp, kd: Gains [N m/rad] and [N m s/rad].
    """

    names: tuple[str, ...]
    kp: Float[np.ndarray, " loop"]
    kd: Float[np.ndarray, " loop"]

    def __post_init__(self) -> None:
        if len(self.names) != len(self.kp):
            raise ConfigError(f"{len(self.names)} names for {len(self.kp)} gains", hint="one for each loop")


@named_kinds
def close_inner_loop(plant: Plant, pd: PDLoops) -> Plant:
    """The plant with ``pd`` closed: same ports, and the states of its modes in their order.

    Modes that are uncontrollable and unobservable are left out (`set_inert_aside` names them). Raises
    `ConfigError` for loops whose ports do not exist.
    """
    active = set_inert_aside(plant).active
    system = active.system
    columns = active.input_indices(pd.names)
    angles = active.output_indices(pd.names)
    rates = active.output_indices([f"{name}_rate" for name in pd.names])
    gain = np.zeros((len(active.inputs), len(active.outputs)))
    gain[columns, angles] = -pd.kp
    gain[columns, rates] = -pd.kd
    closed = close_static(system, gain)
    return dataclasses.replace(active, dynamics=closed, state_names=name_states(active))
