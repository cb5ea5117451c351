"""Friction and gaps in time: energy, order, and free and forced motion against independent solutions."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from joint_reference import stored_energy
from middeck.errors import ConfigError
from middeck.joints.attachment import JointElements
from middeck.joints.deadband import Deadband
from middeck.joints.friction import Friction
from middeck.laboratory.rig.parts.sensors import Gyro, Sampler
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.ticks.simulate_rig import simulate_rig, switch_on
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.sampling.sampling import sample_dynamics
from middeck.systems.sampling.simulation import simulate
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import sum_of_modes
from rig_checks import run_through

J, KP = 0.062, 3.9  # a payload of 5 kg hanging 8 cm below its axis
BEARING = Friction(slip_torque=0.004, stiffness=2.0)
GEAR = Deadband(gap=0.002, stiffness=30.0)
TORQUE, ANGLE = Port("gimbal", "N m"), Port("gimbal", "rad")


def pendulum(zeta=0.0):
    """One joint: inertia J and pendulum stiffness KP."""
    one = np.array([[1.0 / np.sqrt(J)]])
    modal = sum_of_modes(np.array([np.sqrt(KP / J)]), np.array([zeta]), one, one, names=("pendulum",))
    return Plant(dynamics=modal, inputs=(TORQUE,), outputs=(ANGLE,))


def two_joints():
    """Two joints of one article with five undamped modes, one of them rigid."""
    omega = 2.0 * np.pi * np.array([0.0, 0.9, 1.7, 6.0, 31.0])
    phi = np.random.default_rng(2).normal(size=(2, 5))
    ports = tuple(Port(n, "N m") for n in "ab"), tuple(Port(n, "rad") for n in "ab")
    return Plant(
        dynamics=ModalSystem(
            omega=omega, zeta=np.zeros(5), psi=phi.T, phi=phi, phi_rate=0.0 * phi, names=tuple("vwxyz")
        ),
        inputs=ports[0],
        outputs=ports[1],
    )


def at(*elements):
    return JointElements("gimbal", "gimbal", tuple(elements))


def rig_of(plant, joints, step_s, delay_s=0.0):
    """A rig with a substep in a tick."""
    return build_rig(plant, joints=joints, sample_hz=1.0 / step_s, delay_s=delay_s + 0.5 * step_s)


def at_rest(rig, x=None, joints=None):
    start = switch_on(rig, None, 0.0, np.random.default_rng(0))
    x, joints = start.x if x is None else x, start.joints if joints is None else joints
    return dataclasses.replace(start, x=x, joints=joints)


def released(rig, angle, slider):
    """At rest at ``angle``, the elements in the state ``slider``: relaxed where it is the angle."""
    x = np.zeros(rig.plant.angle.shape[1])
    x[0] = angle * np.sqrt(J)
    return at_rest(rig, x, np.full(1, slider))


def step_freely(rig, start, steps):
    """The states after each step of free motion."""
    rng, rest = np.random.default_rng(0), np.zeros((1, len(rig.inputs)))
    return [block.state for block in simulate_rig(rig, None, [rest] * steps, rng, start)]


def reference(element, times, angle):
    """The pendulum as an ordinary differential equation with the spring's torque as a state."""

    def rate(_, y):
        theta, speed, torque = y
        if isinstance(element, Friction):
            slips = abs(torque) >= element.slip_torque and torque * speed > 0.0
            change = 0.0 if slips else element.stiffness * speed
            total = np.clip(torque, -element.slip_torque, element.slip_torque)
        else:
            change, total = 0.0, element.resist(theta, 0.0)[0]
        return [speed, -(KP * theta + total) / J, change]

    # The right-hand side has corners: a fine fixed ceiling on the step keeps their error below 1e-9.
    return solve_ivp(rate, (0.0, times[-1]), [angle, 0.0, 0.0], t_eval=times, rtol=1e-10, atol=1e-13,
                     max_step=1e-3).y[0]  # fmt: skip


