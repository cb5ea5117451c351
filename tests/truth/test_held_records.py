"""A hold that is in the data counts once: loops on models of held records against exact discretisation.

The truth is made here: modes in companion form, held inputs and a delay by the matrix exponential, loops by
the eigenvalues of the sampled closed loop.
"""

from __future__ import annotations

import dataclasses
import json
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as sla
import scipy.signal as ss
from jaxtyping import Float

from cli_runner import middeck
from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.law.compensator import Compensator
from middeck.files.laws.compensators import write_compensator
from middeck.files.measured.models import load_model, write_model
from middeck.files.records import load_record, open_record, write_record
from middeck.identification.fit.fit_response import FitResult, fit_response
from middeck.identification.model.measurement_model import model_response, natural_hz
from middeck.identification.model.steady_simulation import folded_response, held_response, nrmse
from middeck.identification.plants.measured_plant import measured_plant
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.record_fit.simulate_record import record_nrmse
from middeck.identification.spectra.estimate import estimate_response
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.systems.sampling.zero_order_hold import hold_response, release_hold, release_inputs
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record
from repeats import repeats

PORTS = (Port("torque", "N m"),), (Port("angle", "rad"),)
NOISE = 1e-4
BAND_HZ = (0.4, 10.0)


@record(kw_only=True)
class Article:
    """x' = A x + B u(t - delay), y = C x, and its modes."""

    A: Float[np.ndarray, "state state"]
    B: Float[np.ndarray, "state one"]
    C: Float[np.ndarray, "one state"]
    natural_hz: Float[np.ndarray, " mode"]
    delay_s: float


def article(seed: int, delay_s: float) -> Article:
    rng = np.random.default_rng(seed)
    modes = int(rng.integers(1, 4))
    hz = np.sort(rng.uniform(1.5, 6.0, modes)) + 0.8 * np.arange(modes)
    omega, zeta = 2.0 * np.pi * hz, rng.uniform(0.01, 0.03, modes)
    A = sla.block_diag(*[[[0.0, 1.0], [-(w**2), -2.0 * z * w]] for w, z in zip(omega, zeta, strict=True)])
    B, C = np.zeros((2 * modes, 1)), np.zeros((1, 2 * modes))
    B[1::2, 0], C[0, ::2] = rng.uniform(0.4, 1.0, modes), rng.uniform(0.4, 1.0, modes)
    return Article(A=A, B=B, C=C, natural_hz=hz, delay_s=delay_s)


def as_sampled(of: Article, period_s: float) -> SampledStateSpace:
    """Exact: the command of d or d + 1 samples ago acts, the older one for the fraction of the delay."""
    n, d = len(of.A), int(np.floor(of.delay_s / period_s + 1e-12))
    fraction = of.delay_s - d * period_s

    def step(t: float) -> tuple[np.ndarray, np.ndarray]:
        E = sla.expm(np.block([[of.A * t, of.B * t], [np.zeros((1, n + 1))]]))
        return E[:n, :n], E[:n, n:]

    after, newer = step(period_s - fraction)
    A, B = np.zeros((n + d + 1, n + d + 1)), np.zeros((n + d + 1, 1))
    A[:n, :n] = step(period_s)[0]
    B[n] = 1.0
    A[range(n + 1, n + d + 1), range(n, n + d)] = 1.0
    for age, column in ((d, newer), (d + 1, after @ step(fraction)[1])):
        at = A[:n, n + age - 1 : n + age] if age else B[:n]
        at += column
    return SampledStateSpace(
        A, B, np.hstack([of.C, np.zeros((1, d + 1))]), np.zeros((1, 1)), period_s=period_s
    )


def response(of: SampledStateSpace, hz: np.ndarray) -> np.ndarray:
    z = np.exp(2j * np.pi * hz * of.period_s)
    return np.array([(of.C @ np.linalg.solve(p * np.eye(len(of.A)) - of.A, of.B))[0, 0] for p in z])


