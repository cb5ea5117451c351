"""A rig whose modes drift while it runs, against closed forms and an independent integration."""

from __future__ import annotations

import dataclasses
from contextlib import nullcontext

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import jv, yv

from middeck.errors import ConfigError
from middeck.joints.attachment import JointElements
from middeck.joints.friction import Friction
from middeck.laboratory.rig.linear_view import close_rig
from middeck.laboratory.rig.parts.motors import Motor
from middeck.laboratory.rig.parts.sensors import Encoder, Gyro, Sampler
from middeck.laboratory.rig.plant.ageing import CHORD, TURN
from middeck.laboratory.rig.plant.drifting_modes import Drift, age_plant
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.runs import StopRule, run_closed_loop, run_open_loop
from middeck.laboratory.rig.ticks.simulate_rig import simulate_rig, switch_on
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.verdict import is_stable
from middeck.systems.sampling.sampling import tustin
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import sum_of_modes
from rig_checks import on_rig

RATE, DELAY = 500.0, 0.0103
T = 1.0 / RATE
PORTS = (Port("torque", "N m"),), (Port("angle", "rad"),)


def plant_of(hz, zeta, gain):
    n = len(hz)
    shape = np.array([gain], dtype=float)
    names = tuple("abc")[:n]
    omega = 2.0 * np.pi * np.array(hz)
    return Plant(
        dynamics=ModalSystem(
            omega=omega, zeta=np.full(n, zeta), psi=shape.T, phi=shape, phi_rate=0.0 * shape, names=names
        ),
        inputs=PORTS[0],
        outputs=PORTS[1],
    )


def rig_of(plant, drifts=(), age_s=0.0, sensor=Sampler(), motor=Motor(), **more):  # noqa: B008
    return build_rig(
        plant, motors={"torque": motor}, sensors={"angle": sensor}, sample_hz=RATE, delay_s=DELAY,
        drifts=drifts, age_s=age_s, **more,
    )  # fmt: skip


def held_for(rig, ticks, pieces=1):
    return dataclasses.replace(rig, ageing=dataclasses.replace(rig.ageing, ticks=ticks, pieces=pieces))


def measured(rig, u, size=2048, seed=0, start=None):
    rng = np.random.default_rng(seed)
    start = switch_on(rig, None, 0.0, rng) if start is None else start
    pieces = (u[k : k + size] for k in range(0, len(u), size))
    return np.concatenate([b.measured for b in simulate_rig(rig, None, pieces, rng, start)])[:, 0]


def test_an_undamped_mode_that_drifts_is_a_bessel_function():
    """q'' + w0^2 s^2 q = 0 with s = 1 + e t: sqrt(s) times Bessel functions of order 1/4 of w0 s^2/(2 e)."""
    w0, percent, seconds = 2.0 * np.pi * 3.0, 12.0, 8.0
    e = 0.01 * percent / seconds
    rig = rig_of(plant_of([3.0], 0.0, [1.0]), [Drift(("a",), percent, seconds)])
    start = switch_on(rig, None, 0.0, np.random.default_rng(0))
    start = dataclasses.replace(start, x=np.array([1.0, 0.0]))
    t = T * np.arange(round(seconds * RATE))
    s, basis = 1.0 + e * t, []
    for bessel in (jv, yv):
        z, z0 = w0 * s**2 / (2.0 * e), w0 / (2.0 * e)
        # d/dt sqrt(s) J(z) at s = 1: e/2 J + w0 J'.
        slope = 0.5 * e * bessel(0.25, z0) + w0 * 0.5 * (bessel(-0.75, z0) - bessel(1.25, z0))
        basis.append((np.sqrt(s) * bessel(0.25, z), bessel(0.25, z0), slope))
    c = np.linalg.solve([[b[1] for b in basis], [b[2] for b in basis]], [1.0, 0.0])
    exact = c[0] * basis[0][0] + c[1] * basis[1][0]
    rest = np.zeros((len(t), 1))
    held = [np.abs(measured(held_for(rig, n), rest, start=start) - exact).max() for n in (24, 12, 6)]
    assert np.log2(held[0] / held[2]) / 2.0 == pytest.approx(2.0, abs=0.1)
    # At half a turn a piece the renewals kick it in step, though its frequency hardly changes in one.
    half_turn = held_for(rig, round(np.pi / (1.06 * w0) / T))
    assert np.abs(measured(half_turn, rest, start=start) - exact).max() > 1e-2
    # As planned, pieces a radian long: sixty decibels below its swing, though it drifts by 1.5 % a second.
    y = measured(rig, rest, start=start)
    assert np.abs(y - exact).max() < 1e-3
    # Energy over frequency is an adiabatic invariant: the swing shrinks with the root of the frequency.
    assert np.abs(y[-100:]).max() == pytest.approx(1.12**-0.5, rel=2e-3)
    # Without the drift it would be another motion altogether.
    still = measured(rig_of(plant_of([3.0], 0.0, [1.0])), rest, start=start)
    assert np.abs(still - exact).max() > 1.0


