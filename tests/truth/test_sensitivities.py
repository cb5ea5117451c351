"""Derivatives of rest states, modes and plants: closed forms, differences, repeated frequencies."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

import middeck as md
import structure_builders as build
from middeck.errors import ConfigError, NumericalError
from middeck.structure.model.article import (
    Damper,
    DamperPlace,
    Damping,
    DampingTable,
    JointState,
    Structure,
)
from middeck.structure.model.environment import AnchoredSpring, Device, DeviceKind, Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.structure.sensitivity.frequency_derivatives import differentiate_frequencies
from middeck.structure.sensitivity.parameters import ModelParameter, find_parameters, set_parameter
from middeck.structure.sensitivity.plant_derivatives import differentiate_plant
from middeck.structure.sensitivity.rest import differentiate_rest
from middeck.structure.sensitivity.shape_derivatives import differentiate_modes
from repeats import LONG

ROOT = Path(__file__).parents[2]
# Sizes that make derivatives in different units comparable: a tenth of a metre, a radian, one g.
SIZES = {"m": 0.1, "rad": 1.0, "kg m^2": 0.01, "m/s^2": 10.0, "": 1.0}


def size(parameter: ModelParameter) -> float:
    return SIZES.get(parameter.unit) or abs(parameter.value) or 1.0


def lab_article(name: str, elements: int = 2) -> tuple[Structure, Environment]:
    article = md.load_structure(ROOT / f"articles/{name}.toml")
    members = tuple(dataclasses.replace(m, elements=elements) for m in article.members)
    return dataclasses.replace(article, members=members), md.load_environment(ROOT / "environments/lab.toml")


def all_moved(
    article: Structure, place: Environment, parameters: Sequence[ModelParameter], way: np.ndarray
) -> tuple[Structure, Environment]:
    """All parameters moved by as many of their sizes as ``way`` says; those that scale come last."""
    for p, far in sorted(zip(parameters, way, strict=True), key=lambda pair: pair[0].scales):
        article, place = set_parameter(article, place, p, p.value + far * size(p))
    return article, place


def directions(count: int) -> np.ndarray:
    """Each parameter by itself in `make test-all`; else all of them together, in two ways of random signs."""
    return np.eye(count) if LONG else np.random.default_rng(1993).choice([-1.0, 1.0], (2, count))


def along(values: Callable[[np.ndarray], np.ndarray], way: np.ndarray, step: float) -> np.ndarray:
    """Derivative along ``way`` of two central differences: an error of order step^4."""
    near, far = ((values(h * way) - values(-h * way)) / (2.0 * h) for h in (0.5 * step, step))
    return (4.0 * near - far) / 3.0


def central(values: Callable[[float], np.ndarray], parameter: ModelParameter, step: float) -> np.ndarray:
    h = step * size(parameter)
    return (values(parameter.value + h) - values(parameter.value - h)) / (2.0 * h)


def richardson(values: Callable[[float], np.ndarray], parameter: ModelParameter, step: float) -> np.ndarray:
    """Of two central differences: an error of order step^4."""
    return (4.0 * central(values, parameter, 0.5 * step) - central(values, parameter, step)) / 3.0


def solve(article: Structure, environment: Environment, count: int | None = None) -> Modes:
    return solve_modes(solve_equilibrium(article, environment), count)


BOTH = [
    *("node.n3.mass", "node.n1.cg.y", "node.n3.cg.z", "node.n1.inertia.zz", "node.n5.inertia.xy"),
    *("node.n2.position.x", "node.n5.position.y", "node.n3.size", "member.n1-n2.EI_y", "members.E"),
    *("members.rho", "attach.n1.offset.x", "attach.n5.offset.z", "environment.gravity.x"),
    *("environment.gravity.y", "environment.cable_length", "environment.bounce_hz"),
]
GIMBAL = [
    *("joint.pri_x.angle", "joint.pri_z.angle", "joint.pri_x.offset.y", "joint.pri_z.mass"),
    *("joint.pri_z.cg.y", "joint.pri_z.cg.z", "joint.pri_x.inertia.yz", "joint.pri_z.axis.y"),
]
SIMPLE = [
    *("node.n1.mass", "node.n5.cg.x", "node.n3.inertia.xx", "node.n3.position.z", "member.n2-n3.EI_z"),
    *("member.n3-n4.GJ", "member.n4-n5.rho_A", "attach.n3.offset.y"),
]


@pytest.mark.parametrize(("name", "names"), [("mace-dm", BOTH + GIMBAL), ("mace-simple", BOTH + SIMPLE)])
def test_frequencies_of_the_articles(name, names):
    """The whole chain solved again: reactions, devices, rest state, modes."""
    article, lab = lab_article(name)
    parameters = find_parameters(article, lab, names)
    assert len(parameters) == 25
    found = differentiate_frequencies(solve(article, lab, 20), parameters)

    def squares(moved: np.ndarray) -> np.ndarray:
        return solve(*all_moved(article, lab, parameters, moved), 20).omega ** 2

    by_size = found.d_lambda * np.array([size(p) for p in parameters])[:, None]
    for way in directions(len(parameters)):
        error = np.abs(way @ by_size - along(squares, way, 5e-4)) / np.abs(by_size).max(axis=0)
        # The issue's: a millionth of the largest derivative of that frequency.
        assert error.max() < 1e-6, [p.name for p, w in zip(parameters, way, strict=True) if w]


def all_kinds_of_springs() -> tuple[Structure, Environment]:
    """A bar with a sprung and a driven arm and a spring of its own, on a spring, a device and a tuned one."""
    bar = [
        build.node("a", (0, 0, 0), build.body(2.0, (0, -0.1, 0), (0.02, 0.03, 0.02))),
        build.node("b", (1, 0.1, 0.05), build.body(1.5, (0.1, -0.1, 0.02), (0.02, 0.03, 0.02)), size=0.1),
    ]
    x, y, z = np.eye(3)
    arm = build.body(0.7, (0.02, -0.2, 0.01), (0.01, 0.004, 0.01))
    joints = [
        build.joint("swing", "a", x, arm, offset=-0.05 * y, angle=0.1, stiffness=3.0, target=0.2),
        build.joint("crane", "b", z, arm, offset=-0.05 * y, state=JointState.DRIVEN, target=0.3),
        build.joint("bob", "crane", x, arm, offset=-0.1 * y, state=JointState.LOCKED),
    ]
    attach = [
        build.AttachPoint(n, f, np.array(p))
        for n, f, p in (
            ("left", "a", (-0.1, 0.05, 0.02)),
            ("right", "b", (0.1, 0.05, 0)),
            ("third", "b", (0, 0.05, 0.1)),
            ("tip", "crane", (0.05, -0.1, 0.0)),
        )
    ]
    own = [build.Spring(name="stay", start="left", end="tip", stiffness=40.0, free_length=0.8)]
    article = build.structure(bar, [build.member("a", "b", build.TUBE, 2)], joints, own, attach)
    spring = DeviceKind.SPRING
    hangers = (
        Device(
            name="tuned",
            attach="left",
            kind=spring,
            held="xyz",
            bounce_hz=0.5,
            cable_length=2.0,
            moving_mass=0.1,
        ),
        Device(name="other", attach="right", held="yz", bounce_hz=0.4, anchor=np.array([1.2, 3.0, 0.1])),
        Device(name="given", attach="third", force=8.0, stiffness=60.0, anchor=np.array([1.0, 2.0, 0.3])),
    )
    tie = AnchoredSpring(
        name="tie", attach="right", anchor=np.array([1.1, 1.4, 0.4]), stiffness=30.0, free_length=0.9
    )
    return article, Environment(
        title="mixed", gravity=np.array([0.1, -9.7, 0.2]), suspension=None, springs=(tie,), devices=hangers
    )


SPRINGS = [
    *("environment.device.tuned.bounce_hz", "environment.device.tuned.moving_mass"),
    *(
        "environment.device.given.force",
        "environment.device.given.anchor.x",
        "environment.spring.tie.anchor.x",
    ),
    *("spring.stay.free_length", "joint.swing.stiffness", "joint.crane.target"),
    "attach.tip.offset.x",
]


def test_all_kinds_of_springs():
    """Rest state, what holds it, and frequencies."""
    article, place = all_kinds_of_springs()
    modes = solve(article, place, 17)
    parameters = find_parameters(article, place, SPRINGS)
    rest = differentiate_rest(modes.equilibrium, parameters)
    roots = 6 * modes.equilibrium.model.tree.roots
    angle = rest.motion[roots:]
    motion = rest.motion[:roots].reshape(-1, 6, len(parameters))[:, :3].reshape(-1, len(parameters))
    squares = differentiate_frequencies(modes, parameters).d_lambda.T
    found = np.vstack(
        [motion, angle, rest.reaction, rest.stiffness, rest.holding_torque, rest.tension, squares]
    )

    def values(moved: np.ndarray) -> np.ndarray:
        modes = solve(*all_moved(article, place, parameters, moved), 17)
        at = modes.equilibrium
        held = (at.suspension.reaction, at.suspension.stiffness, at.holding_torque, at.tension)
        return np.concatenate([at.config.x.ravel(), at.config.angle, *held, modes.omega**2])

    sizes = np.array([size(p) for p in parameters])
    by_size = found * sizes
    largest = np.abs(by_size).max(axis=1) + 1e-9  # what no parameter moves: rounding
    for way in directions(len(parameters)):
        error = np.abs(by_size @ way - along(values, way, 2e-3)) / largest
        assert error.max() < 1e-6  # the issue's


def test_pendulum():
    """A ball on a tuned cable: g/L twice, (2 pi f)^2, and no other parameter counts."""
    article = build.structure(
        [build.node("ball", (0, 0, 0), build.body(2.0, inertia=(0.1, 0.2, 0.3)))],
        attach=[build.AttachPoint("top", "ball", np.zeros(3))],
    )
    place = build.on_cables(4.0, 0.4, ("xyz",), attach=("top",))
    modes = solve(article, place)
    names = ["environment.cable_length", "environment.gravity.y", "environment.bounce_hz", "node.ball.mass"]
    found = differentiate_frequencies(modes, find_parameters(article, place, names))
    g, f, L = 9.80665, 0.4, 4.0
    expected = np.zeros((4, 6))  # three free turns first, then two swings and the bounce
    expected[0, 3:5], expected[1, 3:5], expected[2, 5] = -g / L**2, -1.0 / L, 8.0 * np.pi**2 * f
    assert found.groups == ((0, 1, 2), (3, 4), (5,))
    np.testing.assert_allclose(found.d_lambda, expected, atol=1e-10)  # reactions are solved to 1e-11
    np.testing.assert_allclose(found.relative[0, 3:5], -0.5, rtol=1e-12)
    assert np.all(np.isnan(found.d_hz[:, :3]))


def test_two_spring_bar():
    """Bounce 2 k/m and tilt 2 k a^2/I of a level bar: by the springs, the mass, the inertia."""
    k, m, inertia, a = 500.0, 8.0, 0.9, 0.6
    bar = build.rigid_bar(m, 2.0 * a, (0.2, 0.8, inertia))
    ends = {"left": (-a, 0.0, 0.0), "right": (a, 0.0, 0.0)}
    place = build.lab(*build.springs_above(ends, 2.0, k, 1.9))
    modes = solve(bar, place)
    names = ["node.bar.mass", "node.bar.inertia.zz", "environment.spring.spring left.stiffness"]
    found = differentiate_frequencies(modes, find_parameters(bar, place, names))
    bounce = int(np.argmin(np.abs(modes.omega**2 - 2.0 * k / m)))
    np.testing.assert_allclose(found.d_lambda[0, bounce], -2.0 * k / m**2, rtol=1e-9)
    tilt = int(np.argmax(np.abs(found.d_lambda[1])))
    lam = float(modes.omega[tilt] ** 2)
    np.testing.assert_allclose(
        found.d_lambda[1], np.where(np.arange(6) == tilt, -lam / inertia, 0), atol=1e-8 * lam
    )
    # One spring of two, to first order: half of what both do to the bounce.
    np.testing.assert_allclose(found.d_lambda[2, bounce], 1.0 / m, rtol=1e-9)


def test_homogeneous_laws():
    """In orbit every omega^2 is proportional to E, and inversely to all that has mass."""
    article, _ = lab_article("mace-dm")
    orbit = Environment.orbit()
    modes = solve(article, orbit, 20)
    lam = modes.omega**2
    E = differentiate_frequencies(modes, find_parameters(article, orbit, ["members.E"])).d_lambda[0]
    np.testing.assert_allclose(E, lam, rtol=1e-9, atol=1e-9)  # rounding of omega^2 near 1e3 beside 1e13
    heavy = find_parameters(
        article,
        orbit,
        ["members.rho", "node.*.mass", "joint.*.mass", "node.*.inertia.*", "joint.*.inertia.*"],
    )
    masses = differentiate_frequencies(modes, heavy)
    total = np.array([p.value for p in heavy]) @ masses.d_lambda
    np.testing.assert_allclose(total, -lam, rtol=1e-9, atol=1e-9)


def test_patches_equal_the_whole():
    """Members that a parameter does not touch, by third derivatives; or all in one perturbed assembly."""
    article, lab = lab_article("mace-dm")
    modes = solve(article, lab, 20)
    names = ["node.n2.position.z", "node.n4.size", "member.n2-n3.*", "joint.pri_x.axis.z", "environment.*"]
    parameters = find_parameters(article, lab, names)
    fast = differentiate_frequencies(modes, parameters).d_lambda
    whole = np.array([np.diag(m.d_lambda) for m in differentiate_modes(modes, parameters)])
    size_of = np.abs(whole).max(axis=1, keepdims=True) + 1e-3 * modes.omega**2  # or of one that counts
    assert np.abs((fast - whole) / size_of).max() < 1e-10  # rounding of the third derivatives


def square_beam() -> Structure:
    """Free, and as stiff in one plane as in the other, with axes that lie in neither plane of the world."""
    ends = [
        build.node(n, (x, 0, 0), build.body(0.2, inertia=(1e-3, 1e-3, 1e-3))) for n, x in (("a", 0), ("b", 2))
    ]
    return build.structure(ends, [build.member("a", "b", build.TUBE, 6, (0.0, 1.0, 0.3))])


def test_dimensions_of_an_article_that_floats():
    """Its length changes all frequencies, a turn of its axis and a shift of the whole none."""
    beam, orbit = square_beam(), Environment.orbit()
    parameters = find_parameters(beam, orbit, ["node.b.position.?"])
    found = differentiate_frequencies(solve(beam, orbit, 14), parameters).d_lambda
    longer, shorter = (
        solve(*set_parameter(beam, orbit, parameters[0], 2.0 + step), 14).omega ** 2 for step in (1e-4, -1e-4)
    )
    rounding = 1e-9 * np.abs(found[0]).max()
    np.testing.assert_allclose(found[0], (longer - shorter) / 2e-4, rtol=1e-6, atol=rounding)
    assert np.abs(found[1:]).max() < rounding
    back = differentiate_frequencies(
        solve(beam, orbit, 14), find_parameters(beam, orbit, ["node.a.position.x"])
    )
    np.testing.assert_allclose(back.d_lambda[0], -found[0], rtol=1e-9, atol=rounding)


def test_repeated_frequencies():
    """Both planes of a round beam: by EI_y one of each pair moves, by E both, by the mass both alike."""
    beam, orbit = square_beam(), Environment.orbit()
    modes = solve(beam, orbit, 14)
    names = ["member.a-b.EI_y", "member.a-b.E", "node.b.mass", "node.b.inertia.zz"]
    by_EI, by_E, by_mass, by_inertia = differentiate_frequencies(
        modes, find_parameters(beam, orbit, names)
    ).d_lambda
    pairs = [g for g in differentiate_frequencies(modes, ()).groups if len(g) == 2]
    assert pairs[:2] == [(6, 7), (8, 9)]
    for i, j in pairs[:2]:
        lam = float(modes.omega[i] ** 2)
        np.testing.assert_allclose([by_EI[i], by_EI[j]], [0.0, lam / 100.0], atol=1e-8 * lam)
        np.testing.assert_allclose([by_E[i], by_E[j]], lam, rtol=1e-8)
        np.testing.assert_allclose(by_mass[i], by_mass[j], rtol=1e-6)
        split = [by_inertia[i], by_inertia[j]]
        assert abs(split[1]) < 1e-6 * abs(split[0])  # the inertia about z is that of one plane

    def squares(v: float) -> np.ndarray:
        p = find_parameters(beam, orbit, names)[3]
        return solve(*set_parameter(beam, orbit, p, v), 10).omega ** 2

    p = find_parameters(beam, orbit, names)[3]
    h = 1e-3 * p.value
    one_sided = (squares(p.value + h) - squares(p.value)) / h
    # A one-sided difference, as the two part: first order in the step.
    np.testing.assert_allclose(
        one_sided[6:10], np.sort(by_inertia[6:10].reshape(2, 2)).ravel(), atol=2e-3 * 1e5
    )


def test_repeated_space():
    """The projector on a pair's space is smooth in a parameter that keeps the pair."""
    beam, orbit = square_beam(), Environment.orbit()
    p = find_parameters(beam, orbit, ["node.b.mass"])[0]

    def projector(modes: Modes) -> np.ndarray:
        pair = modes.shapes[:, 6:8]
        return pair @ pair.T

    modes = solve(beam, orbit, 12)
    change = differentiate_modes(modes, [p])[0]
    pair, d_pair = modes.shapes[:, 6:8], change.d_shapes[:, 6:8]
    found = d_pair @ pair.T + pair @ d_pair.T
    expected = richardson(lambda v: projector(solve(*set_parameter(beam, orbit, p, v), 12)), p, 1e-2)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())  # the issue's


