"""Frequencies predicted to second order in what no test saw, against closed forms and quadrature."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import middeck as md
import structure_builders as build
from middeck.structure.correlation.measured_modes import measure_modes
from middeck.structure.model.article import Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment
from middeck.structure.model.section import Section
from middeck.updating.orbit.predicted_frequencies import Prediction, predict_modes
from middeck.updating.refinement.curvature import frequency_curvature
from middeck.updating.refinement.refine import refine
from middeck.updating.residuals.surveys import Survey, set_up
from middeck.updating.unknowns.unknowns import Unknown

# Two bodies that twist against each other: f^2 = k (1 / J1 + 1 / J2), and k / J2 where the first is clamped.
J1, J2, K, SPREAD, STD = 0.5, 0.3, 40.0, 0.4, 1e-5
CLAMPED = Environment(title="stand", gravity=np.zeros(3), clamps=(Clamp(node="hub"),))
FREE = dataclasses.replace(CLAMPED, title="free", clamps=())
UNSEEN = Unknown(name="hub", parameters=("node.hub.inertia.xx",), spread=SPREAD)
SPRING = Unknown(name="spring", parameters=("joint.ring.stiffness",), spread=0.1)


def two_bodies() -> Structure:
    hub = build.node("hub", (0.0, 0.0, 0.0), build.body(5.0, inertia=(J1, 0.4, 0.4)))
    disc = build.body(2.0, inertia=(J2, 0.2, 0.2))
    ring = build.joint("ring", "hub", np.eye(3)[0], disc, stiffness=K, target=0.0)
    return build.structure([hub], (), [ring])


def told(tested: Environment, place: Environment, spring: float) -> Prediction:
    """The one twisting mode in ``place``, after a test of it in another; ``spring`` is the prior's spread."""
    modes = md.solve_modes(md.solve_equilibrium(two_bodies(), tested))
    index = [next(i for i, kind in enumerate(modes.kind) if kind != "rigid")]
    seen = measure_modes(modes, [("hub", "rx"), ("ring", "angle")], chosen=index)
    survey = Survey(name="test", measured=seen, environment=tested, frequency_std=STD)
    found = refine(two_bodies(), [survey], (UNSEEN, dataclasses.replace(SPRING, spread=spring)), 1e-6)
    return predict_modes(found, place, count=1)


def ln_hz(off: np.ndarray, free: bool) -> np.ndarray:
    """At logarithms of factors on J1, the spring as drawn."""
    return 0.5 * np.log(K * (free * np.exp(-off) / J1 + 1.0 / J2)) - np.log(2.0 * np.pi)


