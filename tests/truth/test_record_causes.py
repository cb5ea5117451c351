"""Samples lost or repeated, runs joined, feedback and long delays are named, with place and size."""

from __future__ import annotations

import dataclasses
import re
import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import butter, freqs, lfilter
from struck_plant import response, shaken
from test_closed_loop_records import cut

from middeck.identification.faults.detect import detect_faults
from middeck.identification.faults.lost_samples_and_feedback import find_relation_faults
from middeck.identification.model.measurement_model import natural_hz
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.spectra.estimate import estimate_response
from middeck.identification.uncertainty.parameter_deviations import parameters_of
from middeck.signals.fault import RecordFault
from middeck.signals.ports import Port
from middeck.signals.record import Record

Campaign = Callable[..., range]
Spoil = Callable[[np.ndarray, np.ndarray, int, int], tuple[np.ndarray, np.ndarray]]
EXTRA = 600


def of(u: np.ndarray, y: np.ndarray) -> list[RecordFault]:
    inputs, outputs = (
        tuple(Port(f"{letter}{k}", "V") for k in range(x.shape[1])) for letter, x in (("u", u), ("y", y))
    )
    return [
        *detect_faults(
            Record(
                sample_hz=100.0,
                u=u[None, None],
                y=y[None, None],
                inputs=inputs,
                outputs=outputs,
                periodic=False,
            )
        )
    ]


