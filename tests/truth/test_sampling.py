"""Hold, delay and Tustin against brute force, closed forms and the exact frequency response."""

import dataclasses
import warnings

import numpy as np
import pytest
import scipy.integrate as si
import scipy.linalg as sla
from hypothesis import given, settings
from hypothesis import strategies as st

from middeck.control.sampled.sampled_design import design_sampled_lqg
from middeck.errors import ConfigError, NumericalError
from middeck.signals.excitation.multisine import random_multisine
from middeck.systems.plants.response import statespace_response
from middeck.systems.poles.stability import growth_rates
from middeck.systems.poles.verdict import is_stable
from middeck.systems.sampling.sampled_plant import sample_plant
from middeck.systems.sampling.sampling import sample_dynamics, tustin
from middeck.systems.sampling.simulation import find_periodic_state, simulate
from middeck.systems.state_space.modal_system import ModalSystem, modal_response
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, poles
from plant_builders import FORCE, WAY, grouped_plant, unit_weights

T = 0.002


def modes(hz=(0.0, 0.3, 7.0, 45.0, 190.0), outputs=2, inputs=2, zeta=0.02):
    rng = np.random.default_rng(0)
    omega = 2.0 * np.pi * np.array(hz)
    n = len(omega)
    return ModalSystem(
        omega=omega,
        zeta=np.full(n, zeta),
        psi=rng.standard_normal((n, inputs)),
        phi=rng.standard_normal((outputs, n)),
        phi_rate=0.1 * rng.standard_normal((outputs, n)),
        names=tuple(f"mode {i}" for i in range(n)),
    )


