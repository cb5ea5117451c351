"""Dry friction of a joint as an unknown: by harmonic balance in matrices of the truth's own."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import lossy_case as case
import numpy as np
import pytest
from scipy.integrate import quad, trapezoid
from scipy.special import erfc, gammainc
from test_promise_friction import asked

import middeck as md
import structure_builders as build
from middeck.errors import ConfigError
from middeck.joints.friction import Friction
from middeck.structure.correlation.measured_modes import MeasurementNoise, measure_modes
from middeck.structure.model.article import Actuator, Body, Damping, Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment
from middeck.structure.model.links import Link
from middeck.updating.orbit.predicted_frequencies import predict_modes
from middeck.updating.promise.refined_slips import spread_refined, with_refined
from middeck.updating.promise.slip import JointSlip, draw_slips
from middeck.updating.refinement.findings import _of_joints_taken_for_free, findings
from middeck.updating.refinement.refine import Refined, refine
from middeck.updating.residuals.damping_rows import compare_with_damping, solve_damped_near
from middeck.updating.residuals.surveyed_friction import SurveyedFriction, equivalent
from middeck.updating.residuals.surveys import Survey, set_up
from middeck.updating.unknowns.unknowns import Unknown
from repeats import repeats

TORQUE, ANGLE = 2e-3, 4e-4  # of the article as drawn; its spring has 9 N m/rad, the friction sticks with 5
SEEDS = 20
SLIPS = [
    Unknown(name="slip torque", parameters=("friction.p.slip_torque",), spread=0.4),
    Unknown(name="slip angle", parameters=("friction.p.slip_angle",), spread=0.4),
]


def first_harmonic(amplitude: float, torque: float, angle: float, points: int = 20001) -> complex:
    """k_eq + j k_loss by Fourier's integral over half a cycle, from one turning point to the other."""
    phase = np.linspace(0.0, np.pi, points)
    stiffness = torque / angle
    top = min(torque, stiffness * amplitude)
    path = np.maximum(top - stiffness * amplitude * (1.0 - np.cos(phase)), -top)
    return complex(2.0 / (np.pi * amplitude) * trapezoid(path * np.exp(-1j * phase), phase))


@pytest.mark.parametrize("random", [False, True])
def test_the_equivalent_of_a_mode_and_its_slopes(random: bool):
    """Sines by an integral over a cycle, narrow-band random motion by the mean over amplitudes."""
    amplitude = ANGLE * np.array([0.25, 1.25, 2.5, 25.0])
    one = SurveyedFriction(
        joint="p", slip_torque=TORQUE, slip_angle=ANGLE, amplitude=amplitude, random=random
    )
    value, slopes = equivalent(one, TORQUE, ANGLE)
    if not random:
        by_cycle = [first_harmonic(a, TORQUE, ANGLE) for a in amplitude]
        np.testing.assert_allclose(value, by_cycle, atol=1e-6 * TORQUE / ANGLE)
    h = 1e-5
    for row, (t, s) in zip(slopes, ((h, 0.0), (0.0, h)), strict=True):
        up, down = (equivalent(one, TORQUE * np.exp(f * t), ANGLE * np.exp(f * s))[0] for f in (1.0, -1.0))
        np.testing.assert_allclose(row, (up - down) / (2.0 * h), atol=1e-6 * TORQUE / ANGLE)


def mean_stiffness(rms: float) -> float:
    """Over what sticks, of a random motion of ``rms`` over the slip angle, by adaptive quadrature.

    With u = (A/rms)^2/2 amplitudes have the weight u exp(-u); u = edge + v^2 takes the root out of the bend.
    """
    edge = 0.5 / rms**2
    law = Friction(slip_torque=1.0, stiffness=1.0)

    def slipping(v: float) -> float:
        u = edge + v**2
        at = law.describing_function(np.array([rms * np.sqrt(2.0 * u)]))
        return 2.0 * v * u * np.exp(-u) * float(at.stiffness[0])

    stops = sorted({0.0, *(n * np.sqrt(edge) for n in (1.0, 5.0, 25.0) if n**2 * edge < 40.0), 7.0})
    some = (quad(slipping, *way, epsabs=1e-15, epsrel=1e-13)[0] for way in pairwise(stops))
    return float(gammainc(2.0, edge)) + sum(some)