def test_an_acceleration_is_read_from_the_plant_as_it_is_now():
    """Of a free undamped mode it is -w^2 times the angle, w drifting; knots are 600 ticks apart."""
    w0, percent, seconds = 2.0 * np.pi * 3.0, 12.0, 4.0
    modal = sum_of_modes([w0], 0.0, [[0.0]], [[1.0], [0.0]], phi_acceleration=[[0.0], [1.0]])
    plant = Plant(
        dynamics=modal, inputs=PORTS[0], outputs=(Port("angle", "rad"), Port("acceleration", "rad/s^2"))
    )
    rig = build_rig(plant, sample_hz=RATE, delay_s=DELAY, drifts=[Drift(("a",), percent, seconds)])
    rig = held_for(rig, 6, pieces=100)
    start = dataclasses.replace(switch_on(rig, None, 0.0, np.random.default_rng(0)), x=np.array([1.0, 0.0]))
    u = np.zeros((round(seconds * RATE), 1))
    blocks = simulate_rig(rig, None, [u], np.random.default_rng(0), start)
    angle, acceleration = np.concatenate([b.measured for b in blocks]).T
    w = w0 * (1.0 + 0.01 * percent * T * np.arange(len(u)) / seconds)
    # Half a piece of 12 ms, in which w^2 changes by 4e-4, and the chord of w^2 over 3.6 %: 3e-4.
    np.testing.assert_allclose(acceleration, -(w**2) * angle, rtol=0.0, atol=1e-3 * w0**2)


def test_a_drift_to_zero_is_refused_before_the_run():
    rig = rig_of(plant_of([3.0], 0.01, [1.0]), [Drift(("a",), -50.0, 2.0)])  # zero at 4 s
    u = np.random.default_rng(3).standard_normal((500, 1))

    def run(periods, rest_s=0.0):
        return run_open_loop(rig, u, periods=periods, rng=np.random.default_rng(0), settle=0, rest_s=rest_s)

    assert run(3).record is not None
    for periods, rest_s in ((4, 0.0), (3, 1.0)):
        with pytest.raises(ConfigError, match="brings a frequency to zero at 4 s"):
            run(periods, rest_s)


def test_a_drift_that_doubles_a_frequency_in_a_run_is_refused():
    """Its pieces would be turns by 3 rad, and its swing wrong by half a per cent."""
    rig = rig_of(plant_of([3.0], 0.01, [1.0]), [Drift(("a",), 200.0, 4.0)])
    u = np.random.default_rng(3).standard_normal((500, 1))
    for periods, refused in ((2, False), (4, True)):
        with pytest.raises(ConfigError, match="raises a frequency to 9") if refused else nullcontext():
            run_open_loop(rig, u, periods=periods, rng=np.random.default_rng(0), settle=0, rest_s=0.0)


def integrated(plant, drifts, age_s, u, gyro):
    """The same as a differential equation: modes, lag and filter of a gyro, torques held and late."""
    modal = plant.dynamics
    delay = DELAY - 0.5 * T - (1.0 / gyro.bandwidth_hz + np.sqrt(2.0) / gyro.anti_alias_hz) / (2.0 * np.pi)
    lag, cut, n = 2.0 * np.pi * gyro.bandwidth_hz, 2.0 * np.pi * gyro.anti_alias_hz, len(modal.omega)
    edges = np.unique(np.concatenate([T * np.arange(len(u)), delay + T * np.arange(len(u))]))
    state, readings = np.zeros(2 * n + 3), []
    for begin, end in zip(edges, [*edges[1:], len(u) * T], strict=True):
        if abs(begin / T - round(begin / T)) < 1e-9 and round(begin / T) < len(u):
            readings.append(state[-2])
        k = int(np.floor((begin - delay) / T + 1e-9))
        torque = u[k, 0] if 0 <= k < len(u) else 0.0

        def rate(t, x, torque=torque):
            q, v = x[:n], x[n : 2 * n]
            w = modal.omega * np.array([
                np.prod([1.0 + 0.01 * d.percent * (age_s + t) / d.age_s for d in drifts if name in d.modes])
                for name in modal.names
            ])  # fmt: skip
            r, f, g = x[2 * n :]
            lagged = lag * (modal.phi[0] @ v - r)
            a = modal.psi[:, 0] * torque - 2.0 * modal.zeta * w * v - w**2 * q
            return np.concatenate([v, a, [lagged, cut * g, cut * (r - f - np.sqrt(2.0) * g)]])

        if end > begin + 1e-12:
            state = solve_ivp(rate, (begin, end), state, method="DOP853", rtol=1e-10, atol=1e-13).y[:, -1]
    return np.array(readings)


