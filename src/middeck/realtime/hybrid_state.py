"""A hybrid system, where its simulation stands, and what a piece of it gives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.joints.simulation import JointElements
from middeck.realtime.computer import Computer
from middeck.realtime.hybrid_plant import HybridPlant
from middeck.realtime.motors import MotorBank
from middeck.realtime.readout import Readout
from middeck.values import record


@record(kw_only=True)
class HybridState:
    """Where a simulation stands.

    Parameters
    ----------
    x, computer:
        States of the continuous part and of the computer.
    issued:
        Torques issued in the last ticks, the latest last.
    momentum:
        Of each rotor, in units of a torque over one tick; minus what it has given.
    joints:
        State of every joint element in order.
    bias:
        Error of each reading now.
    trim:
        What the computer takes for it and subtracts.
    tick:
        Ticks since it was switched on.
    """

    x: Float[np.ndarray, " state"]
    computer: Float[np.ndarray, " computer"]
    issued: Float[np.ndarray, "tick input"]
    momentum: Float[np.ndarray, " input"]
    joints: Float[np.ndarray, " element"]
    bias: Float[np.ndarray, " output"]
    trim: Float[np.ndarray, " output"]
    tick: int = 0


class HybridBlock(NamedTuple):
    """Some ticks of a hybrid simulation.

    ``measured`` are the outputs as the computer has them and ``readings`` what it made them from; ``control``
    is what the law adds, ``torque`` what the motors give for law and excitation together, ``momentum`` that
    of their rotors, and ``state`` where the block ends.
    """

    measured: Float[np.ndarray, "sample output"]
    readings: Float[np.ndarray, "sample output"]
    control: Float[np.ndarray, "sample input"]
    torque: Float[np.ndarray, "sample input"]
    momentum: Float[np.ndarray, "sample input"]
    state: HybridState


def cut_block(block: HybridBlock, ticks: int) -> HybridBlock:
    """Its first ``ticks``; the state stays that of its end."""
    return HybridBlock(*(x[:ticks] for x in block[:-1]), state=block.state)


@record(kw_only=True)
class HybridSystem:
    """Everything that a hybrid simulation needs; `middeck.realtime.hardware_rig` builds one."""

    plant: HybridPlant
    computer: Computer
    motors: MotorBank
    readout: Readout
    joints: tuple[JointElements, ...]


def start_hybrid(system: HybridSystem, bias: Float[np.ndarray, " output"]) -> HybridState:
    """Everything at rest and at zero, but for the error of the readings."""
    m, plant = system.computer.commands, system.plant
    return HybridState(
        x=np.zeros(plant.angle.shape[1]),
        computer=np.zeros(system.computer.states),
        issued=np.zeros((plant.late + 1, m)),
        momentum=np.zeros(m),
        joints=np.zeros(sum(len(j.elements) for j in system.joints)),
        bias=bias,
        trim=np.zeros(system.computer.outputs),
    )