def test_random_motion_of_any_size_about_the_slip_angle():
    """The loss in closed form, 2 sqrt(edge/pi) erfc(sqrt(edge)); the stiffness by adaptive quadrature."""
    rms = np.geomspace(1e-3, 1e3, 61)
    one = SurveyedFriction(joint="p", slip_torque=1.0, slip_angle=1.0, amplitude=rms, random=True)
    value, slopes = equivalent(one, 1.0, 1.0)
    edge = 0.5 / rms**2
    np.testing.assert_allclose(value.imag, 2.0 * np.sqrt(edge / np.pi) * erfc(np.sqrt(edge)), rtol=1e-12)
    np.testing.assert_allclose(value.real, [mean_stiffness(r) for r in rms], rtol=1e-11)
    # k_eq and k_loss are torque over angle times a function of angle over rms.
    rise = np.sqrt(edge / np.pi) * (2.0 * erfc(np.sqrt(edge)) - 4.0 * np.sqrt(edge / np.pi) * np.exp(-edge))
    np.testing.assert_allclose((slopes[1] + value).imag, rise, atol=1e-14)
    far = np.array([1e-100, 1e9, 1e17])
    loss = equivalent(dataclasses.replace(one, amplitude=far), 1.0, 1.0)[0].imag
    np.testing.assert_allclose(loss, [0.0, *np.sqrt(2.0 / np.pi) / far[1:]], rtol=1e-8)


def rubbed(
    x: np.ndarray, slip: np.ndarray, rng: np.random.Generator, swing: float, name: str = "springs"
) -> Survey:
    """Every mode of the truth with the equivalent of its own amplitude, in the median ``swing``."""
    amplitude = swing * np.geomspace(0.5, 2.0, case.MODES)[rng.permutation(case.MODES)]
    torque, angle = TORQUE * np.exp(slip[0]), ANGLE * np.exp(slip[1])
    plain = case.truth(x, True)
    s, shapes = plain.s[: case.MODES].copy(), plain.shapes[:, : case.MODES].copy()
    for m, a in enumerate(amplitude):
        found = case.truth(x, True, friction=first_harmonic(a, torque, angle))
        own = plain.shapes[:, m]
        like = np.abs(own.conj() @ found.shapes) / np.linalg.norm(found.shapes, axis=0)
        n = int(np.argmax(like[: case.MODES + 4]))
        s[m], shapes[:, m] = found.s[n], found.shapes[:, n]
    seen = case.survey(case.Truth(s, shapes), rng)
    stated = SurveyedFriction(joint="p", slip_torque=TORQUE, slip_angle=ANGLE, amplitude=amplitude)
    return dataclasses.replace(seen, friction=(stated,), name=name)


def refined(seed: int) -> tuple[np.ndarray, Refined]:
    """Two surveys, soft and hard; unknowns of stiffness, losses and friction with hidden values."""
    rng = np.random.default_rng([seed, 29])
    x, slip = case.SPREAD * rng.standard_normal(len(case.SPREAD)), 0.4 * rng.standard_normal(2)
    surveys = [rubbed(x, slip, rng, 6e-4, "soft"), rubbed(x, slip, rng, 4e-3, "hard")]
    return np.concatenate([x, slip]), refine(
        case.article(), surveys, [*case.UNKNOWNS, *SLIPS], damping_error=0.02
    )


def test_slip_torque_and_slip_angle_are_recovered_beside_damping():
    """Both to a per cent or two, from frequencies above all; 95 % intervals of all unknowns hold."""
    errors = []
    for seed in repeats(range(SEEDS)):
        true, found = refined(seed)
        assert found.converged
        assert np.all(found.estimate.x_std[-2:] < 0.05)
        errors.append((found.x - true) / found.estimate.x_std)
    held = np.mean(np.abs(errors) < 1.96)
    assert held >= (0.9 if len(errors) == SEEDS else 0.7)
    if len(errors) == SEEDS:
        assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.3


