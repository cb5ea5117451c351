"""The waist itself: a linear model with named ports, w u z y as in the paper's Figure 8."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from middeck.signals.ports import Port, port_indices, require_names
from middeck.systems.modal import ModalSystem, modal_to_statespace
from middeck.systems.statespace import StateSpace
from middeck.values import record


@record
class Plant:
    """A linear time-invariant model between named inputs and outputs.

    Parameters
    ----------
    dynamics:
        Modal form where the model has one (from a structure), otherwise a state space.
    inputs, outputs:
        Ports in the order of the columns and rows.
    w, u:
        Names of the inputs that disturb and of those that control.
    z, y:
        Names of the outputs to be kept small and of those fed back. A port may be in several groups.
    state_names:
        What each state belongs to (a mode's two states carry its name), where the dynamics does not say it
        itself; empty if unknown.
    """

    dynamics: ModalSystem | StateSpace
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    w: tuple[str, ...] = ()
    u: tuple[str, ...] = ()
    z: tuple[str, ...] = ()
    y: tuple[str, ...] = ()
    state_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for group in ("w", "u", "z", "y"):
            require_names(getattr(self, group), group)
        shape = (len(self.outputs), len(self.inputs))
        rows, columns = self.system.D.shape
        if shape != (rows, columns):
            raise ValueError(
                f"Plant: {shape[0]} outputs and {shape[1]} inputs named, dynamics has {rows}, {columns}"
            )
        if self.state_names and len(self.state_names) != len(self.system.A):
            raise ValueError(f"Plant: {len(self.state_names)} state names for {len(self.system.A)} states")
        port_indices(self.inputs, (*self.w, *self.u), "input")
        port_indices(self.outputs, (*self.z, *self.y), "output")

    @property
    def system(self) -> StateSpace:
        """The plant as a state space (computed, not stored)."""
        return modal_to_statespace(self.dynamics) if isinstance(self.dynamics, ModalSystem) else self.dynamics

    def input_indices(self, names: Sequence[str]) -> list[int]:
        """Columns of the inputs ``names``."""
        return port_indices(self.inputs, names, "input")

    def output_indices(self, names: Sequence[str]) -> list[int]:
        """Rows of the outputs ``names``."""
        return port_indices(self.outputs, names, "output")


def name_states(plant: Plant) -> tuple[str, ...]:
    """The mode (or other part) that each state belongs to; ``"state 3"`` where nothing is known."""
    if isinstance(plant.dynamics, ModalSystem):
        return tuple(name for name in plant.dynamics.names for _ in range(2))
    return plant.state_names or tuple(f"state {i}" for i in range(len(plant.dynamics.A)))


def subsystem(plant: Plant, inputs: Sequence[str], outputs: Sequence[str]) -> StateSpace:
    """The state space from ``inputs`` to ``outputs``, by name."""
    system = plant.system
    columns, rows = plant.input_indices(inputs), plant.output_indices(outputs)
    return StateSpace(system.A, system.B[:, columns], system.C[rows], system.D[np.ix_(rows, columns)])