@pytest.mark.parametrize("element", [BEARING, GEAR], ids=["friction", "deadband"])
def test_free_motion_equals_an_independent_integration_to_second_order(element):
    error = []
    for steps in (400, 800, 1600):
        times = np.linspace(0.0, 2.0, steps + 1)
        rig = rig_of(pendulum(), [at(element)], times[1])
        start = released(rig, 0.02, 0.0 if element is GEAR else 0.02)
        y = run_through(rig, None, np.zeros((steps + 1, 1)), start=start)["measured"][:, 0]
        error.append(np.abs(y - reference(element, times, 0.02)).max())
    # Second order, give or take where the corners fall within a step.
    assert np.log2(error[0] / error[2]) / 2.0 == pytest.approx(2.0, abs=0.3)
    # A held mean makes a spring of frequency w slow by (w h)^2/12; the phase that is lost in 2 s.
    w, h = np.sqrt((KP + element.stiffness) / J), times[1]
    assert error[2] < 0.02 * (w * h) ** 2 / 12.0 * w * 2.0


def energies(plant, rig, steps, start):
    """Energy of the plant's modes and of the elements after each step of free motion."""
    total, omega = [], plant.dynamics.omega
    scale = np.where(omega > 0.0, omega, 1.0)
    for state in step_freely(rig, start, steps):
        q, rate = state.x[::2], state.x[1::2] * scale
        angles = rig.plant.angle @ state.x
        parts = [(e, a) for j, a in zip(rig.joints, angles, strict=True) for e in j.elements]
        stored = sum(stored_energy(e, a, s) for (e, a), s in zip(parts, state.joints, strict=True))
        total.append(0.5 * np.sum(rate**2 + (omega * q) ** 2) + stored)
    return np.array(total)


@pytest.mark.parametrize("step_s", [0.001, 0.05])  # fine; and a twentieth of a second with contacts at 5 Hz
def test_energy_never_grows_and_a_gap_keeps_it(step_s):
    plant = two_joints()
    rubbing = [JointElements(n, n, (BEARING, GEAR)) for n in "ab"]
    gap = [JointElements(n, n, (GEAR,)) for n in "ab"]
    for joints, lossless in ((rubbing, False), (gap, True)):
        rig = rig_of(plant, joints, step_s)
        x = 0.01 * np.random.default_rng(3).normal(size=10)
        energy = energies(plant, rig, 600, at_rest(rig, x))
        # Rounding of a step.
        assert np.diff(energy).max() < 1e-13 * energy[0]
        if lossless:
            assert energy[-1] == pytest.approx(energy[0], rel=1e-10)  # of 600 steps
        else:
            assert energy[-1] < (1.0 - 1e-4) * energy[0]


def test_dissipated_energy_is_slip_torque_times_way_slipped():
    rig = rig_of(pendulum(), [at(BEARING)], 0.002)
    states = [start := released(rig, 0.05, 0.05), *step_freely(rig, start, 500)]
    way = np.sum(np.abs(np.diff([state.joints[0] for state in states])))
    energy = [
        0.5 * np.sum(s.x**2) * KP / J
        + stored_energy(BEARING, float((rig.plant.angle @ s.x)[0]), float(s.joints[0]))
        for s in (states[0], states[-1])
    ]
    lost = energy[0] - energy[1]
    assert way > 0.1
    assert lost == pytest.approx(BEARING.slip_torque * way, rel=1e-11)  # rounding of 500 steps


def test_without_elements_it_is_the_exact_sampled_plant():
    plant = pendulum(zeta=0.02)
    u = np.random.default_rng(4).normal(size=(300, 1))
    taken = run_through(rig_of(plant, [], 0.01, 0.0137), None, u)
    exact, last = simulate(sample_dynamics(plant.dynamics, 0.01, 0.0137), u)
    # Rounding.
    np.testing.assert_allclose(taken["measured"], exact, rtol=0.0, atol=1e-13 * np.abs(exact).max())
    np.testing.assert_allclose(taken["state"].x, last[:2], rtol=0.0, atol=1e-13 * np.abs(last).max())


