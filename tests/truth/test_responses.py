"""Responses in a refinement: slopes, anti-resonances, delay and gain of a truth that the model is not."""

import dataclasses
import functools

import numpy as np
import pytest
import updating_case as case

import middeck as md
from middeck.errors import ConfigError
from middeck.identification.fit.fit_response import fit_response
from middeck.laboratory.hidden_errors import draw_hidden_errors
from middeck.signals.ports import Port
from middeck.structure.correlation.measured_modes import MeasurementNoise, measure_modes
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import estimate_damping
from middeck.systems.plants.plant import Plant, delay_plant, subsystem
from middeck.systems.plants.response import FrequencyResponse, evaluate_plant
from middeck.systems.poles.transmission_zeros import transmission_zeros
from middeck.updating.orbit.predicted_frequencies import predict_modes
from middeck.updating.refinement.bayesian_estimate import NORMAL_95
from middeck.updating.refinement.findings import findings
from middeck.updating.refinement.refine import refine
from middeck.updating.residuals.measured_response import AntiResonance, MeasuredResponse, measured_paths
from middeck.updating.residuals.modal_transfer import transfer_of, transfer_slopes
from middeck.updating.residuals.responses import Poles, compare_response, with_poles
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown, bind, change
from repeats import repeats

IN, OUT = ("pri_rel_z", "bus_z"), ("pri_in_z", "pri_rel_z", "bus_z_rate")
HZ = np.geomspace(0.6, 30.0, 400)
COUNT = 24
PARTS = [
    Unknown(name="E", parameters=("members.E",), spread=0.09),
    Unknown(name="n1", parameters=("node.n1.mass",), spread=0.03),
    Unknown(name="cg", parameters=("joint.pri_z.cg.*",), spread=0.06),
    Unknown(name="spin", parameters=("joint.pri_z.inertia.zz",), spread=0.06),
    Unknown(name="cable", parameters=("environment.cable_length",), spread=0.03),
]
DELAY = Unknown(name="delay", parameters=("loop.delay_s",), spread=1e-3, added=True)
GAIN = Unknown(name="gain", parameters=("loop.sensor_gain.pri_in_z",), spread=0.02)
MOTOR = Unknown(name="motor", parameters=("loop.motor_gain.bus_z",), spread=0.02)


def modes_at(x: np.ndarray) -> Modes:
    article, lab = case.sheet()
    return md.solve_modes(md.solve_equilibrium(*change(article, lab, bind(PARTS, article, lab), x)))


@pytest.fixture(scope="module")
def sheet() -> Modes:
    return modes_at(np.zeros(len(PARTS)))


def poles(modes: Modes, held: tuple[int, ...], std: float = 1e-4) -> Poles:
    """Of modes with all that a test says of them, a little beside the model's."""
    zeta = estimate_damping(modes, count=COUNT).zeta
    beside = np.ones(COUNT)
    beside[list(held)] = 1.01
    return Poles(
        held=held,
        omega=beside * modes.omega[:COUNT],
        zeta=zeta,
        omega_std=np.full(COUNT, std),
        zeta_std=np.full(COUNT, 0.05),
    )


def test_slopes_of_responses_are_differences(sheet: Modes):
    """Of three unknowns, poles of measured modes held and those of others free; angles and rates."""
    article, lab = case.sheet()
    held = (6, 8, 9, 10)
    at = poles(sheet, held)
    found = transfer_slopes(sheet, bind(PARTS, article, lab), IN, OUT, held, COUNT)
    s, step = 2j * np.pi * HZ, 3e-4

    @functools.cache
    def modes_along(k: int, h: float) -> Modes:
        return modes_at(h * step * (np.arange(len(PARTS)) == k))

    def response(k: int, h: float, o: int, i: int) -> np.ndarray:
        modes = modes_along(k, h)
        there = poles(modes, held)
        omega, zeta = there.omega.copy(), there.zeta.copy()
        omega[list(held)], zeta[list(held)] = at.omega[list(held)], at.zeta[list(held)]
        moved = dataclasses.replace(there, omega=omega, zeta=zeta)
        return with_poles(transfer_of(modes, IN, OUT, COUNT), moved).parts(s, o, i).sum(axis=1)

    model = with_poles(transfer_of(sheet, IN, OUT, COUNT), at)
    for k in (0, 2, 4):
        for o, i in ((0, 0), (2, 1)):
            wide, narrow = (
                (response(k, h, o, i) - response(k, -h, o, i)) / (2.0 * h * step) for h in (1.0, 0.5)
            )
            slopes = found.of(model, s, (o, i))[:, k]
            # Without the square of the step; rest states leave 1e-9 of a response, over this step.
            off = np.abs(slopes - (4.0 * narrow - wide) / 3.0).max()
            assert off < 3e-5 * np.abs(slopes).max()


