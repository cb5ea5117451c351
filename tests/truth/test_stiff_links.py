"""Rest states and modes beside links of 1 to 1e22 N/m, against relative coordinates by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from stiff_links import article_of, draw, solve

from middeck.files.setups import load_structure
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.model.article import AttachPoint, Section
from middeck.structure.model.environment import AnchoredSpring, Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import node_rotations, rest_imbalance, solve_equilibrium
from repeats import LONG, repeats
from structure_builders import GRAVITY, body, lab, member, node, structure

pytestmark = pytest.mark.kernels

CASES = 10_000 if LONG else 8
G = 9.80665


def _seeds(share: int) -> range:
    return range(share * CASES // 10, (share + 1) * CASES // 10) if LONG else range(CASES)


@pytest.mark.parametrize("share", range(10 if LONG else 1))
def test_dumbbells_with_links_of_any_stiffness(share: int):
    """Near the origin, up to 1 km away, and turned as well: to 1e-4, of which members' bending takes 1e-6."""
    refused: list[int] = []
    for seed in _seeds(share):
        rng = np.random.default_rng(seed)
        case = draw(rng)
        truth = solve(case)
        assert truth is not None
        place = int(rng.integers(3))
        origin = np.zeros(3) if place == 0 else 10.0 ** rng.uniform(0, 3) * rng.uniform(-1, 1, 3)
        R = rotation_exp(rng.standard_normal(3)) if place == 2 else np.eye(3)
        rest = solve_equilibrium(*article_of(case, origin, R))
        if not rest.converged:
            refused.append(seed)
            continue
        shift = (rest.config.x - rest.model.rest.x)[:3] @ R
        turn = np.array(list(node_rotations(rest).values())) @ R
        assert np.abs(shift - truth.shift).max() < 1e-4 * np.abs(truth.shift).max()
        assert np.abs(turn - truth.turn).max() < 1e-4 * max(np.abs(truth.turn).max(), 1e-3)
        modes = solve_modes(rest)
        assert modes.omega[:6] == pytest.approx(truth.omega[:6], rel=1e-4)
        assert modes.kind[:6] == ("suspension",) * 6
    assert len(refused) <= 0.01 * CASES


def test_a_translation_of_everything_changes_nothing():
    """Beyond the rounding of coordinates: 1e-13 m at 1 km, over a link of 1 mm and more."""
    for seed in (3, 5, 8):
        case = draw(np.random.default_rng(seed))
        length = float(np.linalg.norm(case.at[2] - case.at[1]))
        here = solve_equilibrium(*article_of(case))
        far = solve_equilibrium(*article_of(case, np.array([1e3, -700.0, 500.0])))
        allowed = max(1e-9, 4e-13 / length)
        moved = [(r.config.x - r.model.rest.x) for r in (here, far)]
        assert moved[1] == pytest.approx(moved[0], abs=allowed * np.abs(moved[0]).max())
        omega = [solve_modes(r).omega[:8] for r in (here, far)]
        assert omega[1][:6] == pytest.approx(omega[0][:6], rel=allowed)
        assert omega[1] == pytest.approx(omega[0], rel=1e-6)  # kHz beside GHz: 3e-8 of rounding


def test_a_weight_on_a_soft_spring_sinks_anywhere():
    """20 g on 0.5 N/m: m g/k, as near as 1 km from the origin."""
    for x in (0.0, 100.0, 1000.0):
        parts = structure(
            [node("n", (x, 0, 0), body(0.02, inertia=(1e-5,) * 3))],
            attach=[AttachPoint("p", "n", np.zeros(3))],
        )
        spring = AnchoredSpring(
            name="s", attach="p", anchor=np.array([x, 1.0, 0.0]), stiffness=0.5, free_length=1.0
        )
        rest = solve_equilibrium(parts, lab(spring))
        assert rest.converged
        assert (rest.config.x - rest.model.rest.x)[0] == pytest.approx([0.0, -0.02 * G / 0.5, 0.0], abs=1e-9)


