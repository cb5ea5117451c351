"""The rig with nothing switched on measures what the mathematics says; an unstable run says so."""

import dataclasses

import numpy as np
import pytest

from middeck.control.loop.closed_loop import predict_closed_loop_response
from middeck.errors import ConfigError, NumericalError
from middeck.laboratory.rig.linear_view import close_rig, linearise_rig
from middeck.laboratory.rig.parts.sensors import Sampler
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.runs import run_closed_loop, run_open_loop
from middeck.signals.excitation.multisine import random_multisine
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.plants.response import FrequencyResponse, statespace_response
from middeck.systems.poles.verdict import is_stable
from middeck.systems.sampling.sampling import sample_dynamics, tustin
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from rig_checks import on_rig

RATE, PERIOD, DELAY = 500.0, 4.0, 0.010
PORTS = (Port("pri_rel_z", "N m"),), (Port("pri_in_z", "rad"),)


@pytest.fixture(scope="module")
def plant():
    omega = 2.0 * np.pi * np.array([0.9, 1.3, 1.8, 7.2, 9.4, 58.0])
    shape = np.array([[0.3, 1.0, 0.8, 0.55, 0.6, 0.4]])
    zeta = np.full(6, 0.02)
    return Plant(
        dynamics=ModalSystem(
            omega=omega, zeta=zeta, psi=shape.T, phi=shape, phi_rate=0.0 * shape, names=tuple("abcdef")
        ),
        inputs=PORTS[0],
        outputs=PORTS[1],
    )


def rig_of(plant, noise_rms=0.0, delay_s=DELAY):
    return build_rig(plant, sample_hz=RATE, delay_s=delay_s, sensors={PORTS[1][0].name: Sampler(noise_rms)})


def run(rig, law, u, periods, seed=0, settle=0):
    """From the steady state without noise."""
    return run_closed_loop(
        rig, on_rig(rig, law), u, periods=periods, rng=np.random.default_rng(seed), settle=settle, steady=True
    )


@pytest.fixture(scope="module")
def rig(plant):
    return rig_of(plant, 1e-4)


def excite(seed=0):
    return random_multisine((0.5, 60.0), PERIOD, RATE, 1.0, np.random.default_rng(seed))[:, None]


def damper(gain):
    """Rate feedback behind a roll-off at 3 Hz: stable at low gain, unstable through the delay at high."""
    w = 2.0 * np.pi * 3.0
    law = StateSpace([[0.0, 1.0], [-(w**2), -1.4 * w]], [[0.0], [w**2]], [[0.0, -gain]], [[0.0]])
    return tustin(law, 1.0 / RATE)


def measured(record):
    """H at the excited lines from the mean over periods."""
    U, Y = (np.fft.rfft(x[0].mean(axis=0)[:, 0]) for x in (record.u, record.y))
    lines = np.arange(2, 241)
    return lines / PERIOD, Y[lines] / U[lines]


def test_total_delay_counts_half_a_sample_of_hold(plant, rig):
    # 10 ms at 500 Hz: 4.5 samples of true delay, five stored commands.
    sampled = linearise_rig(rig).sampled
    assert len(sampled.A) == 12 + 5
    expected = sample_dynamics(plant.dynamics, 1.0 / RATE, 0.009)
    # Rounding of one exponential or of one for each mode.
    np.testing.assert_allclose(sampled.A, expected.A, rtol=0.0, atol=1e-13)


def test_open_loop_without_noise_is_the_exact_response(plant):
    quiet = rig_of(plant)
    record = run_open_loop(
        quiet, excite(), periods=2, rng=np.random.default_rng(0), settle=0, steady=True
    ).record
    assert record.y.shape == (1, 2, 2000, 1)
    hz, H = measured(record)
    exact = statespace_response(linearise_rig(quiet).sampled, 2.0 * np.pi * hz)[:, 0, 0]
    # Rounding of stepping and transforms, relative to the largest line.
    np.testing.assert_allclose(H, exact, atol=1e-9 * np.abs(exact).max())


def test_noise_has_the_rms_it_was_given(rig):
    records = [run(rig, None, excite(), 20, seed).record for seed in (1, 2)]
    difference = records[0].y - records[1].y
    # 40000 differences: the rms is known to 0.35 %, taken three times.
    assert np.sqrt(np.mean(difference**2) / 2.0) == pytest.approx(1e-4, rel=0.011)