def moments(values: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    mean = weight @ values / weight.sum()
    return float(mean), float(np.sqrt(weight @ (values - mean) ** 2 / weight.sum()))


OFF = np.linspace(-6.0, 6.0, 2001) * SPREAD
PRIOR = np.exp(-0.5 * (OFF / SPREAD) ** 2)


def test_a_frequency_has_the_mean_and_the_deviation_of_what_no_test_saw():
    """The clamped test says nothing of J1: ln f over its normal prior."""
    predicted = told(CLAMPED, FREE, 0.1)
    mean, deviation = moments(ln_hz(OFF, True), PRIOR)
    assert mean - ln_hz(np.zeros(1), True)[0] > 0.008
    assert np.log(predicted.frequency_hz[0]) == pytest.approx(mean, abs=0.0008)
    assert predicted.log_std[0] == pytest.approx(deviation, rel=0.03)


def test_a_bent_test_bends_what_is_inferred_by_it():
    """A free test holds k to J1 on a bent line: clamped, ln f is bent although it is linear in ln k."""
    predicted = told(FREE, CLAMPED, 1.0)
    # On the line the spring makes up for J1; both have their prior.
    spring = 2.0 * (ln_hz(np.zeros(1), True) - ln_hz(OFF, True))
    mean, deviation = moments(ln_hz(OFF, False) + 0.5 * spring, PRIOR * np.exp(-0.5 * spring**2))
    straight = ln_hz(np.zeros(1), False)[0]
    assert straight - mean > 0.006
    assert np.log(predicted.frequency_hz[0]) == pytest.approx(mean, abs=0.0015)
    assert predicted.log_std[0] == pytest.approx(deviation, rel=0.03)


def test_where_it_was_tested_a_frequency_is_what_was_measured():
    predicted = told(FREE, FREE, 1.0)
    assert np.log(predicted.frequency_hz[0]) == pytest.approx(ln_hz(np.zeros(1), True)[0], abs=STD)
    assert predicted.log_std[0] < 2.0 * STD


@pytest.mark.parametrize("gravity", [0.0, 9.80665])
def test_a_cantilever_that_sags_is_not_bent_by_modulus_and_mass(gravity: float):
    """ln f is half of ln E - ln rho, but for what its sag of 1 % of its length does."""
    tube = Section(EA=2.5e7, GJ=2000.0, EI_y=2700.0, EI_z=2500.0, rho_A=1.0, rho_I_y=1e-4, rho_I_z=1e-4)
    wall = Environment(title="wall", gravity=np.array([0.0, -gravity, 0.0]), clamps=(Clamp(node="a"),))
    both = [Unknown(name=n, parameters=(f"members.{n}",), spread=0.1) for n in ("E", "rho")]
    there = set_up(build.straight_beam(tube, 2.1, 6), wall, (), both)
    curvature = frequency_curvature(there.solve(np.zeros(2)), there.bound, np.arange(4))
    assert np.abs(curvature).max() < 0.001


def test_a_bar_on_cables_is_not_bent_by_their_length_their_bounce_and_its_mass():
    """Turning on its cables: omega^2 = W b^2 / (L I), I by the mass; bounce as tuned, whatever its mass."""
    bar = build.rigid_bar(8.0, 2.0, (0.3, 2.0, 2.0), attach_y=0.1)
    lab = build.on_cables(4.0, 0.4, ("xyz", "yz"), attach=("left", "right"))
    names = ("environment.cable_length", "environment.bounce_hz", "node.bar.mass")
    own = [Unknown(name=n, parameters=(n,), spread=0.1) for n in names]
    there = set_up(bar, lab, (), own)

    def ln_hz(x: np.ndarray) -> np.ndarray:
        modes = there.solve(x)
        return np.log([modes.frequency_hz[modes.name.index(n)] for n in ("yaw", "bounce")])

    modes, step = there.solve(np.zeros(3)), 0.02 * np.eye(3)
    middle = ln_hz(np.zeros(3))
    for way in (*step, step[0] + step[2], step[1] + step[2]):
        assert ln_hz(way) + ln_hz(-way) - 2.0 * middle == pytest.approx(0.0, abs=2e-7)
    index = np.array([modes.name.index(n) for n in ("yaw", "bounce")])
    assert np.abs(frequency_curvature(modes, there.bound, index)).max() < 0.001


def curved(structure: Structure, place: Environment, own: list[Unknown]) -> np.ndarray:
    """Second derivatives of ln f of the modes that are not rigid."""
    there = set_up(structure, place, (), own)
    modes = there.solve(np.zeros(len(own)))
    index = np.array([i for i, kind in enumerate(modes.kind) if kind != "rigid"])
    return frequency_curvature(modes, there.bound, index[:6])


@pytest.mark.parametrize("what", ["E", "rho"])
def test_a_factor_on_sections_that_have_unknowns_of_their_own_bends_nothing(what: str):
    """Both multiply the same numbers, so that ln f is linear in both, and in twice one of them."""
    tube = Section(EA=2.5e7, GJ=2000.0, EI_y=2700.0, EI_z=2500.0, rho_A=1.0, rho_I_y=1e-4, rho_I_z=1e-4)
    wall = Environment(title="wall", gravity=np.zeros(3), clamps=(Clamp(node="a"),))
    fields = {"E": ("EI_y", "EI_z"), "rho": ("rho_A",)}[what]
    parameters = ((f"members.{what}",), tuple(f"member.a-b.{f}" for f in fields))
    both = [Unknown(name=p[0], parameters=p, spread=0.1) for p in (*parameters, sum(parameters, ()))]
    beam = build.straight_beam(tube, 2.1, 6)
    assert np.abs(curved(beam, wall, both[:2])[:4]).max() < 0.001
    assert np.abs(curved(beam, wall, both[2:])[:4]).max() < 0.001


def test_a_centre_of_mass_bends_by_its_square_and_with_its_mass():
    """A body turning on a spring: f^2 goes with 1 / (J + m c^2), whose second term is the share s of it."""
    mass, arm, inertia = 2.0, 0.3, 0.02
    hub = build.node("hub", (0.0, 0.0, 0.0), build.body(5.0, inertia=(J1, 0.4, 0.4)))
    body = build.body(mass, (0.0, arm, 0.0), (inertia, 0.02, 0.02))
    ring = build.joint("ring", "hub", np.eye(3)[0], body, stiffness=K, target=0.0)
    names = [f"joint.ring.{name}" for name in ("mass", "cg.y", "inertia.xx")]
    own = [Unknown(name=n, parameters=(n,), spread=0.1) for n in names]
    share = mass * arm**2 / (inertia + mass * arm**2)
    shape = np.array([[-0.5, -1.0, 0.5], [-1.0, -2.0, 1.0], [0.5, 1.0, -0.5]])
    (found,) = curved(build.structure([hub], (), [ring]), CLAMPED, own)
    assert found == pytest.approx(share * (1.0 - share) * shape, rel=3e-4)


@pytest.mark.parametrize("added", [False, True])
def test_modes_that_a_cable_holds_in_part_are_bent_as_differences_say(added: bool):
    """Length and bounce as factors and as amounts, and the mass that cables carry, over all modes."""
    bar = build.rigid_bar(8.0, 2.0, (0.3, 2.0, 2.0), attach_y=0.1)
    lab = build.on_cables(4.0, 0.4, ("xyz", "yz"), attach=("left", "right"))
    names = ("environment.cable_length", "environment.bounce_hz", "node.bar.mass")
    own = [Unknown(name=n, parameters=(n,), spread=0.1, added=added) for n in names]
    there = set_up(bar, lab, (), own)
    middle = there.solve(np.zeros(3))
    steps = np.diag([0.02, 0.004, 0.1] if added else [0.02, 0.02, 0.02])

    def ln_hz(x: np.ndarray) -> np.ndarray:
        return np.log(there.solve(x).frequency_hz)

    found = frequency_curvature(middle, there.bound, np.arange(6))
    for k, a in enumerate(steps):
        for j, b in enumerate(steps[: k + 1]):
            differ = (ln_hz(a + b) - ln_hz(a - b) - ln_hz(b - a) + ln_hz(-a - b)) / (4.0 * a.sum() * b.sum())
            assert found[:, k, j] == pytest.approx(differ, rel=2e-3, abs=1e-4)
    assert np.abs(found).max() > 0.2


@pytest.mark.parametrize("name", ["node.b.position.x", "node.b.position.z", "node.b.size"])
def test_a_dimension_known_to_a_thousandth_bends_no_frequency(name: str):
    """By differences ln f is bent by less than 1e-5; nothing of it strains a member, which rests as drawn."""
    tube = Section(EA=2.5e7, GJ=2000.0, EI_y=2700.0, EI_z=1500.0, rho_A=1.0, rho_I_y=1e-4, rho_I_z=1e-4)
    wall = Environment(title="wall", gravity=np.zeros(3), clamps=(Clamp(node="a"),))
    spread = 0.002
    own = [Unknown(name="off", parameters=(name,), spread=spread, added=True)]
    there = set_up(build.straight_beam(tube, 2.1, 3), wall, (), own)
    lower, middle, upper = (np.log(there.solve(np.array([x])).frequency_hz[:4]) for x in (0.0, 2e-3, 4e-3))
    assert upper + lower - 2.0 * middle == pytest.approx(0.0, abs=1e-5)
    found = frequency_curvature(there.solve(np.zeros(1)), there.bound, np.arange(4))
    assert np.abs(found).max() * spread**2 < 1e-5
