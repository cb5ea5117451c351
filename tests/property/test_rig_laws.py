"""Laws of motors, sensors and joints that hold whatever is commanded and however the article is made."""

from __future__ import annotations

import dataclasses

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from joint_reference import stored_energy
from middeck.joints.attachment import JointElements
from middeck.joints.deadband import Deadband
from middeck.joints.friction import Friction
from middeck.laboratory.rig.parts.motors import Motor, Rotor
from middeck.laboratory.rig.parts.sensors import Encoder, Sampler
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.ticks.simulate_rig import simulate_rig, switch_on
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.sampling.sampling import sample_dynamics
from middeck.systems.sampling.simulation import simulate
from middeck.systems.state_space.modal_system import ModalSystem

RATE = 500.0
seeds = st.integers(0, 2**32 - 1)
BITS = 12


def random_plant(rng, joints):
    """Undamped modes of which the first is rigid, between torques and angles of as many joints."""
    count = int(rng.integers(joints, 6))
    omega = 2.0 * np.pi * np.concatenate([[0.0], 10.0 ** rng.uniform(-0.5, 1.6, count)])
    phi = rng.normal(size=(joints, count + 1))
    names = tuple(f"mode {i}" for i in range(count + 1))
    modal = ModalSystem(
        omega=omega, zeta=np.zeros(count + 1), psi=phi.T, phi=phi, phi_rate=0.0 * phi, names=names
    )
    ports = [f"joint {i}" for i in range(joints)]
    return Plant(
        dynamics=modal,
        inputs=tuple(Port(p, "N m") for p in ports),
        outputs=tuple(Port(p, "rad") for p in ports),
    )


def rig_of(plant, motor=Motor(), sensor=Sampler(), **more):  # noqa: B008
    return build_rig(
        plant, motors={p.name: motor for p in plant.inputs}, sensors={p.name: sensor for p in plant.outputs},
        sample_hz=RATE, delay_s=0.004, **more,
    )  # fmt: skip


def run(rig, u):
    (block,) = simulate_rig(rig, None, [u], np.random.default_rng(0))
    return block


@given(seeds, st.floats(-0.9, 0.9), st.booleans(), st.booleans())
def test_a_motor_keeps_its_limits_whatever_is_commanded(seed, holding, slews, turns):
    rng = np.random.default_rng(seed)
    limit, slew = 10.0 ** rng.uniform(-2.0, 1.0, 2) * [1.0, 100.0]
    rotor = Rotor(0.006, float(10.0 ** rng.uniform(-1.0, 2.5))) if turns else None
    motor = Motor(
        torque_limit=limit,
        holding=holding * limit,
        slew_limit=slew if slews else np.inf,
        resolution=2.0 * limit / 2**BITS,
        rotor=rotor,
    )
    # From far below the limit to far above it, and steps.
    u = limit * 10.0 ** rng.uniform(-3.0, 2.0) * np.where(rng.random(300) < 0.5, 1.0, rng.normal(size=300))
    block = run(rig_of(random_plant(rng, 1), motor), u[:, None])
    torque, room = block.torque[:, 0], 1.0 + 1e-12
    assert np.abs(torque + motor.holding).max() <= limit * room
    if turns:
        # In units of a torque over a tick; what it holds is minus what it gave.
        assert np.abs(block.momentum).max() <= rotor.inertia * rotor.speed_limit * RATE * room
        np.testing.assert_allclose(
            block.momentum[:, 0], -np.cumsum(torque), rtol=0.0, atol=1e-13 * np.abs(torque).sum()
        )
    elif slews:
        assert np.abs(np.diff(torque, prepend=0.0)).max() <= slew / RATE * room
    # Never the other way, never more than was asked for, but for half a step of the converter.
    if not slews and not turns:
        assert np.all(np.abs(torque) <= np.abs(u) + 0.5 * motor.resolution * room)
        assert np.all(torque * u >= -motor.resolution * np.abs(u))


@given(seeds)
def test_limits_and_converters_change_nothing_the_second_time(seed):
    """What a motor gives is what it gives when asked for that; a converter's limit lies on its steps."""
    rng = np.random.default_rng(seed)
    limit = float(10.0 ** rng.uniform(-2.0, 1.0))
    u = 2.0 * limit * rng.normal(size=(200, 1))
    plant = random_plant(rng, 1)
    for motor in (
        Motor(torque_limit=limit, resolution=2.0 * limit / 2**BITS),
        Motor(torque_limit=limit, slew_limit=50.0 * limit),
        Motor(torque_limit=limit, rotor=Rotor(0.006, limit / 0.006 * 0.05)),
    ):
        once = run(rig_of(plant, motor), u).torque
        again = run(rig_of(plant, motor), once).torque
        assert not np.array_equal(once, u)
        np.testing.assert_allclose(again, once, rtol=0.0, atol=1e-13 * limit)


