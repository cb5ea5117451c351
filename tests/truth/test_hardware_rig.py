"""The rig as hardware: ticks and products of many ticks are one motion; delays are exact."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from joint_reference import PlainJoints
from middeck.errors import ConfigError, DataError
from middeck.joints.attachment import JointElements
from middeck.joints.deadband import Deadband
from middeck.joints.friction import Friction
from middeck.laboratory.rig.linear_view import close_rig, linearise_rig
from middeck.laboratory.rig.parts.motors import Motor, Rotor
from middeck.laboratory.rig.parts.sensors import Encoder, Gyro, Sampler, sensor_lag
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.runs import StopRule, remove_ramps, run_closed_loop, run_open_loop
from middeck.laboratory.rig.ticks.simulate_rig import simulate_rig, switch_on
from middeck.signals.excitation.multisine import random_multisine
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.plants.response import statespace_response
from middeck.systems.poles.stability import growth_rates
from middeck.systems.sampling.sampling import sample_dynamics, tustin
from middeck.systems.sampling.simulation import simulate
from middeck.systems.state_space.feedback import feedback
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from rig_checks import on_rig, run_through

RATE, DELAY = 500.0, 0.0103  # not a whole number of samples
INPUTS = (Port("base", "N m"), Port("pri_rel_z", "N m"))
OUTPUTS = (Port("bus_z", "rad"), Port("pri_rel_z", "rad"))
GYRO = Gyro(bandwidth_hz=100.0, anti_alias_hz=200.0)


@pytest.fixture(scope="module")
def plant():
    omega = 2.0 * np.pi * np.array([0.9, 1.3, 7.2, 31.0])
    joint, bus = np.array([0.8, 3.0, 1.1, 0.4]), np.array([0.3, 0.2, -0.4, 0.2])
    psi, phi = np.stack([bus, joint], axis=1), np.stack([bus, joint])
    return Plant(
        dynamics=ModalSystem(
            omega=omega, zeta=np.full(4, 0.02), psi=psi, phi=phi, phi_rate=0.0 * phi, names=tuple("abcd")
        ),
        inputs=INPUTS,
        outputs=OUTPUTS,
    )


def rig_of(plant, motors=None, sensors=None, **more):
    return build_rig(plant, motors=motors, sensors=sensors, **{"sample_hz": RATE, "delay_s": DELAY} | more)


def exactly_sampled(plant, delay_s=DELAY):
    return sample_dynamics(plant.dynamics, 1.0 / RATE, delay_s - 0.5 / RATE)


def damper(gain=0.05):
    """Rate feedback of both angles to both torques behind a roll-off, to be added at the plant's input."""
    w = 2.0 * np.pi * 3.0
    A = np.kron(np.eye(2), np.array([[0.0, 1.0], [-(w**2), -1.4 * w]]))
    B, C = np.kron(np.eye(2), np.array([[0.0], [w**2]])), np.kron(np.eye(2), np.array([[0.0, -gain]]))
    return tustin(StateSpace(A, B, C, np.zeros((2, 2))), 1.0 / RATE)


def noise(samples=3000, seed=0, inputs=2):
    return np.random.default_rng(seed).standard_normal((samples, inputs))


@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize("delay", [0.5 / RATE, 0.003, DELAY])
@pytest.mark.parametrize("ticks", [False, True], ids=["in blocks", "tick by tick"])
def test_with_nothing_switched_on_it_is_the_sampled_plant(plant, steps, delay, ticks):
    u, law, exact = noise(), damper(), exactly_sampled(plant, delay)
    far = {
        "base": Motor(torque_limit=1e9),
        "pri_rel_z": Motor(torque_limit=1e9),
    }  # limits that nothing reaches
    rig = rig_of(plant, motors=far if ticks else None, substeps=steps, delay_s=delay)
    assert rig.linear != ticks
    loop = feedback(exact, law, range(2), range(2))
    y, _ = simulate(loop, np.hstack([u, np.zeros_like(u)]))
    taken = run_through(rig, law, u)
    # Rounding of 3000 steps of lightly damped modes.
    np.testing.assert_allclose(taken["measured"], y[:, :2], rtol=0.0, atol=1e-11 * np.abs(y[:, :2]).max())
    np.testing.assert_allclose(taken["control"], y[:, 2:], rtol=0.0, atol=1e-11 * np.abs(y[:, 2:]).max())
    np.testing.assert_allclose(taken["torque"], u + taken["control"], rtol=0.0, atol=1e-15)
    linear = linearise_rig(rig).sampled
    # As many states as the sampled plant has, but for the last torque where there is no true delay.
    assert len(linear.A) - len(exact.A) == (2 if delay == 0.5 / RATE else 0)
    hz = np.geomspace(0.1, 240.0, 50)
    ours, theirs = (statespace_response(s, 2.0 * np.pi * hz) for s in (linear, exact))
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-11 * np.abs(theirs).max())


