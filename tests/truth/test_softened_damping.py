"""Damping of articles that weight softens or stiffens, against complex eigenvalues of hand-written matrices.

Springs have a loss factor, weight has none and takes none away: an inverted pendulum's ratio is above that of
its springs, by what weight takes of its stiffness, and comes down to it in orbit.
"""

from __future__ import annotations

import dataclasses
import functools
import re
from typing import NamedTuple

import numpy as np
import pytest

import middeck as md
import structure_builders as build
from middeck.errors import ConfigError
from middeck.structure.assembly.energy import inner_forces, split_tangent
from middeck.structure.assembly.linked import dynamic_coordinates
from middeck.structure.correlation.measured_modes import measure_modes
from middeck.structure.model.article import Body, Damping, Section, Spring, Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment, GroundBushing
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damped_modes import solve_damped
from middeck.structure.plants.damping import estimate_damping
from middeck.structure.sensitivity.parameters import find_parameters, set_parameter
from middeck.structure.sensitivity.plant_derivatives import differentiate_plant
from middeck.updating.orbit.predicted_frequencies import predict_modes
from middeck.updating.refinement.refine import refine
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown

GRAVITY = 9.80665
ZETA = 0.013
AXIS = (0.0, 0.0, 1.0)
SECOND = 5e-3  # squares of ratios up to 0.05, and what losses couple


class Chain(NamedTuple):
    """Two bodies in a row in a plane: heights of both centres of mass over their pivots, and of the second
    pivot over the first; stiffnesses of both."""

    first: float
    link: float
    second: float
    springs: tuple[float, float]

    @property
    def mass(self) -> np.ndarray:
        """By the angle of the first and the relative one of the second."""
        reach = np.array([self.link + self.second, self.second])
        M = HEAVY[1] * np.outer(reach, reach) + INERTIA[1]
        M[0, 0] += HEAVY[0] * self.first**2 + INERTIA[0]
        return M

    @property
    def weight(self) -> np.ndarray:
        """Of the energy of heights."""
        first = HEAVY[0] * self.first + HEAVY[1] * self.link
        return -GRAVITY * (HEAVY[1] * self.second * np.ones((2, 2)) + np.diag([first, 0.0]))

    def ratios(self, zeta: float, gravity: float, weight: float = 0.0) -> np.ndarray:
        """Of both modes; ``weight`` is half the loss factor of weight."""
        K = np.diag(self.springs) * (1.0 + 2j * zeta) + gravity * self.weight * (1.0 + 2j * weight)
        s = 1j * np.sqrt(np.linalg.eigvals(np.linalg.solve(self.mass, K)))
        return (-s.real / np.abs(s))[np.argsort(np.abs(s))]


HEAVY, INERTIA = (3.0, 2.0), (0.4, 0.1)
CHAINS = {
    "softens": Chain(0.1, 0.2, 0.1, (20.0, 9.0)),
    "nearly falls": Chain(0.1, 0.2, 0.1, (14.0, 9.0)),
    "stiffens": Chain(-0.1, -0.2, -0.1, (20.0, 9.0)),
    "first stands, second hangs": Chain(0.2, 0.3, -0.2, (20.0, 1.0)),
}
STAND = Environment(title="stand", gravity=np.array([0.0, -GRAVITY, 0.0]), clamps=(Clamp(node="foot"),))
ORBIT = dataclasses.replace(STAND, gravity=np.zeros(3))


def article(chain: Chain, damping: Damping) -> Structure:
    def payload(number: int, height: float) -> Body:
        return Body(HEAVY[number], np.array([0.0, height, 0.0]), np.diag([0.5, 0.5, INERTIA[number]]))

    joints = [
        build.joint("a", "foot", AXIS, payload(0, chain.first), stiffness=chain.springs[0], target=0.0),
        build.joint(
            "b",
            "a",
            AXIS,
            payload(1, chain.second),
            offset=(0.0, chain.link, 0.0),
            stiffness=chain.springs[1],
            target=0.0,
        ),
    ]
    made = build.structure([build.node("foot", (0.0, 0.0, 0.0))], (), joints)
    return dataclasses.replace(made, damping=damping)


def solve(made: Structure, place: Environment) -> Modes:
    return md.solve_modes(md.solve_equilibrium(made, place))


@pytest.mark.parametrize("name", CHAINS)
@pytest.mark.parametrize("gravity", [0.0, 1.0])
def test_ratios_are_those_of_lossy_springs_and_weight_without_loss(name: str, gravity: float):
    chain = CHAINS[name]
    modes = solve(article(chain, Damping(flexible=ZETA)), STAND if gravity else ORBIT)
    exact = chain.ratios(ZETA, gravity)
    for reported in (estimate_damping(modes).zeta, solve_damped(modes).zeta):
        assert reported == pytest.approx(exact, rel=SECOND)
    if gravity:
        assert exact[0] < 0.7 * ZETA if name == "stiffens" else exact[0] > 2.0 * ZETA
        assert exact[1] < 0.4 * ZETA if "hangs" in name else exact[1] > 0.8 * ZETA