def a_run(seed: int) -> tuple[np.ndarray, np.ndarray, np.random.Generator, int]:
    """Light modes z = exp(p) under noise of several colours, or a binary sequence; more than is kept."""
    rng = np.random.default_rng(seed)
    n, inputs, outputs = int(rng.choice([2048, 4096])), int(rng.integers(1, 3)), int(rng.integers(1, 4))
    u = rng.standard_normal((n + EXTRA, inputs))
    colour = rng.integers(4)
    u = lfilter(*butter(3, 0.5), u, axis=0) if colour == 1 else u
    u = lfilter(*butter(2, 0.2), u, axis=0) if colour == 2 else u
    u = np.repeat(np.sign(u[: len(u) // 3]), 3, axis=0) if colour == 3 else u
    y = np.zeros((len(u), outputs))
    for _ in range(int(rng.integers(1, 5))):
        omega, zeta = 2.0 * np.pi * rng.uniform(0.02, 0.35), np.exp(rng.uniform(np.log(0.003), np.log(0.03)))
        motion = lfilter([0.0, 1.0], [1.0, -np.exp(omega * (1j - zeta))], u @ rng.standard_normal(inputs))
        shape = rng.standard_normal(outputs) + 1j * rng.standard_normal(outputs)
        y += np.real(motion[:, None] * shape) * omega
    y += rng.choice([1e-3, 1e-2, 5e-2]) * y.std(axis=0) * rng.standard_normal(y.shape)
    return u[400:], y[400:], rng, n


def without(x: np.ndarray, k: int, m: int) -> np.ndarray:
    return np.concatenate([x[:k], x[k + m :]])


def twice(x: np.ndarray, k: int, m: int) -> np.ndarray:
    return np.concatenate([x[:k], x[k - m :]])


def one_output(change: Callable[[np.ndarray, int, int], np.ndarray]) -> Spoil:
    def spoil(u: np.ndarray, y: np.ndarray, k: int, m: int) -> tuple[np.ndarray, np.ndarray]:
        first = change(y[:, :1], k, m)
        count = min(len(first), len(y))
        return u[:count], np.hstack([first[:count], y[:count, 1:]])

    return spoil


def the_inputs(u: np.ndarray, y: np.ndarray, k: int, m: int) -> tuple[np.ndarray, np.ndarray]:
    u = without(u, k, m)
    return u, y[: len(u)]


def test_a_response_estimated_across_lost_samples_says_so() -> None:
    """Three samples lost halfway move the delay of the whole by some 15 ms; no scatter shows that."""
    whole = shaken(
        (np.array([6.0, 17.0]), np.array([0.02, 0.01]), [300.0, -800.0], 0.011),
        4096,
        100.0,
        (1, 40),
        noise=0.01,
    )
    u, y = whole.u[:, :, :-3], np.delete(whole.y, slice(2000, 2003), axis=2)
    with pytest.warns(UserWarning, match="3 samples earlier .* samples were lost"):
        estimate_response(dataclasses.replace(whole, u=u, y=y))
    estimate_response(whole)


@pytest.mark.parametrize("seed", [9, 12, 15])
def test_a_response_estimated_across_a_dropout_names_no_joint(seed: int) -> None:
    """What is wrong in one output alone is no relation of two; any other warning fails as well."""
    u, y, _, n = a_run(seed)
    u, y = u[:n], y[:n].copy()
    y[1000:1020, 0] = 0.0
    ports = [
        tuple(Port(f"{letter}{k}", "V") for k in range(x.shape[1])) for letter, x in (("u", u), ("y", y))
    ]
    record = Record(
        sample_hz=100.0, u=u[None, None], y=y[None, None], inputs=ports[0], outputs=ports[1], periodic=False
    )
    estimate_response(record)


@pytest.mark.parametrize(
    ("spoil", "sign", "channels"),
    [(one_output(without), -1, "one"), (one_output(twice), 1, "one"), (the_inputs, 1, "all")],
    ids=["lost in an output", "repeated in an output", "lost in the inputs"],
)
def test_lost_and_repeated_samples_are_placed(
    spoil: Spoil, sign: int, channels: str, campaign: Campaign
) -> None:
    missed, wrong = [], []
    for seed in campaign(60):
        u, y, rng, n = a_run(seed)
        k, m = int(rng.integers(n // 5, 4 * n // 5)), int(rng.integers(2, 30))
        u, y = spoil(u, y, k, m)
        found = [f for f in of(u[:n], y[:n]) if f.kind == "shift"]
        missed += [] if found else [seed]
        for f in found:
            right = f"answers {m} samples {'earlier' if sign < 0 else 'later'}" in f.what
            wrong += [] if right and abs(f.samples[0][0] - k) < 60 else [seed]
            assert "cut the record there" in f.hint
        if channels == "one":
            assert {f.channel for f in found} <= {"y0"}
    # One mode alone is much like itself after a cycle or a few.
    assert len({*missed, *wrong}) <= len(campaign(60)) // 20, (missed, wrong)


def test_runs_that_were_joined_are_placed(campaign: Campaign) -> None:
    missed = []
    for seed in campaign(60):
        u, y, rng, n = a_run(seed)
        k, m = int(rng.integers(n // 6, 5 * n // 6)), int(rng.integers(3, 30))
        found = of(without(u, k, m)[:n], without(y, k, m)[:n])
        places = [f.samples[0][0] for f in found if f.kind == "joint"]
        assert all(-1 <= place - k <= 12 for place in places), seed
        missed += [] if places else [seed]
    # What comes after may happen to go on nearly as it was.
    assert len(missed) <= len(campaign(60)) // 5, missed


def test_a_long_delay_is_measured(campaign: Campaign) -> None:
    for seed in campaign(60):
        u, y, rng, n = a_run(seed)
        delays = int(rng.integers(100, 190))
        found = [
            f
            for f in of(
                u[:n],
                np.concatenate([rng.standard_normal((delays, y.shape[1])) * 1e-3 * y.std(axis=0), y])[:n],
            )
            if f.kind == "delay"
        ]
        assert {f.channel for f in found} == {f"y{k}" for k in range(y.shape[1])}, seed
        # Light modes in colour rise over some samples before they are heard.
        assert all(abs(int(f.what.split()[1]) - delays) <= 12 for f in found), seed


@pytest.mark.parametrize("noise", [0.05, 0.3, 1.0])
def test_feedback_is_named_and_the_reference_is_free_of_it(noise: float, campaign: Campaign) -> None:
    for seed in campaign(20):
        r, u, y = (x[0, 0] for x in cut(seed, noise=noise))
        assert "feedback" in {f.kind for f in of(u, y)}
        assert of(r, y) == []


def test_nothing_of_it_is_found_in_sound_runs(campaign: Campaign) -> None:
    seeds = campaign(200)
    runs = (a_run(1000 + seed) for seed in seeds)
    alarms = [str(f) for u, y, _, n in runs for f in of(u[:n], y[:n])]
    assert len(alarms) <= len(seeds) // 100, alarms


def filtered(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Noise, a burst or steps, and the answers of modes, behind a filter that ends near half the rate."""
    rng, n, rate = np.random.default_rng([53, seed]), 4096, 200.0
    u = rng.standard_normal(n) if seed % 3 else np.repeat(rng.standard_normal(n // 64), 64)
    u[n // 3 :] *= float(seed % 3 < 2)
    f = np.fft.rfftfreq(8 * n, 1.0 / rate)
    edge = rng.choice([0.39, 0.45, 0.499])
    U = np.fft.rfft(u, 8 * n) * np.cos(0.5 * np.pi * np.clip((f / rate - edge) / (0.5 - edge), 0.0, 1.0)) ** 2
    hz, zeta = rng.uniform(4.0, 60.0, 3), rng.uniform(0.004, 0.02, 3)
    H = response(hz, zeta, rng.uniform(0.4, 1.0, 3) * hz**2, rng.uniform(0.0, 0.01), 2j * np.pi * f)
    u, y = (np.fft.irfft(x, 8 * n)[:n] for x in (U, H * U))
    return u[:, None], (y + 10.0 ** rng.uniform(-2.9, -1.5) * y.std() * rng.standard_normal(n))[:, None]


def test_the_tail_of_a_filter_before_an_answer_is_no_feedback(campaign: Campaign) -> None:
    assert [f for seed in campaign(120) for f in of(*filtered(seed))] == []


def sines(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Sums of 30 to 120 sines that repeat never within the record, and the answers of light modes."""
    rng = np.random.default_rng([62, seed])
    n, inputs, count = int(rng.choice([2048, 4096])), int(rng.integers(1, 3)), int(rng.integers(30, 120))
    t = np.arange(n + EXTRA)[:, None, None]
    turns = rng.uniform(0.002, rng.uniform(0.2, 0.48), (inputs, count))
    u = np.cos(2.0 * np.pi * (t * turns + rng.uniform(0.0, 1.0, (inputs, count)))).sum(axis=2)
    y = np.zeros(len(u))
    for _ in range(int(rng.integers(2, 6))):
        omega, zeta = 2.0 * np.pi * rng.uniform(0.01, 0.3), 10.0 ** rng.uniform(-3.0, -1.5)
        motion = lfilter([0.0, 1.0], [1.0, -np.exp(omega * (1j - zeta))], u @ rng.standard_normal(inputs))
        y += omega * motion.imag
    y += 10.0 ** rng.uniform(-4.0, -1.0) * y.std() * rng.standard_normal(len(y))
    return u[EXTRA:], y[EXTRA:, None]


def test_sines_that_never_repeat_are_not_told_to_be_fed_back(campaign: Campaign) -> None:
    """Their past foretells them, and later ones tell what far earlier ones were: of 60 five were accused."""
    assert [seed for seed in campaign(300) for f in of(*sines(seed)) if f.kind == "feedback"] == []


def test_noise_of_a_measured_input_is_named(campaign: Campaign) -> None:
    """A band-limited force, measured with 0.3 of its rms: later samples tell what earlier ones were."""
    plant = np.array([6.0, 17.0]), np.array([0.02, 0.01]), [300.0, -800.0], 0.011
    reported: list[bool] = []
    for seed in campaign(12):
        clean = shaken(plant, 3000, 100.0, (1.0, 40.0), noise=1e-3, seed=seed)
        noise = np.random.default_rng([seed, 2]).standard_normal(clean.u.shape)
        assert not detect_faults(clean)
        noisy = dataclasses.replace(clean, u=clean.u + 0.3 * clean.u.std() * noise)
        reported.append(any("or with noise" in fault.what for fault in detect_faults(noisy)))
    assert np.mean(reported) >= 0.75


def test_a_gain_that_changes_within_a_record_is_reported(campaign: Campaign) -> None:
    """By a fiftieth to a tenth, from some sample on: constants were off by 40 deviations with no word."""
    for seed in campaign(24):
        rng = np.random.default_rng([54, seed])
        hz = np.cumsum(rng.uniform(4.0, 9.0, 3))
        plant = hz, rng.uniform(0.005, 0.03, 3), rng.choice([-8.0, 8.0], 3) * hz**2, rng.uniform(0.0, 0.02)
        record = shaken(plant, 3000, 100.0, (0.5, 40.0), noise=1e-3, seed=seed)
        y = record.y.copy()
        y[:, :, int(rng.integers(900, 2100)) :] *= 1.0 + rng.uniform(0.02, 0.1)
        clean, changed = (fit_record(x, states=6) for x in (record, dataclasses.replace(record, y=y)))
        assert not any("standard deviations are too small" in line for line in clean.warnings)
        assert any("standard deviations are too small" in line for line in changed.warnings)
        assert "sound" not in changed.standing


def through(
    order: int, seed: int, count: int = 3000, apart: tuple[float, float] = (4.0, 8.0)
) -> tuple[Record, np.ndarray]:
    """A random force behind a Butterworth filter at 0.4 of the rate and the article, sampled; its modes."""
    rng, finer = np.random.default_rng([55, seed]), 16
    hz = np.cumsum(rng.uniform(*apart, 2))
    size = 2 * count * finer
    f = np.fft.rfftfreq(size, 1.0 / (100.0 * finer))
    H = response(hz, [0.02, 0.01], 8.0 * hz**2, 0.01, 2j * np.pi * f)
    U = (
        np.fft.rfft(rng.standard_normal(size))
        * freqs(*butter(order, 80.0 * np.pi, analog=True), 2.0 * np.pi * f)[1]
    )
    u, y = (np.fft.irfft(x, size)[: count * finer : finer] for x in (U, H * U))
    y = y + 1e-3 * y.std() * rng.standard_normal(count)
    u, y = (x[None, None, :, None] for x in (u, y))
    ports = (Port("force", "N"),), (Port("tip", "m"),)
    return Record(sample_hz=100.0, u=u, y=y, inputs=ports[0], outputs=ports[1], periodic=False), hz


def test_a_force_whose_filter_is_not_steep_is_reported_to_fold_back(campaign: Campaign) -> None:
    """Of order two 8 to 18 deviations of the constants; of order eight none, and no word."""
    for seed in campaign(24):
        for order, reported in ((2, True), (8, False)):
            fit = fit_record(through(order, seed)[0], states=4, sampled=False, band_hz=(1.0, 40.0))
            assert any("folded back" in line for line in fit.warnings) == reported


def test_deviations_count_what_a_filter_folds_back(campaign: Campaign) -> None:
    """Of order four a hundredth of the force's power at 22 Hz, which few per cent of the output show."""
    for seed in campaign(24):
        record, hz = through(4, seed, 12_000, (9.0, 13.0))
        fit = fit_record(record, states=4, sampled=False, band_hz=(1.0, 40.0))
        assert any("folded back" in line for line in fit.warnings)
        known, order = parameters_of(fit.covariance), np.argsort(natural_hz(fit.model))
        places = [known.names.index(f"constant[{m}, tip, force]") for m in order]
        off = (known.values[places] - 8.0 * hz**2) / known.deviation[places]
        assert np.abs(off).max() < 4.0


def test_feedback_in_a_long_record_is_reported_without_much_memory() -> None:
    """The longer past was tested with all samples: 440 MB for 60 000 of them."""
    rng, count, pole = np.random.default_rng(70), 60_000, np.exp(0.7 * (1j - 0.02))
    den, gain = np.array([1.0, -2.0 * pole.real, abs(pole) ** 2, 0.0, 0.0, 0.0]), 0.02
    reference = lfilter(*butter(4, 0.3), rng.standard_normal(count))
    closed = den + 0.2 * gain * np.eye(6)[5]
    y = lfilter([0.0, gain], closed, reference) + lfilter(den, closed, 0.02 * rng.standard_normal(count))
    u = reference - 0.2 * np.concatenate([np.zeros(4), y[:-4]])
    record = Record(
        sample_hz=1.0, u=u[None, None, :, None], y=y[None, None, :, None],
        inputs=(Port("u", "N"),), outputs=(Port("y", "m"),), periodic=False,
    )  # fmt: skip
    tracemalloc.start()
    reported = find_relation_faults(record)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert any("sends its noise back into the inputs" in str(fault) for fault in reported)
    assert most < 220e6


@pytest.mark.parametrize("wander", [1.0, 0.0])
def test_a_sensor_that_drifts_at_random_is_named_and_harms_no_mode(wander: float) -> None:
    """A random walk as large as the signal was told as correlation with the inputs, and doubted the mode."""
    rng = np.random.default_rng(901)
    pole = np.exp(2.0 * np.pi * 0.12 * complex(-0.01, np.sqrt(1.0 - 0.01**2)))
    u, noise, walk = rng.standard_normal((3, 1200))
    y = lfilter([0.0, 1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], u)
    walk = np.cumsum(walk)
    y += y.std() * (0.01 * noise + wander * (walk - walk.mean()) / walk.std())
    record = Record(
        sample_hz=100.0,
        u=u[None, None, :, None],
        y=y[None, None, :, None],
        inputs=(Port("force", "N"),),
        outputs=(Port("tip", "m"),),
        periodic=False,
        held=True,
    )
    fit = fit_record(record, states=2, sampled=True)
    assert fit.standing == ("sound",)
    assert abs(natural_hz(fit.model)[0] - 12.0) < 4.0 * fit.uncertainty.natural_hz[0]
    assert any("drifts at random" in warning for warning in fit.warnings) == (wander > 0.0)
    assert not any("correlated with the inputs" in warning for warning in fit.warnings)


@pytest.mark.parametrize(
    ("fault", "message"), [("spikes", "spikes? up to"), ("dropout", "stuck for 120 samples")]
)
def test_a_fit_of_which_much_is_left_names_spikes_and_dropouts(fault: str, message: str) -> None:
    """As noise in all lines they were "noise and what the model lacks are 76 % of the output" alone."""
    plant = (np.array([6.0]), np.array([0.02]), [300.0], 0.011)
    record = shaken(plant, 1024, 100.0, (1, 40), noise=0.003)
    y = record.y.copy()
    if fault == "spikes":
        y[0, 0, [200, 611], 0] += 30.0 * y.std()
    else:
        y[0, 0, 400:520, 0] = y[0, 0, 400, 0]
    fit = fit_record(dataclasses.replace(record, y=y), states=2, sampled=False)
    assert any(re.search(message, text) for text in fit.warnings)
    assert fit_record(record, states=2, sampled=False).warnings == ()


def test_samples_lost_by_a_clipped_output_are_named() -> None:
    """The limit alone was named, and the worse fault, three lost samples, was not."""
    record = shaken((np.array([6.0]), np.array([0.02]), [300.0], 0.0), 2010, 100.0, (1, 40), noise=0.003)
    limit = 1.8 * record.y.std()
    for lost, kinds in ((3, {"clipping", "shift"}), (0, {"clipping"})):
        y = np.delete(np.clip(record.y[0, 0], -limit, limit), slice(900, 900 + lost), axis=0)
        assert {f.kind for f in of(record.u[0, 0, :2000], y[:2000])} == kinds
