"""Frames, gimbals and offsets under load: every derivative against differences, pendulums in closed form."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.environment_loads import Loads, no_loads
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import Model, lay_out, mesh_structure
from middeck.structure.elements.devices import SpringLaw
from middeck.structure.elements.frames import frame_poses, move, points_in_world, pose_jacobian
from middeck.structure.elements.rotations import rotation_exp, rotation_log
from middeck.structure.model.article import AttachPoint, Section, Spring
from repeats import repeats
from structure_builders import (
    GRAVITY,
    body,
    clamped_matrices,
    joint,
    member,
    node,
    random_configuration,
    structure,
)

TUBE = Section(
    EA=2e4, GJ=30.0, EI_y=50.0, EI_z=80.0, rho_A=0.5, rho_I_y=2e-4, rho_I_z=3e-4, GA_y=4e4, GA_z=3e4
)
UNEQUAL = (0.03, 0.01, 0.02)
X, Z = np.eye(3)[0], np.eye(3)[2]


def gimballed_model() -> Model:
    """Everything at once: rigid offsets, off-centre bodies, two gimbals in a chain, springs, devices."""
    axis = np.array([0.6, 0.0, 0.8])
    nodes = [
        node("a", (0, 0, 0), body(2.0, (0.02, -0.03, 0.01), UNEQUAL), size=0.1),
        node("b", (1, 0.2, 0), body(1.0, (0.0, -0.05, 0.02), UNEQUAL), size=0.06),
    ]
    joints = [
        joint("g1", "a", X, body(0.5, (0, 0.01, 0)), offset=(0.0, -0.1, 0.05), angle=0.5),
        joint("g2", "g1", axis, body(1.5, (0.05, -0.2, 0.1), UNEQUAL), offset=(0.03, 0.0, 0.02), angle=-0.3),
        joint("g3", "b", (0, 0, 1.0), body(1.0), offset=(0, 0.1, 0), angle=0.2, stiffness=3.0, target=0.1),
    ]
    attach = [
        AttachPoint("top", "a", np.array([0, 0.05, 0.02])),
        AttachPoint("arm", "g2", np.array([0.1, 0.0, -0.1])),
        AttachPoint("far", "b", np.array([0, 0.05, 0])),
    ]
    springs = [Spring(name="s", start="arm", end="far", stiffness=40.0, free_length=0.7)]
    return mesh_structure(structure(nodes, [member("a", "b", TUBE, 2)], joints, springs, attach))


def loads_of(model: Model) -> Loads:
    anchors = np.array([[0.1, 3.0, 0.2], [1.0, 3.0, -0.3]])
    at = model.attach_point[[0, 2]]
    law = SpringLaw(np.array([20.0, 10.0]), np.array([5.0, 4.0]), np.array([2.5, 2.8]))
    return Loads(
        gravity=GRAVITY + np.array([1.0, 0.0, 2.0]),
        anchor=anchors,
        attach_point=at,
        law=law,
        mass=np.zeros(len(at)),
    )


def energy_along(model: Model, config, loads, direction):
    return lambda s: assemble(model, move(model.tree, config, s * direction), loads).energy


@pytest.mark.parametrize("seed", repeats(range(3)))
def test_gradient_is_the_slope_of_the_energy(seed: int):
    model, rng = gimballed_model(), np.random.default_rng(seed)
    config, loads = random_configuration(model, rng, 0.15), loads_of(model)
    at = assemble(model, config, loads)
    h = 1e-3
    slopes = []
    for direction in np.eye(model.tree.size):
        e = energy_along(model, config, loads, direction)
        slopes.append((8 * (e(h) - e(-h)) - (e(2 * h) - e(-2 * h))) / (12 * h))
    # Differences of fourth order: truncation 1e-12 f5, rounding 1e-13 E.
    assert np.array(slopes) == pytest.approx(at.gradient, abs=1e-8 * np.abs(at.gradient).max())


@pytest.mark.parametrize("seed", range(3))
def test_tangent_is_the_second_derivative_of_the_energy(seed: int):
    """Along random directions, in the chart of the coordinates: straight lines q, bodies far from rest."""
    model, rng = gimballed_model(), np.random.default_rng(seed)
    config, loads = random_configuration(model, rng, 0.15), loads_of(model)
    K = assemble(model, config, loads).tangent
    assert abs(K - K.T).max() == 0.0
    for scale in (np.ones(model.tree.size), (np.arange(model.tree.size) >= 6 * model.tree.roots)):
        direction = scale * rng.standard_normal(model.tree.size)
        direction /= np.linalg.norm(direction)
        e = energy_along(model, config, loads, direction)

        def second(h, e=e):
            return (e(h) - 2 * e(0.0) + e(-h)) / h**2

        h = 4e-3
        estimate = (64 * second(h / 4) - 20 * second(h / 2) + second(h)) / 45  # Richardson, order six
        # Truncation h^6/64 times the eighth derivative; rounding 1e-16 E/(h/4)^2 = 1e-10 E.
        assert estimate == pytest.approx(direction @ K @ direction, rel=1e-6, abs=1e-8 * abs(K).max())


def test_joint_rows_of_the_tangent_are_the_derivative_of_the_torques():
    """Away from equilibrium a moved root has another chart; angles add, so that theirs never changes."""
    model, rng = gimballed_model(), np.random.default_rng(7)
    config, loads = random_configuration(model, rng, 0.1), loads_of(model)
    K = assemble(model, config, loads).tangent.toarray()
    joints = slice(6 * model.tree.roots, None)
    h = 1e-4
    for column in range(model.tree.size)[joints]:
        q = np.zeros(model.tree.size)
        q[column] = h
        ahead = [assemble(model, move(model.tree, config, s * q), loads).gradient for s in (1, -1, 2, -2)]
        slope = (8 * (ahead[0] - ahead[1]) - (ahead[2] - ahead[3])) / (12 * h)
        assert slope[joints] == pytest.approx(K[joints, column], abs=1e-9 * np.abs(K).max())


def test_jacobian_is_the_derivative_of_the_poses():
    model, rng = gimballed_model(), np.random.default_rng(2)
    config = random_configuration(model, rng, 0.3)
    poses = frame_poses(model.tree, config)
    J = pose_jacobian(model.tree, model.points, poses).toarray()
    h = 1e-4
    for column, q in enumerate(np.eye(model.tree.size)):
        out = []
        for s in (h, -h, 2 * h, -2 * h):
            new = frame_poses(model.tree, move(model.tree, config, s * q))
            shift = points_in_world(model.points, new) - points_in_world(model.points, poses)
            turn = [rotation_log(new.R[f] @ poses.R[f].T) for f in model.points.frame]
            out.append(np.hstack([shift, turn]).ravel())
        slope = (8 * (out[0] - out[1]) - (out[2] - out[3])) / (12 * h)
        assert slope == pytest.approx(J[:, column], abs=1e-10)  # 1e-16 / h, 1e-16 truncation


def test_mass_matrix_is_the_kinetic_energy_of_moving_points():
    """Rates of bodies by differences of their poses, not by the Jacobian."""
    model, rng = gimballed_model(), np.random.default_rng(3)
    config = random_configuration(model, rng, 0.3)
    bodies = structure(model.structure.nodes, (), model.structure.joints)
    model = lay_out(bodies)  # loose parts: without the checks
    config = random_configuration(model, rng, 0.3)
    M = mass_matrix(model, config).toarray()
    rate, h = rng.standard_normal(model.tree.size), 1e-5
    before, at, after = (frame_poses(model.tree, move(model.tree, config, s * h * rate)) for s in (-1, 0, 1))
    energy = 0.0
    for i, part in enumerate((*bodies.nodes, *bodies.joints)):
        cg = [p.p[i] + p.R[i] @ part.body.cg for p in (before, at, after)]
        v = (cg[2] - cg[0]) / (2 * h)
        w = rotation_log(after.R[i] @ before.R[i].T) / (2 * h)
        inertia = at.R[i] @ part.body.inertia @ at.R[i].T
        energy += 0.5 * part.body.mass * v @ v + 0.5 * w @ inertia @ w
    assert 0.5 * rate @ M @ rate == pytest.approx(energy, rel=1e-8)  # h^2 and rounding 1e-16/h


@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi / 4])
def test_compound_pendulum_with_offset_mass(angle: float):
    """Held at ``angle`` by a constant torque m g d sin(angle): omega^2 = m g d cos(angle) / (I + m d^2)."""
    m, d, inertia = 5.0, 0.08, 0.03
    arm = joint(
        "p", "n", (0, 0, 1.0), body(m, (0, -d, 0), (1, 1, inertia)), offset=(0.1, -0.05, 0.2), angle=angle
    )
    model = mesh_structure(structure([node("n", (1, 2, 3), body(1.0))], joints=[arm]))
    none = no_loads()
    loads = dataclasses.replace(none, gravity=GRAVITY)
    K, M, _ = clamped_matrices(model, loads=loads)
    g = 9.80665
    assert K[0, 0] / M[0, 0] == pytest.approx(m * g * d * np.cos(angle) / (inertia + m * d**2), rel=1e-12)
    torque = assemble(model, model.rest, loads).gradient[-1]
    assert torque == pytest.approx(m * g * d * np.sin(angle), rel=1e-12, abs=1e-14)


def test_double_compound_pendulum():
    m, d, inertia, arm = np.array([2.0, 3.0]), np.array([0.3, 0.2]), np.array([0.05, 0.04]), 0.5
    g = 9.80665
    joints = [
        joint("p1", "n", Z, body(m[0], (0, -d[0], 0), (0.1, 0.1, inertia[0]))),
        joint("p2", "p1", Z, body(m[1], (0, -d[1], 0), (0.1, 0.1, inertia[1])), offset=(0, -arm, 0)),
    ]
    model = mesh_structure(structure([node("n", (0, 0, 0), body(1.0))], joints=joints))
    none = no_loads()
    K, M, _ = clamped_matrices(model, loads=dataclasses.replace(none, gravity=GRAVITY))
    # Textbook form in absolute angles; the eigenvalues do not depend on the choice of angles.
    coupling = m[1] * arm * d[1]
    mass = np.array(
        [[inertia[0] + m[0] * d[0] ** 2 + m[1] * arm**2, coupling], [coupling, inertia[1] + m[1] * d[1] ** 2]]
    )
    stiffness = np.diag([(m[0] * d[0] + m[1] * arm) * g, m[1] * d[1] * g])
    expected = sla.eigh(stiffness, mass, eigvals_only=True)
    assert sla.eigh(K, M, eigvals_only=True) == pytest.approx(expected, rel=1e-12)  # rounding


def test_spherical_pendulum_with_gimbal_under_load():
    """Two crossed axes at 45 degrees: a moment through the inner axis stiffens the outer one as it must."""
    m, d, g = 5.0, 0.08, 9.80665
    joints = [
        joint("x", "n", X, angle=np.pi / 4),
        joint("z", "x", Z, body(m, (0, -d, 0), UNEQUAL)),
    ]
    model = mesh_structure(structure([node("n", (0, 0, 0), body(1.0))], joints=joints))
    none = no_loads()
    K, _, _ = clamped_matrices(model, loads=dataclasses.replace(none, gravity=GRAVITY))
    # Height of the centre of mass: -d cos(a) cos(b); both second derivatives at a = 45 degrees, b = 0.
    c = m * g * d * np.cos(np.pi / 4)
    assert pytest.approx(np.array([[c, 0.0], [0.0, c]]), abs=1e-12) == K


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 3.0, np.pi - 1e-6])
def test_rotation_vector_round_trip(angle: float):
    v = angle * np.array([2.0, -1.0, 2.0]) / 3.0
    R = rotation_exp(v)
    assert pytest.approx(np.eye(3), abs=1e-14) == R @ R.T
    # Near pi the sine that fixes the axis loses six digits.
    assert rotation_log(R) == pytest.approx(v, abs=1e-14 if angle < 1 else 1e-9)