PLANT = ["node.n3.mass", "node.n5.position.y", "member.n2-n3.EI_y", "joint.pri_x.angle", "joint.pri_z.cg.x"]


def test_shapes_and_plant_of_an_article():
    """Between all ports, axes turning with the rest state; of modes far enough apart for differences."""
    article, lab = lab_article("mace-dm")
    damping = Damping(
        rigid=0.0, table=DampingTable(np.array([0.1, 1.0, 100.0]), np.array([0.03, 0.01, 0.02]))
    )
    article = dataclasses.replace(article, damping=damping)
    modes = solve(article, lab)
    ports = {
        "inputs": [a.name for a in article.actuators],
        "outputs": [*(s.name for s in article.sensors), article.sensors[0].name + "_rate"],
    }
    apart = np.arange(5, 17)
    parameters = find_parameters(article, lab, [*PLANT, "sensor.bus_z.axis.x", "actuator.bus_y.axis.z"])
    shapes = differentiate_modes(modes, parameters, 17)
    plants = differentiate_plant(modes, parameters, count=17, **ports)
    sizes = np.array([size(p) for p in parameters])

    def values(moved: np.ndarray) -> np.ndarray:
        at = solve(*all_moved(article, lab, parameters, moved))
        modal = build_plant(at, count=17, **ports).dynamics
        system = modal.as_statespace()
        parts = [at.shapes[:, apart], modal.zeta[apart], *_apart(system.A, system.B, system.C, apart)]
        return np.concatenate([x.ravel() for x in parts])

    pairs = zip(shapes, plants, strict=True)
    found = [
        [shape.d_shapes[:, apart], plant.zeta[apart], *_apart(plant.A, plant.B, plant.C, apart)]
        for shape, plant in pairs
    ]
    stops = np.cumsum([x.size for x in found[0]])[:-1]
    for way in directions(len(parameters)):
        flat = along(values, way, 4e-3)
        for mine, theirs in zip(zip(*found, strict=True), np.split(flat, stops), strict=True):
            each = [w * s * x.ravel() for w, s, x in zip(way, sizes, mine, strict=True)]
            # The issue's, of the largest derivative in the matrix; beside it rounding over the step.
            scale = max(np.abs(x).max() for x in each) + 1e-2
            np.testing.assert_allclose(sum(each), theirs, atol=1e-6 * scale)