def stuck(x: np.ndarray, slip: np.ndarray, stiffness: float, rng: np.random.Generator) -> Survey:
    """So small a swing that the joint sticks in every mode: the lowest modes of one other article."""
    sticks = complex(stiffness * np.exp(slip[0] - slip[1]))
    stated = SurveyedFriction(
        joint="p", slip_torque=stiffness * ANGLE, slip_angle=ANGLE, amplitude=np.full(case.MODES, 0.2 * ANGLE)
    )
    return dataclasses.replace(
        case.survey(case.truth(x, True, friction=sticks), rng), friction=(stated,), name=f"{stiffness:g}"
    )


def beside(survey: Survey, x: np.ndarray, article: Structure | None = None, unknowns=None):
    """Frequencies and damping of a survey beside the model with the unknowns at ``x``."""
    made = case.article() if article is None else article
    place = set_up(made, survey.environment, (), [*case.UNKNOWNS, *SLIPS] if unknowns is None else unknowns)
    modes = place.solve(x)
    return compare_with_damping(modes, solve_damped_near(modes, survey), survey, place.bound, x)


@pytest.mark.parametrize("stiffness", repeats([50.0, 5.0, 300.0]))
def test_slopes_of_modes_that_a_stuck_joint_makes(stiffness: float):
    """By differences: the modulus bends modes that no free one is. Shapes have no noise."""
    none = np.zeros(len(case.SPREAD) + 2)
    noisy = stuck(none[:-2], none[-2:], stiffness, np.random.default_rng(4))
    shape = case.truth(none[:-2], True, friction=complex(stiffness)).shapes[:, : case.MODES]
    survey = dataclasses.replace(noisy, measured=dataclasses.replace(noisy.measured, shape=shape))
    found = beside(survey, none)
    assert len(found[0].pairs) == case.MODES
    h = 1e-5
    for k in range(len(none)):
        step = np.where(np.arange(len(none)) == k, h, 0.0)
        ends = zip(beside(survey, step), beside(survey, -step), found, strict=True)
        for up, down, at in ends:
            slope = (down.residual - up.residual)[: case.MODES] / (2.0 * h)
            np.testing.assert_allclose(at.slope[: case.MODES, k], slope, atol=2e-3)


@pytest.mark.parametrize("stiffness", repeats([50.0, 20.0, 300.0]))
def test_a_joint_that_sticks_hides_no_mode_and_loses_no_accuracy(stiffness: float):
    """Every mode is paired; the modulus is as well known as without friction, within what is stated."""
    rng = np.random.default_rng([7, 29])
    x, slip = case.SPREAD * rng.standard_normal(len(case.SPREAD)), 0.4 * rng.standard_normal(2)
    found = refine(case.article(), [stuck(x, slip, stiffness, rng)], [*case.UNKNOWNS, *SLIPS])
    assert found.converged
    assert found.compared[0].unpaired == ()
    assert found.estimate.x_std[0] < 5e-4
    errors = (found.x - np.concatenate([x, slip])) / found.estimate.x_std
    assert np.sqrt(np.mean(errors**2)) < 1.5
    # Of the slips their ratio alone, the stiffness that sticks.
    assert np.linalg.norm(found.estimate.root[-2] - found.estimate.root[-1]) < 0.2


def crossed(stiffness: float) -> Structure:
    """A mast of two nearly equal bendings; across both the axis of a disc with inertia about it."""
    tube = dataclasses.replace(case.TUBE, EI_y=100.0, EI_z=100.3, GA_y=np.inf, GA_z=np.inf)
    axis = np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0)
    disc = Body(0.6, np.zeros(3), 5e-3 * np.outer(axis, axis), rotors_excluded=True)
    nodes = [build.node("a", (0, 0, 0)), build.node("b", (1, 0, 0), build.body(0.5, inertia=(1e-3,) * 3))]
    joint = build.joint("p", "b", axis, disc, angle=0.0, stiffness=stiffness, target=0.0)
    made = build.structure(nodes, [build.member("a", "b", tube, 4)], [joint])
    return dataclasses.replace(made, damping=Damping(flexible=0.01, suspension=0.01))