def test_weight_that_holds_has_the_suspensions_ratio_and_weight_that_softens_none():
    made = {name: article(CHAINS[name], Damping(flexible=ZETA, suspension=0.04)) for name in CHAINS}
    found = {name: estimate_damping(solve(a, STAND)).zeta for name, a in made.items()}
    for name in ("softens", "nearly falls"):
        assert found[name] == pytest.approx(CHAINS[name].ratios(ZETA, 1.0), rel=SECOND)
    assert found["stiffens"] == pytest.approx(CHAINS["stiffens"].ratios(ZETA, 1.0, 0.04), rel=SECOND)


@functools.cache
def surveyed(name: str, damping: Damping) -> tuple[Structure, Survey]:
    """The article and its survey on the ground, where springs lose 1.3 times what the model says."""
    made = article(CHAINS[name], damping)
    modes = solve(made, STAND)
    seen = measure_modes(modes, [("a", "angle"), ("b", "angle")], chosen=range(2))
    seen = dataclasses.replace(seen, damping=CHAINS[name].ratios(1.3 * ZETA, 1.0), damping_std=None)
    return made, Survey(name="stand", measured=seen, environment=STAND, frequency_std=1e-4)


@pytest.mark.parametrize("name", CHAINS)
def test_what_was_measured_on_the_ground_comes_to_orbit(name: str):
    made, survey = surveyed(name, Damping(flexible=ZETA))
    spring = Unknown(name="spring", parameters=("joint.a.stiffness",), spread=0.1)
    refined = refine(made, [survey], [spring])
    exact = CHAINS[name].ratios(1.3 * ZETA, 0.0)
    assert predict_modes(refined, ORBIT, count=2).damping == pytest.approx(exact, rel=SECOND)


@pytest.mark.parametrize("name", CHAINS)
def test_derivatives_are_differences(name: str):
    made = article(CHAINS[name], Damping(flexible=ZETA, suspension=0.04))
    names = ["joint.a.stiffness", "joint.b.mass", "damping.flexible", "damping.suspension"]
    parameters = find_parameters(made, STAND, names)
    found = differentiate_plant(solve(made, STAND), parameters, inputs=[], outputs=[])
    for parameter, plant in zip(parameters, found, strict=True):
        step = 1e-5 * parameter.value
        more, less = (
            estimate_damping(solve(*set_parameter(made, STAND, parameter, parameter.value + h))).zeta
            for h in (step, -step)
        )
        slope = (more - less) / (2.0 * step)
        assert plant.zeta == pytest.approx(slope, rel=1e-5, abs=1e-7 * np.abs(slope).max() + 1e-12)


def test_a_body_above_its_devices():
    """On a lossy base whose pull has no part in the loss: rocking and swaying, coupled by the height."""
    heavy, height, inertia, sway, rock = 4.0, 0.3, 0.2, 900.0, 25.0
    node = build.node("a", (0, 0, 0), Body(heavy, np.array([0.0, height, 0.0]), np.diag([inertia] * 3)))
    attach = [build.AttachPoint("foot", "a", np.zeros(3))]
    stiffness = np.diag([sway, 4e4, 1e5, 1e4, 1e4, rock])
    base = GroundBushing(name="base", attach="foot", stiffness=stiffness)
    place = dataclasses.replace(STAND, clamps=(), bushings=(base,))
    made = dataclasses.replace(build.structure([node], attach=attach), damping=Damping(suspension=0.02))
    M = np.array([[heavy, -heavy * height], [-heavy * height, inertia + heavy * height**2]])
    K = np.diag([sway, rock]) * (1.0 + 0.04j) + np.diag([0.0, -heavy * GRAVITY * height])
    s = 1j * np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)))
    exact = (-s.real / np.abs(s))[np.argsort(np.abs(s))]
    modes = solve(made, place)
    both = [int(np.argmin(np.abs(modes.omega - abs(root)))) for root in s[np.argsort(np.abs(s))]]
    assert modes.omega[both] == pytest.approx(np.sort(np.abs(s)), rel=SECOND)
    assert estimate_damping(modes).zeta[both] == pytest.approx(exact, rel=SECOND)
    assert exact[0] > 0.03


