"""A modal system that reads accelerations and has a direct term, through everything that evaluates it."""

import dataclasses

import numpy as np
import pytest

from middeck.control.law.partition import partition_modes
from middeck.control.loop.closed_loop import close_loop, leave_open
from middeck.control.lqg.design import design_lqg
from middeck.errors import ConfigError
from middeck.joints.attachment import JointElements
from middeck.joints.friction import Friction
from middeck.laboratory.rig.parts.motors import Motor
from middeck.laboratory.rig.parts.sensors import Encoder, Gyro, Sampler
from middeck.laboratory.rig.rig import build_rig
from middeck.signals.ports import Port
from middeck.systems.norms.band_rms import band_rms, band_rms_by_quadrature
from middeck.systems.plants.plant import Plant
from middeck.systems.plants.response import statespace_response
from middeck.systems.sampling.sampling import sample_dynamics
from middeck.systems.sampling.simulation import simulate
from middeck.systems.state_space.modal_system import ModalSystem, modal_response, output_rows, select_modes
from plant_builders import sum_of_modes, unit_weights
from rig_checks import run_through

OMEGA = 2.0 * np.pi * np.array([0.3, 2.0, 11.0, 40.0, 90.0])


def system(hz=(0.0, 0.3, 7.0, 45.0), outputs=2, inputs=2, zeta=0.02):
    rng = np.random.default_rng(3)
    omega = 2.0 * np.pi * np.array(hz)
    n = len(omega)
    phi, rate, acceleration = rng.standard_normal((3, outputs, n))
    psi, direct = rng.standard_normal((n, inputs)), rng.standard_normal((outputs, inputs))
    names = tuple(f"mode {i}" for i in range(n))
    return ModalSystem(
        omega=omega,
        zeta=np.where(omega > 0, zeta, 0.0),
        psi=psi,
        phi=phi,
        phi_rate=rate,
        names=names,
        phi_acceleration=acceleration,
        direct=direct,
    )


def plant(modal):
    ports = tuple(Port(f"u{i}", "N m") for i in range(2)), tuple(Port(f"y{i}", "m/s^2") for i in range(2))
    return Plant(
        dynamics=modal, inputs=ports[0], outputs=ports[1], w=("u0",), u=("u1",), z=("y0",), y=("y1",)
    )


def test_one_mode_in_closed_form():
    # q'' + 2 zeta w0 q' + w0^2 q = psi u and y = a q'' + d u: at resonance q'' = j psi u / (2 zeta).
    modal = sum_of_modes(
        [3.0], 0.05, [[2.0]], [[0.0]], names=("m",), phi_acceleration=[[1.5]], direct=[[0.25]]
    )
    H = modal_response(modal, np.array([3.0, 3e8]))[:, 0, 0]
    # One division; far above, q'' is the force itself to (w0/w)^2 = 1e-16 and damping 1e-9.
    np.testing.assert_allclose(H[0], 1.5 * 2.0 * 1j / 0.1 + 0.25, rtol=1e-14)
    np.testing.assert_allclose(H[1], 1.5 * 2.0 + 0.25, rtol=1e-8)


def test_state_space_has_the_same_response():
    modal = system()
    expected = modal_response(modal, OMEGA)
    # a q'' is a psi u less a w^2 q: cancels by (45 / 0.3)^2 at the lowest line, 2e4 of rounding.
    got = statespace_response(modal.as_statespace(), OMEGA)
    np.testing.assert_allclose(got, expected, atol=1e-11 * np.abs(expected).max())


def test_an_acceleration_is_the_second_derivative():
    modal = system()
    only = dataclasses.replace(modal, phi=0.0 * modal.phi, phi_rate=0.0 * modal.phi_rate, direct=None)
    angle = dataclasses.replace(only, phi=modal.phi_acceleration, phi_acceleration=None)
    expected = -(OMEGA**2)[:, None, None] * modal_response(angle, OMEGA)
    np.testing.assert_allclose(modal_response(only, OMEGA), expected, rtol=1e-13)  # a product more


