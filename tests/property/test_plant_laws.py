"""Laws of plants that hold for every structure: reciprocity, completeness, and where damping comes from."""

from __future__ import annotations

import dataclasses

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from test_structure_laws import random_tree, unit

from middeck.structure.model.article import Actuator, ActuatorKind, Damping, Sensor, SensorKind, Structure
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.damping import estimate_damping
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.systems.state_space.modal_system import modal_response

trees = st.tuples(st.integers(0, 10**6), st.integers(2, 4), st.integers(0, 3))
PORTS = ("t0", "t1", "t2")
UNDAMPED = Damping()


def with_ports(parts: Structure, seed: int) -> Structure:
    """Torques and angles in pairs about random axes, and a force and an accelerometer at one point."""
    rng = np.random.default_rng(seed)
    frames = [p.name for p in (*parts.nodes, *parts.joints)]
    places = [frames[int(rng.integers(len(frames)))] for _ in PORTS]
    axes = [unit(rng) for _ in PORTS]
    pairs = list(zip(PORTS, places, axes, strict=True))
    point, along, where = 0.2 * unit(rng), unit(rng), frames[int(rng.integers(len(frames)))]
    force = Actuator(name="f", frame=where, axis=along, kind=ActuatorKind.FORCE, offset=point)
    feel = Sensor(
        name="f", frame=where, axis=along, axis_frame="", kind=SensorKind.ACCELEROMETER, offset=point
    )
    return dataclasses.replace(
        parts,
        actuators=(*(Actuator(name=n, frame=f, axis=a) for n, f, a in pairs), force),
        sensors=(*(Sensor(name=n, frame=f, axis=a, axis_frame=f) for n, f, a in pairs), feel),
    )


def free_modes(tree: tuple[int, int, int]) -> Modes:
    return solve_modes(solve_equilibrium(with_ports(random_tree(*tree), tree[0]), Environment.orbit()))


@settings(max_examples=10, deadline=None)
@given(trees)
def test_kept_modes_and_residual_are_the_flexibility_of_the_elastic_whole(tree: tuple[int, int, int]):
    modes = free_modes(tree)
    whole = build_plant(modes, inputs=PORTS, outputs=PORTS, count=10**6, damping=UNDAMPED).dynamics
    rigid = int(np.sum(modes.omega == 0.0))
    count = rigid + tree[0] % 6
    cut = build_plant(modes, inputs=PORTS, outputs=PORTS, count=count, damping=UNDAMPED, static=True)
    terms = [
        whole.phi[:, m] / whole.omega[m] ** 2 @ whole.psi[m] for m in (slice(rigid, None), slice(count, None))
    ]
    # Rounding of a flexibility whose members' stiffnesses span 1e4.
    size = np.abs(terms[0]).max()
    np.testing.assert_allclose(cut.dynamics.direct, terms[1], atol=1e-10 * size)
    np.testing.assert_allclose(cut.dynamics.direct, cut.dynamics.direct.T, atol=1e-12 * size)


@settings(max_examples=10, deadline=None)
@given(trees)
def test_what_a_force_meets_at_once_is_a_mass_below_the_whole(tree: tuple[int, int, int]):
    """Acceleration per force at one point, far above all modes; for a body pushed through its centre 1/m."""
    modes = free_modes(tree)
    plant = build_plant(modes, inputs=["f"], outputs=["f"], count=10**6, damping=UNDAMPED)
    # Constraints only add mass (Rayleigh); rounding.
    assert plant.system.D[0, 0] >= (1.0 - 1e-9) / modes.equilibrium.model.structure.mass


@settings(max_examples=10, deadline=None)
@given(trees)
def test_torque_and_acceleration_are_reciprocal_to_force_and_angle(tree: tuple[int, int, int]):
    modes = free_modes(tree)
    ports = [*PORTS, "f"]
    plant = build_plant(modes, inputs=ports, outputs=ports, damping=UNDAMPED)
    omega = 2.0 * np.pi * np.array([0.3, 3.0])
    H = modal_response(plant.dynamics, omega)
    pushed, felt = H[:, :3, 3], H[:, 3, :3]
    scale = np.abs(H[:, 3, :]).max()
    np.testing.assert_allclose(felt, -(omega**2)[:, None] * pushed, atol=1e-10 * scale)  # sums of modes


@settings(max_examples=10, deadline=None)
@given(trees)
def test_one_loss_factor_for_all_members_is_half_of_it_for_every_flexible_mode(tree: tuple[int, int, int]):
    modes = free_modes(tree)
    loss = tuple((m.name, 0.02) for m in modes.equilibrium.model.structure.members)
    zeta = estimate_damping(modes, Damping(loss_factor=loss)).zeta
    flexible = modes.omega > 0.0
    np.testing.assert_allclose(zeta[flexible], 0.01, rtol=1e-6)  # of the highest: rounding of its energy
    assert not zeta[~flexible].any()