def multisine(of: SampledStateSpace, seed: int, *, held: bool | None = True) -> Record:
    """Three steady periods of 20 s."""
    rng, n = np.random.default_rng(seed), round(20.0 / of.period_s)
    hz = np.fft.rfftfreq(n, of.period_s)
    on = (hz > 0.3) & (hz < 10.2)
    U, Y = np.zeros((2, len(hz)), dtype=complex)
    U[on] = np.exp(2j * np.pi * rng.random(on.sum()))
    Y[on] = response(of, hz[on]) * U[on]
    u, y = (np.repeat(np.fft.irfft(X, n)[None], 3, axis=0) for x, X in (("u", U), ("y", Y)))
    y = y + NOISE * y.std() * rng.standard_normal(y.shape)
    return Record(
        sample_hz=1.0 / of.period_s,
        u=u[None, ..., None],
        y=y[None, ..., None],
        inputs=PORTS[0],
        outputs=PORTS[1],
        periodic=True,
        held=held,
    )


def noise_run(of: SampledStateSpace, seed: int) -> Record:
    """Half a minute of held noise in the lower half of the band, from rest."""
    rng, n = np.random.default_rng(seed), round(30.0 / of.period_s)
    u = np.convolve(rng.standard_normal(n + 8), np.hanning(9), "valid")
    x, y = np.zeros(len(of.A)), np.zeros(n)
    for k in range(n):
        y[k] = (of.C @ x)[0]
        x = of.A @ x + of.B[:, 0] * u[k]
    y = y + NOISE * y.std() * rng.standard_normal(n)
    return Record(
        sample_hz=1.0 / of.period_s,
        u=u[None, None, :, None],
        y=y[None, None, :, None],
        inputs=PORTS[0],
        outputs=PORTS[1],
        periodic=False,
        held=True,
    )


def fitted(taken: Record, of: Article) -> FitResult:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        measured = estimate_response(taken, band_hz=BAND_HZ)
    return fit_response(measured, states=2 * len(of.natural_hz))


def lead(gain: float, period_s: float) -> Compensator:
    """-gain times a lead, by Tustin's rule: it damps what lies below some 8 Hz, if delay lets it."""
    a, b, w = 2.0 * np.pi * 2.0, 2.0 * np.pi * 20.0, 2.0 / period_s
    pole, zero = (w - b) / (w + b), (w - a) / (w + a)
    k = -gain * (b / a) * (w + a) / (w + b)
    system = SampledStateSpace([[pole]], [[1.0]], [[k * (pole - zero)]], [[k]], period_s=period_s)
    return Compensator(system, PORTS[1], PORTS[0], method="lead")


def closed(plant: SampledStateSpace, law: Compensator, gain: float) -> float:
    """Spectral radius of the loop u = gain K y."""
    K = law.sampled
    A = np.block([[plant.A + gain * plant.B @ K.D @ plant.C, gain * plant.B @ K.C], [K.B @ plant.C, K.A]])
    return float(np.max(np.abs(np.linalg.eigvals(A))))


def upper_gain(plant: SampledStateSpace, law: Compensator) -> float:
    """The gain above one at which the loop becomes unstable, by bisection."""
    low, high = 1.0, 1.0
    while closed(plant, law, high) < 1.0:
        low, high = high, 1.2 * high
    for _ in range(50):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if closed(plant, law, middle) < 1.0 else (low, middle)
    return float(low)


def strength(plant: SampledStateSpace) -> float:
    """A third of the gain at which the loop goes; small enough to be stable."""
    unit = lead(1.0, plant.period_s)
    gain = 1e-3
    while closed(plant, unit, gain) < 1.0:
        gain *= 1.3
    return gain / 3.0