def test_what_a_thread_holds_is_not_rigid():
    """Three zero-length springs on a steel link: omega^2 goes with their stiffness, to 1e-9 N/m and below."""
    steel = Section(EA=1e8, GJ=8e3, EI_y=1e4, EI_z=1e4, rho_A=0.5, rho_I_y=0.0, rho_I_z=0.0)
    nodes = [node(n, x, body(1.0, inertia=(1e-2,) * 3)) for n, x in (("a", (0, 0, 0)), ("b", (0.01, 0, 0)))]
    offsets = ((0.3, 0.0, 0.0), (0.0, 0.4, 0.1), (-0.2, -0.1, 0.3))
    attach = [AttachPoint(f"p{i}", "a", np.array(o)) for i, o in enumerate(offsets)]
    parts = structure(nodes, [member("a", "b", steel, 1)], attach=attach)

    def omega(k: float) -> np.ndarray:
        ties = tuple(
            AnchoredSpring(name=p.name, attach=p.name, anchor=p.offset, stiffness=k, free_length=0.0)
            for p in attach
        )
        modes = solve_modes(
            solve_equilibrium(
                parts, Environment(title="threads", gravity=np.zeros(3), suspension=None, springs=ties)
            )
        )
        assert modes.kind[:6] == ("suspension",) * 6
        return modes.omega[:6] / np.sqrt(k)

    for k in (1e-6, 1e-9, 1e-11):
        assert omega(k) == pytest.approx(omega(1.0), rel=1e-4)
    free = solve_modes(solve_equilibrium(parts, Environment.orbit()))
    assert free.kind[:7] == ("rigid",) * 6 + ("flexible",)


