"""Bushings against matrices written down, rigid motions, and differences of the energy."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.errors import ConfigError
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.elements.bushings import bushing_state
from middeck.structure.elements.frames import move
from middeck.structure.elements.rotations import rotation_exp, rotation_log
from middeck.structure.model.article import AttachPoint, Bushing, LoadCase, PointLoad, Structure
from middeck.structure.model.environment import Environment, GroundBushing
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.structure.rest.suspension_tuning import environment_loads, tune_suspension
from middeck.structure.sensitivity.frequency_derivatives import differentiate_frequencies
from middeck.structure.sensitivity.parameters import find_parameters, set_parameter
from structure_builders import GRAVITY, TUBE, body, member, node, random_configuration, structure

NONE = np.zeros(3)


def coupled(rng: np.random.Generator, size: float = 100.0) -> np.ndarray:
    A = rng.standard_normal((6, 6))
    return size * (A @ A.T + 0.1 * np.eye(6))


def lump(rng: np.random.Generator) -> Structure:
    """A rigid body whose centre of mass is off its node, with an attach point at the node."""
    at = dataclasses.replace(body(2.0, inertia=(0.3, 0.4, 0.5)), cg=rng.uniform(-0.3, 0.3, 3))
    return structure([node("n", (0.5, 0.1, -0.2), at)], attach=[AttachPoint("foot", "n", NONE)])


def tied(K: np.ndarray, axes: np.ndarray, gravity: np.ndarray = NONE) -> Environment:
    bushing = GroundBushing(name="mount", attach="foot", stiffness=K, axes=axes)
    return Environment(title="bench", gravity=gravity, bushings=(bushing,))


@pytest.mark.parametrize("seed", range(3))
def test_a_body_on_a_coupled_bushing_has_the_frequencies_of_its_matrices(seed: int) -> None:
    rng = np.random.default_rng([6, seed])
    K, axes, parts = coupled(rng), rotation_exp(rng.standard_normal(3)), lump(rng)
    modes = solve_modes(solve_equilibrium(parts, tied(K, axes)))
    turned = np.kron(np.eye(2), axes)
    b = parts.nodes[0].body
    x, y, z = b.cg
    arm = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    M = np.block([[b.mass * np.eye(3), -b.mass * arm], [b.mass * arm, b.inertia - b.mass * arm @ arm]])
    want = sla.eigh(turned @ K @ turned.T, M, eigvals_only=True)
    np.testing.assert_allclose(modes.omega**2, want, rtol=1e-9)
    assert set(modes.kind) == {"suspension"}


@pytest.mark.parametrize("seed", range(8))
def test_what_a_bushing_leaves_free_gets_no_stiffness_from_its_axes(seed: int) -> None:
    """A body on one spring in any direction: k (n' u)^2 and five motions of 0 Hz."""
    rng = np.random.default_rng([31, seed])
    K, axes, parts = np.diag([5e5, 0, 0, 0, 0, 0]), rotation_exp(rng.standard_normal(3)), lump(rng)
    modes = solve_modes(solve_equilibrium(parts, tied(K, axes)))
    assert np.count_nonzero(modes.omega) == 1
    b, n = parts.nodes[0].body, axes[:, 0]
    across = np.cross(b.cg, n)
    compliance = 1.0 / b.mass + across @ np.linalg.solve(b.inertia, across)
    np.testing.assert_allclose(modes.omega[-1] ** 2, 5e5 * compliance, rtol=1e-9)


def test_a_bushing_is_linear_in_the_rotation_vector_to_any_turn() -> None:
    rng = np.random.default_rng(7)
    K = np.diag([1e3, 1e3, 1e3, 2.0, 3.0, 4.0])
    axes = rotation_exp(rng.standard_normal(3))
    load = PointLoad(name="twist", frame="n", moment=axes[:, 2] * 4.0 * 1.7)
    rest = solve_equilibrium(lump(rng), tied(K, axes), LoadCase(name="c", loads=(load,)))
    assert rest.converged
    np.testing.assert_allclose(rotation_log(rest.config.R[0]), 1.7 * axes[:, 2], atol=1e-9)
    np.testing.assert_allclose(rest.reactions[0].moment, -load.moment, atol=1e-8)


def test_a_bushing_carries_a_weight_off_its_point() -> None:
    rng = np.random.default_rng(8)
    K, axes, parts = coupled(rng, 1e6), rotation_exp(rng.standard_normal(3)), lump(rng)
    rest = solve_equilibrium(parts, tied(K, axes, GRAVITY))
    (mount,) = rest.reactions
    np.testing.assert_allclose(mount.force, -2.0 * GRAVITY, rtol=1e-9, atol=1e-9)
    arm = rest.config.R[0] @ parts.nodes[0].body.cg
    np.testing.assert_allclose(mount.moment, -np.cross(arm, 2.0 * GRAVITY), rtol=1e-8, atol=1e-8)


def two_boxes(rng: np.random.Generator) -> Structure:
    """Two beams whose inner nodes are joined by a bushing between points off both."""
    parts = structure(
        [
            node(n, p, body(1.0, inertia=(0.1, 0.2, 0.2)))
            for n, p in zip("abcd", rng.uniform(-1, 1, (4, 3)), strict=True)
        ],
        [member("a", "b", TUBE, 1), member("c", "d", TUBE, 1)],
        attach=[
            AttachPoint("p", "b", rng.uniform(-0.2, 0.2, 3)),
            AttachPoint("q", "c", rng.uniform(-0.2, 0.2, 3)),
            AttachPoint("foot", "a", rng.uniform(-0.2, 0.2, 3)),
        ],
    )
    axes = rotation_exp(rng.standard_normal(3))
    return dataclasses.replace(
        parts, bushings=(Bushing(name="rubber", start="p", end="q", stiffness=coupled(rng), axes=axes),)
    )


@pytest.mark.parametrize("size", [0.0, 0.1, 1.0])
def test_gradient_and_tangent_are_derivatives_of_the_energy(size: float) -> None:
    rng = np.random.default_rng(9)
    parts = two_boxes(rng)
    model = mesh_structure(parts)
    environment = tied(coupled(rng), rotation_exp(rng.standard_normal(3)))
    loads = environment_loads(model, environment, tune_suspension(model, environment))
    at = dataclasses.replace(random_configuration(model, rng, 0.3 * size), since_drawn=None)
    here = assemble(model, at, loads)
    h, e = 1e-30, 1e-5
    way = rng.standard_normal((2, model.tree.size))

    def slope(q: np.ndarray) -> float:
        there = move(model.tree, at, q + 1j * h * way[1])
        return float(assemble(model, there, loads).energy.imag / h)

    assert here.gradient @ way[1] == pytest.approx(slope(0.0 * way[0]), rel=1e-10)
    # The mixed second derivative along straight lines in the chart is that of the sum less those of each.
    both = [_curvature(lambda q, w=w: _energy(model, at, loads, q * w), e) for w in (way[0] + way[1], *way)]
    want = 0.5 * (both[0] - both[1] - both[2])
    assert way[0] @ (here.tangent @ way[1]) == pytest.approx(want, rel=1e-4)


def _energy(model, at, loads, q):
    return assemble(model, move(model.tree, at, q), loads).energy


def _curvature(energy, e):
    """By complex steps of the slope."""
    h = 1e-20
    return (energy(e + 1j * h).imag - energy(-e + 1j * h).imag) / (2.0 * e * h)


def test_moving_both_ends_as_one_body_strains_nothing() -> None:
    rng = np.random.default_rng(10)
    Q = rotation_exp(np.array([1.0, -0.7, 0.4]))
    span = rng.standard_normal(3)
    state = bushing_state(
        coupled(rng)[None],
        rotation_exp(rng.standard_normal(3))[None],
        (Q @ span)[None],
        (Q @ span - span)[None],
        np.stack([Q, Q])[None] - np.eye(3),
    )
    assert np.abs(state.gradient).max() < 1e-11


def test_free_boxes_on_a_bushing_have_six_rigid_modes() -> None:
    modes = solve_modes(solve_equilibrium(two_boxes(np.random.default_rng(11)), Environment.orbit()))
    assert modes.kind[:7] == ("rigid",) * 6 + ("flexible",)
    assert "bushing" in modes.name[6]


def test_derivatives_by_bushings_masses_and_loads_are_those_of_differences() -> None:
    rng = np.random.default_rng(12)
    parts, environment = two_boxes(rng), tied(coupled(rng), np.eye(3), 0.1 * GRAVITY)
    load = PointLoad(name="push", frame="d", force=np.array([1.0, -2.0, 0.5]))
    parts = dataclasses.replace(parts, loads=(load,))
    names = ["bushing.rubber.stiffness.14", "environment.bushing.mount.stiffness.22", "load.push.force.x"]
    names += ["attach.p.offset.y"]
    modes = solve_modes(solve_equilibrium(parts, environment))
    parameters = find_parameters(parts, environment, names)
    found = differentiate_frequencies(modes, parameters, 8).d_lambda
    lam = modes.omega[:8] ** 2
    for row, parameter in zip(found, parameters, strict=True):
        h = 1e-3 * max(1.0, abs(parameter.value))
        near = [
            solve_modes(solve_equilibrium(*set_parameter(parts, environment, parameter, parameter.value + s)))
            for s in (h, -h)
        ]
        want = (near[0].omega[:8] ** 2 - near[1].omega[:8] ** 2) / (2.0 * h)
        np.testing.assert_allclose(row / lam, want / lam, rtol=1e-4, atol=1e-7, err_msg=parameter.name)


@pytest.mark.parametrize(
    ("message", "change"),
    [
        ("not symmetric: 5 in row 1, column 2", (0, 1, 5.0)),
        ("indefinite", (2, 2, -1.0)),
        ("not a number", (3, 3, np.nan)),
    ],
)
def test_a_stiffness_that_cannot_be_is_refused(message: str, change: tuple[int, int, float]) -> None:
    K = np.eye(6)
    K[change[0], change[1]] = change[2]
    with pytest.raises(ConfigError, match=message):
        solve_equilibrium(lump(np.random.default_rng(0)), tied(K, np.eye(3)))