def test_margins_of_a_model_of_held_data_are_those_of_exact_discretisation(
    campaign: Callable[[int], range],
) -> None:
    for seed in campaign(40):
        rng = np.random.default_rng(seed)
        rate_hz = float(rng.choice([50.0, 60.0, 100.0, 250.0]))
        of = article(seed, float(rng.choice([0.0, 0.0005, 0.004, 0.011, rng.uniform(0.0, 0.03)])))
        fit = fitted(multisine(as_sampled(of, 1.0 / rate_hz), seed), of)
        assert fit.model.hold_s == 1.0 / rate_hz
        # Four deviations; a delay of zero is known only to be no lead.
        assert abs(fit.model.delay_s[0] - of.delay_s) < max(4.0 * fit.uncertainty.delay_s[0], 1e-6)
        for other in (rate_hz, 1.5 * rate_hz):  # judged at the rate of the data, and at another
            truth = as_sampled(of, 1.0 / other)
            law = lead(strength(truth), 1.0 / other)
            plant = measured_plant(fit.model, u=("torque",), y=("angle",))
            found = measure_margins(plant, law)
            assert found.stable
            (loop,) = found.loops
            above = min(g for g in loop.gain if g > 1.0)
            assert above == pytest.approx(upper_gain(truth, law), rel=5e-4)  # noise of 1e-4 in the data


def as_measured(taken: Record) -> Record:
    """With noise of a millionth on the inputs: no commands, which repeat to the last digits."""
    noise = np.random.default_rng(0).standard_normal(taken.u.shape)
    return dataclasses.replace(taken, u=taken.u + 1e-6 * np.std(taken.u) * noise)


def test_without_the_word_commands_are_held_and_measured_inputs_have_half_a_period_in_the_delay() -> None:
    of, period_s = article(1, 0.011), 0.01
    commands = multisine(as_sampled(of, period_s), 1, held=None)
    fit = fitted(commands, of)
    assert fit.model.hold_s == period_s
    assert fit.model.delay_s[0] == pytest.approx(0.011, abs=1e-5)
    late = pytest.approx(0.011 + 0.5 * period_s, abs=2e-4 * period_s * 100)
    for taken, hold_s in ((as_measured(commands), None), (dataclasses.replace(commands, held=False), 0.0)):
        fit = fitted(taken, of)
        assert fit.model.hold_s == hold_s
        assert fit.model.delay_s[0] == late


def test_samples_of_a_held_run_give_the_article_behind_the_hold(campaign: Callable[[int], range]) -> None:
    for seed in campaign(20):
        rate_hz = 60.0 + 20.0 * (seed % 5)
        of = article(seed, 0.011)
        taken = noise_run(as_sampled(of, 1.0 / rate_hz), seed)
        fit = fit_record(taken, states=2 * len(of.natural_hz), sampled=False, band_hz=(0.4, rate_hz / 8.0))
        assert fit.model.hold_s == 1.0 / rate_hz
        assert abs(fit.model.delay_s[0] - 0.011) < 4.0 * fit.uncertainty.delay_s[0]
        hz = np.abs(fit.model.poles) / (2.0 * np.pi)
        order = np.argsort(hz)
        assert np.all(np.abs(hz[order] - of.natural_hz) < 4.0 * fit.uncertainty.natural_hz[order])
        # Simulated with the hold that was taken out: what is left is the noise, twice that at most.
        assert record_nrmse(fit.model, taken)[0] < 2.0 * NOISE


def test_what_the_computer_sees_is_hold_and_fold() -> None:
    of = article(4, 0.013)
    exact = as_sampled(of, 0.02)
    fit = fitted(multisine(exact, 4), of)
    hz = np.linspace(0.5, 10.0, 40)
    seen = held_response(fit.model, hz, 50.0)
    truth = response(exact, hz)
    assert np.allclose(seen[:, 0, 0], truth, rtol=0.0, atol=5.0 * NOISE * np.abs(truth).max())
    parts = hold_response(hz, 0.02)[:, None, None] * model_response(fit.model, hz)
    assert np.allclose(
        seen, parts + folded_response(fit.model, hz, 50.0, np.full(len(fit.model.poles), True)), rtol=1e-12
    )
    assert nrmse(fit.model, multisine(exact, 9))[0] < 2.0 * NOISE


