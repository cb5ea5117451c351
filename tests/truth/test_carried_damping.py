"""Measured damping carried to another environment, against complex eigenvalues of damped articles."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest

import middeck as md
import structure_builders as build
from middeck.structure.correlation.measured_modes import measure_modes
from middeck.structure.model.article import Body, Damper, DamperPlace, Damping, Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment
from middeck.updating.orbit.predicted_damping import DampingParts
from middeck.updating.orbit.predicted_frequencies import Prediction, SolvedModes, predict_at, solve_there
from middeck.updating.refinement.findings import findings
from middeck.updating.refinement.refine import Refined, refine
from middeck.updating.residuals.damping_rows import shifted_by_losses
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown
from repeats import repeats

# A payload that hangs from a clamped point by two sprung axes with unlike dampers: a pendulum of two angles.
INERTIA, ARM, MASS = np.array([[0.5, 0.2], [0.2, 0.4]]), 0.2, 3.0
SPRINGS, DAMPERS = np.array([6.0, 3.0]), np.array([0.004, 0.08])
GRAVITY = 9.80665
WEIGHT = GRAVITY * MASS * ARM
NOISE, DRAWS = 0.02, 60  # relative, of measured ratios


def pendulum(damping: Damping) -> Structure:
    inertia = np.diag([INERTIA[0, 0], 0.5, INERTIA[1, 1]])
    inertia[0, 2] = inertia[2, 0] = INERTIA[0, 1]
    # About the centre of mass; INERTIA is about the pivot.
    inertia -= MASS * ARM**2 * np.diag([1.0, 0.0, 1.0])
    payload = Body(MASS, np.array([0.0, -ARM, 0.0]), inertia)
    joints = [
        build.joint("x", "foot", (1.0, 0.0, 0.0), stiffness=SPRINGS[0], target=0.0),
        build.joint("z", "x", (0.0, 0.0, 1.0), payload, stiffness=SPRINGS[1], target=0.0),
    ]
    made = build.structure([build.node("foot", (0.0, 0.0, 0.0))], (), joints)
    return dataclasses.replace(made, damping=damping)


def stand(gravity: float) -> Environment:
    return Environment(title="stand", gravity=np.array([0.0, -gravity, 0.0]), clamps=(Clamp(node="foot"),))


def ratios(K: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Of the two modes of a complex stiffness and dampers."""
    s = roots(K, C)
    return -s.real / np.abs(s)


def roots(K: np.ndarray, C: np.ndarray) -> np.ndarray:
    """By a 4 x 4 eigenvalue problem."""
    inverse = np.linalg.inv(INERTIA)
    s = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ K, -inverse @ C]]))
    s = s[s.imag > 0.0]
    return s[np.argsort(np.abs(s))]


def lossy(flexible: float, weight: float, held: bool) -> np.ndarray:
    """Loss factors of the springs and of the weight, which holds on the ground only."""
    K = np.diag(SPRINGS) * (1.0 + 2j * flexible) + held * WEIGHT * np.eye(2) * (1.0 + 2j * weight)
    return ratios(K, np.zeros((2, 2)))


@functools.cache
def refined_on_the_ground(damping: Damping) -> Refined:
    """Refined on its two modes on the ground."""
    article, place = pendulum(damping), stand(GRAVITY)
    modes = md.solve_modes(md.solve_equilibrium(article, place))
    seen = measure_modes(modes, [("x", "angle"), ("z", "angle")], chosen=range(2))
    spring = Unknown(name="spring", parameters=("joint.x.stiffness",), spread=0.1)
    survey = Survey(name="stand", measured=seen, environment=place, frequency_std=1e-4)
    return refine(article, [survey], [spring])


@functools.cache
def there(damping: Damping, gravity: float) -> SolvedModes:
    return solve_there(refined_on_the_ground(damping), stand(gravity), count=2)


def told(damping: Damping, measured: np.ndarray, gravity: float = 0.0) -> Prediction:
    """What the refined pendulum is promised where ``measured`` are its ratios on the ground."""
    refined = refined_on_the_ground(damping)
    (one,) = refined.compared
    seen = dataclasses.replace(one.survey.measured, damping=measured, damping_std=NOISE * measured)
    survey = dataclasses.replace(one.survey, measured=seen)
    known = dataclasses.replace(refined, compared=(dataclasses.replace(one, survey=survey),))
    return predict_at(known, there(damping, gravity))


@pytest.mark.parametrize("factor", [2.0, 0.5])
def test_a_clamped_article_of_unlike_modes_keeps_its_losses(factor: float):
    """Its modes turn as the weight goes, the first from 1 % to 2.5 %, and nothing is lost."""
    dampers = tuple(Damper(DamperPlace.JOINT, j, c) for j, c in zip("xz", DAMPERS, strict=True))
    C = factor * np.diag(DAMPERS)
    ground, orbit = ratios(np.diag(SPRINGS) + WEIGHT * np.eye(2), C), ratios(np.diag(SPRINGS), C)
    assert np.max(np.abs(orbit / ground - 1.0)) > 0.3
    assert told(Damping(dampers=dampers), ground).damping == pytest.approx(orbit, rel=0.005)