@pytest.mark.parametrize("element", [Friction(0.02, 2.0, 0.01), Deadband(0.01, 3.0)], ids=["rubs", "knocks"])
@pytest.mark.parametrize("steps", [1, 4])
def test_with_joints_it_is_what_plain_steps_give(plant, element, steps):
    u = 0.3 * noise(1500)
    joints = [JointElements("pri_rel_z", "pri_rel_z", (element,))]
    taken = run_through(rig_of(plant, joints=joints, substeps=steps), None, u)
    plain, y = PlainJoints(plant, joints, 1.0 / RATE / steps, DELAY - 0.5 / RATE), []
    for torque in u:
        y.append(plain.outputs)
        for _ in range(steps):
            plain.advance(torque)
    y = np.array(y)
    assert np.abs(y - run_through(rig_of(plant), None, u)["measured"]).max() > 1e-3  # it matters
    # Rounding, which a slider's corner amplifies.
    np.testing.assert_allclose(taken["measured"], y, rtol=0.0, atol=1e-10 * np.abs(y).max())


@pytest.mark.parametrize("steps", [1, 5])
def test_every_sensor_is_delayed_by_the_same_total_delay(plant, steps):
    hz = np.geomspace(0.2, 20.0, 40)
    sensors = {"bus_z": GYRO, "pri_rel_z": Encoder(1e-12)}
    H = statespace_response(
        linearise_rig(rig_of(plant, sensors=sensors, substeps=steps)).sampled, 2 * np.pi * hz
    )
    exact = statespace_response(exactly_sampled(plant), 2.0 * np.pi * hz)
    # The encoder waits for the gyro, by a part of a sample, exactly.
    np.testing.assert_allclose(H[:, 1], exact[:, 1], rtol=0.0, atol=1e-11 * np.abs(exact).max())
    # The gyro's own filters take the place of true delay. They miss its phase by the third power of w lag.
    lag = sensor_lag(GYRO)
    assert lag == pytest.approx((1.0 / 100.0 + np.sqrt(2.0) / 200.0) / (2.0 * np.pi))
    ratio = H[:, 0, 1] / exact[:, 0, 1]
    assert np.all(np.abs(np.angle(ratio)) < (2.0 * np.pi * hz * lag) ** 3)
    # Exactly: the filters and the trapezoidal rule, w T/2 / tan(w T/2), in the place of the delay.
    s = 2j * np.pi * hz
    a, f = 2.0 * np.pi * 100.0, 2.0 * np.pi * 200.0
    filters = a / (s + a) * f**2 / (s**2 + np.sqrt(2.0) * f * s + f**2) * np.exp(s * lag)
    half = np.pi * hz / RATE
    expected = filters * half / np.tan(half)
    # What a plant with modes to 31 Hz folds from beyond 250 Hz into the samples, small beside the response.
    at = hz < 10.0
    np.testing.assert_allclose(ratio[at], expected[at], rtol=2e-3)


@pytest.mark.parametrize("unit", [1.0, 1e8, 1e-8])
@pytest.mark.parametrize("free", [False, True])
def test_the_linear_view_of_a_gyro_is_what_it_sums(plant, free, unit):
    """Its sum is a row of the other states where the plant comes to rest, and a state of its own in orbit.

    In whatever ``unit`` a torque is.
    """
    modal = dataclasses.replace(plant.dynamics, psi=unit * plant.dynamics.psi)
    if free:
        omega = np.concatenate([np.zeros(1), modal.omega[1:]])
        modal = dataclasses.replace(modal, omega=omega, zeta=np.where(omega > 0.0, modal.zeta, 0.0))
    sensors = {"bus_z": GYRO, "pri_rel_z": Sampler()}
    rig = rig_of(dataclasses.replace(plant, dynamics=modal), sensors=sensors)
    linear = linearise_rig(rig).sampled
    extra = 1 if free else 0
    assert len(linear.A) == rig.plant.angle.shape[1] + 2 * (rig.plant.delay_ticks + 1) + extra
    u = noise()
    y, _ = simulate(linear, u)
    taken = run_through(rig, None, u)["measured"]
    np.testing.assert_allclose(y, taken, rtol=0.0, atol=1e-10 * np.abs(taken).max(axis=0).min())
    # Closed, no pole is at one but the sum, and the free angle, of which the law reads the rate only.
    poles = np.linalg.eigvals(close_rig(rig, damper(0.05 / unit)).A)
    assert np.sum(np.abs(poles - 1.0) < 1e-7) == 2 * extra


