"""A bus and a joint of three modes on a rig, with friction in the joint or without."""

from __future__ import annotations

import dataclasses

import numpy as np

from middeck.joints.attachment import JointElements
from middeck.joints.friction import Friction
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.runs import run_open_loop
from middeck.signals.excitation.limits import Limits
from middeck.signals.excitation.multisine import design_multisine
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.systems.plants.plant import Plant
from plant_builders import sum_of_modes

RATE, DELAY, BAND = 200.0, 0.0131, (0.2, 10.0)
BEARING = Friction(slip_torque=0.02, stiffness=4.0)
HZ = np.array([0.9, 1.6, 4.1])
JOINTS = [("joint", "joint")]


def plant() -> Plant:
    """Three modes of a bus and a joint: torques on both, angles of both."""
    psi = np.array([[0.6, 1.1], [0.3, -0.9], [-0.8, 0.5]])
    return Plant(
        dynamics=sum_of_modes(2.0 * np.pi * HZ, np.array([0.03, 0.02, 0.01]), psi, psi.T),
        inputs=(Port("bus", "N m"), Port("joint", "N m")),
        outputs=(Port("bus", "rad"), Port("joint", "rad")),
    )


def records(joints: list[JointElements], noise: float = 2e-3) -> Record:
    """Two experiments tell the torques apart, a third at a third of the drive tells of friction."""
    rng = np.random.default_rng(5)
    rig = build_rig(plant(), joints=joints, sample_hz=RATE, delay_s=DELAY, substeps=4)
    drive = design_multisine(BAND, 20.0, RATE, Limits(rms=0.5), rng, inputs=2).u
    taken: list[Record] = []
    for u in [*drive, drive[0] / 3.0]:
        run = run_open_loop(rig, u, periods=3, rng=rng, settle=2)
        assert run.record is not None
        y = run.record.y
        y = y + noise * np.sqrt(np.mean(y**2, axis=(0, 1, 2))) * rng.standard_normal(y.shape)
        taken.append(dataclasses.replace(run.record, y=y))
    u, y = (np.concatenate([getattr(r, side) for r in taken]) for side in ("u", "y"))
    return dataclasses.replace(taken[0], u=u, y=y)