def _apart(A: np.ndarray, B: np.ndarray, C: np.ndarray, modes: np.ndarray) -> list[np.ndarray]:
    states = np.sort(np.concatenate([2 * modes, 2 * modes + 1]))
    return [A[np.ix_(states, states)], B[states], C[:, states]]


def test_transfer_function_of_equal_frequencies():
    """In orbit, rigid modes and pairs included: whatever basis the modes have, what ports see is smooth."""
    beam = square_beam()
    beam = dataclasses.replace(
        beam,
        actuators=(
            build.Actuator(name="torque", frame="a", axis=np.array([0.0, 0.0, 1.0])),
            build.Actuator(name="twist", frame="b", axis=np.array([0.6, 0.8, 0.0])),
        ),
        sensors=(build.Sensor(name="turn", frame="b", axis=np.array([0.0, 0.6, 0.8]), axis_frame="b"),),
        damping=Damping(flexible=0.01),
    )
    orbit = Environment.orbit()
    p = find_parameters(beam, orbit, ["node.b.inertia.zz"])[0]
    ports = {"inputs": ["torque", "twist"], "outputs": ["turn", "turn_rate"]}
    omega = np.array([0.7, 40.0, 300.0])
    count = 10

    def response(v: float) -> np.ndarray:
        system = build_plant(solve(*set_parameter(beam, orbit, p, v)), count=count, **ports).system
        return _response(system.A, system.B, system.C, omega)

    modes = solve(beam, orbit)
    system = build_plant(modes, count=count, **ports).system
    d = differentiate_plant(modes, [p], count=count, **ports)[0]
    H = [_derivative(system, d, s) for s in 1j * omega]
    expected = richardson(response, p, 2e-3)
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(np.array(H) / scale, expected / scale, atol=1e-6)  # the issue's


