"""What a design method returns: a dynamic law from named measurements to named inputs."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.signals.ports import Port
from middeck.systems.plant import Plant
from middeck.systems.response import FrequencyResponse, statespace_response
from middeck.systems.statespace import StateSpace, gain_system
from middeck.values import record


@record
class Compensator:
    """u = K(s) y, added at the plant's inputs.

    Parameters
    ----------
    system:
        The law, from ``inputs`` to ``outputs``.
    inputs:
        Plant outputs that are measured, in the order of the columns.
    outputs:
        Plant inputs that are driven, in the order of the rows.
    """

    system: StateSpace
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]

    def __post_init__(self) -> None:
        if self.system.D.shape != (len(self.outputs), len(self.inputs)):
            raise ValueError(
                f"Compensator: {len(self.outputs)} outputs and {len(self.inputs)} inputs named, "
                f"the system has {self.system.D.shape}"
            )


def measured_ports(plant: Plant) -> tuple[Port, ...]:
    """The ports a compensator of ``plant`` reads: its group y."""
    return tuple(plant.outputs[i] for i in plant.output_indices(plant.y))


def driven_ports(plant: Plant) -> tuple[Port, ...]:
    """The ports a compensator of ``plant`` drives: its group u."""
    return tuple(plant.inputs[i] for i in plant.input_indices(plant.u))


def idle_compensator(plant: Plant) -> Compensator:
    """The compensator that does nothing: the loop stays open."""
    inputs, outputs = measured_ports(plant), driven_ports(plant)
    return Compensator(gain_system(np.zeros((len(outputs), len(inputs)))), inputs, outputs)


def evaluate_compensator(
    compensator: Compensator, frequency_hz: Float[np.ndarray, " line"]
) -> FrequencyResponse:
    """The compensator's frequency response at ``frequency_hz``."""
    frequency_hz = np.asarray(frequency_hz, dtype=float)
    H = statespace_response(compensator.system, 2.0 * np.pi * frequency_hz)
    return FrequencyResponse(frequency_hz, H, compensator.inputs, compensator.outputs)
