"""What tests would tell: closed forms, what refining on them tells, tests made twice, tests of nothing."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
import pytest
import updating_case as case
from test_updating import MODULUS, SPLIT, TIGHT, TOP, clamped, mast, modes_of, survey_of

from middeck.structure.correlation.measured_modes import MeasurementNoise, measure_modes
from middeck.structure.model.article import LoadCase, PointLoad
from middeck.structure.model.environment import Environment
from middeck.updating.candidates.candidate_survey import CandidateSurvey
from middeck.updating.candidates.rank_tests import rank_tests
from middeck.updating.candidates.refinement_after_one_test import foresee
from middeck.updating.orbit.deflections import Deflection, predict_deflections
from middeck.updating.orbit.predicted_frequencies import predict_modes
from middeck.updating.refinement.bayesian_estimate import Linear, estimate_at
from middeck.updating.refinement.problem import linear_problem
from middeck.updating.refinement.refine import Refined, refine
from middeck.updating.residuals.gauges import Gauge
from middeck.updating.residuals.static_tests import StaticTest
from middeck.updating.residuals.surveys import Survey, set_up
from middeck.updating.unknowns.unknowns import Unknown
from repeats import repeats

USUAL = MeasurementNoise(frequency=1e-3, shape=0.02)
CHANNELS = tuple(
    (n, d) for n in ("top", "mast/1", "mast/2", "mast/3") for d in ("x", "y", "z", "rx", "ry", "rz")
)
ORBIT = {"orbit": clamped(0.0)}
GJ = Unknown(name="torsion", parameters=("member.mast.GJ",), spread=0.05)


def candidate(name: str = "new", std: float = 1e-3, **given: Any) -> CandidateSurvey:
    usual: dict[str, Any] = {"shape_std": 0.02, "channels": CHANNELS, "count": 6, "environment": clamped()}
    return CandidateSurvey(name=name, frequency_std=std, **usual | given)


def push(name: str = "push", newton: float = 1.0, std: float = 1e-5, along: str = "x") -> StaticTest:
    direction = np.eye(3)["xyz".index(along)]
    return StaticTest(
        name=name,
        environment=clamped(),
        gauges=(Gauge(name="tip", at="top", direction=direction, std=std),),
        value=np.zeros(1),
        load_case=LoadCase(name=name, loads=(PointLoad(name=name, frame="top", force=newton * direction),)),
    )


@functools.cache
def two_modes_seen() -> Refined:
    """The first two bending modes of the mast alone."""
    seen = survey_of(modes_of(mast(EI=1.02, split=1.02), clamped()), USUAL, chosen=range(2))
    return refine(mast(), [seen], (MODULUS, SPLIT, TOP, GJ))


@functools.cache
def sheet_seen() -> tuple[Refined, tuple[Survey, ...]]:
    """The frozen case, with the first five flexible modes measured."""
    article, _ = case.sheet()
    surveys = (case.survey(0, 0, case.STRAIGHT, range(case.SUSPENSION + 5)),)
    return refine(article, surveys, case.sheet_unknowns(article)), surveys


def problem_of(found: Refined) -> Linear:
    mean, spread = (np.array([getattr(u, n) for u in found.unknowns]) for n in ("mean", "spread"))
    return linear_problem(found.compared, found.statics, found.fields, found.linear_at - mean, spread)


def test_one_mode_and_one_unknown_in_closed_form():
    """1/var = 1/spread^2 + J^2/(tau^2 + noise^2); a second reading of the same mode has the same tau."""
    seen = survey_of(modes_of(mast(EI=1.02), clamped()), USUAL, chosen=[0])
    found = refine(mast(), [seen], (MODULUS,))
    (J,), tau, noise = found.compared[0].slope[0], found.estimate.tau[1], 1e-3
    predicted = foresee(found, candidate(count=1, channels=())).refined.estimate

    def std(noise: float) -> float:
        return (MODULUS.spread**-2 + J**2 / (tau**2 + noise**2)) ** -0.5

    assert found.estimate.x_std[0] == pytest.approx(std(noise), rel=1e-3)
    assert predicted.x_std[0] == pytest.approx(std(noise / np.sqrt(2.0)), rel=1e-3)
    np.testing.assert_allclose(predicted.x, found.estimate.x, rtol=1e-9)
    np.testing.assert_allclose(predicted.d, found.estimate.d, rtol=1e-9)


def held(really: Refined, before: Refined) -> Refined:
    """As refined, the model's errors being as large as they were thought to be before."""
    found = estimate_at(problem_of(really), before.estimate.tau)
    return dataclasses.replace(really, estimate=found, unseen=before.unseen)