def test_two_close_modes_that_a_stuck_joint_mixes_are_two():
    """Either has most of the one in which the joint stands still. The truth has a spring in the joint."""
    held = Environment(title="held", gravity=np.zeros(3), suspension=None, clamps=(Clamp(node="a"),))
    true = md.solve_modes(md.solve_equilibrium(crossed(1.25), held))
    stated = SurveyedFriction(joint="p", slip_torque=1.2e-3, slip_angle=1e-3, amplitude=np.full(6, 1e-4))
    noise = MeasurementNoise(frequency=1e-4, shape=1e-3)
    measured = measure_modes(true, chosen=range(6), noise=noise, rng=np.random.default_rng(3))
    survey = Survey(name="s", measured=measured, environment=held, friction=(stated,), damping_std=0.1)
    compared, _ = beside(survey, np.zeros(1), crossed(0.05), SLIPS[:1])
    assert compared.pairs[:, 1].tolist() == list(range(6))
    assert len(set(compared.paired.labels.tolist())) == 6
    np.testing.assert_allclose(compared.residual[:6], 0.0, atol=5e-4)


def unfolded(stiffness: float) -> Structure:
    """A clamped boom of two halves and a hinge between them, which bends both where it sticks."""
    tube = dataclasses.replace(case.TUBE, GA_y=np.inf, GA_z=np.inf)
    light, tip = build.body(0.01, inertia=(1e-5,) * 3), build.body(0.2, inertia=(1e-4,) * 3)
    nodes = [
        build.node(n, (x, 0, 0), b) for n, x, b in (("a", 0, build.NONE), ("b", 1, light), ("c", 2, tip))
    ]
    nodes.append(build.node("d", (1, 0, 0)))
    hinge = build.joint("p", "b", (0, 0, 1), light, angle=0.0, stiffness=stiffness, target=0.0)
    made = build.structure(nodes, [build.member(*ends, tube, 3) for ends in ("ab", "dc")], [hinge])
    latch = (Link(name="latch", first="p", second="d"),)
    return dataclasses.replace(made, links=latch, damping=Damping(flexible=0.01, suspension=0.01))


@pytest.mark.parametrize("stiffness", repeats([1e6, 1e3]))
def test_a_hinge_amid_a_boom_may_stick_as_firmly_as_it_likes(stiffness: float):
    """Its flexibility is in modes far above those measured: as many are taken as it asks for."""
    held = Environment(title="held", gravity=np.zeros(3), suspension=None, clamps=(Clamp(node="a"),))
    true = md.solve_modes(md.solve_equilibrium(unfolded(20.0 + stiffness), held))
    stated = SurveyedFriction(
        joint="p", slip_torque=1e-3 * stiffness, slip_angle=1e-3, amplitude=np.full(4, 1e-4)
    )
    noise = MeasurementNoise(frequency=1e-9, shape=1e-6)
    measured = measure_modes(true, chosen=range(4), noise=noise, rng=np.random.default_rng(3))
    survey = Survey(name="s", measured=measured, environment=held, friction=(stated,), damping_std=0.1)
    compared, _ = beside(survey, np.zeros(1), unfolded(20.0), SLIPS[:1])
    assert compared.pairs[:, 1].tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(compared.residual[:4], 0.0, atol=2e-6)


