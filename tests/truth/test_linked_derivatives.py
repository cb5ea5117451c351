"""Derivatives, budgets and reductions of linked articles: closed forms, the whole solved again, limits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from reduced import bent_beam
from test_exact_links import ZERO, G, hung, linked, tangled
from test_sensitivities import lab_article, size

from middeck.errors import ConfigError, NumericalError
from middeck.structure.gravity.budget import GravityBudget, build_budget
from middeck.structure.model.article import (
    Actuator,
    ActuatorKind,
    AttachPoint,
    Bushing,
    JointState,
    Sensor,
    SensorKind,
    Spring,
    Structure,
)
from middeck.structure.model.environment import AnchoredSpring, Environment, GroundBushing
from middeck.structure.model.links import Equation, Interpolation, Link, Share, Term
from middeck.structure.modes.craig_bampton import reduce_structure
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.structure.sensitivity.frequency_derivatives import differentiate_frequencies
from middeck.structure.sensitivity.parameters import (
    ModelParameter,
    find_parameters,
    list_parameters,
    set_parameter,
)
from middeck.structure.sensitivity.plant_derivatives import differentiate_plant
from middeck.structure.sensitivity.rest import differentiate_rest
from repeats import LONG, repeats
from structure_builders import GRAVITY, TUBE, body, member, node, structure

Both = tuple[Structure, Environment]
PORTS = ("actuator", "sensor", "damping")


def solve(parts: Structure, environment: Environment) -> Modes:
    return solve_modes(solve_equilibrium(parts, environment))


def drawn_case(rng: np.random.Generator) -> Both:
    """Two kinds of link, a beam and a joint under gravity on soft bushings, some of it clamped."""
    whole = tangled(rng)
    while True:
        links = tuple(whole.links[i] for i in sorted(rng.choice(5, 2, replace=False)))
        names = {f for link in links for f in link.frames if f != "j"} | {"a", "b", "c"}
        if names - {"a", "b", "c"}:
            break
    nodes = tuple(n for n in whole.nodes if n.name in names)
    free = rng.random() < 0.5 and not any(isinstance(link, Equation) for link in links)
    hangs = body(0.5, (0.0, -0.16, 0.12), (0.1, 0.1, 0.1))
    state = JointState.FREE if free else JointState.SPRUNG
    joint = dataclasses.replace(whole.joints[0], body=hangs, stiffness=30.0, state=state)
    points = tuple(AttachPoint(n.name, n.name, rng.uniform(-0.1, 0.1, 3)) for n in nodes)
    tie = Spring(name="tie", start="a", end="c", stiffness=50.0, free_length=0.3)
    round_bar = dataclasses.replace(TUBE, rho_I_y=1e-3, rho_I_z=1e-3)
    bars = (dataclasses.replace(whole.members[0], section=round_bar, elements=1),)
    parts = dataclasses.replace(
        whole, members=bars, nodes=nodes, joints=(joint,), attach_points=points, springs=(tie,), links=links
    )
    held = ("a",) if rng.random() < 0.5 else ()
    root = np.sqrt(np.diag([300.0] * 3 + [40.0] * 3))
    bushings = []
    for name in sorted(names - set(held)):
        A = rng.standard_normal((6, 6))
        stiffness = root @ (0.05 * A @ A.T + np.eye(6)) @ root
        bushings.append(GroundBushing(name=f"on {name}", attach=name, stiffness=stiffness))
    gravity = rng.uniform(0.2, 1.0) * GRAVITY
    return parts, dataclasses.replace(hung(*held, gravity=gravity), bushings=tuple(bushings))


def moved(both: Both, parameters: list[ModelParameter], way: np.ndarray, step: float) -> Both:
    for p, w in zip(parameters, way, strict=True):
        both = set_parameter(*both, p, p.value + step * w)
    return both


def along(both: Both, parameters: list[ModelParameter], way: np.ndarray, of, h: float) -> np.ndarray:
    """Difference of fourth order of what ``of`` makes of the whole, solved again."""
    before = [of(*moved(both, parameters, way, k * h)) for k in (-2, -1, 1, 2)]
    return (before[0] - 8.0 * before[1] + 8.0 * before[2] - before[3]) / (12.0 * h)


def check_along_all(both: Both, rng: np.random.Generator, h: float = 2e-3) -> None:
    """All parameters (a fifth in `make test`) at once, each by a random part of its size: one way for all."""
    modes = solve(*both)
    count = min(8, len(modes.omega))
    # Of an axis one component: each turns it, and those set later take back what the others did.
    others = (".axis.x", ".axis.y")
    every = [
        p for p in list_parameters(*both) if not p.name.startswith(PORTS) and not p.name.endswith(others)
    ]
    parameters = [p for k, p in enumerate(every) if LONG or rng.random() < 0.2 or p.name.startswith("link")]
    found = differentiate_frequencies(modes, parameters, count)
    way = rng.standard_normal(len(parameters)) * [size(p) for p in parameters] / len(parameters) ** 0.5
    want = along(both, parameters, way, lambda *b: solve(*b).omega[:count] ** 2, h)
    scale = np.abs(way[:, None] * found.d_lambda).max(axis=0) + modes.omega[:count] ** 2
    np.testing.assert_allclose((way @ found.d_lambda - want) / scale, 0.0, atol=1e-6)


@pytest.mark.parametrize("seed", repeats(range(30)))
def test_frequencies_of_random_linked_articles(seed: int) -> None:
    rng = np.random.default_rng([77, seed])
    check_along_all(drawn_case(rng), rng)


def pendulum(about_x: float, length: float = 0.7) -> Structure:
    nodes = [node("a", ZERO), node("b", (0.0, -length, 0.0), body(2.0, inertia=(about_x, 0.02, 0.03)))]
    ball = Link(name="ball", first="a", second="b", about="y", offset=np.array([0.0, length, 0.0]))
    return linked(structure(nodes), ball)


@pytest.mark.parametrize("about_x", [0.01, 0.03])  # the second is two modes of one frequency
def test_a_pendulum_on_a_link_follows_the_length_of_its_arm(about_x: float) -> None:
    """omega^2 = m g L / (m L^2 + I); where its body is drawn, with the pivot above, changes nothing."""
    both, m, L = (pendulum(about_x), hung("a")), 2.0, 0.7
    names = ["link.ball.offset.y", "node.b.mass", "node.b.position.y", "environment.gravity.y"]
    found = differentiate_frequencies(solve(*both), find_parameters(*both, names))
    whole = m * L**2 + np.array([0.03, about_x])
    lam = m * G * L / whole
    want = [lam / L - lam * 2.0 * m * L / whole, lam / m - lam * L**2 / whole, 0.0 * lam, -lam / G]
    np.testing.assert_allclose(found.d_lambda, want, rtol=1e-11, atol=1e-11)


def test_a_short_arm_leaves_frequencies_their_digits() -> None:
    """Shifts follow turns there, never turns shifts, with factors as large as the arm is short."""
    both = drawn_case(np.random.default_rng([77, 0]))
    (arm,) = find_parameters(*both, ["link.hinge.offset.y"])
    for short in (-3e-5, 1e-7):
        modes = solve(*set_parameter(*both, arm, short))
        assert modes.residual.max() < 1e-9


def test_what_repeats_others_has_derivatives_as_long_as_it_does() -> None:
    nodes = [node(n, (k, 0.0, 0.0), body(1.0 + k, inertia=(1, 1, 1))) for k, n in enumerate("ab")]
    springs = tuple(
        GroundBushing(name=n, attach=n, stiffness=(4.0 + k) * np.eye(6)) for k, n in enumerate("ab")
    )
    once, twice = (
        Equation(name, (Term("a", "x", k), Term("b", "x", 2.0 * k)))
        for name, k in (("one", 1.0), ("two", 3.0))
    )
    points = [AttachPoint(n, n, ZERO) for n in "ab"]
    both = (
        linked(
            structure(
                nodes,
                attach=points,
                springs=[Spring(name="s", start="a", end="b", stiffness=1e-9, free_length=1.0)],
            ),
            once,
            twice,
        ),
        dataclasses.replace(hung(gravity=ZERO), bushings=springs),
    )
    modes = solve(*both)
    by_mass = differentiate_frequencies(modes, find_parameters(*both, ["node.a.mass"]))
    # Along x, a = -2 b: omega^2 = (4 * 4 + 5) / (4 m + 2).
    found = by_mass.d_lambda[0][np.argmin(np.abs(modes.omega**2 - 21.0 / 6.0))]
    assert found == pytest.approx(-21.0 * 4.0 / 36.0, rel=1e-8)  # the spring that joins them
    with pytest.raises(NumericalError, match=r"link 'one'|link 'two'"):
        differentiate_frequencies(modes, find_parameters(*both, ["link.two.a.x.coefficient"]))


def test_a_transfer_function_of_a_linked_article() -> None:
    rng = np.random.default_rng([78, 3])
    parts, environment = drawn_case(rng)
    push = Actuator(name="u", kind=ActuatorKind.FORCE, frame="b", axis=np.array([0.6, 0.0, 0.8]))
    look = Sensor(
        name="y",
        kind=SensorKind.ACCELEROMETER,
        frame="a" if not environment.clamps else "c",
        axis=np.array([0.0, 0.6, 0.8]),
    )
    both = dataclasses.replace(parts, actuators=(push,), sensors=(look,)), environment
    modes = solve(*both)
    count, s = len(modes.omega), 2j * np.pi * np.array([0.7, 3.1])
    parameters = list(find_parameters(*both, ["node.b.cg.x", "node.c.position.y", "member.a-b.EI_y"]))
    way = np.array([0.1, 0.1, 30.0])

    def response(system) -> np.ndarray:
        eye = np.eye(len(system.A))
        return np.array(
            [(system.C @ np.linalg.solve(x * eye - system.A, system.B) + system.D)[0, 0] for x in s]
        )

    def solved(*b) -> np.ndarray:
        return response(build_plant(solve(*b), inputs=["u"], outputs=["y"], count=count).system)

    system = build_plant(modes, inputs=["u"], outputs=["y"], count=count).system
    found = np.zeros(len(s), complex)
    eye = np.eye(len(system.A))
    for w, d in zip(
        way, differentiate_plant(modes, parameters, inputs=["u"], outputs=["y"], count=count), strict=True
    ):
        for k, x in enumerate(s):
            right, left = (
                np.linalg.solve(x * eye - system.A, system.B),
                np.linalg.solve((x * eye - system.A).T, system.C.T),
            )
            found[k] += w * (d.C @ right + left.T @ d.A @ right + left.T @ d.B + d.D)[0, 0]
    want = along(both, parameters, way, solved, 1e-3)
    np.testing.assert_allclose(found, want, rtol=1e-6, atol=1e-6 * np.abs(response(system)).max())


def arm(rigid: float | None) -> tuple[GravityBudget, GravityBudget | None]:
    """The budget of a soft bar with a body on an arm: on a link, or on a bushing of that stiffness."""
    at = np.array([[0.0, 0.0, 0.0], [1.0, 0.1, 0.05], [0.5, -0.4, 0.1]])
    cg, inertia = ((0, -0.1, 0), (0.1, -0.1, 0.02), (0.02, -0.1, 0.03)), (0.02, 0.03, 0.02)
    nodes = [node(n, at[k], body(1.0 + 0.2 * k, cg[k], inertia)) for k, n in enumerate("abc")]
    up = np.array([0.0, 0.1, 0.0])
    ends = [("pa", "a", up), ("pb", "b", up), ("b0", "b", ZERO), ("c0", "c", at[1] - at[2])]
    bar = member("a", "b", dataclasses.replace(TUBE, EI_y=20.0, EI_z=20.0), 1)
    parts = structure(nodes, [bar], attach=[AttachPoint(*end) for end in ends])
    if rigid is None:
        parts = linked(parts, Link(name="arm", first="b", second="c", offset=at[1] - at[2]))
    else:
        stiff = Bushing(name="arm", start="b0", end="c0", stiffness=rigid * np.eye(6))
        parts = dataclasses.replace(parts, bushings=(stiff,))
    springs = tuple(
        AnchoredSpring(
            name=p, attach=p, anchor=x + np.array([0.05, 1.5, 0.1]), stiffness=300.0, free_length=1.4
        )
        for p, x in (("pa", at[0]), ("pb", at[1]))
    )
    lab = Environment(title="lab", gravity=GRAVITY, springs=springs)
    return build_budget(solve(parts, Environment.orbit()), solve(parts, lab), 8)


def test_the_budget_of_a_link_is_the_limit_of_those_of_stiff_bushings() -> None:
    linked_budget, soft, stiff = arm(None), arm(1e7), arm(1e8)
    # What is left goes with the compliance: ten times stiffer, ten times less.
    apart = [np.abs(b.corner - linked_budget.corner).max() for b in (soft, stiff)]
    assert apart[1] == pytest.approx(0.1 * apart[0], rel=0.02)
    limit = stiff.corner + (stiff.corner - soft.corner) / 9.0
    np.testing.assert_allclose(linked_budget.corner, limit, rtol=1e-7, atol=1e-7 * np.abs(limit).max())


def test_a_reduction_of_a_linked_article_keeps_its_modes() -> None:
    """All of its modes kept, it is the article; residual loads at a node that follows add nothing then."""
    rng = np.random.default_rng(4)
    _, part = bent_beam(rng)
    foot = node("f", part.nodes[1].position + 0.3, body(0.3, (0.1, 0, 0), (1e-3, 2e-3, 3e-3)))
    link = Link(name="foot", first="m", second="f", offset=np.full(3, -0.3))
    mean = node("g", part.nodes[1].position - 0.2, body(0.2, inertia=(1e-3, 1e-3, 2e-3)))
    shares = tuple(Share(frame=n.name, about="xyz") for n in part.nodes)
    follows = Interpolation(name="mean", frame="g", shares=shares)
    parts = linked(dataclasses.replace(part, nodes=(*part.nodes, foot, mean)), link, follows)
    want = solve(parts, Environment.orbit())
    reduced = reduce_structure(parts, ["a", "b"], count=200, residual=["f"], recover=["f"])
    bare = structure([dataclasses.replace(n, body=body(0.0)) for n in part.nodes if n.name in "ab"])
    found = solve(dataclasses.replace(bare, components=(reduced.component,)), Environment.orbit())
    np.testing.assert_allclose(found.omega[:12], want.omega[:12], rtol=1e-7, atol=1e-6)
    # As one body the recovered node moves with the boundary.
    whole = np.zeros(len(reduced.component.mass))
    whole[[0, 6]] = 1.0
    np.testing.assert_allclose(reduced.component.recovery @ whole, [1, 0, 0, 0, 0, 0], atol=1e-9)
    with pytest.raises(ConfigError, match=r"'foot' along x ties"):
        reduce_structure(parts, ["a", "m", "f"], count=2)


def test_a_tuned_suspension_follows_what_links_carry() -> None:
    """Reactions of the pinned article, devices, rest state and modes, all solved again."""
    article, lab = lab_article("mace-simple", 1)
    at = next(n.position for n in article.nodes if n.name == "n2")
    payload = node("p", at + np.array([0.1, -0.2, 0.05]), body(1.5, (0.0, -0.05, 0.02), (0.01, 0.02, 0.01)))
    ball = Link(name="pin", first="n2", second="p", about="yz", offset=np.array([-0.1, 0.2, -0.05]))
    both = linked(dataclasses.replace(article, nodes=(*article.nodes, payload)), ball), lab
    names = ["link.pin.offset.x", "node.p.mass", "node.p.cg.z", "node.n2.position.x", "environment.bounce_hz"]
    parameters = list(find_parameters(*both, names))
    way, count = np.array([0.1, 0.5, 0.1, 0.1, 0.1]), 12
    modes = solve(*both)
    of_rest = differentiate_rest(modes.equilibrium, parameters)

    def solved(*b: object) -> np.ndarray:
        again = solve(*b)
        return np.concatenate([again.omega[:count] ** 2, again.equilibrium.suspension.reaction])

    found = np.concatenate(
        [way @ differentiate_frequencies(modes, parameters, count).d_lambda, of_rest.reaction @ way]
    )
    want, scale = along(both, parameters, way, solved, 2e-3), solved(*both)
    np.testing.assert_allclose((found - want) / scale, 0.0, atol=1e-6)
