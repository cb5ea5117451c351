"""The rig with friction and gaps: linear without them, their describing functions with them."""

import warnings

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.identification.spectra.estimate import estimate_response
from middeck.joints.attachment import JointElements
from middeck.joints.deadband import Deadband
from middeck.joints.friction import Friction
from middeck.laboratory.rig.parts.motors import Motor
from middeck.laboratory.rig.parts.sensors import Sampler
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.runs import run_open_loop
from middeck.signals.excitation.multisine import random_multisine
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.modal_system import ModalSystem, modal_response
from middeck.systems.state_space.statespace import StateSpace
from repeats import repeats

RATE, DELAY = 500.0, 0.0103  # not a whole number of substeps
PORTS = (
    (Port("base", "N m"), Port("pri_rel_z", "N m")),
    (Port("pri_rel_z", "rad"), Port("bus_z", "rad")),
)
BEARING = Friction(slip_torque=0.02, stiffness=2.0)
GEAR = Deadband(gap=0.01, stiffness=3.0)


@pytest.fixture(scope="module")
def plant():
    omega = 2.0 * np.pi * np.array([0.9, 1.3, 7.2, 31.0])
    joint = np.array([0.8, 3.0, 1.1, 0.4])
    bus = np.array([0.3, 0.2, -0.4, 0.2])
    psi, phi = np.stack([bus, joint], axis=1), np.stack([joint, bus])
    return Plant(
        dynamics=ModalSystem(
            omega=omega, zeta=np.full(4, 0.2), psi=psi, phi=phi, phi_rate=0.0 * phi, names=tuple("abcd")
        ),
        inputs=PORTS[0],
        outputs=PORTS[1],
    )


def at(*elements):
    return [JointElements("pri_rel_z", "pri_rel_z", tuple(elements))]


def quiet_rig(plant, joints, steps=8, delay=DELAY):
    return build_rig(plant, joints=joints, sample_hz=RATE, delay_s=delay, substeps=steps)


def run(rig, u, periods, settle, **more):
    return run_open_loop(rig, u, periods=periods, rng=np.random.default_rng(1), settle=settle, **more).record


@pytest.mark.parametrize("joints", [[], at(Friction(0.0, 5.0)), at(Deadband(1e3, 5.0))])
def test_without_friction_it_is_the_linear_rig(plant, joints):
    u = np.zeros((2000, 2))
    u[:, 0] = random_multisine((0.5, 60.0), 4.0, RATE, 1.0, np.random.default_rng(0))
    taken = run(quiet_rig(plant, joints, steps=3), u, 2, settle=7)
    exact = run(quiet_rig(plant, []), u, 2, settle=0, steady=True)
    # Seven periods of 4 s at 1.13 rad/s and more leave 2e-14 of the start; rounding of 6000 steps.
    np.testing.assert_allclose(taken.y, exact.y, atol=1e-11 * np.abs(exact.y).max())
    assert np.array_equal(taken.u, exact.u)


def dwell(plant, element, torque, hz=1.5):
    """Under a torque sine at the base: frequency, phasors of the joint's angle by order, and the drive."""
    samples = round(RATE / hz)
    hz = RATE / samples
    u = np.zeros((samples, 2))
    u[:, 0] = torque * np.cos(2.0 * np.pi * np.arange(samples) / samples)
    # The delay is the linear part's; without it the phase of a held sine is all that is left to undo.
    taken = run(quiet_rig(plant, at(element), delay=0.5 / RATE, steps=4), u, 2, settle=25)
    np.testing.assert_allclose(taken.y[0, 1], taken.y[0, 0], rtol=0.0, atol=1e-6 * np.std(taken.y))
    phasors = 2.0 * np.fft.rfft(taken.y[0, -1, :, 0])[:10] / samples
    hold = np.sinc(1.0 / samples) * np.exp(-1j * np.pi / samples)
    return hz, phasors, torque * hold


def joint_receptances(plant, hz):
    return modal_response(plant.dynamics, 2.0 * np.pi * np.array([hz]))[0, 0]


