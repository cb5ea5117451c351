"""What is worked out in W beside stiff members: right, or refused with the member named."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from stiff_links import BEND, Case, G, article_of, draw, solve

from middeck.errors import NumericalError
from middeck.joints.friction import Friction
from middeck.structure.gravity.budget import GravityBudget, build_budget
from middeck.structure.model.article import Section
from middeck.structure.model.environment import Device, Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import Equilibrium, solve_equilibrium
from middeck.structure.sensitivity.frequencies import differentiate_frequencies
from middeck.structure.sensitivity.parameters import find_parameters
from middeck.structure.sensitivity.rest import differentiate_rest
from middeck.structure.suspension.device_friction import estimate_rest_band
from repeats import repeats

SEEDS = repeats(range(500, 700), 3)
SOFTER = 1e7
# Pendulums are softer than the springs together, by up to this.
LEAST_REFUSED = 1e8


def with_link(case: Case, ratio: float, carries: float | None = None) -> Case:
    """The same with a link so many times as stiff as all springs, a body that one of ``carries`` bears."""
    way = case.at[2] - case.at[1]
    length = max(float(np.linalg.norm(way)), 0.1)  # the softest link is then no thread
    at = np.vstack([case.at[:2], case.at[1] + length * way / np.linalg.norm(way)])
    EI, weak = (r * case.stiffness.sum() * length**3 / 12.0 for r in (ratio, carries or ratio))
    link = Section(EA=EI / 4e-4, GJ=0.8 * EI, EI_y=EI, EI_z=EI, rho_A=0.0, rho_I_y=0.0, rho_I_z=0.0)
    least = min(1.0, BEND * 2.0 * weak / (G * length**2) / case.mass[2])
    light = np.array([1.0, 1.0, least])
    section = (case.section[0], link)
    return case._replace(
        at=at, section=section, mass=case.mass * light, inertia=case.inertia * light[:, None]
    )


def heavier(case: Case, by: float) -> Case:
    return case._replace(mass=case.mass + np.array([0.0, by, 0.0]))


def refusal(call: Callable[[], object], ratio: float) -> bool:
    """Whether it is refused: by the name of the link, and of no soft one."""
    try:
        call()
    except NumericalError as error:
        return "'b-c'" in str(error) and ratio > LEAST_REFUSED
    return False


@pytest.mark.parametrize("seed", SEEDS)
def test_derivatives_of_frequencies_are_right_or_refused(seed: int):
    """Against differences of the solution by hand; from 1e4 to 1e18 times the springs."""
    rng = np.random.default_rng(seed)
    ratio = 10.0 ** rng.uniform(4, 18)
    case = with_link(draw(rng), ratio)
    modes = solve_modes(solve_equilibrium(*article_of(case)))
    parameters = find_parameters(*article_of(case), ["node.b.mass"])
    if refusal(lambda: differentiate_frequencies(modes, parameters, 6), ratio):
        return
    found = differentiate_frequencies(modes, parameters, 6).d_lambda[0]
    h = 1e-3
    lam = [solve(heavier(case, step)).omega[:6] ** 2 for step in (h, -h, 0.5 * h, -0.5 * h)]
    expected = (8.0 * (lam[2] - lam[3]) - (lam[0] - lam[1])) / (6.0 * h)
    assert found == pytest.approx(expected, rel=2e-3, abs=2e-3 * modes.omega[5] ** 2)


def budget(case: Case) -> GravityBudget:
    article, lab = article_of(case)
    return build_budget(*(solve_modes(solve_equilibrium(article, e)) for e in (Environment.orbit(), lab)), 6)


@pytest.mark.parametrize("seed", SEEDS)
def test_shares_of_gravity_are_those_beside_a_softer_link_or_refused(seed: int):
    """A link of 1e7 times its springs is rigid to 1e-7; and shares sum to the shift."""
    rng = np.random.default_rng(seed)
    ratio = 10.0 ** rng.uniform(8, 18)
    case = draw(rng)
    if refusal(lambda: budget(with_link(case, ratio, SOFTER)), ratio):
        return
    found, expected = budget(with_link(case, ratio, SOFTER)), budget(with_link(case, SOFTER))
    shift = np.abs(found.shift_hz).max()
    assert found.share_hz.sum(axis=1) == pytest.approx(found.shift_hz, abs=1e-12 * shift)
    assert np.abs(found.share_hz - expected.share_hz).max() < 1e-3 * np.abs(expected.share_hz).max()


def rubbing(case: Case) -> Equilibrium:
    """On devices with friction in place of the springs."""
    article, lab = article_of(case)
    pull = case.mass.sum() * G / 4.0
    rub = Friction(0.05, 1e4)
    devices = tuple(
        Device(name=s.name, attach=s.attach, force=pull, stiffness=s.stiffness, anchor=s.anchor, friction=rub)
        for s in lab.springs
    )
    return solve_equilibrium(article, dataclasses.replace(lab, springs=(), devices=devices))


@pytest.mark.parametrize("ratio", [1e9, 1e12, 1e16, 1e20])
def test_the_band_of_rest_is_that_beside_a_softer_link(ratio: float):
    """Friction moves what is soft, whatever is stiff beside it."""
    case = draw(np.random.default_rng(503))
    found, expected = (estimate_rest_band(rubbing(with_link(case, r, SOFTER))) for r in (ratio, SOFTER))
    assert found.travel == pytest.approx(expected.travel, rel=1e-4)
    assert found.shift == pytest.approx(expected.shift, rel=1e-4)
    assert found.turn == pytest.approx(expected.turn, rel=1e-4)


def test_rest_states_have_no_derivative_beside_a_link_too_stiff():
    case = with_link(draw(np.random.default_rng(501)), 1e14)
    rest = solve_equilibrium(*article_of(case))
    with pytest.raises(NumericalError, match="member 'b-c' is"):
        differentiate_rest(rest, find_parameters(*article_of(case), ["node.b.mass"]))