def test_without_friction_its_stiffness_and_loss_go_elsewhere():
    """What an article without friction makes of the same surveys: a joint's damper off by many deviations."""
    rng = np.random.default_rng(2)
    x, slip = np.zeros(len(case.SPREAD)), np.zeros(2)
    surveys = [rubbed(x, slip, rng, 6e-4, "soft"), rubbed(x, slip, rng, 4e-3, "hard")]
    found = refine(case.article(), surveys, [*case.UNKNOWNS, *SLIPS])
    assert not any("contradict" in line for line in findings(found))
    assert not any("slip" in name for name in found.factors)
    assert {u.name for u in found.left_out} == {"slip torque", "slip angle"}
    bare = [dataclasses.replace(s, friction=()) for s in surveys]
    wrong = refine(case.article(), bare, case.UNKNOWNS)
    assert any("contradict" in line for line in findings(wrong))
    orbit = [predict_modes(f, Environment.orbit(), count=8) for f in (found, wrong)]
    true = np.log(case.truth(x, False).zeta[:8])
    right, off = (np.abs(np.log(p.damping) - true).max() for p in orbit)
    assert right < 0.15 < off


def test_friction_that_a_survey_does_not_see_is_named():
    """So hard a swing that presliding is nothing: slip torque is seen, the angle before it is not."""
    rng = np.random.default_rng(4)
    survey = rubbed(np.zeros(len(case.SPREAD)), np.zeros(2), rng, 0.3)
    found = refine(case.article(), [survey], [*case.UNKNOWNS, *SLIPS])
    assert any("the tests do not determine" in line and "slip angle" in line for line in findings(found))


def test_frequencies_alone_tell_friction():
    """Without a damping ratio the joint is as stiff as it swings little."""
    rng = np.random.default_rng(4)
    survey = rubbed(np.zeros(len(case.SPREAD)), np.array([0.3, -0.2]), rng, 6e-4)
    none = np.full(case.MODES, np.nan)
    silent = dataclasses.replace(survey.measured, damping=none, damping_std=None)
    found = refine(case.article(), [dataclasses.replace(survey, measured=silent)], [case.UNKNOWNS[0], *SLIPS])
    assert found.converged
    assert np.all(np.abs(found.x[1:] - [0.3, -0.2]) < 3.0 * found.estimate.x_std[1:])
    assert np.all(found.estimate.x_std[1:] < 0.1)


def test_a_survey_that_states_no_friction_beside_one_that_does_is_named():
    """Right of a record without friction; with it, slip torques were off by 3 to 10 deviations."""
    rng = np.random.default_rng(5)
    none = np.zeros(len(case.SPREAD))
    rubs, linear = rubbed(none, np.zeros(2), rng, 1e-3, "rubs"), case.survey(case.truth(none, True), rng)
    found = refine(case.article(), [linear, rubs], [SLIPS[0]])
    warnings = [line for c in found.compared for line in _of_joints_taken_for_free(c, found)]
    assert len(warnings) == 1
    assert warnings[0].startswith("springs: was measured without friction of p,")


def test_friction_that_cannot_be():
    rng = np.random.default_rng(4)
    survey = rubbed(np.zeros(len(case.SPREAD)), np.zeros(2), rng, 1e-3)
    (stated,) = survey.friction
    with pytest.raises(ConfigError, match="all above zero"):
        dataclasses.replace(stated, slip_angle=0.0)
    with pytest.raises(ConfigError, match="one for each measured mode"):
        dataclasses.replace(survey, friction=(dataclasses.replace(stated, amplitude=np.ones(3)),))
    elsewhere = dataclasses.replace(survey, friction=(dataclasses.replace(stated, joint="q"),))
    with pytest.raises(ConfigError, match=r"(?s)no joint 'q' that moves.*such joints are p"):
        refine(case.article(), [elsewhere], case.UNKNOWNS)
    with pytest.raises(ConfigError, match="states a joint's friction and amplitudes"):
        refine(case.article(), [dataclasses.replace(survey, friction=())], [*case.UNKNOWNS, *SLIPS])
    twice = dataclasses.replace(stated, slip_torque=2.0 * stated.slip_torque)
    other = dataclasses.replace(survey, name="other", friction=(twice,))
    with pytest.raises(ConfigError, match="two slip torques or slip angles of joint 'p'"):
        refine(case.article(), [survey, other], case.UNKNOWNS)
    with pytest.raises(ConfigError, match="could make it negative"):
        dataclasses.replace(SLIPS[0], added=True)