@pytest.mark.parametrize("element", [BEARING, GEAR], ids=["friction", "deadband"])
@pytest.mark.parametrize("torque", repeats([3.0, 0.7]))
def test_a_dwell_has_the_response_of_the_describing_function(plant, element, torque):
    hz, measured, drive = dwell(plant, element, torque)
    A = np.array([abs(measured[1])])
    found = element.describing_function(A)
    k = found.stiffness[0] + 1j * found.loss[0]
    base, own = joint_receptances(plant, hz)
    predicted = base * drive / (1.0 + k * own)
    # What harmonic balance leaves out: the third harmonic of the angle. To first order it is the element's
    # own torque on the rest, and changes the fundamental torque by no more than its part of the stiffness.
    again = abs(joint_receptances(plant, 3.0 * hz)[1])
    third = abs(element.harmonic(A, 3)[0]) * again
    change = element.stiffness * abs(own / (1.0 + k * own)) * third
    step = 1e-5 * A[0]  # (w h)^2/12 of the element's frequency is 2e-6, little amplified off resonance
    assert abs(measured[1] - predicted) < change + step
    # All orders: the element adds no more than its stiffness to the rest at three times the frequency.
    x = element.stiffness * again
    assert x < 0.1
    assert abs(measured[3]) == pytest.approx(third, rel=x / (1.0 - x))
    # Without the element the response is another.
    assert abs(measured[1] - base * drive) > 50.0 * abs(measured[1] - predicted)


def test_below_the_slip_torque_it_is_linear_with_the_joint_sprung(plant):
    hz, measured, drive = dwell(plant, BEARING, 0.01)
    base, own = joint_receptances(plant, hz)
    assert abs(measured[1]) < BEARING.slip_angle
    # Internal step: the mean torque over a step is (w h)^2/12 off, below 1e-6 of the stiffness at 1.5 Hz.
    assert measured[1] == pytest.approx(base * drive / (1.0 + BEARING.stiffness * own), rel=1e-5)
    # What 25 periods have not settled.
    assert np.abs(measured[2:]).max() < 1e-8 * abs(measured[1])


def test_noise_is_added_at_the_sample_and_only_there(plant):
    u = np.zeros((500, 2))
    u[:, 0] = np.cos(2.0 * np.pi * np.arange(500) / 500)
    taken = []
    for noise in (0.0, 1e-3):
        sensors = {p.name: Sampler(noise) for p in PORTS[1]}
        rig = build_rig(plant, joints=at(BEARING), sample_hz=RATE, delay_s=DELAY, sensors=sensors)
        taken.append(run(rig, u, 10, settle=0).y)
    # 10000 values: the rms is known to 0.7 %, taken three times.
    assert np.std(taken[1] - taken[0]) == pytest.approx(1e-3, rel=0.021)


def test_what_has_not_settled_is_found_by_who_compares_the_periods(plant):
    u = random_multisine((2.0, 60.0), 1.0, RATE, 1.0, np.random.default_rng(0))[:, None]
    rig = build_rig(
        plant, joints=at(BEARING), motors={"base": Motor()}, sample_hz=RATE, delay_s=DELAY,
        sensors={p.name: Sampler(1e-4) for p in PORTS[1]},
    )  # fmt: skip
    for settle in (0, 20):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            estimate_response(run(rig, u, 3, settle=settle), band_hz=(2.0, 60.0))
        assert any("begin with a transient" in str(w.message) for w in caught) == (settle == 0)


def test_a_free_wheel_with_friction_runs_though_it_has_no_linear_steady_state():
    wheel = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    plant = Plant(dynamics=wheel, inputs=PORTS[0][:1], outputs=PORTS[1][:1])
    rig = quiet_rig(plant, [JointElements("base", "pri_rel_z", (Friction(0.5, 200.0, viscous=2.0),))])
    u = 0.4 * np.sin(2.0 * np.pi * np.arange(500) / 500)[:, None]
    taken = run(rig, u, 2, settle=19)
    # Stuck: it swings on the presliding spring.
    np.testing.assert_allclose(taken.y[0, 1], taken.y[0, 0], rtol=0.0, atol=1e-6 * np.std(taken.y))
    w = 2.0 * np.pi
    # About where the start has left the slider; the substep, (w h)^2/12 at 14 rad/s.
    assert 0.5 * np.ptp(taken.y[0, 1]) == pytest.approx(0.4 / abs(200.0 - w**2 + 2j * w), rel=1e-4)


def test_settings_that_cannot_be_are_refused(plant):
    with pytest.raises(ConfigError, match="substeps in a tick"):
        quiet_rig(plant, [], steps=0)
    with pytest.raises(ConfigError, match="hold"):
        quiet_rig(plant, [], delay=0.0005)
    with pytest.raises(ConfigError, match="periods"):
        run(quiet_rig(plant, []), np.zeros((5, 2)), 0, settle=0)