def test_anti_resonances_are_zeros_of_the_state_space(sheet: Modes):
    """Their residual, and their slopes, by zeros of the model and of models beside it."""
    article, lab = case.sheet()
    plain = Poles(
        held=(),
        omega=sheet.omega[:COUNT],
        zeta=estimate_damping(sheet, count=COUNT).zeta,
        omega_std=np.full(COUNT, 1e-9),
        zeta_std=np.full(COUNT, 1e-9),
    )
    own, near = zeros_of(sheet)
    measured = AntiResonance(
        output=OUT[0], input=IN[0], frequency_hz=own[near] * 1.002, std_hz=1.002e-3 * own[near]
    )
    test = MeasuredResponse(anti_resonances=(measured,), modal_error=0.0, line_error=1e-9)
    known = np.zeros(len(PARTS)), np.zeros((len(PARTS), 0))
    found = compare_response("lab", test, sheet, plain, bind(PARTS, article, lab), *known)
    row = found.slope[0] / found.residual[0] * np.log(1.002)
    assert abs(found.residual[0]) == pytest.approx(np.log(1.002) / 1e-3, rel=1e-3)
    step = 1e-4
    for k in (0, 3):
        up, down = (zeros_of(modes_at(sign * step * (np.arange(len(PARTS)) == k)))[0] for sign in (1.0, -1.0))
        difference = np.log(up[near] / down[near]) / (2.0 * step)
        assert row[k] == pytest.approx(difference, rel=1e-4, abs=1e-6)


def zeros_of(modes: Modes) -> tuple[np.ndarray, int]:
    """Frequencies [Hz] of oscillating zeros of the first path, and that below 10 Hz farthest from poles."""
    plant = md.build_plant(modes, inputs=IN[:1], outputs=OUT[:1], count=COUNT)
    found = transmission_zeros(subsystem(plant, IN[:1], OUT[:1]))
    hz = np.sort(np.abs(found[found.imag > 1e-3])) / (2.0 * np.pi)
    apart = np.abs(np.log(hz[:, None] / modes.frequency_hz)).min(axis=1)
    return hz, int(np.argmax(np.where(hz < 10.0, apart, 0.0)))


def noisy(plant: Plant, noise: float, rng: np.random.Generator) -> FrequencyResponse:
    clean = evaluate_plant(plant, HZ)
    std = noise * np.abs(clean.H)
    error = std / np.sqrt(2.0) * (rng.standard_normal(std.shape) + 1j * rng.standard_normal(std.shape))
    return dataclasses.replace(clean, H=clean.H + error, variance=std**2, hold_s=0.0)


@functools.cache
def truth(seed: int) -> tuple[Survey, dict[str, float]]:
    """Modes and responses of the frozen truth on the ground, its delay, and gains of one sensor and motor."""
    _, lab = case.sheet()
    modes, rng = case.true_modes(seed, lab), np.random.default_rng([seed, 5])
    article, _ = case.sheet()
    hidden = draw_hidden_errors(article, seed)
    survey = case.survey(seed, 0, case.STRAIGHT, range(18))
    plant = md.build_plant(modes, inputs=IN, outputs=OUT[:2], count=60)
    zeta = case.true_damping(seed, modes, 60)[:60]
    assert plant.modal is not None
    plant = dataclasses.replace(plant, dynamics=dataclasses.replace(plant.modal, zeta=zeta))
    delay, gain = float(hidden.delay_s), float(np.log(dict(hidden.gain)["pri_in_z"]))
    measured = noisy(delay_plant(plant, 0.010 + delay), 0.003, rng)
    motor = 0.02 * float(rng.standard_normal())
    H = measured.H.copy()
    H[:, 0] *= np.exp(gain)
    H[:, :, 1] *= np.exp(motor)
    response = MeasuredResponse(
        response=dataclasses.replace(measured, H=H), delay_s=0.010, band_hz=(0.7, 12.0)
    )
    return dataclasses.replace(survey, response=response), {"delay": delay, "gain": gain, "motor": motor}