def test_a_released_record_has_the_released_response() -> None:
    taken = multisine(as_sampled(article(0, 0.004), 0.01), 3)
    measured = estimate_response(taken, band_hz=BAND_HZ)
    released, of_inputs = release_hold(measured), estimate_response(release_inputs(taken), band_hz=BAND_HZ)
    assert (measured.hold_s, released.hold_s, of_inputs.hold_s) == (0.01, 0.0, 0.0)
    assert np.allclose(released.H, of_inputs.H, rtol=1e-9)
    assert released.variance is not None
    assert of_inputs.variance is not None
    assert np.allclose(released.variance, of_inputs.variance, rtol=1e-6)
    assert release_hold(released) is released
    assert release_inputs(taken).held is False


@pytest.mark.parametrize("ending", ["npz", "h5", "mat", "uff"])
@pytest.mark.parametrize("held", [True, False, None])
def test_files_keep_the_word(ending: str, held: bool | None, tmp_path: Path) -> None:
    taken = Record(
        sample_hz=64.0,
        u=np.ones((1, 1, 8, 1)),
        y=np.arange(8.0).reshape(1, 1, 8, 1),
        inputs=PORTS[0],
        outputs=PORTS[1],
        periodic=False,
        held=held,
    )
    file = tmp_path / f"run.{ending}"
    write_record(file, taken)
    assert (load_record(file).held, open_record(file).held) == (held, held)