def test_softened_modes_of_nearly_one_frequency_share_their_losses():
    """A payload above two axes: weight takes unlike parts of their stiffness, and leaves one frequency."""
    above, inertia, springs = 0.1, np.array([[0.5, 0.004], [0.004, 1.0]]), np.array([5.5, 8.1])
    weight = HEAVY[0] * GRAVITY * above
    about = np.diag([inertia[0, 0], 1.0, inertia[1, 1]])
    about[0, 2] = about[2, 0] = inertia[0, 1]
    payload = Body(
        HEAVY[0], np.array([0.0, above, 0.0]), about - HEAVY[0] * above**2 * np.diag([1.0, 0.0, 1.0])
    )
    joints = [
        build.joint("x", "foot", (1.0, 0.0, 0.0), stiffness=springs[0], target=0.0),
        build.joint("z", "x", AXIS, payload, stiffness=springs[1], target=0.0),
    ]
    made = build.structure([build.node("foot", (0.0, 0.0, 0.0))], (), joints)
    modes = solve(dataclasses.replace(made, damping=Damping(flexible=ZETA, suspension=0.04)), STAND)
    s = 1j * np.sqrt(
        np.linalg.eigvals(np.linalg.solve(inertia, np.diag(springs) * (1.0 + 2j * ZETA) - weight * np.eye(2)))
    )
    exact = np.sort(-s.real / np.abs(s))
    found = estimate_damping(modes)
    (warning,) = (w for w in found.warnings if "share their losses" in w)
    reported = [float(x) for x in re.search(r"would be ([\d.]+) and ([\d.]+)", warning).groups()]
    assert np.sort(reported) == pytest.approx(exact, rel=SECOND)
    assert np.abs(np.sort(found.zeta) / exact - 1.0).max() > 0.02


def test_large_losses_that_couple_nothing_are_no_shared_losses():
    """One loss factor in a cantilever in weight: its roots have sin(atan(2 zeta) / 2), which is less."""
    section = Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=101.0, rho_A=0.5, rho_I_y=1e-5, rho_I_z=1e-5)
    nodes = [build.node("foot", (0.0, 0.0, 0.0)), build.node("tip", (2.0, 0.0, 0.0), build.body(0.2))]
    made = build.structure(nodes, [build.member("foot", "tip", section, 8)])
    for zeta in (0.02, 0.1, 0.5):
        modes = solve(dataclasses.replace(made, damping=Damping(flexible=zeta)), STAND)
        assert not any("share their losses" in w for w in estimate_damping(modes, count=6).warnings)


@pytest.mark.parametrize("free_length", [1.9, 2.1])
def test_preload_holds_or_softens_without_loss_in_orbit_too(free_length: float):
    """A beam with a stay between its ends that presses it together, or pulls at it, against K (1 + j eta)."""
    section = Section(EA=3e5, GJ=20.0, EI_y=30.0, EI_z=40.0, rho_A=0.3, rho_I_y=1e-4, rho_I_z=1e-4)
    lump = build.body(0.4, (0.0, 0.0, 0.0), (1e-2, 2e-2, 3e-2))
    made = build.structure(
        [build.node(n, (x, 0, 0), lump) for n, x in zip("abc", (0.0, 1.0, 2.0), strict=True)],
        [build.member("a", "b", section, 2), build.member("b", "c", section, 2)],
        attach=[build.AttachPoint(n, n, np.zeros(3)) for n in "ac"],
        springs=[Spring(name="stay", start="a", end="c", stiffness=500.0, free_length=free_length)],
    )
    rest = md.solve_equilibrium(made, Environment.orbit())
    forces = inner_forces(rest.model, rest.config, rest.loads)
    parts, modes = split_tangent(rest.model, rest.config, rest.loads, forces), md.solve_modes(rest)
    active = dynamic_coordinates(rest.model)
    K, G, M = (x[active][:, active].toarray() for x in (parts.material, parts.geometric, modes.mass))
    lam = np.linalg.eigvals(np.linalg.solve(M, K * (1.0 + 2j * ZETA) + G))
    s = 1j * np.sqrt(lam[np.argsort(lam.real)][6:12])
    exact = -s.real / np.abs(s)
    found = estimate_damping(modes, Damping(flexible=ZETA, suspension=0.04)).zeta[6:12]
    assert found == pytest.approx(exact, rel=SECOND)
    assert np.abs(exact / ZETA - 1.0).max() > 0.3


def test_a_mode_that_all_but_falls_over_has_no_ratio_and_the_reason_is_reported():
    chain = Chain(0.1, 0.2, 0.1, (9.5, 9.0))
    modes = solve(article(chain, Damping(flexible=ZETA)), STAND)
    with pytest.raises(ConfigError, match=r"ratio 1.04: weight or preload takes 98\.\d+% of its") as caught:
        estimate_damping(modes)
    assert "farther from falling over" in caught.value.hint