@pytest.mark.parametrize("x", repeats([1000.0, 0.0]))
@pytest.mark.parametrize("times", repeats([1e6, 0.3, 1.0, 1e3], 2))
def test_a_closed_ring_of_short_stiff_members_turns_as_one_body(times: float, x: float):
    """Twelve members, of 3e12 N/m and more, in a loop at the end of a bus: it turns as with a rigid hub."""
    turns = 2.0 * np.pi * np.arange(12) / 12
    ring = [
        node(f"r{i}", (x + 1.0 + 0.01 * np.cos(t), 0.01 * np.sin(t), 0.0), body(0.05, inertia=(1e-6,) * 3))
        for i, t in enumerate(turns)
    ]
    steel, bus = (
        Section(
            EA=times * 1e8,
            GJ=times * 8e4,
            EI_y=times * 1e5,
            EI_z=times * 1e5,
            rho_A=0.0,
            rho_I_y=0.0,
            rho_I_z=0.0,
        ),
        Section(EA=1e7, GJ=8e3, EI_y=1e4, EI_z=1e4, rho_A=0.0, rho_I_y=0.0, rho_I_z=0.0),
    )
    nodes = [node("a", (x, 0, 0), body(2.0, inertia=(0.02,) * 3)), *ring]
    links = [member(f"r{i}", f"r{(i + 1) % 12}", steel, 1, up=(0, 0, 1)) for i in range(12)]
    links.append(member("a", "r6", bus, 1, up=(0, 0, 1)))
    points = {"p": ("a", (0, 0.1, 0.1)), "q": ("r6", (0.0, 0.1, 0)), "s": ("a", (0.1, 0.1, -0.1))}
    places = {n.name: n.position for n in nodes}

    def hung(nodes, links):
        attach = [AttachPoint(n, f, np.array(o)) for n, (f, o) in points.items()]
        ties = tuple(
            AnchoredSpring(
                name=n, attach=n, anchor=places[f] + np.array(o) + [0, 3, 0], stiffness=10.0, free_length=2.0
            )
            for n, (f, o) in points.items()
        )
        return structure(nodes, links, attach=attach), lab(*ties)

    rest = solve_equilibrium(*hung(nodes, links))
    whole = [n for n in nodes if n.name in ("a", "r6")]
    centre = np.array([0.01, 0.0, 0.0])
    about = [n.position - places["r6"] - centre for n in ring]
    inertia = sum(0.05 * (r @ r * np.eye(3) - np.outer(r, r)) for r in about) + 12e-6 * np.eye(3)
    whole[1] = node("r6", places["r6"], body(0.6, centre, np.diag(inertia)))
    solid = solve_equilibrium(*hung(whole, links[-1:]))
    ours, theirs = (node_rotations(r)["a"] for r in (rest, solid))
    assert ours == pytest.approx(theirs, abs=1e-6 * np.linalg.norm(theirs))  # the ring gives by 1e-7
    assert solve_modes(rest).omega[:7] == pytest.approx(solve_modes(solid).omega[:7], rel=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_a_free_article_has_its_rigid_modes_whatever_its_masses(seed: int):
    """The rounding of 1e-21 that is left of zero lies near the least that a thread would make."""
    rng = np.random.default_rng(seed)
    masses = tuple(f"node.{i}.mass={10.0 ** rng.uniform(-1.0, 2.0):.4g}" for i in range(3))
    article = load_structure(Path(__file__).parents[2] / "articles/mace-simple.toml", masses)
    modes = solve_modes(solve_equilibrium(article, Environment.orbit()))
    assert modes.kind[:11] == ("rigid",) * 10 + ("flexible",)


@pytest.mark.parametrize("k", [1e6, 1e12])
def test_supports_of_any_stiffness_settle(k: float):
    """A double pendulum's body on two struts turns to where they pull in one plane with its weight."""
    attach = [
        AttachPoint(n, "a", np.array(o)) for n, o in (("p", (0.03, 0.1, 0.02)), ("q", (-0.1, 0.1, 0.05)))
    ]
    parts = structure([node("a", (0, 0, 0), body(2.0, inertia=(0.1,) * 3))], attach=attach)
    ties = (
        AnchoredSpring(
            name="s", attach="p", anchor=np.array([0.03, 0.6, 0.02]), stiffness=k, free_length=0.5
        ),
        AnchoredSpring(
            name="t", attach="q", anchor=np.array([-0.1, 0.6, 0.05]), stiffness=k, free_length=0.45
        ),
    )
    rest = solve_equilibrium(parts, lab(*ties))
    assert rest.converged
    assert len(rest.history) < 60
    # Two inextensible strings of 0.5 and 0.45 m; they give by m g/2k.
    assert rest.config.x[0] == pytest.approx([-0.0350876, 0.0134454, 0.0350202], abs=2e-7 + 40.0 / k)
    left = rest_imbalance(rest)
    assert max(left.force, left.moment) == pytest.approx(rest.residual, rel=1e-12)
    assert left.weight == pytest.approx(2.0 * G)


@pytest.mark.parametrize("load", repeats([3.0, 1.0, 10.0]))
def test_a_cantilever_bends_like_the_elastica(load: float):
    """P L^2/EI of 1 to 10 on a support of 1e9 N/m: 30 to 81 % deflection (Mattiasson 1981), in tens."""
    deflection = {1.0: (0.05643324, 0.30172077), 3.0: (0.25442, 0.60325), 10.0: (0.55500, 0.81061)}
    EI = 10.0
    section = Section(EA=1e6, GJ=8.0, EI_y=EI, EI_z=EI, rho_A=1e-6, rho_I_y=0.0, rho_I_z=0.0)
    arms = ((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1))
    attach = [AttachPoint(f"p{i}", "a", np.array(o, dtype=float)) for i, o in enumerate(arms)]
    nodes = [node("a", (0, 0, 0)), node("b", (1, 0, 0), body(load * EI / G))]
    parts = structure(nodes, [member("a", "b", section, 10, up=(0, 0, 1))], attach=attach)
    rest = solve_equilibrium(
        parts,
        lab(
            *(
                AnchoredSpring(name=p.name, attach=p.name, anchor=p.offset, stiffness=1e9, free_length=0.0)
                for p in attach
            )
        ),
    )
    assert rest.converged
    assert len(rest.history) <= 60
    along, down = -(rest.config.x - rest.model.rest.x)[1, :2]
    # Ten cubic elements on chords, and the stretch P/EA.
    assert (along, down) == pytest.approx(deflection[load], rel=2e-3)


@pytest.mark.parametrize("depth", repeats([0.1, 0.5]))
def test_a_cable_drawn_as_a_v_settles(depth: float):
    """In tens of steps, and symmetric; the lowest point rises above the V's."""
    cable = Section(EA=1e5, GJ=1e-3, EI_y=1e-3, EI_z=1e-3, rho_A=0.05, rho_I_y=0.0, rho_I_z=0.0)
    nodes = [node(n, x) for n, x in (("a", (0, 0, 0)), ("c", (1, -depth, 0)), ("b", (2, 0, 0)))]
    attach = [AttachPoint(n, n, np.zeros(3)) for n in "ab"]
    links = [member("a", "c", cable, 8, up=(0, 0, 1)), member("c", "b", cable, 8, up=(0, 0, 1))]
    ties = [
        AnchoredSpring(name=n, attach=n, anchor=np.array(x, dtype=float), stiffness=1e9, free_length=0.0)
        for n, x in (("a", (0, 0, 0)), ("b", (2, 0, 0)))
    ]
    rest = solve_equilibrium(structure(nodes, links, attach=attach), lab(*ties, gravity=GRAVITY))
    assert rest.converged
    assert len(rest.history) <= 60
    shift = (rest.config.x - rest.model.rest.x)[1]
    assert abs(shift[0]) < 1e-8
    assert 0.0 < shift[1] < 0.12 * depth / 0.5 + 0.02