def test_friction_that_never_slips_is_a_spring_and_viscous_damping_is_exact():
    plant = pendulum(zeta=0.01)
    u = np.random.default_rng(4).normal(size=(2000, 1))
    step = 0.001
    sticky = Friction(slip_torque=1e9, stiffness=2.0, viscous=0.05)
    y = run_through(rig_of(plant, [at(sticky)], step), None, u)["measured"]
    drag = 2.0 * 0.01 * np.sqrt(KP * J) + 0.05
    A = [[0.0, 1.0], [-(KP + 2.0) / J, -drag / J]]
    spring = StateSpace(A, [[0.0], [1.0 / J]], [[1.0, 0.0]], [[0.0]])
    exact, _ = simulate(sample_dynamics(spring, step), u)
    # The held mean of a spring's torque shifts its frequency by (omega_k step)^2/12 at most, omega_k^2 = 2/J:
    # 2.7e-6 of 20 rad over the run.
    assert np.abs(y - exact).max() < 6e-5 * np.abs(exact).max()
    only_drag = Friction(slip_torque=0.0, stiffness=1.0, viscous=0.05)
    y = run_through(rig_of(plant, [at(only_drag)], step), None, u)["measured"]
    A[1][0] = -KP / J
    exact, _ = simulate(sample_dynamics(StateSpace(A, spring.B, spring.C, spring.D), step), u)
    assert np.abs(y - exact).max() < 1e-11 * np.abs(exact).max()  # rounding


def test_a_joint_sticks_under_a_torque_below_its_friction_and_slips_above():
    rig = rig_of(pendulum(zeta=0.3), [at(BEARING)], 0.002)
    taken = run_through(rig, None, np.full((4000, 1), 0.005))
    assert taken["state"].joints[0] == 0.0  # the spring carries 0.0017 N m of it
    assert taken["measured"][-1, 0] == pytest.approx(
        0.005 / (KP + BEARING.stiffness), rel=1e-8
    )  # settled to e^-19
    taken = run_through(rig, None, np.full((4000, 1), 0.1))
    assert taken["measured"][-1, 0] == pytest.approx((0.1 - BEARING.slip_torque) / KP, rel=0.1)
    assert taken["state"].joints[0] > 0.0


def test_an_accelerometer_feels_the_elements_at_once():
    """J times the angular acceleration is what command, weight, drag and element leave over."""
    modal = pendulum(zeta=0.05).dynamics
    phi, rates, accelerations = (np.zeros((3, 1)) for _ in range(3))
    phi[0] = rates[1] = accelerations[2] = modal.phi[0, 0]
    ports = (ANGLE, Port("gimbal_rate", "rad/s"), Port("gimbal_acceleration", "rad/s^2"))
    full = ModalSystem(
        omega=modal.omega,
        zeta=modal.zeta,
        psi=modal.psi,
        phi=phi,
        phi_rate=rates,
        names=modal.names,
        phi_acceleration=accelerations,
    )
    element = Friction(slip_torque=0.004, stiffness=2.0, viscous=0.02)
    rig = rig_of(
        Plant(dynamics=full, inputs=(TORQUE,), outputs=ports), [at(element, GEAR)], 0.005, delay_s=0.005
    )
    u = 0.2 * np.sin(0.03 * np.arange(1500))[:, None]
    y = run_through(rig, None, u)["measured"]
    state, torque = 0.0, []
    for angle in y[:, 0]:
        value, state = element.resist(float(angle), state)
        torque.append(value + GEAR.resist(float(angle), 0.0)[0])
    drag = 2.0 * 0.05 * np.sqrt(KP * J) + element.viscous
    acts = np.concatenate([[0.0], u[:-1, 0]])
    left = acts - KP * y[:, 0] - drag * y[:, 1] - np.array(torque)
    assert np.abs(y[:, 0]).max() > 5.0 * element.slip_angle
    # The way within a step is monotone to the integrator, so that its slider is that of the samples.
    np.testing.assert_allclose(J * y[:, 2], left, atol=1e-12)


