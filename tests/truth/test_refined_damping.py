"""Damping as unknowns of a refinement: recovered, carried to orbit and into plants, and what cannot be."""

from __future__ import annotations

import dataclasses
import functools

import lossy_case as case
import numpy as np
import pytest
import scipy.linalg as sla

import middeck as md
from middeck.errors import ConfigError, DataError
from middeck.structure.model.environment import Environment
from middeck.structure.plants.damped_modes import solve_damped
from middeck.structure.sensitivity.parameters import scale_parameters
from middeck.updating.orbit.predicted_frequencies import predict_modes
from middeck.updating.promise.draws import LoopSpread, draw_plants
from middeck.updating.refinement.findable_unknowns import weigh_unknowns
from middeck.updating.refinement.findings import findings
from middeck.updating.refinement.other_frequencies import other_frequencies
from middeck.updating.refinement.refine import Refined, refine
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown
from repeats import repeats

PER_MODE = ("frequency_hz", "damping", "frequency_std_hz", "damping_std")
PREDICTED, SEEDS = 8, 40


@functools.cache
def drawn(seed: int, off: float) -> tuple[np.ndarray, np.ndarray, Refined, np.ndarray]:
    """Logarithms of hidden factors, other losses of each mode (``off``), the refinement, ln zeta in orbit."""
    rng = np.random.default_rng([seed, 17])
    x = case.SPREAD * rng.standard_normal(len(case.UNKNOWNS))
    other = off * rng.standard_normal(case.MODES)
    seen = case.survey(case.truth(x, True, other), rng)
    found = refine(case.article(), [seen], case.UNKNOWNS, damping_error=0.1)
    return x, other, found, np.log(case.truth(x, False, other).zeta[:PREDICTED])


@pytest.mark.parametrize("off", repeats([0.1, 0.0]))
def test_hidden_damping_is_recovered_within_what_is_stated(off: float):
    """Complex modes of the truth by matrices of its own: 90 % of 95 % intervals hold, in orbit too.

    Of a few seeds (`make test`) no more than a few may miss.
    """
    of_unknowns, in_orbit = [], []
    for seed in repeats(range(SEEDS), 2):
        x, _, found, ln_zeta = drawn(seed, off)
        assert found.converged
        of_unknowns.append(((found.x - x) / found.estimate.x_std)[1:])
        predicted = predict_modes(found, Environment.orbit(), count=PREDICTED)
        in_orbit.append((np.log(predicted.damping) - ln_zeta) / predicted.damping_std(0.3))
    for errors in (np.array(of_unknowns), np.array(in_orbit)):
        held, size = np.mean(np.abs(errors) < 1.96), np.sqrt(np.mean(errors**2))
        if len(errors) == SEEDS:
            assert 0.9 <= held <= 0.99
            assert 0.7 < size < 1.3
        assert held >= 0.7


@pytest.fixture(scope="module")
def sound() -> Refined:
    return drawn(1, 0.0)[2]


def with_modes(found: Refined, **changed: object) -> Survey:
    """Its survey, with other numbers."""
    survey = found.compared[0].survey
    return dataclasses.replace(survey, measured=dataclasses.replace(survey.measured, **changed))


def test_damping_is_compared_only_where_an_unknown_moves_it(sound: Refined):
    """Else whatever a survey says of it changes no digit of what is refined."""
    (survey,) = (c.survey for c in sound.compared)
    none = with_modes(sound, damping=np.full(case.MODES, np.nan), damping_std=None)
    alone, without = (refine(case.article(), [s], case.UNKNOWNS[:1]) for s in (survey, none))
    assert alone.damped == without.damped == ()
    np.testing.assert_array_equal(alone.estimate.root, without.estimate.root)
    assert alone.sorts == ("suspension", "flexible")
    assert sound.sorts == ("suspension", "flexible", "damping")


def test_the_refined_article_has_the_damping(sound: Refined):
    """Its factors make the ratios that the refinement has; they leave errors of the model and noise."""
    refined = scale_parameters(case.article(), sound.factors)
    modes = md.solve_modes(md.solve_equilibrium(refined, case.ground()))
    (damped,) = sound.damped
    left = np.log(damped.survey.measured.damping[damped.pairs[:, 1]])
    left = left - np.log(solve_damped(modes).zeta[damped.pairs[:, 0]])
    assert np.sqrt(np.mean(left**2)) < 0.08  # stated 0.05, and an error of the model of 0.02 or so