@pytest.mark.parametrize("ratios_of_both", repeats([(0.01, 0.03), (0.016, 0.004)]))
def test_losses_of_the_weight_stay_on_the_ground(ratios_of_both: tuple[float, float]):
    """Springs and weight lose unlike shares of what the model says: 95 % intervals hold, and are not wide.

    Where the springs lose more, the modes in orbit do than any on the ground, and no test says how much more.
    """
    flexible, suspension = ratios_of_both
    rng, model = np.random.default_rng(3), Damping(flexible=flexible, suspension=suspension)
    score = []
    for _ in range(DRAWS):
        off = 0.2 * rng.standard_normal(2)
        own = np.array(ratios_of_both) * np.exp(off)
        measured = lossy(*own, held=True) * np.exp(NOISE * rng.standard_normal(2))
        predicted = told(model, measured)
        error = np.log(predicted.damping / lossy(*own, held=False))
        score.append(error / predicted.damping_std(0.2))
    assert np.mean(np.abs(score) < 1.96) > 0.9
    assert 0.5 < np.sqrt(np.mean(np.square(score))) < 1.2


def test_on_the_ground_again_what_was_measured_comes_back():
    measured = np.array([0.017, 0.044])
    again = told(Damping(flexible=0.01, suspension=0.03), measured, GRAVITY)
    assert again.damping == pytest.approx(measured, rel=1e-9)
    assert again.damping_std(0.3) == pytest.approx(NOISE, rel=1e-6)


def test_what_the_model_has_in_the_suspension_alone_is_lost_with_it_without_a_jump():
    measured = np.array([0.02, 0.03])
    models = [Damping(flexible=f, suspension=0.03) for f in (1e-4, 1e-5, 1e-7, 0.0)]
    some = [told(model, measured).damping for model in models]
    assert np.all(np.diff(some, axis=0) <= 0.0)
    assert some[3] == pytest.approx(some[2], rel=1e-6)
    assert np.all(some[3] < 1e-5)


def test_a_model_without_any_damping_carries_what_was_measured():
    """No part of it is known to be the suspension's; what a mode has of each shape is a mean of both."""
    same = told(Damping(), np.array([0.02, 0.02])).damping
    assert same == pytest.approx(0.02, rel=1e-6)
    mixed = told(Damping(), np.array([0.02, 0.03])).damping
    assert np.all((mixed > 0.02) & (mixed < 0.03))


@pytest.mark.parametrize("gravity", [0.0, GRAVITY / 2.0])
def test_noise_of_the_tests_is_carried_as_far_as_the_ratios_follow_it(gravity: float):
    """Differences of the ratios by what was measured, of independent tests."""
    model, measured = Damping(flexible=0.03, suspension=0.01), np.array([0.025, 0.014])
    step = 0.001 * np.eye(2)
    more, less = ([told(model, measured * np.exp(s * d), gravity).damping for d in step] for s in (1.0, -1.0))
    slope = np.log(np.divide(more, less)) / 0.002
    spread = told(model, measured, gravity).damping_spread
    assert spread == pytest.approx(NOISE * np.linalg.norm(slope, axis=0), rel=1e-4)


def test_dampers_of_devices_are_the_suspensions_and_stay_on_the_ground():
    """A bar that bounces on two loses c over m omega, and keeps nothing of it."""
    mass, c = 8.0, 0.6
    bar = dataclasses.replace(
        build.rigid_bar(mass, 2.0, (0.3, 2.0, 2.0), attach_y=0.1),
        damping=Damping(
            flexible=0.01, dampers=tuple(Damper(DamperPlace.DEVICE, at, c) for at in ("left", "right"))
        ),
    )
    lab = build.on_cables(4.0, 0.25, ("xyz", "yz"), attach=("left", "right"))
    modes = md.solve_modes(md.solve_equilibrium(bar, lab))
    shape = np.abs(modes.shapes[1]) * np.sqrt(mass)
    bounce = np.flatnonzero(shape > 0.999)
    article, suspension = DampingParts.of(modes, bounce).of_parts
    assert suspension == pytest.approx([c / mass / (2.0 * np.pi * 0.25)], rel=1e-3)
    assert article == pytest.approx([0.0], abs=2e-6)


def test_frequencies_that_losses_move_are_reported_where_they_were_taken_for_undamped_ones():
    """Dampers that move a frequency by more than its stated deviation, and whose losses are no unknowns."""
    K, C = np.diag(SPRINGS) + WEIGHT * np.eye(2), np.diag([0.004, 0.3])
    damped, undamped = (np.sort(np.abs(roots(K, lossy))) for lossy in (C, np.zeros((2, 2))))
    off = np.log(damped / undamped)
    assert np.max(np.abs(off)) > 1e-3
    dampers = tuple(Damper(DamperPlace.JOINT, j, c) for j, c in zip("xz", np.diag(C), strict=True))
    found = refined_on_the_ground(Damping(dampers=dampers))
    (one,) = found.compared
    assert shifted_by_losses(one) == pytest.approx(off[one.pairs[:, 1]], rel=1e-6)
    worst = np.max(np.abs(off))  # of both modes: the product of the four roots has no dampers in it
    (warning,) = [line for line in findings(found) if "that of the undamped mode" in line]
    assert f"{100.0 * worst:.2g} %, {worst / 1e-4:.2g} of its stated deviations" in warning
    wide = dataclasses.replace(one, survey=dataclasses.replace(one.survey, frequency_std=0.1))
    same = refined_on_the_ground(Damping(flexible=0.05, suspension=0.05))
    for silent in (dataclasses.replace(found, compared=(wide,)), same):
        assert not any("undamped" in line for line in findings(silent))
