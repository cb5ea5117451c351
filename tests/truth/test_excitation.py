"""Designed signals against their definitions."""

import numpy as np
import pytest
from signal_bank import BAND, PERIOD_S, RATE, signals

from middeck.errors import ConfigError
from middeck.signals.excitation.band_noise import design_burst, design_noise
from middeck.signals.excitation.binary_signals import design_binary, design_mls
from middeck.signals.excitation.limits import Limits
from middeck.signals.excitation.multisine import (
    compact_phases,
    design_multisine,
    random_multisine,
    schroeder_phases,
)
from middeck.signals.excitation.signal import line_power, repeat_periods, slew_of
from middeck.signals.excitation.sweep import design_sweep
from repeats import repeats

WHERE = (BAND, PERIOD_S, RATE)
UNIT = Limits(peak=1.0)


def draw(seed=0):
    return np.random.default_rng(seed)


def test_the_studies_multisine_keeps_its_bytes():
    rng = draw(3)
    spectrum = np.zeros(1025, dtype=complex)
    spectrum[8:481] = 1024.0 * 0.5 * np.sqrt(2.0 / 473) * np.exp(2j * np.pi * rng.random(473))
    assert np.array_equal(random_multisine(*WHERE, 0.5, draw(3)), np.fft.irfft(spectrum, 2048))


@pytest.mark.parametrize("name", ["random", "schroeder", "compact", "odd", "odd-odd", "random-odd", "pink"])
def test_power_is_on_the_lines_as_asked_and_nowhere_else(name):
    made = signals()[name]
    power = line_power(made.u)[:, 0]
    wanted = 1.0 / made.frequency_hz**2 if name == "pink" else np.ones(len(made.lines))
    # Rounding of a transform of 2048 samples, squared.
    np.testing.assert_allclose(power[made.lines] / power[made.lines].sum(), wanted / wanted.sum(), rtol=1e-12)
    assert np.delete(power, made.lines).sum() < 1e-28 * power.sum()
    np.testing.assert_allclose(made.power.sum(axis=0), made.rms**2, rtol=1e-12)
    np.testing.assert_allclose(made.peak, 1.0, rtol=1e-12)