def test_scalar_hold_and_fractional_delay():
    # x' = -a x + u(t - 1.25 T): the sample is driven by a quarter of the older and the rest of the newer.
    a, delay = 3.0, 1.25 * T
    held = sample_dynamics(StateSpace([[-a]], [[1.0]], [[1.0]], [[0.0]]), T, delay)
    new = (1.0 - np.exp(-a * 0.75 * T)) / a
    old = np.exp(-a * 0.75 * T) * (1.0 - np.exp(-a * 0.25 * T)) / a
    expected = [[np.exp(-a * T), new, old], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    np.testing.assert_allclose(held.A, expected, atol=1e-15)
    np.testing.assert_allclose(held.B, [[0.0], [1.0], [0.0]], atol=0.0)


def test_modal_and_dense_holds_agree():
    modal = modes()
    for delay in (0.0, 0.4 * T, 4.5 * T):
        blocks, dense = (
            sample_dynamics(modal, T, delay),
            sample_dynamics(modal.as_statespace(), T, delay),
        )
        for name in ("A", "B", "C", "D"):
            # Two matrix exponentials of norm up to 3.
            np.testing.assert_allclose(getattr(blocks, name), getattr(dense, name), atol=1e-12)


@pytest.mark.parametrize("samples", [0.0, 0.3, 1.0, 4.5])
def test_against_an_adaptive_integrator(samples):
    modal = modes((0.3, 7.0, 45.0))
    system, delay = modal.as_statespace(), samples * T
    u = np.random.default_rng(1).standard_normal((12, 2))
    y, _ = simulate(sample_dynamics(modal, T, delay), u)
    state, time = np.zeros(6), 0.0
    # Integrate from switch to switch of the delayed, held input; sample at multiples of T.
    events = sorted({k * T for k in range(12)} | {k * T + delay for k in range(12)})
    for event in (e for e in events if e <= 11 * T + 1e-12):
        if event > time + 1e-12:
            k = int(np.floor((0.5 * (time + event) - delay) / T + 1e-9))
            held = u[k] if k >= 0 else np.zeros(2)
            run = si.solve_ivp(
                lambda _, x, held=held: system.A @ x + system.B @ held,
                (time, event),
                state,
                method="DOP853",
                rtol=1e-12,
                atol=1e-15,
            )
            state, time = run.y[:, -1], event
        k = round(event / T)
        if abs(event - k * T) < 1e-12:
            # The integrator's tolerance, accumulated over twenty pieces.
            np.testing.assert_allclose(y[k], system.C @ state, atol=1e-10)


@settings(max_examples=20, deadline=None)
@given(samples=st.floats(0.0, 6.0))
def test_frequency_response_with_aliases(samples):
    # Sampling folds: H(z) = sum_n Z(s_n) G(s_n) exp(-s_n tau), s_n = j(w + n ws), Z the hold's transform.
    # Displacements only: with the hold they fall as 1/w^3, so that the tail beyond n is 1/n^2 of 1e-4.
    modal = modes((0.3, 7.0, 45.0))
    modal = dataclasses.replace(modal, phi_rate=0.0 * modal.phi_rate)
    omega, delay = 2.0 * np.pi * np.array([1.0, 7.3, 60.0, 200.0]), samples * T
    exact = statespace_response(sample_dynamics(modal, T, delay), omega)
    folded = np.zeros_like(exact)
    for n in range(-100, 101):
        w = omega + 2.0 * np.pi * n / T
        hold = (1.0 - np.exp(-1j * w * T)) / (1j * w * T)
        folded += (hold * np.exp(-1j * w * delay))[:, None, None] * modal_response(modal, w)
    np.testing.assert_allclose(folded, exact, atol=1e-7 * np.abs(exact).max())
    hold = (1.0 - np.exp(-1j * omega * T)) / (1j * omega * T)
    alone = (hold * np.exp(-1j * omega * delay))[:, None, None] * modal_response(modal, omega)
    # The aliases are part of it: at 200 Hz of 500 they are more than a tenth.
    assert np.abs(exact - alone)[-1].max() > 0.1 * np.abs(exact[-1]).max()


def test_delay_is_a_pure_phase_well_below_the_sampling_rate():
    # The sheet's 10 ms in all: 4.5 samples of true delay and half a sample of hold.
    modal = modes((1.3, 7.0), zeta=0.01)
    hz = np.array([0.5, 2.0, 5.0])
    exact = statespace_response(sample_dynamics(modal, T, 4.5 * T), 2.0 * np.pi * hz)
    smooth = modal_response(modal, 2.0 * np.pi * hz) * np.exp(-2j * np.pi * hz * 0.010)[:, None, None]
    # The hold's sinc and the first alias at 500 Hz: (5/500)^2 and less.
    np.testing.assert_allclose(exact, smooth, atol=1e-3 * np.abs(smooth).max())


def test_direct_term_is_delayed_too():
    system = StateSpace([[-1.0]], [[0.0]], [[0.0]], [[2.0]])
    u = np.arange(1.0, 7.0)[:, None]
    for delay, expected in (
        (0.0, [2, 4, 6, 8, 10, 12]),
        (2.0, [0, 0, 2, 4, 6, 8]),
        (1.5, [0, 0, 2, 4, 6, 8]),
    ):
        y, _ = simulate(sample_dynamics(system, T, delay * T), u)
        np.testing.assert_allclose(y[:, 0], expected)


def test_tustin_is_the_bilinear_map():
    rng = np.random.default_rng(3)
    system = StateSpace(
        rng.standard_normal((4, 4)) - 3.0 * np.eye(4),
        rng.standard_normal((4, 2)),
        rng.standard_normal((1, 4)),
        rng.standard_normal((1, 2)),
    )
    period, omega = 0.1, np.array([0.5, 3.0, 20.0])
    mapped = tustin(system, period)
    warped = 2.0 / period * np.tan(omega * period / 2.0)
    np.testing.assert_allclose(
        statespace_response(mapped, omega), statespace_response(system, warped), rtol=1e-12
    )
    expected = (1.0 + poles(system) * period / 2.0) / (1.0 - poles(system) * period / 2.0)
    np.testing.assert_allclose(np.sort_complex(poles(mapped)), np.sort_complex(expected), rtol=1e-12)
    assert is_stable(mapped)


def test_tustin_is_the_same_in_any_units_of_the_states():
    rng = np.random.default_rng(5)
    A = np.diag([-1.0, -20.0, -300.0, -4.0]) + 0.3 * rng.standard_normal((4, 4))
    B, C = rng.standard_normal((4, 1)), rng.standard_normal((1, 4))
    unit = np.array([1e-8, 1.0, 1e9, 1e3])
    turned = StateSpace(A * unit[:, None] / unit, B * unit[:, None], C / unit, [[0.0]])
    plain, mapped = tustin(StateSpace(A, B, C, [[0.0]]), 0.01), tustin(turned, 0.01)
    assert np.linalg.cond(np.eye(4) - 0.005 * turned.A) > 1e12
    assert np.allclose(mapped.A, plain.A * unit[:, None] / unit, rtol=1e-9, atol=0.0)
    assert np.allclose(mapped.B, plain.B * unit[:, None], rtol=1e-9, atol=0.0)
    assert np.allclose(mapped.C, plain.C / unit, rtol=1e-9, atol=0.0)


def test_tustin_refuses_a_pole_it_cannot_map():
    with pytest.raises(ConfigError, match="sample faster"):
        tustin(StateSpace([[20.0]], [[1.0]], [[1.0]], [[0.0]]), 0.1)


def test_growth_rates_of_a_sampled_system_are_those_of_the_continuous():
    modal = modes((0.3, 7.0))
    held = sample_dynamics(modal, T)
    np.testing.assert_allclose(
        np.sort_complex(growth_rates(held)),
        np.sort_complex(poles(modal.as_statespace())),
        rtol=1e-9,  # log of a pole within 1e-4 of one
    )
    assert growth_rates(SampledStateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]], period_s=T)).real == -np.inf


