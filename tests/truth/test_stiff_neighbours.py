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
from middeck.structure.hanging.device_friction import estimate_rest_band
from middeck.structure.model.article import Actuator, ActuatorKind, Section, Sensor, SensorKind
from middeck.structure.model.environment import Device, Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import Equilibrium, solve_equilibrium
from middeck.structure.sensitivity.frequency_derivatives import differentiate_frequencies
from middeck.structure.sensitivity.parameters import find_parameters
from middeck.structure.sensitivity.plant_derivatives import differentiate_plant
from middeck.structure.sensitivity.rest import differentiate_rest
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


def stiffer(case: Case, by: float) -> Case:
    """The link's modulus greater by a share."""
    parts = {name: (1.0 + by) * getattr(case.section[1], name) for name in ("EA", "GJ", "EI_y", "EI_z")}
    return case._replace(section=(case.section[0], dataclasses.replace(case.section[1], **parts)))


def refusal(call: Callable[[], object], ratio: float) -> bool:
    """Whether it is refused: by the name of the link, and of no soft one."""
    try:
        call()
    except NumericalError as error:
        return "'b-c'" in str(error) and ratio > LEAST_REFUSED
    return False


def slope(at: Callable[[float], np.ndarray], h: float = 1e-3) -> np.ndarray:
    """By differences of the fourth order."""
    wide, near = at(h) - at(-h), at(0.5 * h) - at(-0.5 * h)
    return (8.0 * near - wide) / (6.0 * h)


@pytest.mark.parametrize("seed", repeats(SEEDS))
def test_derivatives_beside_a_link_of_any_stiffness(seed: int):
    """Against differences of the solution by hand; from 1e4 to 1e18 times the springs, none refused."""
    rng = np.random.default_rng(seed)
    case = with_link(draw(rng), 10.0 ** rng.uniform(4, 18))
    rest = solve_equilibrium(*article_of(case))
    modes = solve_modes(rest)
    names = ["node.b.mass", "member.b-c.EI_y", "member.b-c.E", "members.E"]
    mass, *stiffness = parameters = find_parameters(*article_of(case), names)
    found = differentiate_frequencies(modes, parameters, 6)
    expected = slope(lambda by: solve(heavier(case, by)).omega[:6] ** 2)
    size = modes.omega[5] ** 2
    # Members bend by 1e-6 and rounding leaves 1e-5, differences of differences 1e-5 of the largest.
    assert found.d_lambda[0] == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())
    # What is all but rigid has next to no part in a frequency, the less the stiffer it is.
    part = slope(lambda by: solve(stiffer(case, by)).omega[:6] ** 2, 0.1)
    own, link, every = (d * p.value for d, p in zip(found.d_lambda[1:], stiffness, strict=True))
    assert link == pytest.approx(part, abs=1e-6 * size)
    assert every == pytest.approx(part, abs=1e-4 * size)
    assert np.all(np.abs(own) < 2.0 * np.abs(part) + 1e-4 * size)
    motion = differentiate_rest(rest, [mass]).motion[:, 0].reshape(3, 6)[:, :3]
    shift = slope(lambda by: solve(heavier(case, by)).shift)
    assert motion == pytest.approx(shift, abs=1e-5 * np.abs(shift).max())


def test_derivatives_in_orbit_and_of_plants_are_those_beside_a_softer_link():
    """Where nothing holds the article its softest mode counts: 1e13 times the springs are 1e6 times that."""
    case = draw(np.random.default_rng(503))
    found = []
    for ratio in (1e13, 1e19):
        article, _ = article_of(with_link(case, ratio, SOFTER))
        force = Actuator(name="push", frame="a", axis=np.array([0.0, 1.0, 0.0]), kind=ActuatorKind.FORCE)
        seen = Sensor(name="seen", frame="c", axis=np.array([0.0, 1.0, 0.0]), kind=SensorKind.ACCELEROMETER)
        article = dataclasses.replace(article, actuators=(force,), sensors=(seen,))
        modes = solve_modes(solve_equilibrium(article, Environment.orbit()))
        names = find_parameters(article, Environment.orbit(), ["node.b.mass", "member.a-b.E"])
        few = differentiate_frequencies(modes, names, 8).d_lambda
        plants = differentiate_plant(modes, names, inputs=["push"], outputs=["seen"], count=8)
        found.append((few, [p.zeta for p in plants], [p.A for p in plants], [np.abs(p.B) for p in plants]))
    for soft, stiff in zip(*found, strict=True):
        assert np.asarray(stiff) == pytest.approx(np.asarray(soft), abs=1e-4 * np.abs(soft).max())


def test_modes_that_the_link_itself_makes_are_refused_by_name_with_how_many_are_not():
    case = with_link(draw(np.random.default_rng(501)), 1e14)
    modes = solve_modes(solve_equilibrium(*article_of(case)))
    parameters = find_parameters(*article_of(case), ["node.b.mass"])
    with pytest.raises(NumericalError, match=r"member 'b-c' is .* moves mode \d+ of") as error:
        differentiate_frequencies(modes, parameters)
    fewer = int(error.value.hint.split()[1])
    assert differentiate_frequencies(modes, parameters, fewer).d_lambda.shape == (1, fewer)


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
    size = np.abs(found.corner).reshape(6, -1).max(axis=1) * found.hz_per_omega2
    assert np.all(np.abs(found.share_hz.sum(axis=1) - found.shift_hz) < 1e-14 * size + 1e-12)
    # Rows that lose their shape are told; and the highest modes may be the softer link's own.
    hung, softer = found.frequency_hz[:, 1], expected.frequency_hz[:, 1]
    same = np.abs(hung - softer) < 1e-4 * softer
    assert np.all(same[:4])
    same[list(found.doubtful)] = False
    assert (
        np.abs((found.share_hz - expected.share_hz)[same]).max()
        < 1e-3 * np.abs(expected.share_hz[same]).max()
    )


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