@pytest.mark.parametrize("seed", repeats(range(20)))
def test_delay_and_gains_of_a_truth_with_another_mesh_are_seen(seed: int):
    """Within three deviations, which are a tenth and 0.6 of those before; modes alone see none of them."""
    article, _ = case.sheet()
    survey, true = truth(seed)
    found = refine(article, [survey], [*case.sheet_unknowns(article), DELAY, GAIN, MOTOR])
    assert found.converged
    named = {u.name: k for k, u in enumerate(found.unknowns)}
    for name, narrower in (("delay", 0.1), ("gain", 0.6), ("motor", 0.6)):
        k = named[name]
        std = found.estimate.x_std[k]
        assert std < narrower * found.unknowns[k].spread
        assert abs(found.x[k] - true[name]) < 3.0 * std
    assert "delay" in {u.name for u in found.left_out}
    assert not any("loop" in name for name in found.factors)
    with pytest.raises(ConfigError, match=r"has a parameter loop\.delay_s"):
        refine(article, [dataclasses.replace(survey, response=None)], [*PARTS, DELAY])


@pytest.mark.parametrize(("delay", "gain"), repeats([(1e-2, 0.5), (1e-3, 0.5), (1e-2, 0.02)]))
def test_a_wide_prior_of_gain_and_delay_makes_no_line_deaf(delay: float, gain: float):
    """They are linear in ln H: however little was known of them before, the same is known afterwards."""
    article, _ = case.sheet()
    survey, _ = truth(0)
    narrow, wide = (
        refine(
            article,
            [survey],
            [*PARTS, dataclasses.replace(DELAY, spread=d), dataclasses.replace(GAIN, spread=g), MOTOR],
        )
        for d, g in ((DELAY.spread, GAIN.spread), (delay, gain))
    )
    k = [u.name for u in wide.unknowns].index("delay")
    assert wide.estimate.x_std[k] < 1.2 * narrow.estimate.x_std[k]
    assert abs(wide.x[k] - narrow.x[k]) < 0.3 * narrow.estimate.x_std[k]


def test_an_error_that_was_not_stated_is_reported_and_counted():
    """A sensor that reads a fifth more above 5 Hz: no unknown of the model does that."""
    article, lab = case.sheet()
    modes = modes_at(np.zeros(len(PARTS)))
    plant = md.build_plant(modes, inputs=IN[:1], outputs=OUT[:1], count=60)
    recorded = noisy(plant, 0.003, np.random.default_rng(4))
    wrong = dataclasses.replace(recorded, H=recorded.H * np.where(HZ > 5.0, 1.2, 1.0)[:, None, None])
    seen = measure_modes(
        modes, chosen=range(16), noise=MeasurementNoise(1e-4, 0.02), rng=np.random.default_rng(5)
    )
    ends = []
    for response in (recorded, wrong):
        test = MeasuredResponse(response=response, band_hz=(0.7, 12.0), modal_error=0.002)
        survey = Survey(name="lab", measured=seen, environment=lab, response=test)
        ends.append(refine(article, [survey], [*PARTS, DELAY]))
    sound, off = ends
    assert not any("the response is off" in warning for warning in findings(sound))
    assert any("the response is off" in warning for warning in findings(off))
    assert off.estimate.x_std[-1] > 2.0 * sound.estimate.x_std[-1]


def test_a_fitted_response_errs_as_its_fit_does():
    """The same unknowns from a fit as from its lines, and the delay less surely: lines of a fit err alike."""
    article, lab = case.sheet()
    x = np.array([0.02, 0.0, 0.01, -0.02, 0.0])
    modes = modes_at(x)
    plant = md.build_plant(modes, inputs=IN[:1], outputs=OUT[:2], count=60)
    whole = noisy(delay_plant(plant, 0.0107), 0.003, np.random.default_rng(4))
    kept = (HZ > 0.7) & (HZ < 25.0)
    recorded = dataclasses.replace(
        whole, frequency_hz=HZ[kept], H=whole.H[kept], variance=np.asarray(whole.variance)[kept]
    )
    seen = measure_modes(
        modes, chosen=range(16), noise=MeasurementNoise(1e-4, 0.02), rng=np.random.default_rng(5)
    )
    found = []
    for response in (recorded, fit_response(recorded, states=24).covariance):
        test = MeasuredResponse(response=response, band_hz=(0.7, 12.0), delay_s=0.010)
        survey = Survey(name="lab", measured=seen, environment=lab, response=test)
        found.append(refine(article, [survey], [*PARTS, DELAY]))
        std = found[-1].estimate.x_std
        assert np.all(np.abs(found[-1].x - [*x, 0.0007]) < 3.0 * std)
        assert found[-1].responses[0].miss < 1.0
    by_lines, by_fit = (f.estimate.x_std for f in found)
    np.testing.assert_allclose(by_fit[:-1], by_lines[:-1], rtol=0.05)
    assert 2.0 * by_lines[-1] < by_fit[-1] < 5e-5