def test_blocks_and_seeds_make_the_same_numbers(plant):
    sensors = {
        "bus_z": Gyro(
            bandwidth_hz=100.0,
            noise=2e-4,
            bias=1e-3,
            bias_walk=1e-4,
            anti_alias_hz=200.0,
            resolution=1e-4,
            range=5.0,
        ),
        "pri_rel_z": Sampler(1e-3),
    }
    rig = rig_of(plant, sensors=sensors)
    taken = [run_through(rig, damper(), noise(), np.random.default_rng(5), size) for size in (100, 777, 3000)]
    for other in taken[1:]:
        for name, values in taken[0].items():
            assert name == "state" or np.array_equal(values, other[name]), name
    # Only what the computer adds up has its mean at rest taken off.
    trim = switch_on(rig, on_rig(rig, damper()), 1.0, np.random.default_rng(5)).trim
    assert (trim != 0.0).tolist() == [True, False]
    again = run_through(rig, damper(), noise(), np.random.default_rng(6))
    assert not np.array_equal(again["measured"], taken[0]["measured"])


def test_a_run_gives_a_record_of_steady_periods(plant):
    u = np.zeros((2000, 2))
    u[:, 1] = random_multisine((0.5, 60.0), 4.0, RATE, 0.1, np.random.default_rng(1))
    run = run_open_loop(rig_of(plant), u, periods=2, rng=np.random.default_rng(0), settle=40)
    assert run.cause == ""
    assert run.record.periodic
    assert run.record.y.shape == (1, 2, 2000, 2)
    assert run.control.shape == run.torque.shape == (2, 2000, 2)
    assert not np.any(run.control)
    spectra = [np.fft.rfft(x[0].mean(axis=0), axis=0)[2:241] for x in (run.record.u, run.record.y)]
    H = spectra[1] / spectra[0][:, 1:]
    hz = np.arange(2, 241) / 4.0
    exact = statespace_response(exactly_sampled(plant), 2.0 * np.pi * hz)[:, :, 1]
    # 40 periods at 0.11 rad/s and more leave 2e-8 of the start.
    np.testing.assert_allclose(H, exact, rtol=0.0, atol=1e-7 * np.abs(exact).max())


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("sensor", [Sampler(), GYRO], ids=["sampled", "gyro"])
@pytest.mark.parametrize("delay", [0.005, DELAY])
def test_a_steady_start_is_steady(plant, closed, sensor, delay):
    u = np.zeros((2000, 2))
    u[:, 1] = random_multisine((0.5, 60.0), 4.0, RATE, 0.1, np.random.default_rng(1))
    rig = rig_of(plant, sensors={"bus_z": sensor, "pri_rel_z": Encoder(1e-14)}, delay_s=delay)
    law = on_rig(rig, damper()) if closed else None
    run = run_closed_loop(
        rig, law, u, periods=2, rng=np.random.default_rng(0), settle=0, rest_s=0.0, steady=True
    )
    first, second = run.record.y[0]
    # Rounding, of a linear system with a condition number of some 1e3; from rest it would be of order one.
    np.testing.assert_allclose(second, first, rtol=0.0, atol=1e-9 * np.abs(first).max())
    assert np.std(first[:, 1]) > 1e-3


def test_an_unstable_loop_is_stopped_and_says_where(plant):
    """Positive rate feedback drives the mode at 1.3 Hz: the motor saturates, the angle passes its stop."""
    rig = rig_of(plant, motors={"base": Motor(torque_limit=0.2), "pri_rel_z": Motor(torque_limit=0.2)})
    law = damper(-0.2)
    u = 0.01 * noise(1000)
    taken = {}
    for name, stops in (("stopped", [StopRule("pri_rel_z", 0.3)]), ("left alone", [])):
        taken[name] = run_closed_loop(
            rig, on_rig(rig, law), u, periods=10, rng=np.random.default_rng(0), stops=stops, settle=0
        )
    stopped = taken["stopped"]
    assert stopped.record is None
    assert stopped.cause.startswith("stopped: pri_rel_z at ")
    rates = growth_rates(close_rig(rig, law))
    growing = rates[np.argmax(rates.real)]
    assert growing.real > 0.1
    reported = float(stopped.cause.split("mostly at ")[1].removesuffix(" Hz"))
    # Four seconds are five turns: a twentieth of a hertz.
    assert reported == pytest.approx(abs(growing.imag) / (2.0 * np.pi), abs=0.05)
    y = stopped.partial.y[0, 0, :, 1]
    assert abs(y[-1]) > 0.3
    assert np.abs(y[:-1]).max() <= 0.3
    assert stopped.events.stopped_s == pytest.approx((len(y) - 1) / RATE)
    assert stopped.partial.u.shape[2] == len(y)
    # What would have come after it is not counted.
    assert round(stopped.events.saturated[1] * len(y), 6).is_integer()
    # Nobody stops it: it goes on at the limit of its motor.
    assert taken["left alone"].record is not None
    assert taken["left alone"].events.saturated[1] > 0.1


