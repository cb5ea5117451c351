"""Links against closed forms, minimal coordinates, matrices written down, and differences of the energy."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla
import scipy.optimize as so

from middeck.errors import ConfigError, EquilibriumError
from middeck.structure.assembly.energy import assemble, assemble_carried
from middeck.structure.assembly.linked import closed, links_at, static_freedom
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.elements.frames import move_carried
from middeck.structure.elements.rotations import rotation_exp, rotation_log
from middeck.structure.gravity.path import follow_gravity
from middeck.structure.model.article import (
    Actuator,
    AttachPoint,
    Joint,
    JointState,
    LoadCase,
    PointLoad,
    Sensor,
    Structure,
)
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment, GroundBushing
from middeck.structure.model.links import AnyLink, Equation, Interpolation, Link, Share, Term
from middeck.structure.modes.solve import solve_modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.rest.equilibrium import rest_warnings, solve_equilibrium
from middeck.structure.rest.link_loads import link_loads
from middeck.structure.rest.rest_criteria import TOLERANCE
from middeck.structure.rest.suspension_tuning import environment_loads, tune_suspension
from middeck.structure.sensitivity.frequency_derivatives import differentiate_frequencies
from middeck.structure.sensitivity.parameters import find_parameters
from middeck.systems.plants.plant import Plant
from repeats import repeats
from structure_builders import GRAVITY, TUBE, body, joint, member, node, structure

G = 9.80665
ZERO = np.zeros(3)


def linked(parts: Structure, *links: AnyLink) -> Structure:
    return dataclasses.replace(parts, links=links)


def hung(*held: str, gravity: np.ndarray = GRAVITY) -> Environment:
    return Environment(title="lab", gravity=gravity, clamps=tuple(Clamp(node=name) for name in held))


def tangled(rng: np.random.Generator) -> Structure:
    """Bodies tied by every kind of link, a beam and a joint, anywhere."""
    nodes = [
        node(name, rng.uniform(-0.5, 0.5, 3), body(1.0, rng.uniform(-0.2, 0.2, 3), (0.3, 0.4, 0.5)))
        for name in "abcdef"
    ]
    arm = Joint(
        name="j",
        parent="c",
        offset=rng.uniform(-0.3, 0.3, 3),
        axis=np.array([0.0, 0.6, 0.8]),
        angle=0.3,
        body=body(0.5, inertia=(0.1, 0.1, 0.1)),
        state=JointState.SPRUNG,
        stiffness=3.0,
    )
    parts = structure(nodes, [member("a", "b", TUBE, 2, up=(0.3, 0.5, 0.7))], [arm])
    axes = rotation_exp(rng.standard_normal(3))
    shares = tuple(
        Share(frame=f, weight=w, about="y", axes=axes) for f, w in (("a", 1.0), ("b", 2.0), ("j", 0.7))
    )
    return linked(
        parts,
        Link(name="universal", first="b", second="c", about="z", offset=rng.uniform(-0.3, 0.3, 3), axes=axes),
        Link(name="hinge", first="a", second="d", about="xz", along="yz", axes=axes),
        Interpolation(name="mean", frame="e", shares=shares),
        Equation("gear", (Term("j", "angle", 1.0), Term("d", "rx", 0.4), Term("e", "y", 0.7))),
        Link(name="rigid", first="j", second="f", offset=rng.uniform(-0.3, 0.3, 3)),
    )


@pytest.mark.parametrize("seed", range(2))
def test_gradient_and_tangent_are_differences_of_the_energy_along_closed_links(seed: int) -> None:
    rng = np.random.default_rng([16, seed])
    parts, environment = tangled(rng), hung("a")
    model = mesh_structure(parts, environment.clamps)
    loads = environment_loads(model, environment, tune_suspension(model, environment))
    free = static_freedom(model, model.rest)
    start = move_carried(model.tree, model.rest, free.spread(0.4 * rng.standard_normal(free.basis.shape[1])))
    here = closed(model, start)
    assert here is not None
    assert np.abs(links_at(model, here).value).max() < 1e-14
    free, at = static_freedom(model, here), assemble_carried(model, here, loads)
    y, h = rng.standard_normal(free.basis.shape[1]), 1e-4
    np.testing.assert_allclose(links_at(model, here).jacobian @ free.spread(y), 0.0, atol=1e-12)
    energy = []
    for k in (-2, -1, 0, 1, 2):
        there = closed(model, move_carried(model.tree, here, free.spread(k * h * y)))
        assert there is not None
        energy.append(assemble(model, there, loads).energy)
    first = np.array([1, -8, 0, 8, -1]) @ energy / (12 * h)
    second = np.array([-1, 16, -30, 16, -1]) @ energy / (12 * h**2)
    assert y @ free.part(at.gradient) == pytest.approx(first, rel=1e-7)
    assert y @ (free.matrix(at.tangent) @ y) == pytest.approx(second, rel=2e-5)


def test_a_ball_and_a_universal_joint_swing_as_their_closed_forms() -> None:
    length, inertia = 0.7, np.array([0.01, 0.02, 0.03])
    nodes = [node("a", ZERO), node("b", (0.0, -length, 0.0), body(2.0, inertia=inertia))]
    ball = Link(name="ball", first="a", second="b", about="", offset=np.array([0.0, length, 0.0]))
    swing = np.sqrt(2.0 * G * length / (2.0 * length**2 + inertia[[2, 0]]))
    rest = solve_equilibrium(linked(structure(nodes), ball), hung("a"))
    np.testing.assert_allclose(solve_modes(rest).omega, [0.0, *np.sort(swing)], atol=1e-12)
    np.testing.assert_allclose(rest.reactions[0].force, [0.0, 2.0 * G, 0.0], atol=1e-9)
    by_ground, by_ball = link_loads(rest)
    np.testing.assert_allclose(by_ball.force, [0.0, 2.0 * G, 0.0], atol=1e-9)
    np.testing.assert_allclose(by_ground.force, -by_ball.force, atol=1e-9)
    assert (by_ball.link, by_ball.frame) == ("ball", "b")
    universal = dataclasses.replace(ball, about="y")
    modes = solve_modes(solve_equilibrium(linked(structure(nodes), universal), hung("a")))
    np.testing.assert_allclose(modes.omega, np.sort(swing), rtol=1e-12)
    assert modes.kind == ("pendulum", "pendulum")


@pytest.mark.parametrize("turn", [0.4, 2.5])
def test_a_universal_joint_turns_its_output_as_the_tangents_of_the_angles(turn: float) -> None:
    """tan(out) = tan(in) cos(bend), the arm of the first shaft at a right angle to the plane of both."""
    bend = 0.5
    first, second = np.array([1.0, 0.0, 0.0]), np.array([np.cos(bend), np.sin(bend), 0.0])
    across = np.cross(second, [0.0, 0.0, 1.0])
    nodes = [node(n, ZERO, body(1.0, inertia=(1, 1, 1))) for n in ("ground", "in", "out")]
    # The cross: its arm in the first shaft along z, that in the second shaft square to it and to the second.
    cross = np.column_stack([np.array([0.0, 0.0, 1.0]), across, np.cross([0.0, 0.0, 1.0], across)])
    bearing = np.column_stack([second, np.array([0.0, 0.0, 1.0]), np.cross(second, [0.0, 0.0, 1.0])])
    parts = linked(
        structure(nodes),
        Link(name="bearing", first="ground", second="out", about="yz", axes=bearing),
        Link(name="cross", first="in", second="out", along="", about="z", axes=cross),
    )
    case = LoadCase(name="turned", prescribed=(Clamp(node="in", turn=turn * first),))
    rest = solve_equilibrium(parts, hung("ground", gravity=ZERO), case)
    out = rotation_log(rest.config.R[2])
    np.testing.assert_allclose(np.cross(out, second), 0.0, atol=1e-9)
    want = np.arctan2(np.sin(turn) * np.cos(bend), np.cos(turn))
    assert out @ second == pytest.approx(want, abs=1e-9)


class FourBar:
    """Crank, coupler and rocker in a plane, in minimal coordinates: all from the angle of the crank."""

    pivots = np.array([[0.0, 0.0], [1.1, 0.2]])
    lengths = (0.5, 0.9, 0.7)
    masses = (1.0, 2.0, 1.5)
    inertias = (0.02, 0.1, 0.05)

    def places(self, angle: float) -> tuple[np.ndarray, np.ndarray]:
        """Centres of mass and angles of the three bars."""
        a, b, c = self.lengths
        A = a * np.array([np.cos(angle), np.sin(angle)])
        d = self.pivots[1] - A
        s = np.linalg.norm(d)
        x = (s**2 + b**2 - c**2) / (2 * s)
        B = A + x * d / s - np.sqrt(b**2 - x**2) * np.array([-d[1], d[0]]) / s
        ends = [(self.pivots[0], A), (A, B), (B, self.pivots[1])]
        return np.array([(p + q) / 2 for p, q in ends]), np.unwrap(
            [np.arctan2(*(q - p)[::-1]) for p, q in ends]
        )

    def energy(self, angle: float) -> float:
        return float(G * np.array(self.masses) @ self.places(angle)[0][:, 1])

    @property
    def rest(self) -> float:
        """The angle of least energy."""
        return so.minimize_scalar(
            self.energy, bounds=(-2.6, -0.2), method="bounded", options={"xatol": 1e-10}
        ).x

    def omega(self, angle: float) -> float:
        h = 1e-3
        E = [self.energy(angle + k * h) for k in (-2, -1, 0, 1, 2)]
        stiffness = np.array([-1, 16, -30, 16, -1]) @ E / (12 * h**2)
        return float(np.sqrt(stiffness / self.mass(angle)))

    def mass(self, angle: float) -> float:
        h = 1e-3
        p, t = zip(*(self.places(angle + k * h) for k in (-2, -1, 1, 2)), strict=True)
        rate = np.tensordot([1, -8, 8, -1], np.array(p), 1) / (12 * h)
        spin = np.tensordot([1, -8, 8, -1], np.array(t), 1) / (12 * h)
        return float(np.array(self.masses) @ np.sum(rate**2, axis=1) + np.array(self.inertias) @ spin**2)

    def article(self, angle: float) -> Structure:
        centres, turns = self.places(angle)
        bars = [
            node(f"bar {k}", (*centres[k], 0.0), body(m, inertia=(i, i, i)))
            for k, (m, i) in enumerate(zip(self.masses, self.inertias, strict=True))
        ]
        half = [
            size / 2 * np.array([np.cos(t), np.sin(t), 0.0])
            for size, t in zip(self.lengths, turns, strict=True)
        ]
        return linked(
            structure([node("ground", ZERO), *bars]),
            Link(name="A0", first="ground", second="bar 0", about="xy", offset=-half[0]),
            Link(name="A", first="bar 0", second="bar 1", about="xy", offset=-half[1]),
            Link(name="B", first="bar 1", second="bar 2", about="xy", offset=-half[2]),
            Link(name="B0", first="ground", second="bar 2", about="xy", offset=half[2]),
        )


def test_a_closed_loop_of_hinges_rests_and_swings_as_its_minimal_coordinate() -> None:
    """Four parallel hinges of rigid bars repeat three conditions, which changes no motion."""
    bars = FourBar()
    rest_angle = bars.rest
    rest = solve_equilibrium(bars.article(-0.3), hung("ground"))
    assert rest.converged
    assert rest.stable
    centres, _ = bars.places(rest_angle)
    np.testing.assert_allclose(rest.config.x[1:, :2], centres, atol=1e-6)
    modes = solve_modes(rest)
    assert modes.kind == ("pendulum",)
    assert modes.omega[0] == pytest.approx(bars.omega(rest_angle), rel=1e-6)
    np.testing.assert_allclose(rest.reactions[0].force, [0.0, sum(bars.masses) * G, 0.0], atol=1e-8)


def test_plant_and_derivatives_of_a_closed_loop_are_those_of_its_minimal_coordinate() -> None:
    """Torque and angle of the crank: the form of one mode; derivatives by masses that move the rest state."""
    bars, z = FourBar(), np.array([0.0, 0.0, 1.0])
    parts = dataclasses.replace(
        bars.article(-0.3),
        actuators=(Actuator(name="motor", frame="bar 0", axis=z),),
        sensors=(Sensor(name="angle", frame="bar 0", axis=z),),
    )
    modes = solve_modes(solve_equilibrium(parts, hung("ground")))
    system = build_plant(modes, inputs=["motor"], outputs=["angle"], count=1).system
    mass, omega = bars.mass(bars.rest), bars.omega(bars.rest)
    zeta = -np.trace(system.A) / (2.0 * omega)
    for s in (0.1j, 3j, 40j):
        found = (system.C @ np.linalg.solve(s * np.eye(2) - system.A, system.B) + system.D)[0, 0]
        assert found == pytest.approx(1.0 / mass / (s**2 + 2.0 * zeta * omega * s + omega**2), rel=1e-5)
    names = [f"node.bar {k}.mass" for k in range(3)]
    found = differentiate_frequencies(modes, find_parameters(parts, hung("ground"), names)).d_lambda[:, 0]
    for k, derivative in enumerate(found):
        ends = []
        for h in (-1e-3, 1e-3):
            moved = FourBar()
            moved.masses = tuple(m + h * (i == k) for i, m in enumerate(bars.masses))
            ends.append(moved.omega(moved.rest) ** 2)
        assert derivative == pytest.approx((ends[1] - ends[0]) / 2e-3, rel=1e-4)


def test_plant_and_derivatives_of_spherical_and_universal_joints() -> None:
    """Both swings: I + m l^2 about the joint; d omega^2/dm by hand, the torque that turns what hangs."""
    length, m, inertia = 0.7, 2.0, np.array([0.01, 0.02, 0.03])
    nodes = [node("a", ZERO), node("b", (0.0, -length, 0.0), body(m, inertia=inertia))]
    about = inertia[[2, 0]] + m * length**2
    for free in ("", "y"):
        link = Link(name="ball", first="a", second="b", about=free, offset=np.array([0.0, length, 0.0]))
        parts = driven(linked(structure(nodes), link))
        modes = solve_modes(solve_equilibrium(parts, hung("a")))
        system = build_plant(modes, inputs=["wheel"], outputs=["tip"]).system
        swings = np.flatnonzero(modes.omega > 1.0)
        s = 30j
        found = (system.C @ np.linalg.solve(s * np.eye(len(system.A)) - system.A, system.B))[0, 0]
        z = np.argmin(np.abs(modes.omega - np.sqrt(m * G * length / about[0])))
        poles = np.linalg.eigvals(system.A)
        decay = -poles.real[np.argmin(np.abs(np.abs(poles) - modes.omega[z]))]
        assert found == pytest.approx(1.0 / about[0] / (s**2 + 2.0 * decay * s + modes.omega[z] ** 2))
        by_mass = differentiate_frequencies(modes, find_parameters(parts, hung("a"), ["node.b.mass"]))
        want = G * length * inertia[[2, 0]] / about**2
        np.testing.assert_allclose(np.sort(by_mass.d_lambda[0][swings]), np.sort(want), rtol=1e-9)


def interpolated(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, tuple[Share, ...], np.ndarray]:
    """Places and ground stiffnesses of five nodes, their shares, and the place of the frame that follows."""
    places = rng.uniform(-1.0, 1.0, (5, 3))
    stiffness = np.array([A @ A.T + np.eye(6) for A in rng.standard_normal((5, 6, 6))]) * 1e4
    motions = [("xyz", ""), ("xy", "z"), ("xyz", "xyz"), ("z", ""), ("xyz", "x")]
    shares = tuple(
        Share(frame=f"n{k}", weight=float(rng.uniform(0.2, 3.0)), along=along, about=about)
        for k, (along, about) in enumerate(motions)
    )
    return places, stiffness, shares, rng.uniform(-1.0, 1.0, 3)


def fit(places: np.ndarray, shares: tuple[Share, ...], at: np.ndarray) -> np.ndarray:
    """Weighted least squares as a problem of its own: motion of the frame per motion of the nodes, 6 x 30."""
    arms = places - at
    mean = np.mean(np.linalg.norm(arms, axis=1))
    rows, picks = [], []
    for k, share in enumerate(shares):
        D = np.eye(6)
        D[:3, 3:] = -np.cross(np.eye(3), arms[k]).T @ np.eye(3)
        D[:3, 3:] = np.array([np.cross(e, arms[k]) for e in np.eye(3)]).T
        for i, (letters, size) in enumerate(((share.along, 1.0), (share.about, mean))):
            for letter in letters:
                c = 3 * i + "xyz".index(letter)
                rows.append(np.sqrt(share.weight) * size * D[c])
                pick = np.zeros(6 * len(places))
                pick[6 * k + c] = np.sqrt(share.weight) * size
                picks.append(pick)
    return np.linalg.lstsq(np.array(rows), np.array(picks), rcond=None)[0]


@pytest.mark.parametrize("seed", range(2))
def test_an_interpolation_is_the_least_squares_fit_and_spreads_loads_by_its_transpose(seed: int) -> None:
    rng = np.random.default_rng([17, seed])
    places, stiffness, shares, at = interpolated(rng)
    nodes = [node(f"n{k}", p, body(1.0, inertia=(1, 1, 1))) for k, p in enumerate(places)] + [node("r", at)]
    points = [AttachPoint(f"p{k}", f"n{k}", ZERO) for k in range(5)]
    parts = linked(structure(nodes, attach=points), Interpolation(name="mean", frame="r", shares=shares))
    mounts = tuple(GroundBushing(name=f"k{k}", attach=f"p{k}", stiffness=K) for k, K in enumerate(stiffness))
    load = 1e-4 * rng.standard_normal(6)
    case = LoadCase(name="l", loads=(PointLoad(name="l", frame="r", force=load[:3], moment=load[3:]),))
    rest = solve_equilibrium(parts, Environment(title="mounts", gravity=ZERO, bushings=mounts), case)
    P, K = fit(places, shares, at), sla.block_diag(*stiffness)
    u = np.linalg.solve(K, P.T @ load)
    shift = rest.config.since_drawn.shift
    got = np.hstack([shift, [rotation_log(R) for R in rest.config.R]])
    np.testing.assert_allclose(got[:5].ravel(), u, atol=1e-6 * np.abs(u).max())
    np.testing.assert_allclose(got[5], P @ u, atol=1e-6 * np.abs(u).max())
    modes = solve_modes(solve_equilibrium(parts, Environment(title="mounts", gravity=ZERO, bushings=mounts)))
    np.testing.assert_allclose(modes.omega**2, np.linalg.eigvalsh(K), rtol=1e-9)


def test_an_interpolation_follows_a_rigid_body_through_a_large_turn() -> None:
    rng = np.random.default_rng(18)
    places, _, shares, at = interpolated(rng)
    nodes = [node(f"n{k}", p, body(1.0, inertia=(1, 1, 1))) for k, p in enumerate(places)] + [node("r", at)]
    rigid = [Link(name=f"k{k}", first="n0", second=f"n{k}") for k in range(1, 5)]
    turn = np.array([1.0, -1.2, 0.7])
    case = LoadCase(name="turned", prescribed=(Clamp(node="n0", turn=turn),))
    parts = linked(structure(nodes), *rigid, Interpolation(name="mean", frame="r", shares=shares))
    rest = solve_equilibrium(parts, hung(gravity=ZERO), case)
    R = rotation_exp(turn)
    np.testing.assert_allclose(rest.config.x[5], places[0] + R @ (at - places[0]), atol=1e-9)
    np.testing.assert_allclose(rest.config.R[5], R, atol=1e-9)


@pytest.mark.parametrize("length", repeats([1e3, 1e-3, 0.1, 10.0], 2))
def test_a_rigid_link_of_any_length_is_an_offset_of_its_mass(length: float) -> None:
    mass, inertia = min(1.0, 0.2 / length), (0.02, 0.03, 0.04)
    beam = [member("a", "b", TUBE, 3)]
    far = np.array([length, 0.3 * length, -0.2 * length])
    ends = node("a", ZERO), np.array([1.0, 0.0, 0.0])
    apart = [ends[0], node("b", ends[1]), node("c", ends[1] + far, body(mass, inertia=inertia))]
    one = [ends[0], node("b", ends[1], body(mass, far, inertia))]
    rests = [
        solve_equilibrium(parts, hung("a"))
        for parts in (
            linked(structure(apart, beam), Link(name="arm", first="b", second="c")),
            structure(one, beam),
        )
    ]
    np.testing.assert_allclose(rests[0].config.x[1], rests[1].config.x[1], rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(*(solve_modes(rest, 8).omega for rest in rests), rtol=1e-8)
    # Each rest state leaves up to TOLERANCE of the weight, or of its moment over a metre.
    np.testing.assert_allclose(
        *(np.concatenate(rest.reactions[0][1:]) for rest in rests), rtol=1e-9, atol=2.0 * TOLERANCE * 15.0
    )


def test_gears_add_their_inertias_and_springs_by_the_ratio() -> None:
    k, inertia, ratio = (2.0, 5.0), (0.1, 0.03), 3.5
    joints = [
        joint(
            f"j{i}", "a", (0.0, 0.0, 1.0), body(1.0, inertia=(inertia[i],) * 3), offset=ZERO, stiffness=k[i]
        )
        for i in range(2)
    ]
    gear = Equation("gear", (Term("j1", "angle", 1.0), Term("j0", "angle", -ratio)))
    parts = linked(structure([node("a", ZERO, body(1.0, inertia=(1, 1, 1)))], joints=joints), gear)
    modes = solve_modes(solve_equilibrium(parts, hung("a")))
    want = (k[0] + ratio**2 * k[1]) / (inertia[0] + ratio**2 * inertia[1])
    np.testing.assert_allclose(modes.omega**2, [want], rtol=1e-12)


def test_a_prescribed_motion_that_contradicts_a_link_names_it() -> None:
    parts = linked(
        structure([node("a", ZERO), node("b", (1, 0, 0), body(1.0))]), Link(name="bar", first="a", second="b")
    )
    case = LoadCase(name="pull", prescribed=(Clamp(node="b", shift=np.array([0.01, 0.0, 0.0])),))
    with pytest.raises(EquilibriumError, match="contradicts link 'bar' along x"):
        solve_equilibrium(parts, hung("a"), case)


def test_a_link_that_repeats_others_is_named_and_one_that_nearly_does_is_refused() -> None:
    rest = solve_equilibrium(FourBar().article(-0.3), hung("ground"))
    warnings = solve_modes(rest).warnings
    assert sum("repeats" in w for w in warnings) == 3
    assert all(any(f"link {name!r}" in w for w in warnings) for name in ("A", "B"))
    nodes = [node("a", ZERO), node("b", (1, 0, 0), body(1.0, inertia=(1, 1, 1))), node("c", (1, 1, 0))]
    ring = [Link(name=f"{p}{q}", first=p, second=q) for p, q in ("ab", "bc", "ca")]
    rest = solve_equilibrium(linked(structure(nodes), *ring), hung("c"))
    remarks = [w for w in rest_warnings(rest) if "repeats" in w]
    assert len(remarks) == 6
    assert all(f"link 'ca' {w}" in " ".join(remarks) for w in ("along x", "about z"))
    twice = [
        Link(
            name=name,
            first="a",
            second="b",
            axes=rotation_exp(np.array([0.0, 0.0, turn])),
            about="xy",
            along="x",
        )
        for name, turn in (("one", 0.0), ("two", 1e-8))
    ]
    more = [Link(name="rest", first="a", second="c")]
    with pytest.raises(ConfigError, match="nearly repeats"):
        solve_equilibrium(linked(structure(nodes), *twice, *more), hung("a", gravity=ZERO))


def test_a_frame_that_clamps_hold_already_is_named() -> None:
    nodes = [node("a", ZERO, body(1.0)), node("b", (1, 0, 0), body(1.0))]
    rest = solve_equilibrium(
        linked(structure(nodes, [member("a", "b", TUBE, 1)]), Link(name="bar", first="a", second="b")),
        hung("a", "b"),
    )
    assert sum("link 'bar'" in w and "what clamps and locks hold" in w for w in rest_warnings(rest)) == 6


def driven(parts: Structure) -> Structure:
    """With a torque and an angle at the last node."""
    z = np.array([0.0, 0.0, 1.0])
    return dataclasses.replace(
        parts,
        actuators=(Actuator(name="wheel", frame="b", axis=z),),
        sensors=(Sensor(name="tip", frame="b", axis=z),),
    )


def test_plants_and_gravity_paths_are_those_of_an_offset() -> None:
    beam = [member("a", "b", TUBE, 3)]
    mass, inertia = 3.0, (0.02, 0.03, 0.04)
    far, end = np.array([0.2, 0.1, -0.1]), np.array([1.0, 0.0, 0.0])
    hanger = body(1.0, inertia=(0.01, 0.01, 0.01))
    apart = structure(
        [node("a", ZERO, hanger), node("b", end), node("c", end + far, body(mass, inertia=inertia))], beam
    )
    one = structure([node("a", ZERO, hanger), node("b", end, body(mass, far, inertia))], beam)
    pair = [driven(p) for p in (linked(apart, Link(name="arm", first="b", second="c")), one)]
    environment = hung("a")
    plants = [
        build_plant(
            solve_modes(solve_equilibrium(p, environment)),
            inputs=["wheel"],
            outputs=["tip"],
            count=4,
            static=True,
        )
        for p in pair
    ]
    gains = [plant_response(p, np.array([0.3, 2.0, 30.0])) for p in plants]
    np.testing.assert_allclose(*gains, rtol=1e-7)
    orbit = solve_modes(solve_equilibrium(pair[1], hung("a", gravity=ZERO)), 2)
    np.testing.assert_allclose(
        follow_gravity(pair[0], environment, count=2).omega2[-1], orbit.omega**2, rtol=1e-7
    )


def plant_response(plant: Plant, frequency_hz: np.ndarray) -> np.ndarray:
    s, system = 2j * np.pi * frequency_hz, plant.system
    one = np.eye(len(system.A))
    return np.array([system.C @ np.linalg.solve(x * one - system.A, system.B) + system.D for x in s])


@pytest.mark.parametrize(
    ("link", "message"),
    [
        (Link(name="k", first="a", second="q"), "names frame 'q'"),
        (Link(name="k", first="a", second="b", along="xx"), "'xx' is none of x, y and z"),
        (Link(name="k", first="a", second="b", along="", about=""), "ties nothing"),
        (Link(name="k", first="a", second="a"), "names a frame twice"),
        (Link(name="k", first="a", second="b", axes=2 * np.eye(3)), "no right-handed set"),
        (Interpolation(name="k", frame="a", shares=()), "needs frames"),
        (Interpolation(name="k", frame="a", shares=(Share(frame="b", weight=-1.0),)), "positive weight"),
        (Interpolation(name="k", frame="a", shares=(Share(frame="b"),)), "determine no turn"),
        (Equation("k", (Term("a", "angle", 1.0),)), "no joint"),
        (Equation("k", (Term("a", "up", 1.0),)), "none of x"),
        (Equation("k", (Term("a", "x", 0.0),)), "not all zero"),
    ],
)
def test_an_impossible_link_is_refused(link: AnyLink, message: str) -> None:
    nodes = [node("a", ZERO, body(1.0)), node("b", (1, 0, 0), body(1.0))]
    with pytest.raises(ConfigError, match=message):
        mesh_structure(linked(structure(nodes, [member("a", "b", TUBE, 1)]), link))


@pytest.mark.parametrize("stiffness", repeats([1e21, 1e14]))
def test_links_at_the_ends_of_a_stiff_member_and_along_it_keep_the_digits_of_what_is_soft(
    stiffness: float,
) -> None:
    bar = dataclasses.replace(TUBE, EA=stiffness, GJ=stiffness, EI_y=stiffness, EI_z=stiffness)
    near, far = (1.0, 0.0, 0.0), (2.3, 0.2, 0.1)
    heavy, light = body(2.0, inertia=(0.02, 0.03, 0.04)), body(1.0, inertia=(0.1, 0.1, 0.1))
    ends = [node("a", ZERO), node("b", near, light), node("e", (3.0, 1.0, 0.0))]
    one = structure(
        [*ends, node("d", far, heavy)],
        [member("a", "b", TUBE, 2), member("b", "d", bar, 1), member("d", "e", TUBE, 2)],
    )
    apart = structure(
        [*ends, node("d", far), node("c", near), node("f", far, heavy)],
        [member("a", "b", TUBE, 2), member("c", "d", bar, 1), member("f", "e", TUBE, 2)],
    )
    joined = linked(apart, Link(name="k", first="b", second="c"), Link(name="l", first="d", second="f"))
    along = linked(one, Link(name="k", first="b", second="d"))
    want = solve_equilibrium(one, hung("a"))
    omega = solve_modes(want, 5).omega
    for parts in (joined, along):
        rest = solve_equilibrium(parts, hung("a"))
        np.testing.assert_allclose(rest.config.x[2], want.config.x[2], atol=1e-11)
        np.testing.assert_allclose(solve_modes(rest, 5).omega, omega, rtol=1e-9)


def test_a_tuned_suspension_bears_what_links_carry() -> None:
    far = np.array([-0.4, -0.1, -0.1])
    ends = [node("a", ZERO, body(1.0, inertia=(0.1, 0.1, 0.1))), node("b", (1.0, 0.0, 0.0))]
    points = [
        AttachPoint(n, f, np.array(o))
        for n, f, o in (("p", "a", ZERO), ("q", "b", ZERO), ("r", "a", (0.5, 0.0, -0.3)))
    ]
    beam, heavy = [member("a", "b", TUBE, 2)], body(3.0, inertia=(0.02, 0.03, 0.04))
    apart = structure([*ends, node("c", ends[1].position + far, heavy)], beam, attach=points)
    moved = dataclasses.replace(ends[1], body=dataclasses.replace(heavy, cg=far))
    pair = (
        linked(apart, Link(name="arm", first="b", second="c")),
        structure([ends[0], moved], beam, attach=points),
    )
    modes = [solve_modes(solve_equilibrium(p, Environment.lab(p)), 8) for p in pair]
    np.testing.assert_allclose(modes[0].omega, modes[1].omega, rtol=1e-7)
    assert modes[0].kind == modes[1].kind


def test_an_equation_in_world_directions_holds_a_free_article_with_tension() -> None:
    """Five rigid motions are left, and the modes are those of the matrices in the equation's null space."""
    nodes = [node(n, x, body(1.0, inertia=(0.1,) * 3)) for n, x in zip("abc", np.eye(3), strict=True)]
    sides = [member(a, b, TUBE, 2, up=(0.3, 0.4, 1.0)) for a, b in ("ab", "bc", "ca")]
    bare = structure(nodes, [dataclasses.replace(sides[0], tension=50.0), *sides[1:]])
    terms = (Term("a", "x", 1.0), Term("b", "y", 0.5), Term("c", "z", -0.7))
    rest = solve_equilibrium(linked(bare, Equation(name="e", terms=terms)), Environment.orbit())
    lowest = solve_modes(rest).omega[:12]
    model = mesh_structure(bare)
    K = assemble(model, rest.config, rest.loads).tangent.toarray()
    M = mass_matrix(model, rest.config, rest.loads).toarray()
    row = np.zeros((1, len(K)))
    row[0, [0, 7, 14]] = [term.coefficient for term in terms]
    Z = sla.null_space(row)
    # The mass is singular: nothing turns about a tube's axis. Shifted, the stiffness is not.
    expected = 1.0 / sla.eigh(Z.T @ M @ Z, Z.T @ (K + 100.0 * M) @ Z, eigvals_only=True)[:-13:-1] - 100.0
    assert np.all(lowest[:5] < 1e-4 * lowest[5])
    np.testing.assert_allclose(lowest[5:] ** 2, expected[5:], rtol=1e-6)


@pytest.mark.parametrize(("pulled", "stable"), [(0.0199, True), (0.0201, False)])
def test_springs_that_a_link_holds_against_each_other_can_buckle_an_article_without_members(pulled, stable):
    """A slide pulls a straight arm towards its sprung hinge: it turns from K d r = k on."""
    hinge, k, r = 10.0, 1000.0, 0.5
    root = node("hub", (0.0, 0.0, 0.0), body(5.0, inertia=(0.5, 0.4, 0.4)))
    lever = joint("arm", "hub", (0, 0, 1), body(1.0, inertia=(0.1,) * 3), stiffness=hinge, target=0.0)
    slide = joint(
        "slide", "hub", (1, 0, 0), body(1.0, inertia=(0.1,) * 3), offset=(r, 0.0, 0.0),
        stiffness=k, target=-pulled, slides=True,
    )  # fmt: skip
    tip = Link(name="tip", first="slide", second="arm", along="x", about="", offset=np.array([r, 0.0, 0.0]))
    article = dataclasses.replace(structure([root], (), [lever, slide]), links=(tip,))
    rest = solve_equilibrium(article, Environment.orbit())
    assert rest.stable is stable