@pytest.mark.parametrize("element", [BEARING, GEAR], ids=["friction", "deadband"])
def test_an_accelerometer_that_waits_converges_with_the_internal_step(element):
    """Beside a slow gyro its samples are taken between two ticks, and between two substeps."""
    one = np.full((1, 1), 1.0 / np.sqrt(J))
    phi, accelerations = np.vstack([one, one, 0.0 * one]), np.vstack([0.0 * one, 0.0 * one, one])
    names = ("gimbal", "inertial", "acceleration")
    modal = sum_of_modes(
        [np.sqrt(KP / J)], 0.05, one, phi, names=("pendulum",), phi_acceleration=accelerations
    )
    plant = Plant(dynamics=modal, inputs=(TORQUE,), outputs=tuple(Port(n, "rad") for n in names))
    u = 0.2 * np.sin(0.05 * np.arange(300))[:, None]

    def acceleration(joints, steps):
        sensors = {"acceleration": Sampler(), "inertial": Gyro(anti_alias_hz=25.0)}
        rig = build_rig(
            plant, joints=joints, sensors=sensors, sample_hz=200.0, delay_s=0.0153, substeps=steps
        )
        return run_through(rig, None, u)["readings"][:, 0]

    exact = acceleration([at(element)], 64)
    error = [np.abs(acceleration([at(element)], n) - exact) for n in (2, 4, 8)]
    # Of second order; a sample in whose step a corner lies, one in ten, may be off by more.
    middle = [np.median(e) for e in error]
    assert np.log2(middle[0] / middle[2]) / 2.0 > 1.7
    without = np.std(acceleration([], 1) - exact)
    assert middle[2] < 2e-3 * without
    assert error[2].max() < 5e-2 * without


def test_ports_that_are_not_of_one_joint_are_refused():
    plant = two_joints()
    with pytest.raises(ConfigError, match=r"not reciprocal|does not turn"):
        rig_of(plant, [JointElements("a", "b", (GEAR,)), JointElements("b", "a", (GEAR,))], 0.01)
    # An angle of b that is read with a part of a's, in whatever unit b is: it may be a travel.
    for unit in (1.0, 1e-8):
        s = plant.system
        turned = StateSpace(
            s.A, s.B * [1.0, unit], np.array([[1.0, 0.0], [0.1, 1.0]]) @ s.C * [[1.0], [unit]], s.D
        )
        joints = [JointElements(name, name, (GEAR,)) for name in "ab"]
        rig_of(
            dataclasses.replace(plant, dynamics=dataclasses.replace(turned, C=s.C * [[1.0], [unit]])),
            joints,
            0.01,
        )
        with pytest.raises(ConfigError, match="not reciprocal"):
            rig_of(dataclasses.replace(plant, dynamics=turned), joints, 0.01)
    with pytest.raises(ConfigError, match="two entries for joint 'a'"):
        rig_of(plant, [JointElements("a", "a", ()), JointElements("a", "b", ())], 0.01)
    with pytest.raises(ConfigError, match="no input named 'c'"):
        rig_of(plant, [JointElements("c", "a", (GEAR,))], 0.01)
    direct = Plant(
        dynamics=StateSpace([[-1.0]], [[1.0]], [[1.0]], [[1.0]]), inputs=(TORQUE,), outputs=(ANGLE,)
    )
    with pytest.raises(ConfigError, match="without delay"):
        rig_of(direct, [at(GEAR)], 0.01, delay_s=0.01)
