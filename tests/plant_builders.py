"""Sums of modes and plants with their groups, for tests of plants, loops and rigs."""

from __future__ import annotations

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.control.lqg.weights import LQGWeights
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import gain_system

FORCE, WAY, RATE = Port("force", "N"), Port("way", "m"), Port("rate", "m/s")
"""What acts on a body, and what is seen of it."""
BODY = Plant(
    dynamics=ModalSystem(
        omega=[0.0], zeta=[0.0], psi=[[1.0]], phi=[[1.0], [0.0]], phi_rate=[[0.0], [1.0]], names=("body",)
    ),
    inputs=(FORCE,),
    outputs=(WAY, RATE),
)


def gain(*k: float) -> Compensator:
    """The law that feeds the first outputs of `BODY` back by these gains."""
    return Compensator(gain_system(-np.array([k])), (WAY, RATE)[: len(k)], (FORCE,))


def sum_of_modes(omega, zeta, psi, phi, **more) -> ModalSystem:
    """Read by its displacements alone, its modes a, b, c ..., where nothing else is said.

    One ``zeta`` is that of every mode.
    """
    count, phi = len(omega), np.asarray(phi)
    read = {"phi_rate": np.zeros(phi.shape), "names": tuple("abcdefghijkl"[:count])} | more
    return ModalSystem(omega=omega, zeta=np.broadcast_to(zeta, count), psi=psi, phi=phi, **read)


def grouped_plant(dynamics, inputs, outputs, **groups) -> Plant:
    """Every input disturbs and controls, every output is a measure and is measured, but where said less."""
    driven, read = (tuple(port.name for port in ports) for ports in (inputs, outputs))
    groups = {"w": driven, "u": driven, "z": read, "y": read} | groups
    return Plant(dynamics=dynamics, inputs=inputs, outputs=outputs, **groups)


def unit_weights(disturbed, sensor, *, outputs=1, inputs=1, process=1.0) -> LQGWeights:
    """Unit cost of outputs and inputs; noise of one intensity at each input that is disturbed."""
    noise = {"process": process * np.eye(len(disturbed)), "sensor": np.atleast_1d(sensor)}
    return LQGWeights(output=np.ones(outputs), input=np.ones(inputs), disturbed=disturbed, **noise)
