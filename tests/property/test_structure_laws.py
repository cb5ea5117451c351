"""Laws that hold for every structure and every environment."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.linked import static_coordinates
from middeck.structure.elements.frames import move
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.gravity.compare_modes import compare_modes
from middeck.structure.model.article import AttachPoint, Body, Joint, JointState, Section, Spring, Structure
from middeck.structure.model.environment import AnchoredSpring, Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from repeats import repeats
from structure_builders import GRAVITY, body, joint, member, node, on_cables, structure

TUBE = Section(EA=1e6, GJ=80.0, EI_y=90.0, EI_z=110.0, rho_A=0.5, rho_I_y=1e-4, rho_I_z=2e-4)
X, Y, Z = np.eye(3)


def unit(rng: np.random.Generator) -> np.ndarray:
    v = rng.standard_normal(3)
    return v / np.linalg.norm(v)


def random_body(rng: np.random.Generator, mass: float) -> Body:
    turn = rotation_exp(rng.standard_normal(3))
    inertia = turn @ np.diag(0.02 + 0.01 * rng.random(3)) @ turn.T
    return Body(mass, 0.05 * rng.standard_normal(3), 0.5 * (inertia + inertia.T))


def random_tree(seed: int, nodes: int, joints: int, states=(JointState.FREE,)) -> Structure:
    """Nodes joined by members as a tree, joints on random frames, bodies everywhere."""
    rng = np.random.default_rng(seed)
    places = [np.zeros(3)]
    members = []
    for i in range(1, nodes):
        at = int(rng.integers(i))
        places.append(places[at] + (0.6 + 0.4 * rng.random()) * unit(rng))
        along = places[i] - places[at]
        members.append(member(f"n{at}", f"n{i}", TUBE, 2, up=np.cross(along, unit(rng))))
    parts = [
        dataclasses.replace(node(f"n{i}", p, size=0.05), body=random_body(rng, 1.0 + rng.random()))
        for i, p in enumerate(places)
    ]
    frames = [p.name for p in parts]
    found = []
    for j in range(joints):
        carrier = frames[int(rng.integers(len(frames)))]
        state = states[int(rng.integers(len(states)))]
        found.append(
            Joint(
                name=f"j{j}",
                parent=carrier,
                offset=0.1 * unit(rng),
                axis=unit(rng),
                angle=0.5 * rng.standard_normal(),
                body=random_body(rng, 0.5 + rng.random()),
                state=state,
                stiffness=5.0,
                target=0.3,
            )
        )
        frames.append(f"j{j}")
    attach = [AttachPoint(f, f, 0.05 * rng.standard_normal(3)) for f in frames]
    return structure(parts, members, found, (), attach)


trees = st.tuples(st.integers(0, 10**6), st.integers(1, 5), st.integers(0, 4))


@given(trees)
@example((129, 2, 3))  # what Newton leaves unbalanced turns with the body
def test_orbit_has_six_rigid_modes_and_one_for_each_free_joint(tree: tuple[int, int, int]):
    states = (JointState.FREE, JointState.LOCKED, JointState.DRIVEN, JointState.SPRUNG)
    parts = random_tree(*tree, states)
    # A sprung axis with a target off its angle settles first; the body then turns as a whole.
    modes = solve_modes(solve_equilibrium(parts, Environment.orbit()))
    free = sum(j.state is JointState.FREE for j in parts.joints)
    assert modes.kind.count("rigid") == 6 + free
    assert np.all(modes.omega[: 6 + free] == 0.0)
    # A spring far off its target turns the free body about it: nothing else may be warned about.
    assert all("turned by" in warning for warning in modes.stated_warnings)
    gram = modes.shapes[:, : 6 + free].T @ (modes.mass @ modes.shapes[:, : 6 + free])
    assert gram == pytest.approx(np.eye(6 + free), abs=1e-10)


@given(trees)
def test_orbit_mass_is_the_sum_of_its_parts(tree: tuple[int, int, int]):
    parts = random_tree(*tree)
    modes = solve_modes(solve_equilibrium(parts, Environment.orbit()))
    # A mass-normalised translation moves every root by 1 / sqrt(mass).
    assert np.abs(modes.shapes[0, 0]) ** -2 == pytest.approx(parts.mass, rel=1e-9)


def springs_from(parts: Structure, seed: int) -> tuple[AnchoredSpring, ...]:
    """Three springs to ground that hold any tree: long, taut, from distinct frames if there are."""
    rng = np.random.default_rng(seed)
    names = [a.name for a in parts.attach_points if a.frame.startswith("n")]
    ends = [names[i % len(names)] for i in range(3)]
    places = {n.name: n.position for n in parts.nodes}
    lift = np.array([0.0, 4.0, 0.0])
    return tuple(
        AnchoredSpring(
            name=f"s{i}",
            attach=n,
            anchor=places[n] + lift + 0.5 * rng.standard_normal(3),
            stiffness=60.0,
            free_length=2.0,
        )
        for i, n in enumerate(ends)
    )


def rotated(parts: Structure, R: np.ndarray) -> Structure:
    """The same structure, turned: every vector and tensor of it in the world's axes."""

    def turned_body(b: Body) -> Body:
        inertia = R @ b.inertia @ R.T
        return Body(b.mass, R @ b.cg, 0.5 * (inertia + inertia.T))

    def turn(part, **vectors):
        return dataclasses.replace(part, **{k: R @ getattr(part, k) for k in vectors})

    nodes = [dataclasses.replace(turn(n, position=0), body=turned_body(n.body)) for n in parts.nodes]
    joints = [dataclasses.replace(turn(j, offset=0, axis=0), body=turned_body(j.body)) for j in parts.joints]
    return dataclasses.replace(
        parts,
        nodes=tuple(nodes),
        joints=tuple(joints),
        members=tuple(turn(m, up=0) for m in parts.members),
        attach_points=tuple(turn(a, offset=0) for a in parts.attach_points),
    )