def _response(A: np.ndarray, B: np.ndarray, C: np.ndarray, omega: np.ndarray) -> np.ndarray:
    return np.array([C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B.astype(complex)) for w in omega])


def _derivative(system, d, s: complex) -> np.ndarray:
    """d[C (sI - A)^-1 B]."""
    inverse = np.linalg.inv(s * np.eye(len(system.A)) - system.A)
    return d.C @ inverse @ system.B + system.C @ inverse @ (d.A @ inverse @ system.B + d.B)


def test_what_is_asked_of_a_rest_state_in_turn_is_its_own():
    """The last motion is kept with the state: of other parameters, or of fewer, it is another."""
    article, environment = all_kinds_of_springs()
    both = find_parameters(article, environment, ["spring.stay.stiffness", "joint.swing.stiffness"])
    rest = solve_equilibrium(article, environment)
    for asked in (both, both[:1], both[1:], both, both[::-1]):
        alone = differentiate_rest(solve_equilibrium(article, environment), asked)
        assert differentiate_rest(rest, asked) == alone
    assert len(both) > 1


def test_unknown_parameter_is_named():
    article, lab = lab_article("mace-dm")
    with pytest.raises(ConfigError, match=r"no parameter 'node\.n1\.mas'") as caught:
        find_parameters(article, lab, ["node.n1.mas"])
    assert "node.n1.mass" in caught.value.hint