def test_modes_taken_apart_add_up():
    modal = dataclasses.replace(system(), direct=None)
    first, rest = select_modes(modal, np.arange(2)), select_modes(modal, np.arange(2, 4))
    total = modal_response(first, OMEGA) + modal_response(rest, OMEGA)
    np.testing.assert_allclose(total, modal_response(modal, OMEGA), rtol=1e-12)  # sums in another order
    split = output_rows(first).direct + output_rows(rest).direct
    np.testing.assert_allclose(split, output_rows(modal).direct, rtol=1e-14)


def test_inert_modes_leave_and_the_response_stays():
    modal = system()
    dead = np.array([1.0, 1.0, 0.0, 1.0])
    modal = dataclasses.replace(
        modal,
        psi=modal.psi * dead[:, None],
        phi=modal.phi * dead,
        phi_rate=modal.phi_rate * dead,
        phi_acceleration=modal.phi_acceleration * dead,
    )
    part = partition_modes(plant(modal))
    assert part.inert == ("mode 2",)
    before, after = (modal_response(m, OMEGA) for m in (modal, part.active.dynamics))
    np.testing.assert_allclose(after, before, rtol=1e-13)


def test_an_accelerometer_alone_sees_its_modes():
    modal = system()
    only = dataclasses.replace(modal, psi=0.0 * modal.psi, phi=0.0 * modal.phi, phi_rate=0.0 * modal.phi_rate)
    # The rigid mode, whose acceleration is the input's and not the state's, is inert where nothing drives it.
    assert partition_modes(plant(only)).inert == ("mode 0",)


def test_band_rms_counts_the_direct_term():
    modal = system(hz=(0.3, 7.0, 45.0))
    continuous = modal.as_statespace()
    for band in ((0.1, 60.0), (50.0, 500.0)):
        closed, slow = (f(continuous, np.eye(2), band) for f in (band_rms, band_rms_by_quadrature))
        np.testing.assert_allclose(closed, slow, rtol=1e-9)  # the quadrature's own tolerance
    # Far above the modes the system is its direct term: rms^2 = 2 |D|^2 times the width, to (45/1e6)^1.
    D = continuous.D
    high = band_rms(continuous, np.eye(2), (1e6, 2e6))
    np.testing.assert_allclose(high, np.sqrt(2.0 * np.sum(D**2, axis=1) * 1e6), rtol=1e-4)


def test_a_band_without_end_is_refused():
    with pytest.raises(ConfigError, match="finite"):
        band_rms(system(hz=(0.3, 7.0)).as_statespace(), np.eye(2), (0.1, np.inf))


@pytest.mark.parametrize("delay_s", [0.0, 0.003, 0.0045])
def test_a_held_input_comes_through_at_once_or_after_the_delay(delay_s):
    period = 0.002
    modal = system(hz=(7.0, 45.0))
    sampled = sample_dynamics(modal, period, delay_s)
    # First sample at which the command has arrived: all that moves till then is the direct term.
    u = np.array([1.0, 0.0])
    x, k = np.zeros(len(sampled.A)), 0
    while not np.any(y := sampled.C @ x + sampled.D @ u):
        x, k = sampled.A @ x + sampled.B @ u, k + 1
    assert k == int(np.ceil(delay_s / period - 1e-9))
    # A whole number of samples: nothing has moved yet. Else the modes have moved for a part of a sample.
    if (delay_s / period) % 1.0 < 1e-9:
        np.testing.assert_allclose(y, output_rows(modal).direct @ u, rtol=1e-12)


def test_a_rig_without_delay_is_refused_by_name():
    with pytest.raises(ConfigError, match="algebraic loop: output 'y0' responds at once"):
        build_rig(plant(system(hz=(7.0,))), sample_hz=500.0, delay_s=0.001)
    with pytest.raises(ConfigError, match="'y0' answers a command at once: its rate is infinite"):
        build_rig(plant(system(hz=(7.0,))), sample_hz=500.0, delay_s=0.01, sensors={"y0": Gyro()})
    joint = JointElements("u0", "y0", (Friction(0.1, 1.0),))
    with pytest.raises(ConfigError, match="responds to a torque without delay"):
        build_rig(plant(system(hz=(7.0,))), sample_hz=500.0, delay_s=0.01, joints=[joint])