def test_drawn_plants_have_the_damping_and_its_deviation(sound: Refined):
    """Decibels follow: ratios of drawn plants scatter as told, those of one loss together."""

    def build(modes: md.Modes) -> md.Plant:
        return md.build_plant(modes, inputs=[], outputs=[], count=6 + 1 + PREDICTED)

    predicted = predict_modes(sound, Environment.orbit(), count=PREDICTED)
    drawing = draw_plants(
        sound, Environment.orbit(), build, draws=60, rng=np.random.default_rng(3), loop=LoopSpread()
    )
    plants = drawing.plants(range(60)).plants
    zeta = np.log([p.modal.zeta[predicted.index] for p in plants if p.modal is not None])
    # A deviation of 60 is known to 9 %.
    assert np.std(zeta, axis=0) / predicted.damping_std(0.3) == pytest.approx(1.0, abs=0.3)
    shared = (
        predicted.damping_root
        @ predicted.damping_root.T
        / np.outer(predicted.damping_std(0.3), predicted.damping_std(0.3))
    )
    close = np.unravel_index(np.argmax(shared - np.eye(PREDICTED)), shared.shape)
    assert np.corrcoef(zeta.T)[close] == pytest.approx(shared[close], abs=0.35)


def test_what_a_survey_does_not_see_keeps_its_prior_and_is_named(sound: Refined):
    """A damper that moves no measured mode; two losses of which modes tell one sum."""
    keep = [k for k in range(case.MODES) if k < 5]  # what the springs hold: members hardly bend
    measured = sound.compared[0].survey.measured
    few = with_modes(
        sound,
        **{n: getattr(measured, n)[keep] for n in PER_MODE},
        **{n: getattr(measured, n)[:, keep] for n in ("shape", "shape_std")},
    )
    found = refine(case.article(), [few], case.UNKNOWNS)
    (line,) = [warning for warning in findings(found) if "the tests do not determine" in warning]
    assert "tube" in line
    assert "ground" not in line
    chosen = weigh_unknowns(case.article(), [few], case.UNKNOWNS)
    assert chosen.strength[4] > 2.0 > chosen.strength[1]


def test_an_error_of_the_model_is_named_and_widens_the_prediction(sound: Refined):
    """Losses of each mode that no unknown has, 40 % of each."""
    rng = np.random.default_rng(5)
    seen = case.survey(case.truth(np.zeros(5), True, 0.4 * rng.standard_normal(case.MODES)), rng)
    found = refine(case.article(), [seen], case.UNKNOWNS)
    assert any("no unknowns fit the damping ratios" in line for line in findings(found))
    wide, narrow = (predict_modes(f, Environment.orbit(), count=PREDICTED) for f in (found, sound))
    # A mode that keeps its shape keeps its ratio; what mixes has more.
    assert np.max(wide.damping_std(0.0)) > 2.0 * np.max(narrow.damping_std(0.0))


def test_surveys_that_contradict_in_damping_are_reported(sound: Refined):
    """The same modes with 40 % more damping in a second test, as at another amplitude; frequencies agree."""
    survey = sound.compared[0].survey
    hz = survey.measured.frequency_hz * (1.0 + 1e-5)  # no copy, rounded or not
    again = dataclasses.replace(with_modes(sound, frequency_hz=hz), name="again")
    damping = 1.4 * survey.measured.damping
    more = dataclasses.replace(with_modes(sound, frequency_hz=hz, damping=damping), name="harder")
    found = refine(case.article(), [survey, more], case.UNKNOWNS)
    warnings = " ".join(findings(found))
    assert "contradict one another in damping" in warnings
    assert "contradict one another: their frequencies" not in warnings
    assert found.damped[0].std[0] > 2.0 * sound.damped[0].std[0]
    assert "contradict" not in " ".join(findings(refine(case.article(), [survey, again], case.UNKNOWNS)))


def test_ratios_of_zero_are_left_out_by_name(sound: Refined):
    zeta = sound.compared[0].survey.measured.damping.copy()
    zeta[[2, 5]] = 0.0, np.nan
    found = refine(case.article(), [with_modes(sound, damping=zeta)], case.UNKNOWNS)
    hz = sound.compared[0].survey.measured.frequency_hz
    assert any(f"{hz[2]:.4g}, {hz[5]:.4g} Hz are zero, not stated" in line for line in findings(found))
    assert len(found.damped[0].pairs) == case.MODES - 2