def test_a_parameter_that_drives_a_free_motion_is_refused():
    """In orbit a push by gravity has no rest state."""
    article, _ = lab_article("mace-dm")
    orbit = Environment.orbit()
    rest = solve_equilibrium(article, orbit)
    with pytest.raises(NumericalError, match="nothing holds"):
        differentiate_rest(rest, find_parameters(article, orbit, ["environment.gravity.y"]))


@pytest.mark.filterwarnings("ignore:dampers couple modes")
def test_ratios_that_follow_the_shapes():
    """Loss factors and dampers of every place, by their own sizes and by what moves the shapes."""
    article, place = all_kinds_of_springs()
    dampers = (
        Damper(DamperPlace.JOINT, "swing", 0.02),
        Damper(DamperPlace.SPRING, "stay", 0.5),
        Damper(DamperPlace.DEVICE, "left", 0.7),
    )
    given = Damping(flexible=0.01, loss_factor=(("a-b", 0.03),), dampers=dampers, by_mode=((4, 0.02),))
    article = dataclasses.replace(article, damping=given)
    own = ["damping.loss_factor.a-b", "damping.spring.stay.c", "damping.mode.4"]
    parameters = find_parameters(article, place, [*own, "node.b.mass", "spring.stay.stiffness"])
    plants = differentiate_plant(solve(article, place), parameters, inputs=[], outputs=[], count=12)
    apart = np.arange(3, 12)  # the slowest two swings are near to each other
    sizes = np.array([size(p) for p in parameters])

    def ratios(moved: np.ndarray) -> np.ndarray:
        at = solve(*all_moved(article, place, parameters, moved))
        return build_plant(at, inputs=[], outputs=[], count=12).dynamics.zeta[apart]

    by_size = np.array([plant.zeta[apart] for plant in plants]) * sizes[:, None]
    for way in np.eye(len(parameters)):  # one by one: their effects are too unlike to be added
        # The issue's; beside it the rounding of the shapes over the step.
        scale = np.abs(way[:, None] * by_size).max() + 1e-2
        np.testing.assert_allclose(way @ by_size, along(ratios, way, 2e-3), atol=1e-6 * scale)