def test_bad_times_are_refused():
    for period, delay in ((0.0, 0.0), (T, -T)):
        with pytest.raises(ConfigError):
            sample_dynamics(modes(), period, delay)


def test_periodic_state_repeats():
    held = sample_dynamics(modes((0.3, 7.0)), T, 4.5 * T)
    u = np.random.default_rng(0).standard_normal((500, 2))
    start = find_periodic_state(held, u)
    first, end = simulate(held, u, start)
    np.testing.assert_allclose(end, start, atol=1e-10 * np.abs(start).max())
    # The same by the discrete Fourier transform: Y = H U on every line.
    lines = np.fft.rfftfreq(500, T)
    Y = np.einsum("kij,kj->ki", statespace_response(held, 2.0 * np.pi * lines), np.fft.rfft(u, axis=0))
    np.testing.assert_allclose(first, np.fft.irfft(Y, 500, axis=0), atol=1e-9 * np.abs(first).max())


def test_a_rigid_mode_has_no_periodic_state():
    with pytest.raises(NumericalError, match="repeats itself"):
        find_periodic_state(sample_dynamics(modes((0.0, 7.0)), T), np.ones((50, 2)))


def test_simulation_is_the_power_of_the_transition():
    held = sample_dynamics(modes((0.3, 7.0)), T)
    start = np.arange(1.0, 5.0)
    _, end = simulate(held, np.zeros((37, 2)), start)
    np.testing.assert_allclose(end, np.linalg.matrix_power(held.A, 37) @ start, rtol=1e-12)
    np.testing.assert_allclose(
        end, sla.expm(modes((0.3, 7.0)).as_statespace().A * 37 * T) @ start, rtol=1e-11
    )


def test_multisine_has_equal_lines_in_the_band_and_nothing_else():
    u = random_multisine((0.1, 60.0), 64.0, 500.0, 0.3, np.random.default_rng(5))
    assert u.shape == (32000,)
    amplitude = 2.0 * np.abs(np.fft.rfft(u)) / len(u)
    lines = np.fft.rfftfreq(len(u), 1.0 / 500.0)
    inside = (lines >= 0.1 - 1e-9) & (lines <= 60.0 + 1e-9)
    assert inside.sum() == 3840 - 7 + 1  # lines 7/64 to 3840/64 Hz
    # Rounding of a transform of 32000 samples.
    np.testing.assert_allclose(amplitude[inside], 0.3 * np.sqrt(2.0 / inside.sum()), rtol=1e-12)
    assert amplitude[~inside].max() < 1e-15
    assert np.sqrt(np.mean(u**2)) == pytest.approx(0.3, rel=1e-12)
    # Gaussian-like: a crest of 2 or 10 would mean aligned or optimised phases.
    assert 3.0 < np.abs(u).max() / 0.3 < 5.5


def test_multisine_depends_on_the_generator_alone():
    make = [random_multisine((1.0, 5.0), 2.0, 50.0, 1.0, np.random.default_rng(s)) for s in (1, 1, 2)]
    assert np.array_equal(make[0], make[1])
    assert not np.allclose(make[0], make[2])


@pytest.mark.parametrize(
    ("band", "period", "rate", "message"),
    [
        ((1.0, 5.0), 1.01, 50.0, "samples"),
        ((1.1, 1.2), 1.0, 50.0, "no multiple"),
        ((1.0, 25.0), 1.0, 50.0, "half"),
    ],
)
def test_multisine_refuses(band, period, rate, message):
    with pytest.raises(ConfigError, match=message):
        random_multisine(band, period, rate, 1.0, np.random.default_rng(0))


@pytest.mark.parametrize(("hz", "period_s", "doubted"), [
    ((3.0,), 100.0, True), ((0.1, 3.0, 40.0), 100.0, True), ((0.0, 3.0), 100.0, True),
    ((3.0,), 0.01, False), ((0.0,), 100.0, False), ((0.0, 30.0), 1.0, False), ((0.001, 0.02), 100.0, False),
])  # fmt: skip
def test_a_rate_for_the_period_is_reported(hz, period_s, doubted):
    """A mode "sampled at 100" was sampled every 100 s without a word; slow laws, slow plants are not told."""
    plant, weights = grouped_plant(modes(hz, 1, 1), (FORCE,), (WAY,)), unit_weights(("force",), 1e-4)
    for ask in (sample_plant, lambda plant, period_s: design_sampled_lqg(plant, weights, 1.0, period_s)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            ask(plant, period_s)
        assert any("is the rate" in str(warning.message) for warning in caught) == doubted