def rotated_lab(env: Environment, R: np.ndarray) -> Environment:
    springs = tuple(dataclasses.replace(s, anchor=R @ s.anchor) for s in env.springs)
    return dataclasses.replace(env, gravity=R @ env.gravity, springs=springs)


@pytest.mark.parametrize("seed", repeats(range(4)))
def test_rotating_article_gravity_and_springs_together_changes_nothing(seed: int):
    parts = random_tree(seed, 3, 2, (JointState.SPRUNG,))
    env = Environment(title="lab", gravity=GRAVITY, suspension=None, springs=springs_from(parts, seed))
    R = rotation_exp(2.0 * np.random.default_rng(seed).standard_normal(3))
    rest, turned = solve_equilibrium(parts, env), solve_equilibrium(rotated(parts, R), rotated_lab(env, R))
    assert rest.converged
    assert turned.converged
    assert turned.tension == pytest.approx(rest.tension, rel=1e-8)
    first, second = solve_modes(rest), solve_modes(turned)
    # Newton's last residual of 1e-9 of the weight is what differs.
    assert second.omega[:20] == pytest.approx(first.omega[:20], rel=1e-8, abs=1e-8)


PERMUTATION = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def hung_bus() -> Structure:
    nodes = [
        node(n, (x, 0, 0), body(m, (0.01, -0.05, 0.02), (0.1, 0.2, 0.3)), 0.05)
        for n, x, m in (("a", 0.0, 5.0), ("b", 1.0, 8.0), ("c", 2.0, 6.0))
    ]
    payload = joint("p", "a", X, body(3.0, (0, -0.2, 0), (0.02, 0.01, 0.02)), offset=(0, -0.05, 0), angle=0.4)
    attach = [AttachPoint(n, n, np.array([0, 0.02, 0.01 * i])) for i, n in enumerate("abc")]
    members = [member("a", "b", TUBE, 3), member("b", "c", TUBE, 3)]
    return structure(nodes, members, [payload], attach=attach)


def hung_lab(factor: float = 1.0) -> Environment:
    return on_cables(4.0, 0.25, gravity=factor * GRAVITY)


def test_rotating_article_gravity_and_suspension_together_changes_nothing():
    """To 1e-10; held directions are world letters, so that the rotation permutes the axes."""
    parts, env = hung_bus(), hung_lab()
    R = PERMUTATION  # x to y, y to z, z to x
    held = tuple("".join("yzx"["xyz".index(c)] for c in h) for h in env.suspension.held)
    turned_env = dataclasses.replace(
        env, gravity=R @ env.gravity, suspension=dataclasses.replace(env.suspension, held=held)
    )
    first = solve_modes(solve_equilibrium(parts, env))
    second = solve_modes(solve_equilibrium(rotated(parts, R), turned_env))
    assert second.equilibrium.suspension.reaction == pytest.approx(
        first.equilibrium.suspension.reaction, rel=1e-10
    )
    assert second.equilibrium.holding_torque == pytest.approx(first.equilibrium.holding_torque, rel=1e-10)
    assert second.omega[:30] == pytest.approx(first.omega[:30], rel=1e-10)
    assert second.kind == first.kind


def test_no_gravity_and_no_springs_is_orbit():
    parts = hung_bus()
    orbit = solve_modes(solve_equilibrium(parts, Environment.orbit()))
    nothing = solve_modes(solve_equilibrium(parts, Environment(title="nothing", gravity=np.zeros(3))))
    assert nothing.omega == pytest.approx(orbit.omega, rel=0, abs=0)