def test_a_promise_draws_the_friction_that_was_refined():
    """Slip torque with its deviation, drawn with the article; the plan's slip angle stays."""
    rng = np.random.default_rng(4)
    survey = rubbed(np.zeros(len(case.SPREAD)), np.array([0.3, 0.0]), rng, 1e-3)
    motor = Actuator(name="motor", frame="p", axis=None)
    article = dataclasses.replace(case.article(), actuators=(motor,))
    found = refine(article, [survey], [*case.UNKNOWNS, SLIPS[0]])
    stated = JointSlip(
        name="motor", slip_torque=1.0, slip_angle=3e-4, slip_torque_tolerance=0.5, slip_angle_tolerance=0.1
    )
    other = dataclasses.replace(stated, name="elsewhere")
    plan = dataclasses.replace(asked(), joints=(stated, other))
    joints = with_refined(plan, found).joints
    assert joints[1] == other
    (friction,) = found.friction()
    assert joints[0].slip_torque == friction.value[0] == pytest.approx(TORQUE * np.exp(0.3), rel=0.05)
    assert (joints[0].slip_torque_tolerance, joints[0].slip_angle_tolerance) == (0.0, 0.1)
    n = rng.standard_normal((4000, found.estimate.root.shape[1]))
    slips = spread_refined(draw_slips(joints, len(n), rng), joints, found, n)
    log = np.log(slips.slip_torque[:, 0] / joints[0].slip_torque)
    # A deviation of 4000 is known to 1.1 %.
    assert np.std(log) == pytest.approx(friction.log_std[0], rel=0.05)
    np.testing.assert_allclose(slips.drawn[:, 0] * friction.log_std[0], log, atol=1e-12)
    np.testing.assert_array_equal(np.ptp(slips.slip_angle, axis=0) > 0.0, [True, True])
    k = len(case.UNKNOWNS)
    np.testing.assert_allclose(log, n @ found.estimate.root[k], atol=1e-12)


def test_friction_of_a_slide_is_in_newtons_and_metres():
    """A proof mass that sticks at a mast's tip; the truth has a spring in its place."""

    def mast(stiffness: float) -> Structure:
        nodes = [build.node("a", (0, 0, 0)), build.node("b", (1, 0, 0), build.body(0.5, inertia=(1e-3,) * 3))]
        slide = build.joint(
            "p", "b", (0, 1, 0), build.body(0.1), angle=0.0, stiffness=stiffness, target=0.0, slides=True
        )
        made = build.structure(nodes, [build.member("a", "b", case.TUBE, 4)], [slide])
        return dataclasses.replace(made, damping=Damping(flexible=0.01, suspension=0.01))

    held = Environment(title="held", gravity=np.zeros(3), suspension=None, clamps=(Clamp(node="a"),))
    stiffness, off = 20.0, 0.5  # N/m, and the logarithm of what the truth has in its place
    true = md.solve_modes(md.solve_equilibrium(mast(5.0 + stiffness * np.exp(off)), held))
    noise = MeasurementNoise(frequency=1e-4, shape=1e-3)
    measured = measure_modes(true, chosen=range(6), noise=noise, rng=np.random.default_rng(0))
    stated = SurveyedFriction(
        joint="p", slip_torque=1e-3 * stiffness, slip_angle=1e-3, amplitude=np.full(6, 1e-4)
    )
    survey = Survey(name="s", measured=measured, environment=held, friction=(stated,), damping_std=0.1)
    found = refine(mast(5.0), [survey], SLIPS[:1])
    assert found.compared[0].unpaired == ()
    assert abs(found.x[0] - off) < 3.0 * found.estimate.x_std[0] < 0.003
    (friction,) = found.friction()
    np.testing.assert_allclose(friction.value, [1e-3 * stiffness * np.exp(off), 1e-3], rtol=2e-3)
