"""The accuracy that is expected before a test is the accuracy that the test then has."""

import dataclasses

import gimbal_model
import gimbal_record
import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import damping_ratio, model_response, natural_hz
from middeck.identification.model.plant_model import model_of_plant
from middeck.identification.spectra.estimate import estimate_response
from middeck.identification.uncertainty.accuracy import expected_accuracy, structure_of
from middeck.identification.uncertainty.covariance import draw_errors
from middeck.identification.uncertainty.model_unknowns import model_at, unknowns_of
from middeck.identification.uncertainty.response_derivatives import entry_slopes
from middeck.signals.excitation.binary_signals import design_mls
from middeck.signals.excitation.limits import Limits
from middeck.signals.excitation.multisine import design_multisine
from middeck.signals.excitation.sweep import design_sweep
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import StateSpace

SCORED = gimbal_record.SCORED_HZ
RNG = np.random.default_rng


def noise_of(outputs=1, inputs=1):
    clean = gimbal_record.multisine(0, outputs=outputs, inputs=inputs, noise=0.0)
    return 0.01 * np.sqrt(np.mean(clean.y**2, axis=(0, 1, 2)))


def test_a_plant_becomes_the_model_of_a_perfect_test():
    f = np.linspace(0.5, 20.0, 50)
    truth = gimbal_record.response(f, 3, 2)
    np.testing.assert_allclose(
        model_response(gimbal_model.model(3, 2), f), truth, atol=1e-12 * np.abs(truth).max()
    )
    plant = gimbal_model.plant(3, 2)
    # The same through eigenvalues of its state space; their condition costs a few digits.
    by_states = model_of_plant(Plant(dynamics=plant.system, inputs=plant.inputs, outputs=plant.outputs))
    turn = np.exp(-2j * np.pi * f[:, None] * gimbal_record.DELAY_S)[:, :, None]
    np.testing.assert_allclose(model_response(by_states, f) * turn, truth, atol=1e-9 * np.abs(truth).max())
    assert structure_of(gimbal_model.model()).real_constants
    rigid = ModalSystem(omega=[0.0], zeta=[0.0], psi=[[1.0]], phi=[[1.0]], phi_rate=[[0.0]], names=("free",))
    for dynamics in (rigid, StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]])):
        with pytest.raises(ConfigError):
            model_of_plant(
                Plant(dynamics=dynamics, inputs=gimbal_record.INPUTS[:1], outputs=gimbal_record.OUTPUTS[:1])
            )


def test_the_bound_of_the_benchmark_is_expected_before_its_test():
    """benchmark-cases: 1.18e-4 for `multisine` with real modal constants, the median over noise."""
    expected = expected_accuracy(
        gimbal_model.model(), gimbal_record.multisine(0), noise_of(), periods=3, scored_hz=SCORED
    )
    covariance = expected.covariance
    entry = entry_slopes(covariance.model, covariance.structure, 2j * np.pi * SCORED, 0, 0)
    errors = entry.by.T @ draw_errors(covariance, 4000, RNG(0))[entry.place]
    relative = np.sqrt(np.sum(np.abs(errors) ** 2, axis=0) / np.sum(np.abs(entry.H) ** 2))
    # Three digits are printed, and the median of 4000 draws of 14 unknowns scatters by 0.4 %.
    assert np.median(relative) == pytest.approx(1.18e-4, rel=0.015)
    # The expected error is the root of the mean square, whose draws scatter by 0.4 % as well.
    assert expected.error[0] == pytest.approx(np.sqrt(np.mean(relative**2)), rel=0.02)
    assert expected.duration_s == 192.0


def test_one_mode_has_the_closed_form():
    """Peak of one light mode under dense lines of amplitude a: var(omega) from the integral of |dH/domega|^2.

    H = K / (s^2 + 2 zeta w s + w^2). Near the peak H = -j K / (2 w) / (sigma + j d), with sigma = zeta w and
    d the distance from the peak; dH/dw_d = H j / (sigma + j d). With spacing 2 pi / (N T) of lines, the sum
    of |dH/dw|^2 is N T / (2 pi) times the integral of (K / 2w)^2 / (sigma^2 + d^2)^2 dd =
    (K / 2w)^2 pi / (2 sigma^3); frequency and the (phase of the) constant are uncorrelated only if the
    constant is real, which the structure says. Hence var(w_d) = N s^2 / (2 a^2 (N/2)^2 P) / that sum.
    """
    w, zeta, K, rate, period, sigma_y = 2.0 * np.pi * 5.0, 0.01, 3.0, 100.0, 400.0, 1e-3
    modal = ModalSystem(omega=[w], zeta=[zeta], psi=[[K]], phi=[[1.0]], phi_rate=[[0.0]], names=("one",))
    plant = Plant(dynamics=modal, inputs=gimbal_record.INPUTS[:1], outputs=gimbal_record.OUTPUTS[:1])
    made = design_multisine((1.0, 20.0), period, rate, Limits(rms=1.0), RNG(0))
    model = model_of_plant(plant)
    structure = dataclasses.replace(structure_of(model), with_delay=False)
    expected = expected_accuracy(model, made, sigma_y, periods=2, structure=structure)
    N, a = 40000, np.sqrt(2.0 / len(made.lines))
    slopes = N / rate / (2.0 * np.pi) * (K / (2.0 * w)) ** 2 * np.pi / (2.0 * (zeta * w) ** 3)
    variance = N * sigma_y**2 / (2.0 * a**2 * (N / 2) ** 2 * 2) / slopes
    # The other terms of H are smaller by zeta, and the band cuts the tails of the integral.
    assert expected.uncertainty.natural_hz[0] == pytest.approx(np.sqrt(variance) / (2.0 * np.pi), rel=0.02)
    # In a light mode sigma and omega_d have the same variance (the slopes differ by j), but the real constant
    # of unknown size is correlated with sigma: half of its information is lost.
    assert expected.uncertainty.damping[0] == pytest.approx(np.sqrt(2.0 * variance) / w, rel=0.03)