def test_a_loop_without_limits_that_overflows_has_a_cause(plant):
    law = SampledStateSpace(
        np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((2, 0)), 1e6 * np.eye(2), period_s=1.0 / RATE
    )
    rig = rig_of(plant, sensors={"bus_z": Encoder(1e-9), "pri_rel_z": Encoder(1e-9)})
    run = run_closed_loop(
        rig, on_rig(rig, law), noise(2000), periods=1, rng=np.random.default_rng(0), settle=0
    )
    assert run.record is None
    assert "overflow" in run.cause
    assert run.partial is None


def test_a_law_that_overflows_behind_a_limited_motor_has_a_cause_too(plant):
    """The motor's limit keeps the plant finite; the law's own state doubles every tick."""
    B = np.array([[1.0, 0.0]])
    law = SampledStateSpace([[2.0]], B, 1e-3 * B.T, np.zeros((2, 2)), period_s=1.0 / RATE)
    rig = rig_of(plant, motors={"base": Motor(torque_limit=0.1), "pri_rel_z": Motor(torque_limit=0.1)})
    run = run_closed_loop(
        rig, on_rig(rig, law), noise(600), periods=8, rng=np.random.default_rng(0), settle=0
    )
    assert run.record is None
    assert "the law itself" in run.cause
    assert np.isfinite(run.partial.y).all()
    assert run.partial.u.shape[2] == run.partial.y.shape[2] == 600


def test_ramps_are_taken_out_and_nothing_else():
    rng = np.random.default_rng(2)
    periodic = rng.standard_normal((100, 2)) - 0.3
    y = np.broadcast_to(periodic, (4, 100, 2)).copy()
    ramp = 0.02 * np.arange(400).reshape(4, 100)
    y[:, :, 0] += ramp + 7.0
    flat = remove_ramps(y, np.array([True, False]))
    expected = np.broadcast_to(periodic[:, 0] - periodic[:, 0].mean(), (4, 100))
    # The mean of four ramped periods is the ramp's; what is left is the periodic part without its mean.
    np.testing.assert_allclose(flat[:, :, 0], expected, rtol=0.0, atol=1e-12)
    assert np.array_equal(flat[:, :, 1], y[:, :, 1])


def test_settings_that_cannot_be_are_refused(plant):
    with pytest.raises(ConfigError, match="hold and filters"):
        rig_of(plant, sensors={"bus_z": GYRO}, delay_s=0.003)
    with pytest.raises(ConfigError, match="substeps in a tick"):
        rig_of(plant, substeps=0)
    with pytest.raises(ConfigError, match="no output named 'nose'"):
        rig_of(plant, sensors={"nose": Sampler()})
    with pytest.raises(ConfigError, match="no input named 'fin'"):
        rig_of(plant, motors={"fin": Motor()})
    rub = JointElements("pri_rel_z", "pri_rel_z", (Friction(0.1, 1.0),))
    with pytest.raises(ConfigError, match="two entries"):
        rig_of(plant, joints=[rub, rub])
    with pytest.raises(ConfigError, match="the motor gives no more than"):
        Motor(torque_limit=1.0, holding=-1.5)
    with pytest.raises(ConfigError, match="rotor"):
        Rotor(0.0, 300.0)
    with pytest.raises(ConfigError, match="a gain of nan"):
        Encoder(1e-6, gain=np.nan)
    with pytest.raises(ConfigError, match="a gain of 0"):
        Gyro(gain=0.0)
    with pytest.raises(ConfigError, match="noise = -1"):
        Gyro(noise=-1.0)
    for rig in (rig_of(plant), rig_of(plant, joints=[rub])):
        with pytest.raises(ConfigError, match="2 motors"):
            list(simulate_rig(rig, None, [np.ones((5, 3))], np.random.default_rng(0)))
        with pytest.raises(DataError, match="not finite"):
            list(simulate_rig(rig, None, [np.full((5, 2), np.nan)], np.random.default_rng(0)))
    with pytest.raises(ConfigError, match="samples a second"):
        rig_of(plant, sample_hz=0.0)
    with pytest.raises(ConfigError, match="without motor or sensor"):
        rig_of(plant, motors={})
    with pytest.raises(ConfigError, match="periods"):
        run_open_loop(rig_of(plant), noise(10), periods=0, rng=np.random.default_rng(0))
    with pytest.raises(ConfigError, match="no output named"):
        run_open_loop(
            rig_of(plant), noise(10), periods=1, rng=np.random.default_rng(0), stops=[StopRule("x", 1.0)]
        )
