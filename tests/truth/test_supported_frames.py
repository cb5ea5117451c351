"""Rest states of supported articles of any size, stiffness and load, against linear statics and others."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from frame_reference import solve_frame
from middeck.errors import ConfigError, EquilibriumError, NumericalError
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.model.article import (
    AddedMass,
    AttachPoint,
    Bushing,
    LoadCase,
    PointLoad,
    Section,
    Structure,
)
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment, GroundBushing
from middeck.structure.model.load_case import apply_load_case
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import Equilibrium, rest_warnings, solve_equilibrium
from middeck.structure.sensitivity.frequency_derivatives import differentiate_frequencies
from middeck.structure.sensitivity.parameters import find_parameters
from repeats import repeats
from structure_builders import TUBE, body, member, node, straight_beam, structure

NONE = np.zeros(3)
SIX = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


def bench(
    *clamps: Clamp, gravity: np.ndarray = NONE, bushings: tuple[GroundBushing, ...] = ()
) -> Environment:
    return Environment(title="bench", gravity=gravity, clamps=clamps, bushings=bushings)


def random_frame(rng: np.random.Generator) -> tuple[Structure, Environment, LoadCase, float]:
    """A frame with bushings on skew clamps under slight loads, and its size."""
    size, EI, slight = 10.0 ** rng.uniform([-3, -2, -8], [3, 8, -6])
    n = int(rng.integers(3, 6))
    joined = {(i, i + 1) for i in range(n - 1)} | {(0, n - 1)}
    members = []
    for i, j in sorted(joined):
        a = EI * rng.uniform(0.3, 3.0, 3)
        shear = EI / size**2 * rng.uniform(3.0, 30.0, 2) if rng.random() < 0.5 else np.full(2, np.inf)
        section = Section(
            EA=EI / size**2 * 10.0 ** rng.uniform(1, 5),
            GJ=a[0],
            EI_y=a[1],
            EI_z=a[2],
            rho_A=10.0 ** rng.uniform(-2, 1),
            rho_I_y=1e-4,
            rho_I_z=1e-4,
            GA_y=shear[0],
            GA_z=shear[1],
        )
        ends = 0.1 * size * rng.uniform(-1.0, 1.0, (2, 3))
        plain = member(f"n{i}", f"n{j}", section, int(rng.integers(1, 3)), rng.standard_normal(3).tolist())
        members.append(dataclasses.replace(plain, start_offset=ends[0], end_offset=ends[1]))

    def lump() -> object:
        return body(rng.uniform(0.1, 2.0), size * rng.uniform(-0.2, 0.2, 3))

    def stiffness() -> np.ndarray:
        A = rng.standard_normal((6, 6)) * (SIX + size * (1.0 - SIX))[:, None]
        full = A @ A.T + 0.3 * np.diag((SIX + size * (1.0 - SIX)) ** 2)
        return EI / size**3 * 10.0 ** rng.uniform(-2, 2) * full

    def axes() -> np.ndarray:
        return rotation_exp(rng.standard_normal(3))

    parts = structure(
        [node(f"n{i}", size * rng.uniform(-1.0, 1.0, 3), lump()) for i in range(n)],
        members,
        attach=[AttachPoint(f"a{i}", f"n{i}", 0.2 * size * rng.uniform(-1.0, 1.0, 3)) for i in range(n)],
    )
    rubber = Bushing(name="rubber", start="a0", end=f"a{n - 1}", stiffness=stiffness(), axes=axes())
    parts = dataclasses.replace(parts, bushings=(rubber,))
    mount = GroundBushing(name="mount", attach="a1", stiffness=stiffness(), axes=axes())
    skew = Clamp(node="n0", along="xz", about="y", axes=axes())
    moved = Clamp(node="n2", axes=axes(), shift=slight * size * rng.standard_normal(3))
    moved = dataclasses.replace(moved, turn=slight * rng.standard_normal(3))
    pull = EI / size**2 * slight
    force, moment, arm = rng.standard_normal((3, 3)) * np.array([[pull], [pull * size], [0.2 * size]])
    load = PointLoad(name="push", frame="n1", force=force, moment=moment, offset=arm)
    case = LoadCase(
        name="case",
        loads=(load,),
        masses=(AddedMass("lump", "n1", lump()),),
        prescribed=(moved,) if rng.random() < 0.5 else (),
    )
    gravity = rng.standard_normal(3) * pull / parts.mass * rng.integers(0, 2)
    return parts, bench(skew, gravity=gravity, bushings=(mount,)), case, size


# Seed 37 moves by 1e-8 of its size: rounding of the rest state is a part of that, not of the size.
@pytest.mark.parametrize("seed", repeats((37, *range(37), *range(38, 60)), 8))
def test_slight_loads_bend_frames_of_any_size_as_linear_statics_does(seed: int) -> None:
    parts, surroundings, case, size = random_frame(np.random.default_rng([2026, seed]))
    motion, reactions = solve_frame(*apply_load_case(parts, surroundings, case))
    rest = solve_equilibrium(parts, surroundings, case)
    assert rest.converged
    n = len(motion)
    R = rest.config.R[:n]
    turn = 0.5 * (R - np.swapaxes(R, 1, 2))[:, [2, 0, 1], [1, 2, 0]]
    got = np.hstack([(rest.config.x[:n] - rest.model.rest.x[:n]) / size, turn])
    want = np.hstack([motion[:, :3] / size, motion[:, 3:]])
    most = np.abs(want).max()
    # Second order of the motion, and 1e-16 of the size in a coordinate.
    np.testing.assert_allclose(got, want, atol=(30.0 * most + 1e-6) * most + 1e-15)
    scale = np.concatenate([np.ones(3), np.full(3, size)])
    largest = max(np.abs(r / scale).max() for r in reactions.values())
    for at, force, moment in rest.reactions:
        given = np.concatenate([force, moment]) / scale
        np.testing.assert_allclose(given, reactions[at] / scale, atol=(30.0 * most + 1e-6) * largest)


def bathe_bend(elements: int = 8) -> Structure:
    """Bathe and Bolourchi 1979, section 4.3: an eighth of a circle of radius 100, of a square of side one."""
    E, angle = 1e7, np.linspace(0.0, np.pi / 4.0, elements + 1)
    square = Section(
        EA=E, GJ=0.0704 * E, EI_y=E / 12, EI_z=E / 12, rho_A=1e-3, rho_I_y=1e-4, rho_I_z=1e-4,
        GA_y=5.0 / 12.0 * E, GA_z=5.0 / 12.0 * E,
    )  # fmt: skip
    nodes = [node(f"n{i}", (100.0 * np.sin(a), 100.0 * (1.0 - np.cos(a)), 0)) for i, a in enumerate(angle)]
    members = [member(f"n{i}", f"n{i + 1}", square, 1, (0, 0, 1)) for i in range(elements)]
    return structure(nodes, members, attach=[AttachPoint("root", "n0", NONE)])


@pytest.mark.parametrize("stiffness", repeats([1e15, None, 1e9], 2))
@pytest.mark.parametrize(
    ("force", "tip"), repeats([(300.0, (58.84, 22.33, 40.08)), (600.0, (47.23, 15.79, 53.37))][::-1])
)
def test_the_45_degree_bend_settles_in_tens_of_iterations(
    force: float, tip: tuple[float, ...], stiffness: float | None
) -> None:
    """Figures of Simo and Vu-Quoc 1986, 8 elements; those of other programs differ by as much."""
    where = bench(Clamp(node="n0"))
    if stiffness is not None:
        mount = GroundBushing(name="mount", attach="root", stiffness=stiffness * np.eye(6))
        where = bench(bushings=(mount,))
    case = LoadCase(name="up", loads=(PointLoad(name="up", frame="n8", force=np.array([0.0, 0.0, force])),))
    rest = solve_equilibrium(bathe_bend(), where, case)
    assert rest.converged
    assert rest.stable
    assert len(rest.history) < 40
    np.testing.assert_allclose(rest.config.x[8], tip, atol=0.4)


@pytest.mark.parametrize("mass", [0.3, 3.0])
def test_a_heavy_tip_takes_few_factorisations(mass: float) -> None:
    case = LoadCase(name="tip", masses=(AddedMass("tip", "b", body(mass)),))
    rest = solve_equilibrium(straight_beam(TUBE, 2.0, 10), Environment.clamped("a"), case)
    assert rest.converged
    assert len(rest.history) <= 15


@pytest.mark.parametrize("force", [1e-20, 1e-9])
def test_in_weightlessness_no_load_is_too_small(force: float) -> None:
    """A body of a tonne beside it: the weight that it would have on the ground is no measure of the load."""
    beam = straight_beam(TUBE, 2.0, 2)
    heavy = dataclasses.replace(beam.nodes[0], body=body(1000.0, inertia=(1.0, 1.0, 1.0)))
    beam = dataclasses.replace(beam, nodes=(heavy, beam.nodes[1]))
    case = LoadCase(
        name="pull", loads=(PointLoad(name="pull", frame="b", force=np.array([0.0, force, 0.0])),)
    )
    rest = solve_equilibrium(beam, bench(Clamp(node="a")), case)
    since = rest.config.since_drawn
    assert since is not None
    assert since.shift[1, 1] == pytest.approx(force * 2.0**3 / 300.0, rel=1e-6)
    np.testing.assert_allclose(rest.reactions[0].force, [0.0, -force, 0.0], rtol=1e-6, atol=1e-6 * force)


def on_mounts(stiffness: float) -> Equilibrium:
    """Wall, bushing, beam, bushing, body, under a weight that turns the body by 41 deg."""
    K, lump = stiffness * np.eye(6), body(3, (0, 0.2, 0.1), (0.1, 0.2, 0.15))
    parts = structure(
        [node("a", (0.5, 0, 0)), node("b", (2.5, 0, 0)), node("c", (3, 0, 0), lump)],
        [member("a", "b", TUBE, 4)],
        attach=[
            AttachPoint("foot", "a", np.array([-0.25, 0.1, 0.0])),
            AttachPoint("p", "b", np.array([0.2, 0.0, 0.1])),
            AttachPoint("q", "c", np.array([-0.25, 0.0, 0.05])),
        ],
    )  # fmt: skip
    parts = dataclasses.replace(parts, bushings=(Bushing(name="j", start="p", end="q", stiffness=K),))
    mount = GroundBushing(name="mount", attach="foot", stiffness=K)
    return solve_equilibrium(parts, bench(gravity=np.array([0.0, -9.8, 2.0]), bushings=(mount,)))


@pytest.mark.parametrize("stiffness", repeats([1e22, 1e10, 1e14, 1e18], 2))
def test_beside_bushings_of_any_stiffness_the_article_rests_as_if_they_were_rigid(stiffness: float) -> None:
    rigid = structure(
        [node("a", (0.5, 0, 0)), node("b", (2.5, 0, 0), body(3, (0.5, 0.2, 0.1), (0.1, 0.2, 0.15)))],
        [member("a", "b", TUBE, 4)],
    )
    want = solve_equilibrium(rigid, bench(Clamp(node="a"), gravity=np.array([0.0, -9.8, 2.0])))
    got = on_mounts(stiffness)
    assert got.converged
    assert len(got.history) < 30
    np.testing.assert_allclose(got.config.x[1], want.config.x[1], atol=200.0 / stiffness + 1e-12)
    omega = solve_modes(got).omega[:6], solve_modes(want).omega[:6]
    np.testing.assert_allclose(*omega, rtol=2e4 / stiffness + 1e-4)


def twisted(moment: float) -> Equilibrium:
    parts = structure(
        [node("n", NONE, body(1.0, inertia=(0.1,) * 3))], attach=[AttachPoint("foot", "n", NONE)]
    )
    mount = GroundBushing(name="mount", attach="foot", stiffness=np.diag([1e4] * 3 + [1.0] * 3))
    load = PointLoad(name="twist", frame="n", moment=np.array([0.0, 0.0, moment]))
    return solve_equilibrium(parts, bench(bushings=(mount,)), LoadCase(name="c", loads=(load,)))


def test_a_bushing_turned_to_its_end_says_so() -> None:
    rest = twisted(3.0)
    assert rest.converged
    assert not any("bushing" in w for w in rest_warnings(rest))
    with pytest.raises(EquilibriumError) as lost:
        solve_modes(dataclasses.replace(rest, residual=1.0))
    assert "bushing 'mount' has turned far" in lost.value.hint
    with pytest.raises(EquilibriumError, match=r"bushing 'mount': its frames turn by 179.7 deg"):
        twisted(np.pi - 5e-3)


def test_names_that_clash_and_modes_of_what_cannot_move_are_refused() -> None:
    beam = straight_beam(TUBE, 2.0, 1)
    with pytest.raises(ConfigError, match="load case 'x' is there twice"):
        solve_equilibrium(
            dataclasses.replace(beam, load_cases=(LoadCase(name="x"), LoadCase(name="x"))),
            bench(Clamp(node="a")),
        )
    mount = GroundBushing(name="a", attach="foot", stiffness=np.eye(6))
    with pytest.raises(ConfigError, match="two supports are called 'a'"):
        bench(Clamp(node="a"), bushings=(mount,))
    with pytest.raises(ConfigError, match="there are no modes"):
        solve_modes(solve_equilibrium(beam, Environment.clamped("a", "b")))


def test_derivatives_beside_a_bushing_too_stiff_for_them_are_refused() -> None:
    modes = solve_modes(on_mounts(1e18))
    at = modes.equilibrium
    parameters = find_parameters(at.model.structure, at.environment, ["member.a-b.EI_y"])
    with pytest.raises(NumericalError, match=r"would be rounding: bushing '(j|mount)'"):
        differentiate_frequencies(modes, parameters, 3)
