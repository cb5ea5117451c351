"""The frozen case of multi-model control: five modes, 10 ms of delay, rho = 1e-2, 13 states."""

import numpy as np

from middeck.control.law.uncertainty import ModeShift, Uncertainty
from middeck.control.lqg.weights import LQGWeights
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.modal_system import ModalSystem

UNIT_S = 1.0 / (2.0 * np.pi * 3.0)  # seconds in a unit of time
HZ = np.array([1.1, 1.7, 7.0, 8.8, 9.4])
NAMES = tuple(f"{hz} Hz" for hz in HZ)
AUTHORITY = 100.0
WEIGHTS = LQGWeights(
    output=np.ones(1), input=np.ones(1), disturbed=("w",), process=np.eye(1), sensor=np.array([1e-6])
)
TOGETHER = Uncertainty(shifts=(ModeShift(NAMES[3:], 0.02),))
APART = Uncertainty(shifts=(ModeShift(NAMES[3:4], 0.02), ModeShift(NAMES[4:], 0.02)))
UNSEEN = Uncertainty(
    shifts=tuple(ModeShift((name,), 0.02) for name in NAMES), damping=0.5, gain=0.1, delay=0.1
)


def reference_plant() -> Plant:
    phi = np.array([1.0, 0.6, 0.6, 0.8, 0.7])
    modal = ModalSystem(
        omega=HZ / 3.0,
        zeta=np.full(5, 0.01),
        psi=np.ones((5, 2)),
        phi=np.stack([phi, phi]),
        phi_rate=np.zeros((2, 5)),
        names=NAMES,
    )
    ports = (Port("w", "N"), Port("u", "N")), (Port("z", "m"), Port("y", "m"))
    plant = Plant(dynamics=modal, inputs=ports[0], outputs=ports[1], w=("w",), u=("u",), z=("z",), y=("y",))
    delay = 0.010 / UNIT_S
    return delay_plant(plant, np.array([[0.0, 0.0], [delay, delay]]))


def grid() -> np.ndarray:
    """The 9x9 positions of `APART`."""
    steps = np.linspace(-1.0, 1.0, 9)
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
