"""Saturation, rotor, slew, converters, counts, friction and a law in one run, against a loop written out."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from joint_reference import PlainJoints
from middeck.joints.attachment import JointElements
from middeck.joints.friction import Friction
from middeck.laboratory.rig.parts.motors import Motor, Rotor
from middeck.laboratory.rig.parts.sensors import Encoder
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.ticks.simulate_rig import cut_blocks, simulate_rig
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import SampledStateSpace
from rig_checks import on_rig

RATE, DELAY, STEPS = 500.0, 0.0103, 2
NAMES = ("bus_z", "pri_rel_z")
WHEEL = Motor(torque_limit=0.5, slew_limit=80.0, resolution=1.0 / 2**12, rotor=Rotor(0.006, 20.0))
GIMBAL = Motor(torque_limit=0.4, holding=0.15, slew_limit=60.0, resolution=0.8 / 2**10)
STEP = 2.0 * np.pi / 2**16
RUB = JointElements("pri_rel_z", "pri_rel_z", (Friction(0.02, 2.0, 0.005),))


@pytest.fixture(scope="module")
def plant():
    omega = 2.0 * np.pi * np.array([0.9, 1.3, 7.2, 31.0])
    shape = np.array([[0.3, 0.2, -0.4, 0.2], [0.8, 3.0, 1.1, 0.4]])
    modal = ModalSystem(
        omega=omega, zeta=np.full(4, 0.02), psi=shape.T, phi=shape, phi_rate=0.0 * shape, names=tuple("abcd")
    )
    return Plant(
        dynamics=modal,
        inputs=tuple(Port(n, "N m") for n in NAMES),
        outputs=tuple(Port(n, "rad") for n in NAMES),
    )


@pytest.fixture(scope="module")
def law():
    """A little of everything: one state, cross paths, a direct term."""
    return SampledStateSpace(
        [[0.9]], [[0.1, 0.2]], [[-0.5], [-1.5]], [[-3.0, 0.4], [0.2, -2.0]], period_s=1.0 / RATE
    )


@pytest.fixture(scope="module")
def rig(plant):
    motors, sensors = dict(zip(NAMES, (WHEEL, GIMBAL), strict=True)), dict.fromkeys(NAMES, Encoder(STEP))
    return build_rig(
        plant, motors=motors, sensors=sensors, joints=[RUB], sample_hz=RATE, delay_s=DELAY, substeps=STEPS
    )


def written_out(plant, law, u):
    """One tick after the other in the plainest of ways."""
    plain, x = PlainJoints(plant, [RUB], 1.0 / RATE / STEPS, DELAY - 0.5 / RATE), np.zeros(1)
    given, momentum = np.zeros(2), 0.0
    rows = []
    for e in u:
        y = np.round(plain.outputs / STEP) * STEP
        control = law.C @ x + law.D @ y
        x = law.A @ x + law.B @ y
        torque = np.zeros(2)
        for i, motor in enumerate((WHEEL, GIMBAL)):
            wanted = motor.resolution * np.round((control[i] + e[i]) / motor.resolution)
            change = motor.slew_limit / RATE
            wanted = min(max(wanted, given[i] - change), given[i] + change)
            most = motor.torque_limit
            torque[i] = min(max(wanted, -most - motor.holding), most - motor.holding)
        full = WHEEL.rotor.inertia * WHEEL.rotor.speed_limit
        # The rotor turns the other way: its speed times its inertia after this tick stays within its limit.
        torque[0] = min(max(torque[0], (momentum - full) * RATE), (momentum + full) * RATE)
        momentum -= torque[0] / RATE
        given = torque
        rows.append((y, control, torque))
        for _ in range(STEPS):
            plain.advance(torque)
    return [np.array(x) for x in zip(*rows, strict=True)]


def excitation(samples):
    slow = np.sin(2.0 * np.pi * 0.4 * np.arange(samples) / RATE)
    return 0.6 * np.random.default_rng(0).standard_normal((samples, 2)) + 0.4 * slow[:, None]


def test_all_at_once_is_the_loop_written_out(plant, rig, law):
    u = excitation(3000)
    blocks = list(simulate_rig(rig, on_rig(rig, law), cut_blocks(u), np.random.default_rng(0)))
    ours = [np.concatenate([getattr(b, n) for b in blocks]) for n in ("measured", "control", "torque")]
    exact = written_out(plant, law, u)
    for name, a, b in zip(("measured", "control", "torque"), ours, exact, strict=True):
        # Rounding; a count or a step of a converter more would be a thousand times as much.
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-3 * STEP, err_msg=name)
    torque = ours[2]
    # Each of them has its turn: both ends of the motors, the slew, the rotor, friction that slips.
    for i, motor in enumerate((WHEEL, GIMBAL)):
        assert np.sum(np.abs(torque[:, i] + motor.holding) >= motor.torque_limit * (1.0 - 1e-9)) > 100
        assert np.sum(np.isclose(np.abs(np.diff(torque[:, i])), motor.slew_limit / RATE, rtol=1e-9)) > 100
    momentum = np.concatenate([b.momentum for b in blocks])[:, 0] / RATE
    assert np.sum(np.abs(momentum) >= 0.12 * (1.0 - 1e-9)) > 30
    assert abs(blocks[-1].state.joints[0]) > 0.0


def test_memory_is_that_of_a_block_however_long_the_run(rig, law):
    peaks = []
    for count in (2, 20):
        tracemalloc.start()
        pieces = (excitation(1000) for _ in range(count))
        for _ in simulate_rig(rig, on_rig(rig, law), pieces, np.random.default_rng(0)):
            pass
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # Ten times as long, the same memory: a tenth for what the interpreter keeps, 10 kB whatever the block.
    assert peaks[1] < 1.1 * peaks[0]