@pytest.mark.parametrize("settings", repeats([case.TURNED, case.STRAIGHT]))
def test_what_is_foreseen_is_what_refining_tells(settings: tuple[tuple[str, float], ...]):
    """Twenty modes of the most probable article, with noise, refined on: the modes that none had seen.

    The others hang on how close modes mix, and so on the noise.
    """
    before, surveys = sheet_seen()
    article, lab = case.sheet()
    noise = case.NOISE
    asked = CandidateSurvey(
        name="asked", environment=lab, settings=settings, count=20,
        frequency_std=noise.frequency, shape_std=noise.shape,
    )  # fmt: skip
    ranking = rank_tests(before, [asked], {"orbit": Environment.orbit()})
    modes = set_up(article, lab, settings, before.unknowns).solve(before.x)
    measured = measure_modes(modes, chosen=range(20), noise=noise, rng=np.random.default_rng(5))
    made = Survey(name="made", measured=measured, environment=lab, settings=settings)
    really = held(refine(article, [*surveys, made], before.unknowns), before)
    predicted, came = ranking.tests[0], predict_modes(really, Environment.orbit()).log_std
    new = predict_modes(before, Environment.orbit()).seen < 0.5
    assert np.count_nonzero(new) == 5
    assert np.all(predicted.ratio[new] < 0.2)
    np.testing.assert_allclose(predicted.std[new], came[new], rtol=0.03)


def test_all_of_it_is_foreseen_where_modes_are_apart():
    """The mast, its bending modes 15 % apart: every frequency, seen before or not."""
    article, unknowns = mast(split=1.3), (MODULUS, SPLIT, TOP, GJ)
    seen = survey_of(modes_of(mast(EI=1.02, split=1.32), clamped()), USUAL, chosen=range(2))
    before = refine(article, [seen], unknowns)
    found = rank_tests(before, [candidate()], ORBIT, count=6)
    modes = set_up(article, clamped(), (), unknowns).solve(before.x)
    made = dataclasses.replace(survey_of(modes, USUAL, 3), name="made")
    really = held(refine(article, [seen, made], unknowns), before)
    came = predict_modes(really, ORBIT["orbit"], count=6).log_std
    np.testing.assert_allclose(found.tests[0].std, came, rtol=0.03)
    assert found.tests[0].widest < 0.1


def test_a_test_made_twice_tells_no_more_than_one_without_noise():
    """Its noise goes, the model's own errors stay: in frequencies, in how modes mix, and in readings."""
    seen = survey_of(modes_of(mast(EI=1.02, split=1.005), clamped()), MeasurementNoise(1e-4, 1e-4))
    made = dataclasses.replace(push(), value=np.array([0.006]))
    found = refine(mast(), [seen], (MODULUS, SPLIT, TOP, GJ), 3e-3, [made], 0.02)
    problem = problem_of(found)
    modal = np.arange(len(problem.y)) < len(problem.y) - 1
    for again, rows in (
        (candidate(std=1e-9, shape_std=1e-9), modal),
        (push("again", std=1e-12), ~modal),
    ):
        exact = estimate_at(
            dataclasses.replace(problem, std=np.where(rows, 1e-9, problem.std)), found.estimate.tau
        )
        predicted = foresee(found, again).refined.estimate
        np.testing.assert_allclose(predicted.x_std, exact.x_std, rtol=0.01)


def test_a_mode_that_no_test_saw_is_best_seen():
    """Of torsion nothing was measured: a test of it, a worse one, the same bending again, and nothing."""
    tests = [
        candidate("bending again", count=2),
        candidate("all six"),
        candidate("all six, worse", std=5e-3),
        push("a gauge of no use", std=1e3),
    ]
    found = rank_tests(two_modes_seen(), tests, ORBIT, count=6)
    assert [t.name for t in found.tests] == [
        "all six",
        "all six, worse",
        "bending again",
        "a gauge of no use",
    ]
    assert found.tests[0].widest < found.tests[1].widest < 0.5
    assert found.tests[2].widest > 0.9
    np.testing.assert_allclose(found.tests[3].ratio, 1.0, rtol=1e-6)
    assert found.promised[found.widest].std == max(p.std for p in found.promised)
    for test in found.tests:
        assert np.all(test.ratio < 1.0 + 1e-9)
    backwards = rank_tests(two_modes_seen(), tests[::-1], ORBIT, count=6)
    for one, other in zip(found.tests, backwards.tests, strict=True):
        assert one.name == other.name
        np.testing.assert_array_equal(one.std, other.std)


