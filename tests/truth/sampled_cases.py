"""Plants of the tests of sampled control."""

import numpy as np
import scipy.linalg as sla

from middeck.control.lqg.weights import LQGWeights
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import grouped_plant, sum_of_modes, unit_weights

UNIT = 2.0 * np.pi * 3.0  # the multi-model case counts time in units of 1/(2 pi 3 Hz)
FREQUENCY_HZ = np.array([1.1, 1.7, 7.0, 8.8, 9.4])
SHAPE = np.array([1.0, 0.6, 0.6, 0.8, 0.7])


def gimbal(more_hz=(), more_shape=()):
    """The paper's single loop as the benchmark cases write it (five modes, no delay), and modes beyond."""
    omega = 2.0 * np.pi * np.concatenate([FREQUENCY_HZ, more_hz])
    phi = UNIT**2 * np.concatenate([SHAPE, more_shape])[None]
    names = tuple(f"{f:g} Hz" for f in omega / (2.0 * np.pi))
    modal = sum_of_modes(omega, 0.01, np.ones((len(omega), 1)), phi, names=names)
    force, angle = (Port("torque", "N m"),), (Port("angle", "rad"),)
    return grouped_plant(modal, force, angle)


def late_gimbal():
    return delay_plant(gimbal(), 0.010)


def gimbal_weights():
    return unit_weights(("torque",), 1e-6 / UNIT, process=1.0 / UNIT)


def tangled():
    """A resonance and a rigid-body mode; two inputs, two measurements and two outputs, all late differently.

    Delays are whole numbers of 0.005 s; those of the sums, 0.02 to 0.28 s.
    """
    rng = np.random.default_rng(1)
    A = sla.block_diag([[0.0, 6.0], [-6.0, -0.3]], [[0.0, 1.0], [0.0, 0.0]])
    D = np.zeros((4, 3))
    D[:, :2] = 0.1 * rng.standard_normal((4, 2))
    system = StateSpace(A, rng.standard_normal((4, 3)), rng.standard_normal((4, 4)), D)
    inputs = tuple(Port(name, "N") for name in ("u1", "u2", "w1"))
    outputs = tuple(Port(name, "m") for name in ("z1", "z2", "y1", "y2"))
    plant = Plant(
        dynamics=system,
        inputs=inputs,
        outputs=outputs,
        w=("w1",),
        u=("u1", "u2"),
        z=("z1", "z2"),
        y=("y1", "y2"),
    )
    of_input, of_output = np.array([0.13, 0.045, 0.02]), np.array([0.01, 0.07, 0.0, 0.235])
    return delay_plant(plant, of_input + of_output[:, None])


def tangled_weights():
    return LQGWeights(
        output=[1.0, 2.0], input=[1.0, 0.5], disturbed=("w1",), process=[[0.3]], sensor=[0.01, 0.02]
    )