@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"response": None}, "nothing measured"),
        ({"band_hz": (5.0, 1.0)}, "low < high"),
        ({"line_error": 0.0}, "above zero"),
        ({"modal_error": -1.0}, "positive"),
        (
            {"anti_resonances": (AntiResonance(output=OUT[0], input=IN[0], frequency_hz=3.0, std_hz=0.1),)},
            "its anti-resonances again",
        ),
    ],
)
def test_a_response_that_cannot_be_is_refused(sheet: Modes, changed: dict[str, object], what: str):
    plant = md.build_plant(sheet, inputs=IN[:1], outputs=OUT[:1], count=COUNT)
    test = MeasuredResponse(response=noisy(plant, 0.01, np.random.default_rng(0)))
    with pytest.raises(ConfigError, match=what):
        dataclasses.replace(test, **changed)
    with pytest.raises(ConfigError, match="how well it is known"):
        MeasuredResponse(response=evaluate_plant(plant, HZ))


@pytest.mark.parametrize(
    ("parameters", "added", "what"),
    [
        (("loop.delay_s",), False, "is added to"),
        (("loop.sensor_gain.pri_in_z",), True, "is a factor"),
        (("loop.gain",), False, "a loop has no"),
        (("loop.delay_s", "members.E"), True, "together"),
    ],
)
def test_an_unknown_of_a_loop_that_cannot_be_is_refused(parameters: tuple[str, ...], added: bool, what: str):
    with pytest.raises(ConfigError, match=what):
        Unknown(name="x", parameters=parameters, spread=0.1, added=added)


def test_a_port_that_the_article_lacks_is_refused(sheet: Modes):
    article, lab = case.sheet()
    plant = md.build_plant(sheet, inputs=IN[:1], outputs=OUT[:1], count=COUNT)
    recorded = noisy(plant, 0.01, np.random.default_rng(0))
    recorded = dataclasses.replace(recorded, outputs=(dataclasses.replace(recorded.outputs[0], name="none"),))
    seen = measure_modes(
        sheet, chosen=range(12), noise=MeasurementNoise(1e-4, 0.02), rng=np.random.default_rng(5)
    )
    survey = Survey(name="lab", measured=seen, environment=lab, response=MeasuredResponse(response=recorded))
    with pytest.raises(ConfigError, match="none"):
        refine(article, [survey], PARTS)


@pytest.mark.parametrize("seed", repeats([2, 1, 3], quick=1))
def test_a_mode_that_no_survey_saw_leaves_the_response_its_word(seed: int):
    """Its pole is off by more than its width at first: there the logarithm is far from linear."""
    article, _ = case.sheet()
    survey, _ = truth(seed)
    few = case.survey(seed, 0, case.STRAIGHT, range(case.SUSPENSION, case.SUSPENSION + 5))
    unknowns = [*case.sheet_unknowns(article), DELAY, GAIN, MOTOR]
    found = refine(article, [dataclasses.replace(few, response=survey.response)], unknowns)
    assert found.converged
    assert found.responses[0].miss < 2.0
    predicted = predict_modes(found, Environment.orbit())
    error = case.log_errors(predicted.modes, predicted.frequency_hz, predicted.index, case.ten_in_orbit(seed))
    assert np.sqrt(np.mean((error / predicted.log_std) ** 2)) < NORMAL_95


@pytest.mark.parametrize("periods", [2, 3, 30])
def test_a_line_that_was_quiet_by_chance_does_not_rule(periods: int):
    """What a mean of 400 lines, weighed by their stated noise, errs by is what its deviation says."""
    rng, ports = np.random.default_rng(periods), (Port("u", "N"),)
    squares = []
    for _ in range(60):
        noise = rng.standard_normal((2, periods, 400)) / np.sqrt(2.0)
        each = 1.0 + 0.1 * (noise[0] + 1j * noise[1])
        of_mean = np.sum(np.abs(each - each.mean(axis=0)) ** 2, axis=0) / (periods * (periods - 1))
        response = FrequencyResponse(
            frequency_hz=HZ, H=each.mean(axis=0)[:, None, None], inputs=ports, outputs=(Port("y", "m"),),
            variance=of_mean[:, None, None],
        )  # fmt: skip
        (path,) = measured_paths(MeasuredResponse(response=response))
        weight = path.noise**-2.0
        squares.append(np.abs(np.sum(weight * (path.H - 1.0))) ** 2 / np.sum(weight))
    assert 0.6 < np.mean(squares) < 1.6
