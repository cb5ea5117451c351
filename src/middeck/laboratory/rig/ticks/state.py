"""State of the simulation of a rig, and the results of a piece of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.laboratory.rig.rig import Rig
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record


@record(kw_only=True)
class RigState:
    """State of a simulation.

    Attributes:
        x, computer: States of the continuous part and of the computer: the gyros' sums, then the
            compensator's.
        issued: Torques issued in the last ticks, the latest last.
        momentum: Momentum of each rotor, in units of a torque over one tick; minus the sum of its torques.
        joints: State of every joint element in order.
        bias: Error of each reading now.
        trim: Estimate of it that the computer subtracts.
        tick: Ticks since it was switched on.
    """

    x: Float[np.ndarray, " state"]
    computer: Float[np.ndarray, " computer"]
    issued: Float[np.ndarray, "tick input"]
    momentum: Float[np.ndarray, " input"]
    joints: Float[np.ndarray, " element"]
    bias: Float[np.ndarray, " output"]
    trim: Float[np.ndarray, " output"]
    tick: int


@dataclass(frozen=True, kw_only=True, eq=False)
class RigBlock:
    """Some ticks of a simulation.

    ``measured`` are the outputs as the computer has them and ``readings`` what it made them from; ``control``
    is what the compensator adds, ``torque`` what the motors give for it and the excitation together,
    ``momentum`` that of their rotors, and ``state`` where the block ends.
    """

    measured: Float[np.ndarray, "sample output"]
    readings: Float[np.ndarray, "sample output"]
    control: Float[np.ndarray, "sample input"]
    torque: Float[np.ndarray, "sample input"]
    momentum: Float[np.ndarray, "sample input"]
    state: RigState


def cut_block(block: RigBlock, ticks: int) -> RigBlock:
    """The first ``ticks`` of a block; the state stays that of its end."""
    return RigBlock(
        measured=block.measured[:ticks],
        readings=block.readings[:ticks],
        control=block.control[:ticks],
        torque=block.torque[:ticks],
        momentum=block.momentum[:ticks],
        state=block.state,
    )


def check_start(rig: Rig, law: SampledStateSpace, start: RigState) -> None:
    """Raise `ConfigError` for a state of another rig, or of another compensator."""
    rest = start_at_rest(rig, law, np.zeros(len(rig.outputs)))
    for name in ("x", "computer", "issued", "momentum", "joints", "bias", "trim"):
        given, asked = np.shape(getattr(start, name)), np.shape(getattr(rest, name))
        if given != asked:
            raise ConfigError(
                f"{name} of the start has the shape {given}, this rig and law have {asked}",
                where="start",
                hint="switch_on(rig, law, rest_s, rng) with the same rig and law, or a state of their blocks",
            )


def start_at_rest(rig: Rig, law: SampledStateSpace, bias: Float[np.ndarray, " output"]) -> RigState:
    """All at rest and at zero, except for the error of the readings."""
    m, p = len(rig.inputs), len(rig.outputs)
    return RigState(
        x=np.zeros(rig.plant.angle.shape[1]),
        computer=np.zeros(int(rig.readout.summed.sum()) + len(law.A)),
        issued=np.zeros((rig.plant.delay_ticks + 1, m)),
        momentum=np.zeros(m),
        joints=np.zeros(sum(len(j.elements) for j in rig.joints)),
        bias=bias,
        trim=np.zeros(p),
        tick=0,
    )