@pytest.mark.parametrize(
    ("factor", "std", "what"),
    [
        (70.0, 70.0, "in place of a ratio"),
        (-1.0, 1.0, "negative"),
        (150.0, 1.0, "not below one"),
        (0.0, 0.0, "no survey states a damping ratio"),
        (1.0, None, "no standard deviations of its damping"),
    ],
)
def test_damping_that_cannot_be(sound: Refined, factor: float, std: float | None, what: str):
    measured = sound.compared[0].survey.measured
    assert measured.damping_std is not None
    survey = with_modes(
        sound,
        damping=factor * measured.damping,
        damping_std=None if std is None else std * measured.damping_std,
    )
    with pytest.raises((ConfigError, DataError), match=what):
        refine(case.article(), [survey], case.UNKNOWNS)


def test_a_survey_may_state_one_deviation_for_all(sound: Refined):
    stated = dataclasses.replace(with_modes(sound, damping_std=None), damping_std=0.05)
    found = refine(case.article(), [stated], case.UNKNOWNS)
    np.testing.assert_allclose(found.x, sound.x, atol=0.1 * np.max(sound.estimate.x_std))


def test_unknowns_of_damping_that_cannot_be(sound: Refined):
    survey = sound.compared[0].survey
    with pytest.raises(ConfigError, match="could make it negative"):
        Unknown(name="a", parameters=("damping.joint.p.c",), spread=1e-3, added=True)
    bare = dataclasses.replace(case.article(), damping=md.Damping())
    with pytest.raises(ConfigError, match=r"damping.flexible is 0") as raised:
        refine(bare, [survey], [Unknown(name="a", parameters=("damping.flexible",), spread=0.5)])
    assert "[damping]" in str(raised.value)
    one = dataclasses.replace(bare, damping=md.Damping(by_mode=((7, 0.01),)))
    with pytest.raises(ConfigError, match=r"the model gives mode .* no damping"):
        refine(one, [survey], [Unknown(name="a", parameters=("damping.mode.7",), spread=0.5)])


def test_frequencies_of_decays_or_of_undamped_modes_are_distinguished_from_those_of_roots():
    """Dampers seven times the model's: a root is 0.1 % off the undamped mode, and 0.4 % off its decay."""
    x = np.append(np.zeros(len(case.UNKNOWNS) - 1), 2.0)
    some = slice(0, None, len(case.UNKNOWNS) - 1)
    true = case.truth(x, held=True)
    seen = case.survey(true, np.random.default_rng(6))
    lam = sla.eigvalsh(sum(case.parts()[:4]), case.parts().mass)[1:]  # it turns freely about its two ends
    shift = np.log(2.0 * np.pi * true.hz / np.sqrt(lam))[: case.MODES]
    undamped = seen.measured.frequency_hz * np.exp(-shift)
    stated = dataclasses.replace(seen, measured=dataclasses.replace(seen.measured, frequency_hz=undamped))
    found = refine(case.article(), [stated], case.UNKNOWNS[some], damping_error=0.1)
    (warning,) = (line for line in findings(found) if "fit better as those" in line)
    assert "as those of undamped modes, than as natural ones" in warning
    assert f"by up to {100.0 * np.abs(shift).max():.2g} %" in warning
    (one,) = found.compared
    at = one.pairs[:, 1]
    decay = 0.5 * np.log1p(-(true.zeta[at] ** 2))
    for moved, words in ((shift[at], None), (shift[at] + decay, "as those of decays, |s| sqrt(1 - zeta^2)")):
        residual = one.residual.copy()
        residual[: len(at)] += moved
        again = dataclasses.replace(found, compared=(dataclasses.replace(one, residual=residual),))
        lines = [line for line in findings(again) if "fit better as those" in line]
        assert [words in line for line in lines] == [True] * (words is not None)


def test_ratios_in_per_cent_are_of_no_decay(sound: Refined):
    """A ratio of one or more leaves no frequency of a decay to be compared with."""
    (one,) = sound.compared
    per_cent = dataclasses.replace(
        one.survey.measured, damping=np.append(1.0, 100.0 * one.survey.measured.damping[1:])
    )
    again = dataclasses.replace(one, survey=dataclasses.replace(one.survey, measured=per_cent))
    with np.errstate(all="raise"):
        assert not list(other_frequencies(dataclasses.replace(sound, compared=(again,))))