def test_what_a_hold_takes_from_the_inputs_is_not_counted():
    """The bound by differences of the samples themselves: one mode at 0.43 of the rate, held exactly."""
    rate, N, sigma_y = 100.0, 800, 1e-3
    made = design_multisine((0.5, 49.0), N / rate, rate, Limits(rms=1.0), RNG(1))
    turn = np.exp(2j * np.pi * np.arange(N // 2 + 1) / N)
    U = np.fft.rfft(made.u[0, :, 0])

    def held(x):
        """Steady samples behind the hold, each pole's step response exact."""
        s = x[0] * (-x[1] + 1j * np.sqrt(1.0 - x[1] ** 2))
        z, b = np.exp(s / rate), x[2] / (2j * s.imag)
        H = sum(c * (p - 1.0) / q / (turn - p) for c, p, q in ((b, z, s), (b.conj(), z.conj(), s.conj())))
        return np.fft.irfft(H * U, N)

    true = np.array([2.0 * np.pi * 43.0, 0.01, 5.0])
    steps = 1e-5 * np.diag(true)
    slopes = np.array([(held(true + h) - held(true - h)) / (2.0 * h.sum()) for h in steps])
    bound = np.sqrt(np.diag(np.linalg.inv(2.0 * slopes @ slopes.T / sigma_y**2)))
    w, zeta, K = true
    modal = ModalSystem(omega=[w], zeta=[zeta], psi=[[K]], phi=[[1.0]], phi_rate=[[0.0]], names=("one",))
    plant = Plant(dynamics=modal, inputs=gimbal_record.INPUTS[:1], outputs=gimbal_record.OUTPUTS[:1])
    model = dataclasses.replace(model_of_plant(plant), hold_s=1.0 / rate)
    structure = dataclasses.replace(structure_of(model), with_delay=False)
    record = gimbal_record.multisine(0)
    u = made.u[:, None]
    record = dataclasses.replace(record, sample_hz=rate, u=u, y=np.zeros_like(u), held=True)
    for behind, command in ((plant, made), (model, made), (model, record)):
        known = expected_accuracy(behind, command, sigma_y, periods=2, structure=structure).uncertainty
        # What folds back from beyond half the rate adds little.
        found = np.array([2.0 * np.pi * known.natural_hz[0], known.damping[0]])
        np.testing.assert_allclose(found, bound[:2], rtol=0.02)


def maximum_likelihood(measured, start, structure, variance):
    """Gauss-Newton from the truth with the true variance: three steps end far below a deviation."""
    s, x = 2j * np.pi * measured.frequency_hz, unknowns_of(start, structure)
    for _ in range(3):
        entry = entry_slopes(model_at(start, structure, x), structure, s, 0, 0)
        J = (entry.by / np.sqrt(variance)).view(float)
        left = ((measured.H[:, 0, 0] - entry.H) / np.sqrt(variance)).view(float)
        x = x + np.linalg.lstsq(J.T, left, rcond=None)[0]
    return model_at(start, structure, x)


@pytest.mark.long
def test_estimates_scatter_as_expected(campaign):
    """Monte Carlo of the benchmark's gimbal: estimates from independent noise, mode by mode."""
    model, seeds = gimbal_model.model(), campaign(1000)
    clean = gimbal_record.multisine(0, noise=0.0)
    expected = expected_accuracy(model, clean, noise_of(), periods=3, scored_hz=SCORED)
    structure = expected.covariance.structure
    on = estimate_response(clean, band_hz=(0.1, 60.0))
    U = np.fft.rfft(clean.u[0, 0, :, 0])[np.round(on.frequency_hz * 64.0).astype(int)]
    variance = 16384 * noise_of()[0] ** 2 / 3.0 / np.abs(U) ** 2
    truth, found = gimbal_record.response(SCORED), []
    for seed in seeds:
        parts = np.random.default_rng(seed).standard_normal((2, len(U)))
        H = on.H + (np.sqrt(0.5 * variance) * (parts[0] + 1j * parts[1]))[:, None, None]
        best = maximum_likelihood(dataclasses.replace(on, H=H), model, structure, variance)
        error = gimbal_record.complex_error(model_response(best, SCORED), truth)
        found.append([*natural_hz(best), *damping_ratio(best), best.delay_s[0], error])
    true = [*gimbal_record.MODES_HZ, *[gimbal_record.ZETA] * 5, gimbal_record.DELAY_S[0], 0.0]
    known = expected.uncertainty
    deviation = [*known.natural_hz, *known.damping, *known.delay_s, expected.error[0]]
    ratio = np.sqrt(np.mean((np.array(found) - true) ** 2, axis=0)) / deviation
    # The rms of n draws scatters by 1/sqrt(2 n): four deviations for twelve numbers.
    assert np.all(np.abs(ratio - 1.0) < 4.0 / np.sqrt(2.0 * len(seeds)))


def test_accuracy_follows_length_noise_and_amplitude():
    model = gimbal_model.model(3, 2)
    made = design_multisine((0.1, 60.0), 64.0, 256.0, Limits(rms=1.0), RNG(0), inputs=2)
    once = expected_accuracy(model, made, 1e-3, periods=1)
    louder = design_multisine((0.1, 60.0), 64.0, 256.0, Limits(rms=3.0), RNG(0), inputs=2)
    for other, factor in (
        (expected_accuracy(model, made, 1e-3, periods=4), 2.0),
        (expected_accuracy(model, made, 5e-4), 2.0),
        (expected_accuracy(model, louder, 1e-3), 3.0),
    ):
        # Exact laws of the bound, up to rounding of an inverse of 34 unknowns.
        np.testing.assert_allclose(other.error, once.error / factor, rtol=1e-6)
        np.testing.assert_allclose(other.gain, once.gain / factor, rtol=1e-6)
        np.testing.assert_allclose(other.uncertainty.damping, once.uncertainty.damping / factor, rtol=1e-6)
    assert once.gain.shape == (3, 5, 2)
    twice = design_multisine((0.1, 60.0), 128.0, 256.0, Limits(rms=1.0), RNG(0), inputs=2)
    # A period twice as long holds as much as two periods: the modes are many lines wide in both.
    np.testing.assert_allclose(
        expected_accuracy(model, twice, 1e-3).uncertainty.natural_hz,
        expected_accuracy(model, made, 1e-3, periods=2).uncertainty.natural_hz,
        rtol=0.1,
    )


def test_better_signals_for_the_same_peak_are_expected_to_say_more():
    """A peak of one: compact phases carry more than random ones, and a sweep as much as its crest says."""
    model = gimbal_model.model()
    where = ((0.5, 30.0), 32.0, 256.0)
    error = {
        phases: expected_accuracy(
            model, design_multisine(*where, Limits(peak=1.0), RNG(0), phases=phases), 1e-3
        ).error[0]
        for phases in ("random", "compact")
    }
    crest = {
        phases: design_multisine(*where, Limits(peak=1.0), RNG(0), phases=phases).crest_factor[0]
        for phases in ("random", "compact")
    }
    # Equal spectra: the error goes with the crest factor exactly.
    assert error["random"] / error["compact"] == pytest.approx(crest["random"] / crest["compact"], rel=1e-9)
    sweep = expected_accuracy(model, design_sweep(*where, Limits(peak=1.0)), 1e-3).error[0]
    # The sweep's spectrum is that of the multisine but for its ripples.
    assert sweep == pytest.approx(error["compact"] * np.sqrt(2.0) / crest["compact"], rel=0.1)


def test_tests_that_cannot_tell_are_refused():
    model = gimbal_model.model(1, 2)
    made = design_multisine((0.1, 60.0), 64.0, 256.0, Limits(rms=1.0), RNG(0), inputs=2)
    first = dataclasses.replace(made, u=made.u[:, :, :1])
    one_experiment = dataclasses.replace(made, u=made.u[:1, :, :1].repeat(2, axis=2))
    with pytest.raises(ConfigError, match="1 inputs, the model 2"):
        expected_accuracy(model, first, 1e-3)
    with pytest.raises(ConfigError, match="undetermined"):
        expected_accuracy(model, one_experiment, 1e-3)  # the same signal on both inputs
    with pytest.raises(ConfigError, match="noise"):
        expected_accuracy(model, made, 0.0)
    with pytest.raises(ConfigError, match="periods"):
        expected_accuracy(model, made, 1.0, periods=0)
    few = design_mls(3, 256.0, Limits(peak=1.0), RNG(0))
    with pytest.raises(ConfigError, match="undetermined"):
        expected_accuracy(gimbal_model.model(), few, 1e-3)