def test_a_static_test_is_foreseen_as_refining_on_it_tells():
    """A tip that is pushed: with what the model reads there, refined on in truth."""
    first = dataclasses.replace(push("first", along="z"), value=np.array([0.0066]))
    seen = survey_of(modes_of(mast(EI=1.02, split=1.02), clamped()), USUAL, chosen=range(2))
    before = refine(mast(), [seen], (MODULUS, SPLIT, TOP, GJ), statics=[first])
    predicted = foresee(before, push()).refined
    value = predicted.statics[-1].value
    made = dataclasses.replace(push(), value=value)
    really = refine(mast(), [seen], before.unknowns, statics=[first, made])
    assert len(predicted.estimate.d) == len(really.estimate.d)
    same = estimate_at(problem_of(really), before.estimate.tau)
    np.testing.assert_allclose(predicted.estimate.x_std, same.x_std, rtol=0.02)
    assert predicted.estimate.x_std[1] < 0.96 * before.estimate.x_std[1]


def test_static_tests_of_an_article_that_had_none():
    predicted = foresee(two_modes_seen(), push())
    assert len(predicted.refined.estimate.tau) == len(predicted.refined.unseen) == 4
    assert predicted.refined.fields is not None


def test_a_candidate_beside_static_tests_alone():
    made = dataclasses.replace(push("made"), value=np.array([0.0066]))
    before = refine(mast(), [], (MODULUS, TOP), statics=[made])
    found = rank_tests(before, [candidate()], ORBIT, count=4)
    assert found.tests[0].widest < 0.1
    assert len(found.tests[0].foreseen.refined.compared) == 1


def test_what_gauges_will_read_is_promised_too():
    """Of a push: one half as large tells most of it, one across less, a survey of modes little."""
    tip = push("promised").gauges[0]

    def readings(refined: Refined) -> tuple[Deflection, ...]:
        load = push("promised").load_case
        return predict_deflections(refined, clamped(), [load], [tip])

    tests = [push("half", 0.5), push("across", 0.5, along="z"), candidate("modes", count=2)]
    found = rank_tests(two_modes_seen(), tests, {}, readings=readings)
    assert [t.name for t in found.tests] == ["half", "across", "modes"]
    (reported,) = readings(two_modes_seen())
    (before,) = found.promised
    assert (before.name, before.where, before.unit) == ("tip", "promised", "m")
    assert before.std == pytest.approx(reported.std[0] / reported.value[0], rel=1e-9)
    (then,) = readings(found.tests[0].foreseen.refined)
    assert found.tests[0].widest == pytest.approx(then.std[0] / reported.std[0], rel=1e-6)
    assert then.value[0] == pytest.approx(reported.value[0], rel=1e-3)
    both = rank_tests(two_modes_seen(), tests, ORBIT, count=3, readings=readings)
    assert len(both.promised) == 4


def test_modes_that_move_no_channel_are_left_out():
    """Bending in the plane of x leaves z at rest; what is not seen tells nothing."""
    predicted = foresee(two_modes_seen(), candidate(channels=(("top", "z"),)))
    (added,) = predicted.refined.compared[1:]
    left = [hz for _, hz in predicted.unseen]
    assert left
    assert len(added.pairs) + len(left) == 6
    assert not set(np.round(left, 6)) & set(np.round(added.survey.measured.frequency_hz, 6))


def test_it_does_not_hang_on_the_noise_of_what_was_seen():
    """Two surveys of one article with other noise: the same ranking."""
    names = []
    for seed in (0, 1):
        seen = survey_of(modes_of(mast(EI=1.02), clamped()), TIGHT, seed, chosen=range(2))
        found = rank_tests(
            refine(mast(), [seen], (MODULUS, SPLIT, TOP, GJ)),
            [candidate("six"), candidate("two", count=2), candidate("four", count=4)],
            ORBIT,
            count=6,
        )
        names.append([t.name for t in found.tests])
    assert names[0] == names[1]
    assert names[0][0] == "six"