@pytest.mark.parametrize("delay_s", [0.0001, 0.002, 0.0031, 0.006])
@pytest.mark.parametrize("ticks", [False, True], ids=["in blocks", "tick by tick"])
def test_a_rig_reads_accelerations_as_the_sampled_plant_does(delay_s, ticks):
    modal = system(hz=(0.3, 7.0, 45.0))
    motors = {f"u{i}": Motor(torque_limit=1e9 if ticks else np.inf) for i in range(2)}
    rig = build_rig(plant(modal), sample_hz=500.0, delay_s=delay_s + 0.001, motors=motors)
    assert rig.linear != ticks
    u = np.random.default_rng(1).standard_normal((700, 2))
    y, _ = simulate(sample_dynamics(modal, 0.002, delay_s), u)
    # Rounding of 700 steps.
    np.testing.assert_allclose(run_through(rig, None, u)["measured"], y, atol=1e-11 * np.abs(y).max())


SENSORS = {
    "a sample that waits": Sampler(),
    "an encoder that waits": Encoder(1e-12),
    "a lag": Gyro(bandwidth_hz=100.0),
    "a lag and a filter": Gyro(bandwidth_hz=100.0, anti_alias_hz=200.0),
}


@pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)
@pytest.mark.parametrize("steps", [1, 3])
def test_residual_flexibility_is_a_mode_without_end(sensor, steps):
    """A direct term d is a mode of w -> oo with d w^2 = phi psi: the difference falls as 1/w."""
    soft = ModalSystem(
        omega=[9.0], zeta=[0.02], psi=[[1.0]], phi=[[1.0], [0.7]], phi_rate=np.zeros((2, 1)), names=("m",)
    )
    direct = np.array([[0.004], [0.003]])  # a third of the static 1/81
    u, error = np.random.default_rng(2).standard_normal((300, 1)), []

    def taken(modal):
        ports = (Port("u", "N m"),), (Port("y", "rad"), Port("slow", "rad"))
        sensors = {"y": sensor, "slow": Gyro(bandwidth_hz=30.0, anti_alias_hz=150.0)}
        rig = build_rig(
            Plant(dynamics=modal, inputs=ports[0], outputs=ports[1]),
            sample_hz=500.0,
            delay_s=0.0117,
            sensors=sensors,
            substeps=steps,
        )
        return run_through(rig, None, u)["readings"]

    exact = taken(dataclasses.replace(soft, direct=direct))
    for w in (2e5, 2e6):
        fast = sum_of_modes(
            [9.0, w], [0.02, 1.0], [[1.0], [w]], np.hstack([soft.phi, direct * w]), names=("m", "fast")
        )
        error.append(np.abs(taken(fast) - exact).max(axis=0) / np.abs(exact).max(axis=0))
    # Filters of 200 Hz are 1256 / w; the encoder counts in 1e-12 rad.
    assert np.all(error[0] < 4.0 * 1256.0 / 2e5)
    assert np.all(error[1] < 0.12 * error[0] + 1e-8)
    without = taken(dataclasses.replace(soft, direct=None))
    assert np.all(np.abs(without - exact).max(axis=0) > 0.05 * np.abs(exact).max(axis=0))


def test_white_noise_straight_onto_the_cost_is_refused_by_name():
    weights = unit_weights(("u0",), 1.0)
    with pytest.raises(ConfigError, match="infinite"):
        design_lqg(plant(system(hz=(0.3, 7.0))), weights, 1.0)


def test_lqg_with_direct_terms_keeps_the_separation_of_poles():
    modal = system(hz=(0.3, 7.0))
    rows = output_rows(modal).direct
    quiet = np.array(modal.direct)
    quiet[0, 0] -= rows[0, 0]  # no white noise straight onto z
    design = plant(dataclasses.replace(modal, direct=quiet))
    weights = unit_weights(("u0",), 1.0)
    law = design_lqg(design, weights, 10.0)
    got = np.sort_complex(close_loop(design, law).poles)
    expected = np.sort_complex(np.concatenate([law.regulator.poles, law.estimator.poles]))
    # Eigenvalues of a Riccati solution at rounding, conditioned to four digits.
    np.testing.assert_allclose(got, expected, atol=1e-8 * np.abs(expected).max())
    assert leave_open(design).stable