def test_qualify_has_the_hold_once_or_says_what_it_assumes(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    of, period_s = article(1, 0.011), 0.01
    truth = as_sampled(of, period_s)
    law = lead(strength(truth), period_s)
    law_file, record_file = tmp_path / "law.json", tmp_path / "run.npz"
    write_compensator(law_file, law)
    write_record(record_file, as_measured(multisine(truth, 1, held=None)))
    kind = [
        "--states",
        str(2 * len(of.natural_hz)),
        "--band",
        "0.4,10",
        "--continuous",
        "--constants",
        "real",
    ]
    gains: dict[str, float] = {}
    for word in ("", "--held"):
        file = tmp_path / f"model{word}.json"
        assert middeck(capfd, "identify", record_file, *kind, *([word] if word else []), "-o", file).code == 0
        shown = json.loads(middeck(capfd, "qualify", law_file, file, "--json").out)
        (row,) = shown["rows"]
        gains[word] = row["gain_db"]
        remarks = [w for w in shown["warnings"] if "does not state" in w]
        assert len(remarks) == (not word)
        if remarks:
            assumed = float(remarks[0].split("gain ")[1].split(" dB")[0])
    decibels = 20.0 * np.log10(upper_gain(truth, law))
    assert gains["--held"] == pytest.approx(decibels, abs=0.01)
    assert abs(gains[""] - decibels) > 0.1
    # Without the half period the model still lacks what the hold takes from its magnitude.
    assert assumed == pytest.approx(decibels, abs=0.1)


def test_the_file_of_a_model_keeps_its_hold(tmp_path: Path) -> None:
    of = article(0, 0.004)
    model = fitted(multisine(as_sampled(of, 0.01), 1), of).model
    for hold_s in (0.01, 0.0, None):
        marked = dataclasses.replace(model, hold_s=hold_s)
        write_model(tmp_path / "model.json", marked)
        assert load_model(tmp_path / "model.json") == marked


def test_poles_that_stand_for_what_is_folded_back_are_not_folded_themselves():
    """A band to 0.44 of the rate, weak force noise: a first fit takes what is folded back for poles beyond.

    Simulated mode by mode at eight times the rate, exact for held inputs.
    """
    rate, over, count, delay_s, rng = 50.0, 8, 1024, 0.03, np.random.default_rng(1)
    h = 1.0 / (rate * over)
    u = rng.standard_normal(count)
    forces = np.repeat(u, over), rng.standard_normal(count * over)
    y = np.zeros((2, count * over))
    for hz, zeta, gain in ((3.0, 0.01, 1.0), (9.0, 0.015, -2.0)):
        p = 2.0 * np.pi * hz * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
        motion = ss.lfilter([0.0, (np.exp(p * h) - 1.0) / p], [1.0, -np.exp(p * h)], np.array(forces) + 0j)
        y += gain * hz * motion.imag
    delay = round(delay_s / h)
    seen = np.concatenate([np.zeros(delay), y[0, :-delay]]) + 0.02 * y[0].std() / y[1].std() * y[1]
    record = Record(
        sample_hz=rate, u=u[None, None, :, None], y=seen[None, None, ::over, None], inputs=PORTS[0],
        outputs=PORTS[1], periodic=False, held=True,
    )  # fmt: skip
    fit = fit_record(record, sampled=False, band_hz=(0.5, 22.0))
    assert fit.standing == ("sound", "sound")
    order = np.argsort(natural_hz(fit.model))
    off = natural_hz(fit.model)[order] - [3.0, 9.0]
    assert np.all(np.abs(off) < 4.0 * fit.uncertainty.natural_hz[order])
    assert abs(fit.model.delay_s[0] - delay_s) < 4.0 * fit.uncertainty.delay_s[0] < 8e-5
    assert fit.warnings == ()


@pytest.mark.parametrize("seed", repeats([0, 3, 1]))
def test_a_mode_below_the_band_is_folded_back_as_those_within_are(seed: int) -> None:
    """Its tail goes on beyond half the rate: left out, a mode was many deviations off and none was sound."""
    rng, rate, count = np.random.default_rng([44, seed]), 100.0, 1000
    hz, zeta, gain = np.array([rng.uniform(0.5, 2.0), 27.0]), [0.05, 0.008], [8.0, -0.8]
    u = rng.standard_normal(count)
    y = np.zeros(count)
    for f, z, a in zip(hz, zeta, gain, strict=True):
        p = 2.0 * np.pi * f * (-z + 1j * np.sqrt(1.0 - z**2))
        step = np.exp(p / rate)
        y += a * ss.lfilter([0.0, (step - 1.0) / p], [1.0, -step], u + 0j).imag
    y += 1e-4 * y.std() * rng.standard_normal(count)
    record = Record(
        sample_hz=rate, u=u[None, None, :, None], y=y[None, None, :, None], inputs=PORTS[0],
        outputs=PORTS[1], periodic=False, held=True,
    )  # fmt: skip
    fit = fit_record(record, states=4, sampled=False, band_hz=(4.0, 40.0))
    within = int(np.argmax(natural_hz(fit.model)))
    assert fit.standing[within] == "sound"
    assert abs(natural_hz(fit.model)[within] - hz[1]) < 4.0 * fit.uncertainty.natural_hz[within]


@pytest.mark.parametrize("seed", repeats([2, 3, 1]))
def test_a_pole_near_half_the_rate_that_stands_for_what_is_folded_back_is_not_folded(seed: int) -> None:
    """White commands, lines up to half the rate: 5 of 9 records had two to five pairs more, and doubts."""
    rng, rate_hz, w, zeta = np.random.default_rng([261, seed]), 64.0, 2.0 * np.pi * 19.2, 0.012
    p = w * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    u = rng.standard_normal(320)
    y = (
        w
        / p.imag
        * ss.lfilter([0.0, np.expm1(p / rate_hz) / p * w], [1.0, -np.exp(p / rate_hz)], u + 0j).imag
    )
    y += 0.005 * y.std() * rng.standard_normal(len(y))
    u, y = u[None, None, :, None], y[None, None, :, None]
    given = Record(sample_hz=rate_hz, u=u, y=y, inputs=PORTS[0], outputs=PORTS[1], periodic=False, held=True)
    fit = fit_record(given, sampled=False)
    assert fit.warnings == ()
    assert abs(natural_hz(fit.model)[0] - 19.2) < 4.5 * fit.uncertainty.natural_hz[0]
    assert fit.model.states == 2