@given(seeds)
def test_an_encoder_is_right_to_half_a_step_and_odd(seed):
    rng = np.random.default_rng(seed)
    plant, step = random_plant(rng, 2), float(10.0 ** rng.uniform(-7.0, -2.0))
    u = rng.normal(size=(200, 2))
    true = run(rig_of(plant), u).readings
    counted = run(rig_of(plant, sensor=Encoder(step)), u).readings
    assert np.abs(counted - true).max() <= 0.5 * step * (1.0 + 1e-9)
    np.testing.assert_allclose(counted / step, np.round(counted / step), rtol=0.0, atol=1e-6)
    assert np.array_equal(run(rig_of(plant, sensor=Encoder(step)), -u).readings, -counted)


@given(seeds, st.sampled_from([0.0, 1.0, 2.0, 0.37, 1.5, 4.9]), st.integers(1, 3), st.booleans())
def test_with_nothing_switched_on_it_is_the_sampled_plant(seed, delay, steps, accelerates):
    """In blocks and tick by tick, angles and accelerations, with whatever delay."""
    rng = np.random.default_rng(seed)
    plant = random_plant(rng, int(rng.integers(1, 4)))
    if accelerates:
        delay = max(delay, 0.01)
        phi = plant.dynamics.phi
        full = dataclasses.replace(plant.dynamics, phi_acceleration=1e-3 * rng.normal(size=phi.shape))
        plant = dataclasses.replace(plant, dynamics=full)
    u = rng.normal(size=(300, len(plant.inputs)))
    exact, _ = simulate(sample_dynamics(plant.dynamics, 1.0 / RATE, delay / RATE), u)
    for motor in (Motor(), Motor(torque_limit=1e9)):
        motors = {p.name: motor for p in plant.inputs}
        rig = build_rig(plant, motors=motors, sample_hz=RATE, delay_s=(delay + 0.5) / RATE, substeps=steps)
        assert rig.linear == (motor == Motor())
        # Rounding of 300 steps of undamped modes.
        np.testing.assert_allclose(run(rig, u).measured, exact, rtol=0.0, atol=1e-11 * np.abs(exact).max())


def random_element(rng):
    if rng.random() < 0.7:
        return Friction(float(10.0 ** rng.uniform(-4.0, 0.0)), float(10.0 ** rng.uniform(-1.0, 4.0)))
    return Deadband(float(10.0 ** rng.uniform(-4.0, -1.0)), float(10.0 ** rng.uniform(-1.0, 4.0)))


@given(seeds, st.integers(1, 3), st.integers(1, 3))
def test_left_alone_a_rig_never_gains_energy(seed, joints, steps):
    """Modes, presliding springs and flanks together, tick by tick, at any stiffness against the step."""
    rng = np.random.default_rng(seed)
    plant = random_plant(rng, joints)
    parts = [
        JointElements(p.name, p.name, tuple(random_element(rng) for _ in range(int(rng.integers(1, 3)))))
        for p in plant.inputs
    ]
    rig = rig_of(plant, joints=parts, substeps=steps)
    omega = plant.dynamics.omega
    scale, size = np.where(omega > 0.0, omega, 1.0), 2 * len(omega)
    rng0 = np.random.default_rng(0)
    state = dataclasses.replace(
        switch_on(rig, None, 0.0, rng0), x=0.05 * rng.normal(size=rig.plant.angle.shape[1])
    )

    def energy(state):
        q, rate = state.x[:size:2], state.x[1:size:2] * scale
        states, angles = iter(state.joints), rig.plant.angle @ state.x
        stored = sum(
            stored_energy(e, float(a), float(next(states)))
            for j, a in zip(parts, angles, strict=True)
            for e in j.elements
        )
        return 0.5 * float(np.sum(rate**2 + (omega * q) ** 2)) + stored

    found = []
    for _ in range(60):
        (block,) = simulate_rig(rig, None, [np.zeros((1, joints))], rng0, state)
        state = block.state
        found.append(energy(state))
    assume(found[0] > 1e-9)
    # Rounding of a tick; near-dependent joints settle to some digits less.
    assert np.diff(found).max() <= 1e-11 * found[0]