def test_closed_loop_equals_a_loop_written_out_tick_by_tick(plant):
    damped = dataclasses.replace(plant, dynamics=dataclasses.replace(plant.dynamics, zeta=np.full(6, 0.2)))
    rig = rig_of(damped, 0.02)
    sampled = linearise_rig(rig).sampled
    law, u, settle, periods = damper(0.3), excite(), 1, 2
    taken = run(rig, law, u, periods, 7, settle)
    # The same noise and the same start, then one tick after another in the order of the docstring.
    noise = 0.02 * np.random.default_rng(7).standard_normal((settle + periods, len(u), 1))
    many = 6  # periods from rest until the transient (1 rad/s at least) is below the tolerance
    x, c = np.zeros(len(sampled.A)), np.zeros(2)
    y, control = [], []
    for period in range(many + settle + periods):
        for k in range(len(u)):
            sample = sampled.C @ x + (noise[period - many, k] if period >= many else 0.0)
            command = law.C @ c + law.D @ sample
            c = law.A @ c + law.B @ sample
            x = sampled.A @ x + sampled.B @ (command + u[k])
            if period >= many + settle:
                y.append(sample)
                control.append(command)
    assert taken.cause == ""
    # What is left of the start after 24 s; rounding.
    np.testing.assert_allclose(taken.record.y.ravel(), np.ravel(y), atol=1e-9 * np.abs(y).max())
    np.testing.assert_allclose(taken.control.ravel(), np.ravel(control), atol=1e-9 * np.abs(control).max())


def test_prediction_from_the_open_loop_equals_the_measured_closed_loop(plant):
    quiet, law = rig_of(plant), damper(0.3)
    hz, H = measured(run(quiet, None, excite(), 1).record)
    K = statespace_response(law, 2.0 * np.pi * hz)
    predicted = predict_closed_loop_response(
        FrequencyResponse(frequency_hz=hz, H=H[:, None, None], inputs=PORTS[0], outputs=PORTS[1]),
        FrequencyResponse(frequency_hz=hz, H=K, inputs=PORTS[1], outputs=PORTS[0]),
    )
    _, closed = measured(run(quiet, law, excite(), 1).record)
    assert np.abs(H).max() > 1.2 * np.abs(closed).max()  # the law does something
    np.testing.assert_allclose(closed, predicted.H[:, 0, 0], atol=1e-9 * np.abs(closed).max())


def test_an_unstable_run_is_a_value_with_a_cause(rig):
    taken = run(rig, damper(50.0), excite(), 1)
    assert taken.record is None
    assert taken.control is None
    assert taken.cause.startswith("diverged: ")
    assert "Hz" in taken.cause


def test_stability_margin_of_pure_gain_and_delay():
    # Integrator 1/s, gain -k: held for T and delayed by 4.5 T it is T (z + 1) / (2 z^5 (z - 1)), so the phase
    # is -180 degrees where 5 T w = pi/2, and the gain limit there (2/T) tan(w T / 2).
    plant = Plant(dynamics=StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]]), inputs=PORTS[0], outputs=PORTS[1])
    rig = rig_of(plant)

    def stable(gain):
        law = SampledStateSpace(
            np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[-gain]], period_s=1.0 / RATE
        )
        return is_stable(close_rig(rig, law))

    low, high = 1.0, 1000.0
    while high - low > 1e-6:
        middle = (low + high) / 2.0
        low, high = (middle, high) if stable(middle) else (low, middle)
    # The bisection's width, and the growth that still counts as stable.
    assert low == pytest.approx(2.0 * RATE * np.tan(np.pi / (4.0 * DELAY * RATE)), rel=1e-7)


def test_a_rigid_body_has_no_steady_state_to_begin_in_unless_a_loop_holds_it():
    body = Plant(
        dynamics=StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]),
        inputs=PORTS[0],
        outputs=PORTS[1],
    )
    rig, u = rig_of(body), excite() + 0.1
    with pytest.raises(NumericalError, match="no periodic steady state"):
        run(rig, None, u, 1)
    law = tustin(StateSpace([[-60.0]], [[60.0]], [[120.0]], [[-130.0]]), 1.0 / RATE)  # 10 N m/rad, a lead
    first, second = run(rig, law, u, 2).record.y[0]
    # Rounding; from rest the angle would begin 0.01 rad off.
    np.testing.assert_allclose(second, first, rtol=0.0, atol=1e-11 * np.abs(first).max())


def test_rates_and_delays_that_do_not_fit_are_refused(plant, rig):
    with pytest.raises(ConfigError, match="hold"):
        rig_of(plant, delay_s=0.0005)
    law = damper(0.1)
    slow = SampledStateSpace(law.A, law.B, law.C, law.D, period_s=0.01)
    with pytest.raises(ConfigError, match=r"at 0\.01 s"):
        run(rig, slow, excite(), 1)