def test_driven_and_filtered_it_equals_an_independent_integration():
    """Three modes of which two drift, one of them twice over; a gyro reads the rate behind its filters."""
    gyro = Gyro(bandwidth_hz=100.0, anti_alias_hz=200.0)
    plant = plant_of([1.3, 7.0, 9.0], 0.02, [1.0, 0.7, -0.5])
    drifts, age_s = [Drift(("b", "c"), -20.0, 2.0), Drift(("c",), 30.0, 4.0)], 0.5
    u = np.random.default_rng(1).standard_normal((250, 1))
    exact = integrated(plant, drifts, age_s, u, gyro)
    rig, error = rig_of(plant, drifts, age_s, gyro), []
    for ticks in (8, 4, 2):
        rng = np.random.default_rng(0)
        start = switch_on(held_for(rig, ticks), None, 0.0, rng)
        blocks = simulate_rig(held_for(rig, ticks), None, [u], rng, start)
        error.append(np.abs(np.concatenate([b.readings for b in blocks])[:, 0] - exact).max())
    # Of second order at the least; at 2 ticks, a tenth of a radian of the mode at 9 Hz, a millionth.
    assert np.log2(error[0] / error[2]) / 2.0 > 1.8
    assert error[2] < 1e-6 * np.abs(exact).max()
    still = rig_of(age_plant(plant, drifts, age_s), sensor=gyro)
    blocks = list(simulate_rig(still, None, [u], np.random.default_rng(0)))
    assert np.abs(blocks[0].readings[:, 0] - exact).max() > 0.01 * np.abs(exact).max()


def test_pieces_and_knots_are_as_near_as_what_drifts_asks():
    plant = plant_of([1.3, 7.0, 9.0], 0.02, [1.0, 1.0, 1.0])
    rig = rig_of(plant, [Drift(("a",), 1.0, 100.0), Drift(("b", "a"), -2.0, 100.0)])
    # The mode at 7 Hz is the fastest that drifts, the one at 1.3 Hz may change by 3 % in 100 s.
    assert rig.ageing.ticks == int(TURN / (2.0 * np.pi * 7.0) / T)
    assert rig.ageing.pieces == int(CHORD / 3e-4 / (rig.ageing.ticks * T))
    assert rig_of(plant, [Drift(("a",), 0.0, 1.0)]).ageing is None
    assert rig_of(plant).ageing is None


def test_between_knots_it_lies_on_the_chord():
    """A frequency that changes by c of itself between knots is wrong by c^2/12 on the average."""
    plant, u = plant_of([3.0], 0.0, [1.0]), np.zeros((5_000, 1))
    u[0] = 1.0
    rig = rig_of(plant, [Drift(("a",), 4.0, 10.0)])
    y = [measured(held_for(rig, 10, pieces), u) for pieces in (1, 25, 50)]
    error = [np.abs(x - y[0])[-500:].max() / np.abs(y[0][-500:]).max() for x in y[1:]]
    change = [4e-3 * pieces * 10 * T for pieces in (25, 50)]  # of the frequency, from knot to knot
    expected = [2.0 * np.pi * 3.0 * 10.0 * c**2 / 12.0 for c in change]
    # The frequency grows by 4 % on the way.
    np.testing.assert_allclose(error, expected, rtol=0.1)


def test_where_blocks_are_cut_and_how_long_it_rests_makes_no_other_motion():
    """A rest ages it; so does where the drift began."""
    drift, plant = Drift(("b",), 20.0, 10.0), plant_of([1.3, 7.0], 0.02, [1.0, 0.7])
    sensor = Gyro(
        bandwidth_hz=100.0,
        noise=2e-4,
        bias=1e-3,
        bias_walk=1e-4,
        anti_alias_hz=200.0,
        resolution=1e-4,
        range=5.0,
    )
    joints = [JointElements("torque", "angle", (Friction(0.01, 2.0, 0.01),))]
    rig = rig_of(plant, [drift], sensor=sensor, motor=Motor(torque_limit=2.0, resolution=1e-3), joints=joints)
    u = np.random.default_rng(1).standard_normal((1200, 1))
    taken = [measured(rig, u, size) for size in (100, 777, 1200)]
    assert np.array_equal(taken[0], taken[1])
    assert np.array_equal(taken[0], taken[2])
    quiet = [rig_of(plant, [drift], age) for age in (0.0, 3.0)]
    ticks = 3 * round(RATE)
    quiet = [held_for(rig, 10) for rig in quiet]  # pieces that begin alike
    rested = switch_on(quiet[0], None, 3.0, np.random.default_rng(0))
    assert rested.tick == ticks
    assert switch_on(rig, None, 1.0, np.random.default_rng(0)).tick == RATE
    y = measured(quiet[0], u, start=rested)
    # Rounding: the states' scale is that of the switching on.
    np.testing.assert_allclose(y, measured(quiet[1], u), rtol=0.0, atol=1e-12 * np.abs(y).max())


