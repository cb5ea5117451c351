"""Records of held inputs that do not say so: the data tell, where the lines reach far."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfilt
from struck_plant import FORCE, TIP

from middeck.identification.fit.fit_response import fit_response
from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.spectra.estimate import estimate_response
from middeck.signals.ports import Port
from middeck.signals.record import Record
from repeats import LONG

RATE, COUNT, DELAY = 64.0, 512 if LONG else 320, 0.0072
ZETA = 0.012


def sweep(rng: np.random.Generator) -> np.ndarray:
    t, last = np.arange(COUNT) / RATE, rng.uniform(0.32, 0.42) * RATE
    return np.sin(2.0 * np.pi * (0.4 + 0.5 * (last - 0.4) * t * RATE / COUNT) * t)


def multisine(rng: np.random.Generator) -> np.ndarray:
    lines = np.zeros(COUNT // 4 + 1, dtype=complex)
    lines[2 : round(COUNT // 2 * rng.uniform(0.32, 0.42))] = 1.0
    return np.tile(np.fft.irfft(lines * np.exp(2j * np.pi * rng.random(len(lines)))) * 16.0, 2)


def record_of(u: np.ndarray, y: np.ndarray, *, periodic: bool, held: bool | None = None) -> Record:
    return Record(
        sample_hz=RATE, u=u[None, None, :, None], y=y[None, None, :, None], inputs=(FORCE,), outputs=(TIP,),
        periodic=periodic, held=held,
    )  # fmt: skip


def measured(
    drive: Callable[[np.random.Generator], np.ndarray], seed: int, *more_hz: float
) -> tuple[Record, np.ndarray]:
    """From rest, each mode exact: the command of this sample acts from ``DELAY`` on, until then the last."""
    rng = np.random.default_rng([253, seed])
    u, y, hz = (
        drive(rng),
        np.zeros(COUNT),
        np.array([*[rng.uniform(3.0, 6.0), rng.uniform(8.0, 14.0)][: 1 + LONG], *more_hz]),
    )
    for f in hz:
        p = 2.0 * np.pi * f * (-ZETA + 1j * np.sqrt(1.0 - ZETA**2))
        rest = 1.0 / RATE - DELAY
        new, old = np.expm1(p * rest) / p, np.exp(p * rest) * np.expm1(p * DELAY) / p
        y += rng.uniform(0.4, 1.0) * f * lfilter([0.0, new, old], [1.0, -np.exp(p / RATE)], u + 0j).imag
    y += 3e-3 * y.std() * rng.standard_normal(COUNT)
    return record_of(u, y, periodic=False), hz


@pytest.mark.parametrize("drive", [sweep, multisine])
def test_a_hold_that_the_record_does_not_say_is_recognised(
    drive: Callable[[np.random.Generator], np.ndarray], campaign: Callable[..., range]
) -> None:
    """Half a period was in the delay, thousands of deviations; 15 of 16 sweeps had extra modes and doubts."""
    for seed in campaign(20):
        record, hz = measured(drive, seed)
        searched = LONG and seed % 5 == 1  # the order, which takes ten times as long
        fit = fit_record(record, states=None if searched else 2 * len(hz), sampled=False)
        assert fit.model.hold_s == 1.0 / RATE
        assert "held inputs, which the record does not say" in fit.order_reason
        assert fit.warnings == ()
        order = np.argsort(natural_hz(fit.model))
        assert len(order) == len(hz)
        known = fit.uncertainty
        assert np.all(np.abs(natural_hz(fit.model)[order] - hz) < 5.0 * known.natural_hz[order])
        assert np.all(np.abs(damping_ratio(fit.model)[order] - ZETA) < 5.0 * known.damping[order])
        assert abs(fit.model.delay_s[0] - DELAY) < 5.0 * known.delay_s[0] < 1e-4


def test_a_hold_that_leaves_doubts_is_reported() -> None:
    """A mode beyond the sweep: the held fit is shorter, with doubts; the delay has half a period."""
    record, hz = measured(sweep, 1, 28.0)
    fit = fit_record(record, states=2 * len(hz), sampled=False)
    assert fit.model.hold_s is None
    assert any("if they were held" in text for text in fit.warnings)


def test_steps_that_are_taken_as_not_held_are_warned_of() -> None:
    """A mode beyond their band: the held fit is the longer one, and half a period was in the delay."""
    rng, w, zeta = np.random.default_rng([257, 5]), 2.0 * np.pi * 13.0, 0.0015
    p = w * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    u = np.repeat(rng.choice([-1.0, 0.0, 1.0], 32), 16)
    y = lfilter([0.0, np.expm1(p / RATE) / p * w], [1.0, -np.exp(p / RATE)], u + 0j).imag
    y += 1e-4 * y.std() * rng.standard_normal(len(y))
    fit = fit_record(record_of(u, y, periodic=False), states=4, sampled=False)
    assert fit.model.hold_s == 1.0 / RATE or any("if they were held" in text for text in fit.warnings)


def test_a_filter_is_not_taken_for_a_hold() -> None:
    """Band-limited inputs, and a sensor behind a slow filter: the doubts stay, and the hold is not known."""
    rng = np.random.default_rng(7)
    f = np.fft.rfftfreq(COUNT, 1.0 / RATE)
    s, w = 2j * np.pi * f, 2.0 * np.pi * 5.0
    U = np.where((f > 0.3) & (f < 25.0), np.exp(2j * np.pi * rng.random(len(f))), 0.0)
    u, y = (
        np.fft.irfft(X, COUNT) for X in (U, U * w / (s**2 + 2.0 * ZETA * w * s + w**2) / (1.0 + s / 90.0))
    )
    y = y + 1e-3 * y.std() * rng.standard_normal(COUNT)
    fit = fit_record(record_of(u, y, periodic=True), states=2, sampled=False)
    assert fit.model.hold_s is None
    assert fit.warnings


def noisy(share: float, drive: Callable[[np.random.Generator], np.ndarray], seed: int) -> Record:
    record, _ = measured(drive, seed)
    more = np.random.default_rng([254, seed]).standard_normal(record.y.shape)
    return dataclasses.replace(record, y=record.y + share * record.y.std() * more)


def white(rng: np.random.Generator) -> np.ndarray:
    return rng.standard_normal(COUNT)


def low_noise(rng: np.random.Generator) -> np.ndarray:
    return sosfilt(butter(4, 0.4, output="sos"), rng.standard_normal(COUNT))


def test_noise_held_over_one_sample_is_a_command(campaign: Callable[..., range]) -> None:
    """No measured input drives all up to half the rate: half a period was in the delay, in silence."""
    for seed in campaign(20):
        fit = fit_record(
            noisy(0.03, white, seed), states=4 if LONG else 2, band_hz=(0.5, 20.0), sampled=False
        )
        assert fit.model.hold_s == 1.0 / RATE
        assert "half the rate" in fit.order_reason
        assert abs(fit.model.delay_s[0] - DELAY) < 5.0 * fit.uncertainty.delay_s[0] < 2e-3


def test_a_hold_that_is_likelier_but_not_sure_is_told() -> None:
    """Commands below 0.4 of half the rate: half a period in the delay, many deviations, in silence."""
    fit = fit_record(noisy(0.03 if LONG else 0.01, low_noise, 0), states=4 if LONG else 2)
    assert abs(fit.model.delay_s[0] - DELAY) > 20.0 * fit.uncertainty.delay_s[0]
    assert any("half a sample period" in text for text in fit.warnings)


def test_white_inputs_that_may_be_either_are_warned_of() -> None:
    """Band-limited to half the rate, short and noisy: half a sample was in the delay, 330 deviations."""
    rng, delay_s = np.random.default_rng([5, 4]), 0.01
    modes = int(rng.integers(1, 4))
    hz, zeta = np.sort(rng.uniform(3.0, 30.0, modes)), rng.uniform(0.005, 0.03, modes)
    constants = rng.choice([-1.0, 1.0], modes) * rng.uniform(0.4, 1.0, modes) * hz**2
    s, w = 2j * np.pi * np.fft.rfftfreq(1100, 0.01), 2.0 * np.pi * hz
    H = np.sum(constants[:, None] / (s**2 + 2.0 * (zeta * w)[:, None] * s + (w**2)[:, None]), axis=0)
    u = rng.standard_normal(1100)
    y = np.fft.irfft(np.fft.rfft(u) * H * np.exp(-delay_s * s), 1100)[800:]
    noisy = record_of(u[800:], y + 0.01 * y.std() * rng.standard_normal(300), periodic=False)
    fit = fit_record(dataclasses.replace(noisy, sample_hz=100.0), states=2 * modes, sampled=False)
    assert fit.model.hold_s == 0.01
    assert any("held and band-limited" in text for text in fit.warnings)
    made = dataclasses.replace(noisy, sample_hz=100.0, held=False)
    said = fit_record(made, states=2 * modes, sampled=False)
    assert np.all(np.abs(said.model.delay_s - delay_s) < 4.0 * said.uncertainty.delay_s)


def repeated(seed: int, noise: float, *, held: bool, top: float = 0.6, count: int = 512) -> Record:
    """Four steady periods of a multisine below ``top`` of half the rate, through a mode at 7.3 Hz, exact."""
    rng, f = np.random.default_rng([256, seed]), np.fft.rfftfreq(count, 1.0 / RATE)
    U = np.where((f > 0.4) & (f < 0.5 * top * RATE), np.exp(2j * np.pi * rng.random(len(f))), 0.0)
    s, w = 2j * np.pi * f, 2.0 * np.pi * 7.3
    if held:
        p, z = w * (-ZETA + 1j * np.sqrt(1.0 - ZETA**2)), np.exp(s / RATE)
        parts = []
        for pole, share in ((p, -0.5j), (np.conj(p), 0.5j)):
            rest = 1.0 / RATE - DELAY
            new, old = np.expm1(pole * rest), np.exp(pole * rest) * np.expm1(pole * DELAY)
            parts.append(share * (new + old / z) / pole / (z - np.exp(pole / RATE)))
        H = w**2 / p.imag * sum(parts)
    else:
        H = w**2 / (s**2 + 2.0 * ZETA * w * s + w**2) * np.exp(-s * DELAY)
    u, y = (np.tile(np.fft.irfft(X, count), 4).reshape(1, 4, count, 1) for X in (U, U * H))
    y = y + noise * y.std() * rng.standard_normal(y.shape)
    return Record(sample_hz=RATE, u=u, y=y, inputs=(FORCE,), outputs=(TIP,), periodic=True)


def test_a_response_to_held_commands_is_fitted_behind_the_hold(campaign: Callable[..., range]) -> None:
    """Half a period was in the delay, in silence in 5 of 16; without noise 3 to 13 modes
    stood for one to three.
    """
    for seed in campaign(20):
        fit = fit_response(estimate_response(repeated(seed, [3e-3, 1e-3][seed % 2], held=True)))
        assert fit.model.hold_s == 1.0 / RATE
        assert fit.model.states == 2
        assert fit.warnings == ()
        assert abs(natural_hz(fit.model)[0] - 7.3) < 4.5 * fit.uncertainty.natural_hz[0]
        assert abs(fit.model.delay_s[0] - DELAY) < 4.5 * fit.uncertainty.delay_s[0]


def test_a_response_to_commands_says_whether_they_were_held_or_warns(campaign: Callable[..., range]) -> None:
    """Much noise does not tell; a stated hold is no question, nor is that of a measured input."""
    for seed in campaign(20):
        known, doubted = repeated(seed, 3e-3, held=False), repeated(seed, 0.2, held=True, top=0.55)
        assert fit_response(estimate_response(known), states=2).warnings == ()
        fit = fit_response(estimate_response(doubted), states=2)
        assert any("if they were held" in text for text in fit.warnings)
        assert fit.model.hold_s is None
        said = fit_response(estimate_response(dataclasses.replace(doubted, held=True)), states=2)
        assert said.warnings == ()
        assert abs(said.model.delay_s[0] - DELAY) < 4.5 * said.uncertainty.delay_s[0]
        noise = 1e-4 * np.random.default_rng(seed).standard_normal(doubted.u.shape)
        heard = estimate_response(dataclasses.replace(doubted, u=doubted.u + noise * doubted.u.std()))
        assert heard.perhaps_held_s is None


def test_a_delay_that_a_model_lacks_is_not_taken_for_a_hold() -> None:
    """Accelerations have complex constants: of 20 ms, half a period was in a hold, in 3 of 3, in silence."""
    known = repeated(0, 3e-3, held=False)
    s = 2j * np.pi * np.fft.rfftfreq(known.u.shape[2], 1.0 / RATE)[:, None]
    y = np.fft.irfft(np.fft.rfft(known.y, axis=2) * s**2 * np.exp(-s * (0.02 - DELAY)), axis=2)
    felt = dataclasses.replace(known, y=y, outputs=(Port("felt", "m/s^2"),))
    fit = fit_response(estimate_response(felt, band_hz=(0.5, 18.0)))
    assert fit.model.hold_s is None
