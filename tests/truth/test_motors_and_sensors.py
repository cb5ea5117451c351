"""Motors and sensors of the rig: momentum, saturation, converters, counts, gyro noise, and drift."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.signal

import rig_checks
from middeck.errors import ConfigError
from middeck.joints.attachment import JointElements
from middeck.joints.friction import Friction
from middeck.laboratory.rig.parts.motors import Motor, Rotor
from middeck.laboratory.rig.parts.sensors import Encoder, Gyro, Sampler
from middeck.laboratory.rig.plant.drifting_modes import Drift, age_plant, nearest_modes
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.runs import run_closed_loop, run_open_loop
from middeck.laboratory.rig.ticks.simulate_rig import BLOCK, cut_blocks, simulate_rig, switch_on
from middeck.laboratory.rig.ticks.stepped import SteppedRig
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.sampling.sampling import sample_dynamics
from middeck.systems.sampling.simulation import simulate
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from plant_builders import sum_of_modes

RATE, DELAY = 500.0, 0.010
T = 1.0 / RATE
INERTIA = 0.5
NOISE = 2e-4
SHEET = Gyro(bandwidth_hz=100.0, noise=NOISE, bias=1e-3, bias_walk=1e-5, anti_alias_hz=200.0)


def free_body(viscous=0.0):
    """A free inertia with one torque and one angle."""
    modal = sum_of_modes(np.zeros(1), 0.0, [[INERTIA**-0.5]], [[INERTIA**-0.5]], names=("spin",))
    return Plant(dynamics=modal, inputs=(Port("bus_z", "N m"),), outputs=(Port("bus_z", "rad"),))


def oscillator(zeta=0.01, hz=1.3):
    modal = ModalSystem(
        omega=[2.0 * np.pi * hz], zeta=[zeta], psi=[[1.0]], phi=[[1.0]], phi_rate=[[0.0]], names=("swing",)
    )
    return Plant(dynamics=modal, inputs=(Port("bus_z", "N m"),), outputs=(Port("bus_z", "rad"),))


def rig_of(plant, motor=Motor(), sensor=Sampler(), **more):  # noqa: B008
    return build_rig(
        plant, motors={"bus_z": motor}, sensors={"bus_z": sensor}, sample_hz=RATE, delay_s=DELAY, **more
    )


def gain(value):
    return SampledStateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[value]], period_s=T)


def run_through(rig, u, law=None):
    taken = rig_checks.run_through(rig, law, np.reshape(u, (-1, 1)))
    return {name: values[:, 0] for name, values in taken.items() if name != "state"}


# Motors


def test_a_wheel_gives_its_momentum_to_the_bus_and_no_more():
    rotor = Rotor(0.006, 300.0)
    u = np.full(4000, 0.4)
    taken = run_through(rig_of(free_body(), Motor(torque_limit=0.5, rotor=rotor)), u)
    torque = taken["torque"]
    # Momentum of the rotor is minus the integral of its torque, tick by tick; rounding of 4000 sums.
    np.testing.assert_allclose(taken["momentum"] * T, -np.cumsum(torque) * T, rtol=0.0, atol=1e-12)
    full = rotor.inertia * rotor.speed_limit
    assert np.sum(torque) * T == pytest.approx(full, rel=1e-12)
    # 0.4 N m fills 1.8 N m s in 4.5 s.
    assert np.all(torque[: round(4.5 * RATE)] == 0.4)
    assert np.all(np.abs(torque[round(4.5 * RATE) + 1 :]) < 1e-12)
    # Then the bus turns on with what the rotor has lost: momentum is kept.
    rate = np.diff(taken["measured"][-10:]) / T
    np.testing.assert_allclose(INERTIA * rate, full, rtol=1e-9)


def test_a_full_rotor_still_runs_down():
    motor = Motor(torque_limit=0.5, rotor=Rotor(0.006, 300.0))
    u = np.concatenate([np.full(3000, 0.5), np.full(1000, -0.5)])
    torque = run_through(rig_of(free_body(), motor), u)["torque"]
    assert abs(torque[2999]) < 1e-12
    assert np.all(torque[3000:] == -0.5)


def test_events_of_a_wheel_are_counted():
    rig = rig_of(free_body(), Motor(torque_limit=0.5, slew_limit=100.0, rotor=Rotor(0.006, 300.0)))
    u = np.full((2500, 1), 2.0)
    run = run_open_loop(rig, u, periods=1, rng=np.random.default_rng(0), settle=0)
    # 0.2 N m a tick up to 0.5; then 0.5 N m fill what is left of 1.8 N m s.
    up = 0.2 + 0.4
    at_limit = (1.8 - up * T) / (0.5 * T)
    events = run.events
    assert events.saturated[0] == pytest.approx(np.floor(at_limit) / 2500)
    # Two ticks up, and one or two down when the rotor is full.
    assert round(2500 * events.slewed[0]) in (3, 4)
    assert events.rotor_full[0] == pytest.approx(1.0 - (2.0 + at_limit) / 2500, abs=1.0 / 2500)
    assert events.peak_speed_rad_s[0] == pytest.approx(300.0, rel=1e-9)


def test_disturbance_and_control_share_the_saturation_and_holding_counts():
    motor = Motor(torque_limit=0.6, holding=0.3)
    rng = np.random.default_rng(1)
    u = np.sin(8.0 * T * np.arange(3000)) + rng.standard_normal(3000)
    taken = run_through(rig_of(oscillator(0.2), motor), u, gain(-60.0))
    wanted = u + taken["control"]
    assert np.std(taken["control"]) > 0.3
    # The motor gives torque and holding together: 0.3 up, 0.9 down.
    np.testing.assert_allclose(taken["torque"], np.clip(wanted, -0.9, 0.3), rtol=0.0, atol=1e-15)
    assert taken["torque"].max() == pytest.approx(0.3)
    assert taken["torque"].min() == pytest.approx(-0.9)


def test_slew_is_limited_from_tick_to_tick():
    turns = np.sign(np.sin(np.arange(2000) / 20.0))
    torque = run_through(rig_of(oscillator(), Motor(slew_limit=10.0)), turns)
    steps = np.diff(torque["torque"], prepend=0.0)
    assert np.abs(steps).max() == pytest.approx(10.0 * T, rel=1e-12)
    # 62.8 samples of 0.02 N m from turn to turn: once they are even, half of it to either side.
    assert np.ptp(torque["torque"][1000:]) == pytest.approx(62.8 * 0.02, abs=0.04)


def test_a_converter_rounds_to_its_steps_with_the_noise_of_a_uniform_error():
    step = 1e-3
    u = np.random.default_rng(2).standard_normal(20000)
    torque = run_through(rig_of(oscillator(), Motor(resolution=step)), u)["torque"]
    np.testing.assert_allclose(torque / step, np.round(torque / step), rtol=0.0, atol=1e-9)
    error = torque - u
    assert np.abs(error).max() <= 0.5 * step * (1.0 + 1e-9)
    # step^2/12 (Widrow 1956): the mean square of 20,000 uniform errors is known to 0.63 %, taken four times.
    assert np.mean(error**2) == pytest.approx(step**2 / 12.0, rel=0.026)


# Sensors


def test_an_encoder_counts():
    step = 2.0 * np.pi / 4096
    u = 30.0 * np.random.default_rng(3).standard_normal(20000)
    plant = oscillator(0.2)
    counted, true = (run_through(rig_of(plant, sensor=s), u)["measured"] for s in (Encoder(step), Sampler()))
    np.testing.assert_allclose(counted / step, np.round(counted / step), rtol=0.0, atol=1e-9)
    assert np.ptp(true) > 20.0 * step
    assert np.abs(counted - true).max() <= 0.5 * step * (1.0 + 1e-9)
    # As above; successive errors of a swing through many steps hardly depend on each other: twice the margin.
    assert np.mean((counted - true) ** 2) == pytest.approx(step**2 / 12.0, rel=0.05)


def at_rest(rig, ticks, seed=0, rest_s=0.0, chosen="readings"):
    rng = np.random.default_rng(seed)
    start = switch_on(rig, None, rest_s, rng)
    blocks = simulate_rig(rig, None, cut_blocks(np.zeros((ticks, 1))), rng, start)
    return np.concatenate([getattr(b, chosen) for b in blocks])[:, 0]


def test_gyro_noise_has_its_spectrum_behind_the_filter():
    readings = at_rest(
        rig_of(
            oscillator(),
            sensor=Gyro(bandwidth_hz=100.0, noise=NOISE, bias=0.0, bias_walk=0.0, anti_alias_hz=200.0),
        ),
        100_000,
    )
    hz, density = scipy.signal.welch(readings, RATE, nperseg=1024)
    # White noise through Butterworth's filter, folded at half the rate; welch counts both sides as one.
    images = np.arange(-200, 201)[:, None] * RATE + hz[None]
    expected = 2.0 * NOISE**2 * np.sum(1.0 / (1.0 + (images / 200.0) ** 4), axis=0)
    for low, high in ((5.0, 20.0), (20.0, 60.0), (60.0, 120.0), (120.0, 180.0), (180.0, 240.0)):
        at = (hz > low) & (hz < high)
        # Some 150 averages of 30 lines and more: 1.5 %, taken four times.
        assert density[at].mean() == pytest.approx(expected[at].mean(), rel=0.06)
    # At low frequency: the sheet's two-sided density, and a twentieth that folds back from around 500 Hz.
    assert expected[5] / 2.0 == pytest.approx(1.0541 * NOISE**2, rel=1e-3)


def test_gyro_without_a_filter_has_the_noise_of_its_band():
    readings = at_rest(rig_of(oscillator(), sensor=Gyro(noise=NOISE)), 20_000)
    # Two-sided NOISE^2 over 500 Hz. 20,000 values: 0.5 % of the rms, taken four times.
    assert np.std(readings) == pytest.approx(NOISE * np.sqrt(RATE), rel=0.02)


def test_integrated_noise_walks():
    """The angle that white rate noise of intensity S leaves has the variance S t."""
    rig = rig_of(
        oscillator(),
        sensor=Gyro(bandwidth_hz=100.0, noise=NOISE, bias=0.0, bias_walk=0.0, anti_alias_hz=200.0),
    )
    angle = at_rest(rig, 30_000, chosen="measured").reshape(200, 150)
    steps = angle[:, -1] - angle[:, 0]
    # 200 pieces of 0.3 s; the filter ties their ends together for some milliseconds only. The rms is known to
    # 5 %, taken three times.
    assert np.sqrt(np.mean(steps**2)) == pytest.approx(NOISE * np.sqrt(149 * T), rel=0.15)


def test_bias_is_drawn_walks_and_is_measured_at_rest():
    rig = rig_of(oscillator(), sensor=Gyro(bias=1e-3))
    only_bias = [at_rest(rig, 1, seed)[0] for seed in range(300)]
    # 300 draws: 4 %, taken four times.
    assert np.std(only_bias) == pytest.approx(1e-3, rel=0.16)
    walked = at_rest(rig_of(oscillator(), sensor=Gyro(bias_walk=1e-2)), 30_001)
    # 300 steps of 0.2 s each: 4 %, taken four times.
    assert np.std(np.diff(walked[::100])) == pytest.approx(1e-2 * np.sqrt(0.2), rel=0.16)
    left, rig = [], rig_of(oscillator(), sensor=SHEET)
    for seed in range(60):
        state = switch_on(rig, None, 1.0, np.random.default_rng(seed))
        left.append((state.bias - state.trim)[0])
    # The mean of 1 s of white noise is known to NOISE; the walk adds little. 60 runs: 9 %, three times.
    assert np.std(left) == pytest.approx(NOISE, rel=0.27)


def test_a_measured_bias_is_no_ramp():
    rig = rig_of(oscillator(), sensor=Gyro(bias=1e-2))
    ramp = at_rest(rig, 1000, chosen="measured")
    flat = at_rest(rig, 1000, rest_s=2.0, chosen="measured")
    slope = np.diff(ramp) / T
    np.testing.assert_allclose(slope, slope[0], rtol=1e-9)
    assert abs(slope[0]) > 1e-3
    assert np.abs(flat).max() < 1e-12  # the sum of rounding


def test_a_gyro_clips_and_says_so():
    rig = rig_of(oscillator(), sensor=Gyro(range=0.5, resolution=0.5 / 2**15))
    u = 2.0 * np.sin(2.0 * np.pi * 1.3 * np.arange(5000) * T)[:, None]
    run = run_open_loop(rig, u, periods=1, rng=np.random.default_rng(0), settle=0)
    readings = np.concatenate([b.readings for b in simulate_rig(rig, None, [u], np.random.default_rng(0))])
    assert np.abs(readings).max() == 0.5
    assert run.events.clipped[0] == pytest.approx(np.mean(np.abs(readings) > 0.4999), abs=2e-3)
    assert run.events.clipped[0] > 0.1


@pytest.mark.parametrize(("resolution", "reach", "codes"), [(0.1, 0.26, 2), (0.1, 0.3, 3), (0.05, 0.38, 7)])
def test_a_converter_reads_whole_steps_within_its_range(resolution, reach, codes):
    u = 3.0 * np.random.default_rng(8).standard_normal((3000, 1))
    rig, without = (
        rig_of(oscillator(), sensor=gyro) for gyro in (Gyro(resolution=resolution, range=reach), Gyro())
    )
    true = run_through(without, u)["readings"]
    counts = np.clip(np.round(true / resolution), -codes, codes)
    np.testing.assert_allclose(run_through(rig, u)["readings"], counts * resolution, rtol=1e-12)
    events = run_open_loop(rig, u, periods=1, rng=np.random.default_rng(0), settle=0, rest_s=0.0).events
    assert events.clipped[0] == np.mean(np.abs(counts) == codes)
    assert 0.05 < events.clipped[0] < 0.95


def test_a_converter_without_a_step_in_its_range_is_refused():
    with pytest.raises(ConfigError, match="a range of one step or more"):
        Gyro(resolution=0.1, range=0.09)


def test_a_gyro_on_a_rate_reads_the_acceleration_at_once():
    """Behind its lag a the reading is a (v - v lagged): no derivative of the torque is needed."""
    corner = 40.0
    plant = oscillator(0.05)
    rate = np.array([[0.0, 1.0]]) @ plant.system.A  # a row that a torque moves at once
    plant = Plant(
        dynamics=StateSpace(plant.system.A, plant.system.B, rate, [[0.0]]),
        inputs=plant.inputs,
        outputs=(Port("bus_z", "rad/s"),),
    )
    a, s = 2.0 * np.pi * corner, plant.system
    A = np.block([[s.A, np.zeros((2, 1))], [a * s.C, np.array([[-a]])]])
    lagged = StateSpace(A, np.vstack([s.B, [[0.0]]]), np.hstack([a * s.C, [[-a]]]), [[0.0]])
    u = np.random.default_rng(9).standard_normal((400, 1))
    exact = simulate(sample_dynamics(lagged, T, DELAY - 0.5 * T - 1.0 / a), u)[0][:, 0]
    readings = run_through(rig_of(plant, sensor=Gyro(bandwidth_hz=corner)), u)["readings"]
    np.testing.assert_allclose(readings, exact, rtol=0.0, atol=1e-11 * np.abs(exact).max())


def test_an_angle_is_the_sum_of_the_samples_that_a_gyro_at_the_rate_gives():
    swing = oscillator(0.05)
    turning = Plant(
        dynamics=dataclasses.replace(swing.modal, phi=[[1.0], [0.0]], phi_rate=[[0.0], [1.0]]),
        inputs=swing.inputs,
        outputs=(Port("angle", "rad"), Port("rate", "rad/s")),
    )
    sensors = {"angle": SHEET, "rate": dataclasses.replace(SHEET, summed=False, gain=1.02)}
    sensors = {name: dataclasses.replace(one, noise=0.0, bias_walk=0.0) for name, one in sensors.items()}
    rig = build_rig(turning, sensors=sensors, sample_hz=RATE, delay_s=DELAY)
    u = np.random.default_rng(9).standard_normal((500, 1))
    rng = np.random.default_rng(1)
    start = switch_on(rig, None, 1.0, rng)
    read = np.concatenate([b.measured for b in simulate_rig(rig, None, cut_blocks(u, 333), rng, start)])
    angle, rate = read[:, 0], read[:, 1] / 1.02
    np.testing.assert_allclose(angle, T * (np.cumsum(rate) - 0.5 * rate), rtol=0.0, atol=1e-9)
    stepped = SteppedRig(rig, np.random.default_rng(1), rest_s=1.0)
    for sample, command in zip(read, u, strict=True):
        np.testing.assert_allclose(stepped.read(), sample, rtol=0.0, atol=1e-12)
        stepped.write(command)


def test_momentum_is_minus_the_torque_given_with_and_without_limits():
    u = np.random.default_rng(10).standard_normal(1000)
    for motor in (Motor(), Motor(torque_limit=1e6)):
        rig = rig_of(oscillator(), motor)
        assert rig.linear == (motor == Motor())
        taken = run_through(rig, u, gain(-2.0))
        np.testing.assert_allclose(taken["momentum"], -np.cumsum(taken["torque"]), rtol=0.0, atol=1e-12)


def test_slew_is_counted_across_blocks():
    """A torque that stands still where blocks of a run meet is not slewed there."""
    rig = rig_of(oscillator(), Motor(slew_limit=100.0))
    u = np.full((3 * BLOCK + 5, 1), 5.0)
    u[BLOCK // 2 :: 1000] = -5.0
    run = run_open_loop(rig, u, periods=1, rng=np.random.default_rng(0), settle=0)
    steps = np.abs(np.diff(run.torque.ravel(), prepend=0.0))
    assert run.events.slewed[0] * len(u) == pytest.approx(np.sum(steps > 100.0 * T * (1.0 - 1e-9)))


def test_records_of_the_sheets_gyro_serve_identification():
    """Bias, walk and noise are on; the response at the excited lines is what the noise allows."""
    plant = oscillator(0.02)
    rig = rig_of(plant, sensor=SHEET)
    rng = np.random.default_rng(4)
    samples, periods = 4000, 6
    lines = np.arange(4, 161)  # 0.5 to 20 Hz in periods of 8 s
    phases = np.exp(2j * np.pi * rng.random(len(lines)))
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    spectrum[lines] = phases * samples / 2.0 * 0.02
    u = np.fft.irfft(spectrum, samples)[:, None]
    run = run_open_loop(rig, u, periods=periods, rng=rng, settle=4, rest_s=10.0)
    clean = run_open_loop(
        rig_of(plant, sensor=Gyro(bandwidth_hz=100.0, anti_alias_hz=200.0)), u, periods=1, rng=rng, settle=4
    )
    Y, Y0 = (np.fft.rfft(r.record.y[0].mean(axis=0)[:, 0])[lines] for r in (run, clean))
    hz = lines * RATE / samples
    # Angle noise NOISE^2/w^2 over the record; the ends of the walk of each period leak as much again.
    allowed = np.sqrt(2.0) * NOISE / (2.0 * np.pi * hz) * np.sqrt(samples * RATE / periods)
    error = np.abs(Y - Y0) / allowed
    assert np.sqrt(np.mean(error**2)) < 1.3
    assert np.sqrt(np.mean(error**2)) > 0.3
    near = (hz > 1.0) & (hz < 1.7)
    assert np.median(np.abs(Y / Y0 - 1.0)[near]) < 0.02


# Joints


def test_friction_only_takes_energy_and_stops_the_joint_where_it_must():
    """An undamped swing under Coulomb friction loses 2 Tc/k of its amplitude in half a turn, then sticks."""
    w = 2.0 * np.pi * 1.3
    friction = Friction(0.05, 5000.0)
    rig = rig_of(oscillator(0.0), joints=[JointElements("bus_z", "bus_z", (friction,))], substeps=4)
    push = np.zeros(6000)
    push[:200] = 1.0 * np.sign(np.sin(w * np.arange(200) * T))
    angle = run_through(rig, push)["measured"]
    turning = np.abs(angle[np.flatnonzero((angle[1:-1] - angle[:-2]) * (angle[2:] - angle[1:-1]) < 0.0) + 1])
    after = turning[turning > 3.0 * friction.slip_torque / w**2][2:]
    lost = -np.diff(after)
    expected = 2.0 * 0.05 / w**2 * (1.0 - 2.0 * friction.slip_angle / (after[1:] + after[:-1]))
    # In half a turn the torque works over both swings, but for the slip angle twice, in which it turns over:
    # w^2 (A1^2 - A2^2)/2 = Tc (A1 + A2 - 2 a). A sample misses the turning point by (w T/2)^2/2 of it.
    np.testing.assert_allclose(lost, expected, rtol=0.0, atol=0.5 * (0.5 * w * T) ** 2 * after[0])
    assert len(lost) > 5
    assert np.ptp(angle[-500:]) < 2.0 * friction.slip_angle


def test_a_closed_loop_through_everything_runs_and_is_the_same_twice():
    motor = Motor(torque_limit=0.5, slew_limit=50.0, resolution=1e-5, rotor=Rotor(0.006, 300.0))
    joints = [JointElements("bus_z", "bus_z", (Friction(0.002, 2.0, 0.001),))]
    rig = rig_of(oscillator(), motor, SHEET, joints=joints)
    u = 0.05 * np.random.default_rng(6).standard_normal((1000, 1))
    runs = [
        run_closed_loop(rig, rig_checks.on_rig(rig, gain(-1.0)), u, periods=2, rng=np.random.default_rng(7))
        for _ in "ab"
    ]
    assert runs[0] == runs[1]
    assert np.isfinite(runs[0].record.y).all()


# Drift


def test_named_modes_drift_with_age_and_only_they():
    modal = ModalSystem(
        omega=2.0 * np.pi * np.array([1.0, 8.8, 9.3]),
        zeta=np.full(3, 0.01),
        psi=np.ones((3, 1)),
        phi=np.ones((1, 3)),
        phi_rate=np.zeros((1, 3)),
        names=("first", "second", "third"),
    )
    plant = Plant(dynamics=modal, inputs=(Port("u", "N m"),), outputs=(Port("y", "rad"),))
    pair = nearest_modes(plant, 9.0)
    assert pair == ("second", "third")
    drift = Drift(pair, 2.0, 1000.0)
    for age, factor in ((0.0, 1.0), (500.0, 1.01), (1000.0, 1.02), (2000.0, 1.04)):
        aged = age_plant(plant, [drift], age).dynamics
        np.testing.assert_allclose(aged.omega / modal.omega, [1.0, factor, factor], rtol=1e-15)
        assert np.array_equal(aged.zeta, modal.zeta)
    with pytest.raises(ConfigError, match="no mode 'fourth'"):
        age_plant(plant, [Drift(("fourth",), 1.0, 1.0)], 1.0)
    with pytest.raises(ConfigError, match="to zero"):
        age_plant(plant, [Drift(("first",), -100.0, 1.0)], 1.0)
    # Two drifts past zero are no positive frequency.
    with pytest.raises(ConfigError, match="an age below 1 s"):
        age_plant(plant, [Drift(("first",), -100.0, 1.0), Drift(("first",), -100.0, 1.5)], 2.0)
    with pytest.raises(ConfigError, match="-5 s old"):
        age_plant(plant, [], -5)