def spring(gain):
    """Position feedback through a resonance at 4 Hz: with the delay it lags by half a turn at some 6 Hz."""
    w = 2.0 * np.pi * 4.0
    A = [[0.0, 1.0], [-(w**2), -0.4 * w]]
    return tustin(StateSpace(A, [[0.0], [w**2]], [[gain, 0.0]], [[0.0]]), T)


def test_a_loop_that_drifts_into_instability_is_stopped_after_it_has():
    """It damps what is above 6 Hz and drives what is below, where the mode at 7.5 Hz will come to."""
    plant = plant_of([7.5], 0.005, [1.0])
    drift, law = Drift(("a",), -30.0, 20.0), spring(-300.0)

    def holds(age_s, law=law):
        return is_stable(close_rig(rig_of(plant, [drift], age_s), law))

    ages = np.arange(0.0, 20.0, 0.5)
    stable = np.array([holds(a) for a in ages])
    assert stable[0]
    first = ages[int(np.argmin(stable))]
    assert 1.0 < first < 15.0
    u = 0.05 * np.random.default_rng(2).standard_normal((2000, 1))
    rig = rig_of(plant, [drift], sensor=Encoder(1e-6))
    run = run_closed_loop(
        rig, on_rig(rig, law), u, periods=5,
        rng=np.random.default_rng(0), settle=0, rest_s=0.0, stops=[StopRule("angle", 0.05)],
    )  # fmt: skip
    assert run.cause.startswith("stopped")
    assert first < run.events.stopped_s < first + 8.0
    weak = spring(-1.0)
    assert all(holds(a, weak) for a in ages)
    run = run_closed_loop(
        rig, on_rig(rig, weak), u, periods=5,
        rng=np.random.default_rng(0), settle=0, rest_s=0.0, stops=[StopRule("angle", 0.05)],
    )  # fmt: skip
    assert run.cause == ""


def test_a_record_shows_where_the_mode_has_gone():
    """The mode's peak in the first and the last period of one record: two runs of the age in between."""
    plant, u = plant_of([9.0], 0.002, [1.0]), np.zeros((2000, 1))
    u[:, 0] = np.fft.irfft(np.exp(2j * np.pi * np.random.default_rng(0).random(1001)), 2000)
    rig = rig_of(plant, [Drift(("a",), 10.0, 50.0)])
    run = run_open_loop(rig, u, periods=5, rng=np.random.default_rng(0), settle=1, rest_s=0.0)
    peak = [np.argmax(np.abs(np.fft.rfft(y[:, 0]))) / 4.0 for y in run.record.y[0]]
    middle = 9.0 * (1.0 + 2e-3 * (4.0 * (np.arange(5) + 1.5)))
    # Lines are 1/4 Hz apart; within a period the mode moves by 0.07 Hz.
    np.testing.assert_allclose(peak, middle, rtol=0.0, atol=0.2)


def test_drifts_that_cannot_be_are_refused():
    plant = plant_of([1.0], 0.02, [1.0])
    with pytest.raises(ConfigError, match="no mode 'z'"):
        rig_of(plant, [Drift(("z",), 1.0, 1.0)])
    with pytest.raises(ConfigError, match="a drift by nan %"):
        Drift(("a",), np.nan, 1.0)
    with pytest.raises(ConfigError, match="an article nan s old"):
        rig_of(plant, [Drift(("a",), 1.0, 1.0)], np.nan)
    with pytest.raises(ConfigError, match="only a plant in modal form"):
        rig_of(Plant(dynamics=plant.system, inputs=PORTS[0], outputs=PORTS[1]), [Drift(("a",), 1.0, 1.0)])
    with pytest.raises(ConfigError, match="a rest of -1"):
        switch_on(rig_of(plant), None, -1.0, np.random.default_rng(0))
    # It is found when it comes to it.
    rig = rig_of(plant, [Drift(("a",), -50.0, 1.0)])
    with pytest.raises(ConfigError, match="brought a frequency to zero"):
        list(simulate_rig(rig, None, [np.zeros((2000, 1))], np.random.default_rng(0)))
