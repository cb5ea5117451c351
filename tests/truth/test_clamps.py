"""Clamped nodes against closed forms of beams: cantilevers, props, rollers in turned axes, hinges."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.errors import ConfigError, EquilibriumError
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.gravity.budget import build_budget
from middeck.structure.gravity.compare_modes import compare_modes
from middeck.structure.model.article import Actuator, ActuatorKind, AttachPoint, Body, JointState, Sensor
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment, GroundBushing
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.residual_flexibility import compare_static_gain
from middeck.structure.rest.equilibrium import Equilibrium, rest_warnings, solve_equilibrium
from middeck.structure.sensitivity.frequency_derivatives import differentiate_frequencies
from middeck.structure.sensitivity.parameters import find_parameters
from middeck.structure.sensitivity.rest import differentiate_rest
from structure_builders import GRAVITY, TUBE, body, joint, member, node, spin, straight_beam, structure

L, EI, EA, RHO = 2.0, 100.0, 1e6, 0.5
SLIGHT = 1e-6 * GRAVITY
NONE = np.zeros(3)
HINGE = {"along": "xyz", "about": "xy"}


def held(*clamps: Clamp, gravity: np.ndarray = NONE) -> Environment:
    return Environment(title="bench", gravity=gravity, clamps=clamps)


def at_rest(environment: Environment, elements: int = 8) -> Equilibrium:
    return solve_equilibrium(straight_beam(TUBE, L, elements), environment)


def tip(rest: Equilibrium) -> np.ndarray:
    since = rest.config.since_drawn
    assert since is not None
    return since.shift[1]


def test_cantilever_sags_by_its_own_weight() -> None:
    rest = at_rest(held(Clamp(node="a"), gravity=SLIGHT))
    assert tip(rest)[1] == pytest.approx(RHO * SLIGHT[1] * L**4 / (8.0 * EI), rel=1e-9)
    (wall,) = rest.reactions
    np.testing.assert_allclose(wall.force, -RHO * L * SLIGHT, rtol=1e-9, atol=1e-16)
    np.testing.assert_allclose(wall.moment, [0.0, 0.0, -0.5 * RHO * L**2 * SLIGHT[1]], rtol=1e-6, atol=1e-16)


BEAMS = {
    "cantilever": ((Clamp(node="a"),), 1.8751040687119611),
    "built in": ((Clamp(node="a"), Clamp(node="b", along="yz")), 4.730040744862704),
    "propped": ((Clamp(node="a"), Clamp(node="b", along="yz", about="")), 3.9266023120479185),
    "simply supported": (
        (Clamp(node="a", along="xyz", about="xy"), Clamp(node="b", along="yz", about="")),
        np.pi,
    ),
}


@pytest.mark.parametrize("case", BEAMS)
def test_frequencies_converge_on_the_closed_form(case: str) -> None:
    clamps, beta = BEAMS[case]
    want = (beta / L) ** 2 * np.sqrt(EI / RHO)
    error = []
    for elements in (4, 8):
        modes = solve_modes(at_rest(held(*clamps), elements))
        assert set(modes.kind) == {"flexible"}
        error.append(np.abs(modes.omega / want - 1.0).min())
    assert error[1] < 2e-4
    assert error[0] / error[1] == pytest.approx(16.0, rel=0.1)


def test_a_roller_in_turned_axes_shares_the_load_by_compliance() -> None:
    axes = rotation_exp(np.array([0.0, 0.0, 0.4]))
    way = axes[:, 1]
    rest = at_rest(held(Clamp(node="a"), Clamp(node="b", along="y", about="", axes=axes), gravity=SLIGHT))
    give = np.diag([L / EA, L**3 / (3.0 * EI), L**3 / (3.0 * EI)])
    free = np.array([0.0, RHO * SLIGHT[1] * L**4 / (8.0 * EI), 0.0])
    push = -(way @ free) / (way @ give @ way)
    np.testing.assert_allclose(rest.reactions[1].force, push * way, rtol=1e-6, atol=1e-18)
    np.testing.assert_allclose(tip(rest), free + give @ way * push, rtol=1e-5, atol=1e-16)
    assert abs(way @ tip(rest)) < 1e-20


def test_a_plane_of_antisymmetry_gives_the_antisymmetric_modes() -> None:
    """Half of a free beam, held at the middle as its antisymmetric modes hold it."""
    thick = dataclasses.replace(TUBE, rho_I_y=1e-5, rho_I_z=1e-5)
    whole = solve_modes(solve_equilibrium(straight_beam(thick, 2.0 * L, 8), Environment.orbit()))
    middle = held(Clamp(node="a", along="yz", about="x"))
    half = solve_modes(solve_equilibrium(straight_beam(thick, L, 4), middle))
    swings, bent = (m.omega[m.omega > 0.0] for m in (whole, half))
    np.testing.assert_allclose(bent[:2], swings[2:4], rtol=1e-9)


def test_one_turn_held_alone_says_when_it_has_turned_far() -> None:
    near, far = (
        at_rest(held(Clamp(node="a"), Clamp(node="b", along="", about="x"), gravity=g))
        for g in (1e-3 * GRAVITY, GRAVITY)
    )
    assert rest_warnings(near) == ()
    assert any("held about one axis alone" in w for w in rest_warnings(far))


def test_a_force_at_the_tip_has_the_static_gains_of_a_cantilever() -> None:
    beam = dataclasses.replace(
        straight_beam(TUBE, L, 4),
        actuators=(Actuator(name="push", frame="b", axis=np.eye(3)[1], kind=ActuatorKind.FORCE),),
        sensors=(Sensor(name="tilt", frame="b", axis=np.eye(3)[2], axis_frame="b"),),
    )
    modes = solve_modes(solve_equilibrium(beam, held(Clamp(node="a"))))
    gains = compare_static_gain(modes, inputs=["push"], outputs=["tilt"], count=3, frequency_hz=0.0)
    for gain in (gains.full, gains.completed):
        np.testing.assert_allclose(gain, [[L**2 / (2.0 * EI)]], rtol=1e-9)


def pendulum(mass: float, length: float, inertia: float) -> Modes:
    """A rigid body hinged about z at its drawn place, beside the hinge: it falls to hang below it."""
    bob = structure([node("hub", (0, 0, 0), body(mass, (length, 0, 0), (inertia,) * 3))])
    return solve_modes(solve_equilibrium(bob, held(Clamp(node="hub", **HINGE), gravity=GRAVITY)))


def test_a_compound_pendulum_falls_to_its_rest_angle_and_swings_there() -> None:
    m, h, J = 2.0, 0.3, 0.05
    modes = pendulum(m, h, J)
    np.testing.assert_allclose(modes.equilibrium.config.R[0] @ [1.0, 0.0, 0.0], [0.0, -1.0, 0.0], atol=1e-9)
    assert modes.omega == pytest.approx([np.sqrt(m * 9.80665 * h / (J + m * h**2))], rel=1e-9)
    assert modes.kind == ("pendulum",)
    np.testing.assert_allclose(modes.equilibrium.reactions[0].force, -m * GRAVITY, atol=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_reactions_balance_the_weight_of_random_frames(seed: int) -> None:
    """Sums of forces and of moments about the origin, with clamps in axes of their own."""
    rng = np.random.default_rng([1993, seed])
    places = rng.uniform(-1.0, 1.0, (5, 3))
    bodies = [body(rng.uniform(0.1, 2.0), rng.uniform(-0.2, 0.2, 3), (0.1,) * 3) for _ in places]
    nodes = [node(f"n{i}", p, b) for i, (p, b) in enumerate(zip(places, bodies, strict=True))]
    light = dataclasses.replace(TUBE, rho_A=0.0)
    members = [member(f"n{i}", f"n{j}", light, 2) for i, j in ((0, 1), (1, 2), (2, 3), (3, 4), (4, 0))]
    turned = [rotation_exp(rng.standard_normal(3)) for _ in range(3)]
    clamps = (
        Clamp(node="n0", along="xyz", about="xz", axes=turned[0]),
        Clamp(node="n2", along="yz", about="", axes=turned[1]),
        Clamp(node="n3", along="x", about="xyz", axes=turned[2]),
    )
    gravity = rng.standard_normal(3)
    rest = solve_equilibrium(structure(nodes, members), held(*clamps, gravity=gravity))
    assert rest.converged
    at = zip(bodies, rest.config.x, rest.config.R, strict=False)
    pulls = [(x + R @ b.cg, b.mass * gravity) for b, x, R in at]
    weight, about = sum(p for _, p in pulls), sum(np.cross(x, p) for x, p in pulls)
    force = sum(r.force for r in rest.reactions)
    where = {n.name: x for n, x in zip(rest.model.structure.nodes, rest.config.x, strict=False)}
    moment = sum(r.moment + np.cross(where[r.at], r.force) for r in rest.reactions)
    np.testing.assert_allclose(force, -weight, atol=1e-8 * np.abs(weight).max())
    np.testing.assert_allclose(moment, -about, atol=1e-8 * np.abs(weight).max())
    for clamp in clamps:
        i = int(clamp.node[1:])
        for letter in clamp.along:
            axis = clamp.axes[:, "xyz".index(letter)]
            assert abs(axis @ (rest.config.x[i] - places[i])) < 1e-15


WRONG = {
    "no node 'c'": (Clamp(node="c"),),
    "fixed or prescribed twice": (Clamp(node="a"), Clamp(node="a", along="y", about="")),
    "falls along": (Clamp(node="a", along="xz", about="xyz"),),
}


@pytest.mark.parametrize("message", WRONG)
def test_clamps_that_cannot_be_are_refused(message: str) -> None:
    with pytest.raises((ConfigError, EquilibriumError), match=message):
        at_rest(held(*WRONG[message], gravity=GRAVITY))


@pytest.mark.parametrize(
    ("message", "wrong"),
    [
        ("some of x, y and z", {"along": "xx"}),
        ("holds nothing", {"along": "", "about": ""}),
        ("right-handed", {"axes": np.diag([1.0, 1.0, -1.0])}),
        ("does not hold", {"along": "x", "shift": np.array([0.0, 1.0, 0.0])}),
        ("leaves a turn free", {"about": "xy", "turn": np.array([0.1, 0.0, 0.0])}),
    ],
)
def test_a_clamp_says_what_is_wrong_with_it(message: str, wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigError) as error:
        Clamp(node="a", **wrong)
    assert message in str(error.value) or message in error.value.hint


def test_what_a_clamp_leaves_is_a_rigid_mode_with_a_name() -> None:
    modes = solve_modes(at_rest(held(Clamp(node="a", along="yz", about="xyz"))))
    assert modes.kind[:2] == ("rigid", "flexible")
    assert modes.name[0] == "translation x"
    assert any("nothing holds 'translation x'" in w for w in modes.warnings)


@pytest.mark.parametrize(("angle_deg", "name"), [(30.0, "rotation x"), (75.0, "rotation y")])
def test_the_roll_of_a_slender_body_is_named_by_its_axis(angle_deg: float, name: str) -> None:
    """Its products of inertia give it more momentum about z, about which it does not turn at all."""
    axes = rotation_exp(np.array([0.0, 0.0, np.radians(angle_deg)]))
    slender = axes @ np.array([[0.02, 0.0, 0.15], [0.0, 3.1, 0.0], [0.15, 0.0, 3.1]]) @ axes.T
    rod = structure([node("a", (0, 0, 0), Body(4.7, np.array([0.0, 0.0, -0.04]), (slender + slender.T) / 2))])
    modes = solve_modes(solve_equilibrium(rod, held(Clamp(node="a", about="yz", axes=axes))))
    assert modes.name == (name,)
    roll = modes.shapes[:, 0] / np.linalg.norm(modes.shapes[:, 0])
    np.testing.assert_allclose(roll, [0.0, 0.0, 0.0, *axes[:, 0]], atol=1e-12)


def test_a_clamp_beside_a_stiff_link_keeps_the_soft_digits() -> None:
    stiff = dataclasses.replace(TUBE, EA=1e16, GJ=1e14, EI_y=1e14, EI_z=1e14, rho_A=1e-9)
    parts = structure(
        [node("w", (-0.5, 0, 0)), node("a", (0, 0, 0)), node("b", (L, 0, 0))],
        [member("w", "a", stiff, 1), member("a", "b", TUBE, 8)],
    )
    modes = solve_modes(solve_equilibrium(parts, held(Clamp(node="w"))))
    want = solve_modes(at_rest(held(Clamp(node="a")))).omega
    np.testing.assert_allclose(modes.omega[:4], want[:4], rtol=1e-8)


def sloping(change: dict[str, float]) -> Modes:
    """A bent frame with a heavy tip on a wall, a sloping roller and a hinge; two numbers of it changed."""
    section = dataclasses.replace(TUBE, EI_y=100.0 + change.get("member.b-c.EI_y", 0.0))
    x = 2.0 + change.get("node.b.position.x", 0.0)
    axes = rotation_exp(np.array([0.3, -0.2, 0.4]))
    parts = structure(
        [
            node("a", (0, 0, 0)),
            node("b", (x, 0.3, 0), body(1.5, (0, 0, 0.1), (0.1, 0.1, 0.1))),
            node("c", (2.5, 1.0, 0.5), spin(0.5, (0.1,) * 3)),
        ],
        [member("a", "b", TUBE, 3), member("b", "c", section, 2)],
    )
    clamps = Clamp(node="a"), Clamp(node="b", along="y", about="xz", axes=axes)
    return solve_modes(solve_equilibrium(parts, held(*clamps, gravity=0.3 * GRAVITY)))


@pytest.mark.parametrize("name", ["member.b-c.EI_y", "node.b.position.x"])
def test_derivatives_of_a_clamped_frame_are_those_of_differences(name: str) -> None:
    modes = sloping({})
    rest = modes.equilibrium
    parameter = find_parameters(rest.model.structure, rest.environment, [name])
    h = 1e-4 * (100.0 if "EI" in name else 1.0)
    above, below = sloping({name: h}), sloping({name: -h})
    got = differentiate_frequencies(modes, parameter, 6).d_lambda[0]
    want = (above.omega[:6] ** 2 - below.omega[:6] ** 2) / (2.0 * h)
    lam = modes.omega[:6] ** 2
    np.testing.assert_allclose(got / lam, want / lam, rtol=1e-5, atol=1e-8)
    moved = differentiate_rest(rest, parameter).motion[:, 0]
    want = (above.equilibrium.config.x - below.equilibrium.config.x).ravel() / (2.0 * h)
    np.testing.assert_allclose(
        moved.reshape(-1, 6)[:, :3].ravel(), want, rtol=1e-4, atol=1e-6 * np.abs(want).max()
    )


def hinged(arm: tuple[float, float, float], axis: tuple[float, float, float] = (0, 0, 1)) -> Equilibrium:
    """A body on a hinge without stiffness at a clamped node, its centre of mass at ``arm``."""
    bob = dataclasses.replace(body(2.0, inertia=(0.05, 0.05, 0.05)), cg=np.array(arm))
    hinge = joint(
        "hinge", "a", np.array(axis, dtype=float), bob, offset=(0.1, 0.0, 0.0), state=JointState.SPRUNG
    )
    parts = structure([node("a", (0, 0, 0))], joints=[hinge])
    return solve_equilibrium(parts, held(Clamp(node="a"), gravity=GRAVITY))


def test_a_hinge_without_stiffness_settles_below_its_axis_and_swings_there() -> None:
    rest = hinged((0.3, 0.1, 0.0))
    assert rest.config.angle[0] == pytest.approx(-np.pi / 2.0 - np.arctan2(0.1, 0.3), abs=1e-9)
    assert rest.stable
    modes = solve_modes(rest)
    assert modes.omega == pytest.approx(
        [np.sqrt(2.0 * 9.80665 * np.sqrt(0.1) / (0.05 + 2.0 * 0.1))], rel=1e-9
    )
    assert modes.kind == ("pendulum",)
    np.testing.assert_allclose(rest.holding_torque, 0.0, atol=1e-7)


def test_an_upright_hinge_is_unstable_and_a_balanced_one_neutral() -> None:
    upright = hinged((0.0, 0.3, 0.0))
    assert upright.converged
    assert any("not stable" in w for w in rest_warnings(upright))
    neutral = solve_modes(hinged((0.3, 0.0, 0.0), axis=(0, 1, 0)))
    assert neutral.kind == ("rigid",)
    assert any("neutral balance; what it carries" in w for w in neutral.warnings)


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_a_repeated_pair_turned_in_its_plane_is_no_difference(angle: float) -> None:
    """The bending pairs of a round beam, in whatever basis an eigensolver leaves them."""
    round_beam = straight_beam(dataclasses.replace(TUBE, rho_I_y=1e-5, rho_I_z=1e-5), L, 4)
    free, loaded = (
        solve_modes(solve_equilibrium(round_beam, held(Clamp(node="a"), gravity=g))) for g in (NONE, GRAVITY)
    )
    shapes = free.shapes.copy()
    c, s = np.cos(angle), np.sin(angle)
    for pair in ([0, 1], [2, 3]):
        assert free.omega[pair[0]] == pytest.approx(free.omega[pair[1]], rel=1e-9)
        shapes[:, pair] = shapes[:, pair] @ [[c, -s], [s, c]]
    comparison = compare_modes(dataclasses.replace(free, shapes=shapes), loaded, 4)
    at = tuple(comparison.pairs.T)
    assert comparison.pairs[:, 0].tolist() == [0, 1, 2, 3]
    assert comparison.cross_orthogonality[at].min() > 0.99
    assert comparison.mac[at].min() > 0.98


def test_a_clamp_leaves_a_flexible_mode_its_partner() -> None:
    """Two equal wheels on a light shaft: one held, the other turns at sqrt(k/J), free both at sqrt(2k/J).

    Half of that mode is the rigid turn, which no mode of the held shaft is for.
    """
    wheel = body(0.0, inertia=(0.02, 0.02, 0.02))
    ends = node("a", (0.0, 0.0, 0.0), wheel), node("b", (L, 0.0, 0.0), wheel)
    shaft = structure(ends, [member("a", "b", TUBE, 4)])
    free, fixed = (solve_modes(solve_equilibrium(shaft, held(*c))) for c in ((), (Clamp(node="a"),)))
    found = compare_modes(free, fixed, 12)
    names = [free.name[i] for i in found.pairs[:, 0]]
    assert found.ratio[names.index("first torsion")] == pytest.approx(np.sqrt(0.5), rel=1e-9)
    assert found.ratio.max() < 10.0


def test_a_stiff_mount_leaves_a_flexible_mode_its_partner() -> None:
    """The same on a mount far stiffer than the shaft, in the budget too.

    The wheel on the mount turns at 36 kHz, and has as much in common with the free torsion.
    """
    wheel = body(0.5, inertia=(0.02, 0.02, 0.02))
    ends = node("a", (0.0, 0.0, 0.0), wheel), node("b", (L, 0.0, 0.0), wheel)
    foot = AttachPoint(name="foot", frame="a", offset=np.zeros(3))
    shaft = structure(ends, [member("a", "b", TUBE, 4)], attach=[foot])
    mount = GroundBushing(name="mount", attach="foot", stiffness=1e9 * np.eye(6), axes=np.eye(3))
    places = Environment.orbit(), Environment(title="bench", gravity=NONE, bushings=(mount,))
    free, fixed = (solve_modes(solve_equilibrium(shaft, place)) for place in places)
    torsion = free.name.index("first torsion")
    for found in (compare_modes(free, fixed, 12), build_budget(free, fixed, 12)):
        (held_as,) = (j for i, j in found.pairs.tolist() if i == torsion)
        ratio = fixed.frequency_hz[held_as] / free.frequency_hz[torsion]
        assert ratio == pytest.approx(np.sqrt(0.5), rel=1e-3)


def test_a_shaft_without_inertia_about_its_axis_has_subspaces_to_compare() -> None:
    """Two equal wheels, one on a soft mount: the largest angle is that of its turn, of two inertias."""
    wheel = body(1.0, inertia=(0.02, 0.02, 0.02))
    ends = node("a", (0.0, 0.0, 0.0), wheel), node("b", (L, 0.0, 0.0), wheel)
    shaft = dataclasses.replace(
        structure(ends, [member("a", "b", TUBE, 4)]),
        attach_points=(AttachPoint(name="p", frame="a", offset=NONE),),
    )
    mount = GroundBushing(name="mount", attach="p", stiffness=0.01 * np.eye(6))
    soft = dataclasses.replace(held(), bushings=(mount,))
    found = compare_modes(*(solve_modes(solve_equilibrium(shaft, e)) for e in (Environment.orbit(), soft)))
    k = TUBE.GJ / L
    turn = np.linalg.eigh([[k + 0.01, -k], [-k, k]])[1][:, 0]
    assert found.subspace_angle.shape == (6,)
    assert found.subspace_angle.max() == pytest.approx(abs(np.arctan2(*turn) % np.pi - np.pi / 4.0), rel=1e-6)