def test_weak_gravity_approaches_orbit():
    """Flexible frequencies shift in proportion to g; at 1e-5 g they are those of orbit to 1e-5."""
    parts = hung_bus()
    orbit = solve_modes(solve_equilibrium(parts, Environment.orbit()))
    shifts = []
    for factor in (1e-4, 1e-5):
        env = hung_lab(factor)
        soft = dataclasses.replace(env.suspension, bounce_hz=0.25 * np.sqrt(factor))
        modes = solve_modes(solve_equilibrium(parts, dataclasses.replace(env, suspension=soft)))
        compared = compare_modes(orbit, modes)
        assert np.all(np.diff(compared.pairs, axis=1) == 0)  # same rank
        shifts.append(compared.ratio[:6] - 1.0)
    assert np.abs(shifts[1]).max() < 1e-5
    largest = np.argmax(np.abs(shifts[0]))
    assert shifts[0][largest] / shifts[1][largest] == pytest.approx(10.0, rel=0.01)


def test_nothing_compares_to_itself_as_anything_else():
    modes = solve_modes(solve_equilibrium(hung_bus(), Environment.orbit()))
    compared = compare_modes(modes, modes)
    assert compared.cross_orthogonality == pytest.approx(np.eye(compared.count), abs=1e-8)
    assert np.diag(compared.mac) == pytest.approx(np.ones(compared.count))
    assert compared.ratio == pytest.approx(np.ones(len(compared.pairs)))


@pytest.mark.parametrize("seed", range(4))
def test_tangent_at_rest_is_the_derivative_of_the_force(seed: int):
    """Where the gradient is zero, charts do not matter: every coordinate, loaded gimbals included."""
    parts = random_tree(seed, 3, 2, (JointState.FREE, JointState.SPRUNG))
    rest = solve_equilibrium(
        parts, Environment(title="lab", gravity=GRAVITY, suspension=None, springs=springs_from(parts, seed))
    )
    active = static_coordinates(rest.model)
    K = assemble(rest.model, rest.config, rest.loads).tangent.toarray()
    rng = np.random.default_rng(seed)
    q = np.where(active, rng.standard_normal(len(active)), 0.0)
    q /= np.linalg.norm(q)
    h = 1e-4

    def gradient(s: float) -> np.ndarray:
        return assemble(rest.model, move(rest.model.tree, rest.config, s * q), rest.loads).gradient

    slope = (8 * (gradient(h) - gradient(-h)) - (gradient(2 * h) - gradient(-2 * h))) / (12 * h)
    assert slope[active] == pytest.approx((K @ q)[active], abs=1e-8 * np.abs(K).max())


@given(st.floats(0.2, 5.0), st.integers(0, 100))
def test_units_of_mass_and_length_scale_as_they_must(size: float, seed: int):
    """Lengths times s and EI, GJ, EA L^2 times s^3 leave omega^2 = EI / (m L^3) f(GJ/EI, EA L^2/EI)."""
    parts = random_tree(seed, 2, 1)
    bigger_section = dataclasses.replace(
        TUBE,
        EA=TUBE.EA * size,
        GJ=TUBE.GJ * size**3,
        EI_y=TUBE.EI_y * size**3,
        EI_z=TUBE.EI_z * size**3,
        rho_A=TUBE.rho_A / size,
        rho_I_y=TUBE.rho_I_y * size,
        rho_I_z=TUBE.rho_I_z * size,
    )

    def grown(b: Body) -> Body:
        return Body(b.mass, size * b.cg, size**2 * b.inertia)

    bigger = dataclasses.replace(
        parts,
        nodes=tuple(
            dataclasses.replace(n, position=size * n.position, size=size * n.size, body=grown(n.body))
            for n in parts.nodes
        ),
        members=tuple(dataclasses.replace(m, section=bigger_section) for m in parts.members),
        joints=tuple(
            dataclasses.replace(j, offset=size * j.offset, body=grown(j.body)) for j in parts.joints
        ),
    )
    first, second = (solve_modes(solve_equilibrium(p, Environment.orbit())) for p in (parts, bigger))
    assert second.omega[:12] == pytest.approx(first.omega[:12], rel=1e-8)


def test_preloaded_ring_keeps_its_rigid_modes():
    """A tensioned string across a bent frame in space, self-equilibrated: it holds nothing."""
    parts = random_tree(11, 4, 1)
    places = {a.name: a.offset + next(n.position for n in parts.nodes if n.name == a.frame)
              for a in parts.attach_points if a.frame.startswith("n")}  # fmt: skip
    apart = float(np.linalg.norm(places["n3"] - places["n0"]))
    strung = dataclasses.replace(
        parts, springs=(Spring(name="s", start="n0", end="n3", stiffness=300.0, free_length=0.8 * apart),)
    )
    modes = solve_modes(solve_equilibrium(strung, Environment.orbit()))
    assert modes.kind.count("rigid") == 7
    assert modes.rigid_residual < 1e-9