def test_grids_leave_lines_for_detection():
    made = signals()
    for name in ("odd", "odd-odd", "random-odd"):
        assert np.all(made[name].lines % 2 == 1)
        half = made[name].u.shape[1] // 2
        np.testing.assert_allclose(made[name].u[:, :half], -made[name].u[:, half:], atol=1e-12)
    assert np.all(made["odd-odd"].lines % 4 == 1)
    odd = np.arange(9, 480, 2)
    silent = np.setdiff1d(odd[: 4 * 59], made["random-odd"].lines)
    # One of each four odd lines in succession, at random.
    groups = [np.isin(odd[k : k + 4], made["random-odd"].lines).sum() for k in range(0, 236, 4)]
    assert groups == [3] * 59
    assert len(np.unique((silent - 9) // 2 % 4)) == 4
    lines = made["random"].lines
    assert np.array_equal(lines, np.arange(lines[0], lines[-1] + 1))


def test_distortion_falls_on_the_silent_lines_that_detect_it():
    made = signals()["random-odd"]
    silent = np.setdiff1d(np.arange(made.lines[0], made.lines[-1] + 1), made.lines)
    even, odd = silent[silent % 2 == 0], silent[silent % 2 == 1]
    power = {name: line_power(f(made.u))[:, 0] for name, f in (
        ("linear", lambda u: u), ("square", lambda u: u + 0.1 * u**2), ("cube", lambda u: u + 0.1 * u**3),
    )}  # fmt: skip
    small = 1e-26 * power["linear"].sum()  # rounding
    assert power["linear"][even].sum() < small
    assert power["linear"][odd].sum() < small
    assert power["square"][even].sum() > 1e-5
    assert power["square"][odd].sum() < small
    assert power["cube"][odd].sum() > 1e-6
    assert power["cube"][even].sum() < small


@pytest.mark.parametrize("inputs", repeats([3, 4, 2, 5], 2))
@pytest.mark.parametrize("phases", ["random", "compact"])
def test_several_inputs_are_orthogonal_on_every_line(inputs, phases):
    made = design_multisine(BAND, 2.0, RATE, UNIT, draw(), inputs=inputs, realisations=2, phases=phases)
    assert made.u.shape == (2 * inputs, 512, inputs)
    U = np.fft.rfft(made.u, axis=1)[:, made.lines].reshape(2, inputs, -1, inputs)
    gram = np.einsum("rekj,reki->rkij", U, U.conj())
    # U^H U is diagonal, so that the variance of a response is that of one input over as many experiments.
    size = np.abs(U[:, :1]) ** 2
    np.testing.assert_allclose(
        gram, inputs * size[:, 0][..., None] * np.eye(inputs), atol=1e-9 * np.abs(gram).max()
    )
    assert not np.allclose(made.u[0], made.u[inputs])


@pytest.mark.parametrize(("band", "period_s"), [((1.0, 60.0), 1.0), ((1.0, 60.0), 8.0), ((0.1, 60.0), 64.0)])
def test_compact_phases_beat_schroeders(band, period_s):
    # Guillaume et al. (1991) reach 1.4 for flat low-pass multisines; Schroeder's phases give 1.6 to 1.9.
    made = {
        phases: design_multisine(band, period_s, RATE, Limits(rms=1.0), draw(), phases=phases)
        for phases in ("random", "schroeder", "compact")
    }
    crest = {phases: x.crest_factor[0] for phases, x in made.items()}
    assert crest["compact"] < 1.45 < crest["schroeder"] < 2.0 < crest["random"]


def test_compact_phases_for_several_inputs_keep_every_experiment_low():
    # Signs of two inputs change no peak; the three angles of three must share one set of phases.
    two = design_multisine(*WHERE, UNIT, draw(), inputs=2, phases="compact")
    three = design_multisine(*WHERE, UNIT, draw(), inputs=3, phases="compact")
    assert two.crest_factor.max() < 1.45
    assert three.crest_factor.max() < 1.7


@pytest.mark.kernels
def test_compact_phases_do_not_hang_on_last_digits():
    """As another processor rounds the start and each value of the norm."""
    lines, rng = np.arange(4, 64), np.random.default_rng(5)
    amplitude = np.ones(len(lines))
    start, turns = schroeder_phases(amplitude) + rng.random(len(lines)), np.zeros(1)
    found = compact_phases(lines, amplitude, 512, start, turns)
    moved = start + 1e-12 * rng.standard_normal(len(lines))
    np.testing.assert_array_equal(compact_phases(lines, amplitude, 512, moved, turns), found)


def test_sweeps_have_the_crest_of_a_sine_and_the_frequencies_asked_for():
    for law in ("linear", "logarithmic"):
        made = design_sweep(*WHERE, UNIT, law=law)
        np.testing.assert_allclose(made.crest_factor, np.sqrt(2.0), rtol=0.01)
        u = made.u[0, :, 0]
        rising = np.flatnonzero((u[:-1] < 0.0) & (u[1:] >= 0.0))
        at = rising + u[rising] / (u[rising] - u[rising + 1])
        seen, t = RATE / np.diff(at), 0.5 * (at[1:] + at[:-1]) / RATE / PERIOD_S
        wanted = 1.0 + 59.0 * t if law == "linear" else 60.0**t
        # Half a cycle a period, and the error of a crossing interpolated at 60 of 256 Hz.
        early = t < 0.5
        np.testing.assert_allclose(seen[early], wanted[early], rtol=0.1)
        # The period closes: the first sample continues the last.
        assert abs(u[0]) < 1e-12
        assert made.slew[0] <= 1.01 * 2.0 * np.pi * 60.0
    thirds = [line_power(made.u)[k : 2 * k, 0].sum() for k in (32, 64, 128)]
    # Every octave has the same power; the transitions at the ends of a short sweep leave a few per cent.
    np.testing.assert_allclose(thirds, np.mean(thirds), rtol=0.1)


@pytest.mark.parametrize("order", [2, 3, 5, 7, 8, 10, 12, 15])
def test_a_maximum_length_sequence_is_correlated_with_nothing_but_itself(order):
    made = design_mls(order, RATE, UNIT, draw())
    u = made.u[0, :, 0]
    length = 2**order - 1
    assert set(u) == {-1.0, 1.0}
    correlation = np.fft.irfft(np.abs(np.fft.rfft(u)) ** 2, length)
    # Golomb 1967: N at lag zero, -1 at every other.
    np.testing.assert_allclose(correlation, np.where(np.arange(length), -1.0, length), atol=1e-9 * length)
    assert not np.array_equal(u, design_mls(order, RATE, UNIT, draw(1)).u[0, :, 0])


def test_a_held_sequence_holds():
    made = design_mls(7, RATE, UNIT, draw(), hold=3, inputs=3)
    assert made.u.shape == (4, 381, 3)
    np.testing.assert_array_equal(np.diff(made.u.reshape(4, 127, 3, 3), axis=2), 0.0)
    assert np.einsum("esi,esj->ij", made.u, made.u) == pytest.approx(4 * 381 * np.eye(3), abs=1e-9)


def test_a_binary_signal_gathers_its_power_in_the_band():
    made = design_binary(*WHERE, UNIT, draw())
    assert set(np.unique(made.u)) == {-1.0, 1.0}
    start = np.where(random_multisine(*WHERE, 1.0, draw()) >= 0.0, 1.0, -1.0)
    share = made.power.sum()
    clipped = line_power(start[None, :, None])[made.lines].sum()
    # Two levels have three times the power of a random multisine of the same peak (crest near 3.5), and the
    # search gathers more of it in the band than clipping alone.
    assert share > clipped + 0.03
    assert made.power.min() > 0.1 * made.power.mean()
    assert clipped > 0.6  # the sign of Gaussian noise keeps 2/pi of its power (Bussgang 1952)


def test_noise_and_bursts_stay_in_their_band():
    noise = design_noise((5.0, 20.0), 64.0, RATE, Limits(rms=2.0), draw(), inputs=2, experiments=3)
    assert noise.u.shape == (3, 16384, 2)
    np.testing.assert_allclose(np.sqrt(np.mean(noise.u**2, axis=1)).max(axis=0), 2.0)
    # A cut of a longer signal leaks 1/(pi^2 lines) at each edge, of 960 lines.
    assert np.all(noise.power.sum(axis=0) > 0.998 * noise.rms**2)
    assert abs(np.corrcoef(noise.u[0].T)[0, 1]) < 4.0 / np.sqrt(2 * 960)  # four deviations of 2 B T numbers
    burst = design_burst((5.0, 20.0), 16.0, RATE, UNIT, draw(), share=0.25)
    assert not burst.u[0, 1024:].any()
    assert burst.u[0, :1024].any()
    assert burst.power.sum() > 0.99 * burst.rms[0] ** 2


@pytest.mark.parametrize(
    ("limits", "reached"),
    [
        (Limits(rms=0.3), "rms"),
        (Limits(rms=0.3, peak=0.7), "peak"),
        (Limits(rms=0.3, peak=5.0, slew=1.0), "slew"),
        (Limits(rms=0.3, peak=5.0, slew=1e4), "rms"),
    ],
)
def test_signals_are_as_large_as_their_limits_allow(limits, reached):
    made = design_multisine(*WHERE, limits, draw(), inputs=2)
    each = {
        "rms": np.sqrt(np.mean(made.u**2, axis=1)).max(axis=0),
        "peak": made.peak,
        "slew": slew_of(made.u, RATE, periodic=True).max(axis=0),
    }
    for name, value in each.items():
        allowed = getattr(limits, name)
        assert allowed is None or np.all(value <= allowed * (1.0 + 1e-12))
    np.testing.assert_allclose(each[reached], getattr(limits, reached), rtol=1e-12)


def test_each_input_may_have_its_own_limits():
    made = design_multisine(*WHERE, (Limits(peak=1.0), Limits(peak=20.0)), draw(), inputs=2)
    np.testing.assert_allclose(made.peak, [1.0, 20.0], rtol=1e-12)


def test_the_rng_alone_decides():
    for first, second, other in zip(*(signals(s).values() for s in (0, 0, 1)), strict=True):
        assert first == second
        if first.what.startswith(("random", "compact", "Gaussian", "burst", "maximum", "binary")):
            assert not np.array_equal(first.u, other.u)


def test_commands_repeat():
    made = signals()["odd"]
    assert repeat_periods(made, 4).shape == (1, 4, 2048, 1)
    with pytest.raises(ConfigError, match="not periodic"):
        repeat_periods(signals()["noise"], 2)


@pytest.mark.parametrize(
    "design",
    [
        lambda: Limits(),
        lambda: Limits(peak=-1.0),
        lambda: Limits(rms=float("nan")),
        lambda: design_multisine((1.0, 60.0), 1.0 / 3.0, RATE, UNIT, draw()),
        lambda: design_multisine((1.0, 200.0), 8.0, RATE, UNIT, draw()),
        lambda: design_multisine((1.01, 1.02), 8.0, RATE, UNIT, draw()),
        lambda: design_multisine((float("nan"), 2.0), 8.0, RATE, UNIT, draw()),
        lambda: design_multisine(*WHERE, UNIT, draw(), grid="even"),
        lambda: design_multisine(*WHERE, UNIT, draw(), phases="flat"),
        lambda: design_multisine(*WHERE, UNIT, draw(), inputs=0),
        lambda: design_multisine(*WHERE, UNIT, draw(), amplitude=lambda f: 0.0 * f),
        lambda: design_multisine(*WHERE, UNIT, draw(), amplitude=lambda f: f / 0.0 * 0.0 + np.nan),
        lambda: design_multisine(*WHERE, (UNIT, UNIT), draw(), inputs=3),
        lambda: design_sweep((60.0, 1.0), 8.0, RATE, UNIT),
        lambda: design_sweep(*WHERE, UNIT, law="square"),
        lambda: design_mls(1, RATE, UNIT, draw()),
        lambda: design_mls(5, RATE, UNIT, draw(), hold=0),
        lambda: design_mls(5, RATE, Limits(peak=1.0, slew=1.0), draw()),
        lambda: design_binary(*WHERE, Limits(slew=1.0), draw()),
        lambda: design_burst(*WHERE, UNIT, draw(), share=1.0),
        lambda: design_noise(*WHERE, UNIT, draw(), inputs=0),
    ],
)
def test_what_cannot_be_designed_is_refused(design):
    with np.errstate(all="ignore"), pytest.raises(ConfigError):
        design()
