"""A made-up structure of the paper's size, for rehearsals: no geometry, only modes and named ports.

In orbit ten rigid-body modes, of which three translations that no torque reaches and no angle sees; in the
lab the same ten on a suspension, where translations and rotations mix; sixteen flexible modes to 45 Hz.
"""

from __future__ import annotations

import numpy as np

from middeck.control.law.pd_loops import PDLoops
from middeck.control.lqg.weights import LQGWeights
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.modal_system import ModalSystem

CONTROLS = ("bus_x", "bus_y", "bus_z", "pri_rel_x", "pri_rel_z")
DISTURBANCES = ("sec_rel_x", "sec_rel_z")
ANGLES = ("bus_x", "bus_y", "bus_z", "pri_in_x", "pri_in_z", "pri_rel_x", "pri_rel_z")
METRIC = ("pri_in_x", "pri_in_z", "bus_x", "bus_y", "bus_z")
METRIC_WEIGHTS = np.array([1.0, 1.0, 0.5, 0.5, 0.5])
BAND_HZ = (0.1, 60.0)
LOOPS = (*CONTROLS, *DISTURBANCES)
SENSED = (*ANGLES, *DISTURBANCES)
# kp = J (2 pi f)^2 and kd = J (2 pi f) with rough inertias J: the shape of the data sheet's gains.
PD_HZ = np.array([0.03, 0.03, 0.03, 0.08, 0.08, 0.03, 0.03])
INERTIA = np.array([0.3, 9.0, 9.0, 0.04, 0.06, 0.04, 0.06])


def pd_loops() -> PDLoops:
    omega = 2.0 * np.pi * PD_HZ
    return PDLoops(LOOPS, INERTIA * omega**2, INERTIA * omega)


def weights(intensity: float, process_ratio: float = 1e-5) -> LQGWeights:
    process = intensity * np.diag([1.0, 1.0] + 5 * [process_ratio])
    sensor = np.concatenate([np.full(7, 2e-5**2), np.full(7, 2e-4**2)])
    return LQGWeights(
        output=METRIC_WEIGHTS,
        input=np.ones(5),
        disturbed=(*DISTURBANCES, *CONTROLS),
        process=process,
        sensor=sensor,
    )


def _rotations(rng: np.random.Generator) -> np.ndarray:
    """Mass-normalised rigid rotations: the seven torques' influence on seven modes."""
    mixing, _ = np.linalg.qr(rng.standard_normal((7, 7)))
    return mixing * 0.15 / np.sqrt(INERTIA)[None, :] + np.diag(1.0 / np.sqrt(INERTIA))


def _sensed_from_collocated(collocated: np.ndarray, extra: np.ndarray) -> np.ndarray:
    """Angle shapes: five collocated ones, the two inertial payload angles, two secondary ones."""
    bus_x, bus_y, bus_z, rel_x, rel_z, sec_x, sec_z = collocated.T
    c = np.sqrt(0.5)
    in_x = rel_x + bus_x + extra[0]
    in_z = rel_z + c * bus_z + c * bus_y + extra[1]
    return np.array([bus_x, bus_y, bus_z, in_x, in_z, rel_x, rel_z, sec_x, sec_z])


def build(environment: str, part: str = "all", seed: int = 3) -> Plant:
    """The plant in ``"orbit"`` or ``"lab"``; ``part`` keeps all modes, the rigid or the flexible ones."""
    rng = np.random.default_rng(seed)
    rigid = np.vstack([np.zeros((3, 7)), _rotations(rng)])
    flexible_hz = np.geomspace(1.7, 45.0, 16) * (1.0 + 0.03 * rng.standard_normal(16))
    flexible = 0.5 * rng.standard_normal((16, 7)) / np.sqrt(INERTIA)
    extra = np.concatenate([np.zeros((2, 10)), 0.3 * rng.standard_normal((2, 16))], axis=1)
    omega = 2.0 * np.pi * np.concatenate([np.zeros(10), flexible_hz])
    zeta = np.concatenate([np.zeros(10), np.full(16, 0.01)])
    names = [f"translation {a}" for a in "xyz"] + [f"rotation {i}" for i in range(7)]
    if environment == "lab":
        # Suspension: stiffness couples translations with rotations; flexible modes move a little.
        stiffness = 2.0 * np.pi * np.array([0.25, 0.25, 0.26, 0.2, 0.3, 0.32, 0.5, 1.1, 1.3, 1.4])
        turn, _ = np.linalg.qr(np.eye(10) + 0.35 * rng.standard_normal((10, 10)))
        rigid = turn.T @ rigid
        omega = np.concatenate([stiffness, omega[10:] * (1.0 + 0.01 * rng.standard_normal(16))])
        zeta = np.concatenate([np.full(10, 0.03), zeta[10:]])
        names = [f"suspension {i}" for i in range(10)]
    names += [f"bending {i}" for i in range(16)]
    collocated = np.vstack([rigid, flexible])
    phi = _sensed_from_collocated(collocated, extra)
    keep = {"all": slice(None), "rigid": slice(10), "flexible": slice(10, None)}[part]
    modal = ModalSystem(
        omega=omega[keep],
        zeta=zeta[keep],
        psi=collocated[keep],
        phi=np.vstack([phi, np.zeros_like(phi)])[:, keep],
        phi_rate=np.vstack([np.zeros_like(phi), phi])[:, keep],
        names=tuple(names[keep]),
    )
    outputs = tuple(Port(n, "rad") for n in SENSED) + tuple(Port(f"{n}_rate", "rad/s") for n in SENSED)
    return Plant(
        dynamics=modal,
        inputs=tuple(Port(n, "N m") for n in LOOPS),
        outputs=outputs,
        w=DISTURBANCES,
        u=CONTROLS,
        z=METRIC,
        y=(*ANGLES, *(f"{n}_rate" for n in ANGLES)),
    )
