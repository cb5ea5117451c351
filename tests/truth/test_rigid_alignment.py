"""Free articles at a few ports: what no port reaches or sees is set aside whatever the axes and the basis."""

from __future__ import annotations

import numpy as np
import pytest

import middeck as md
from middeck.control.law.partition import partition_modes
from middeck.errors import NotStabilisableError
from middeck.structure.model.article import Actuator, Body, Sensor
from middeck.structure.modes.solve import solve_modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.inert_modes import inert_modes
from middeck.systems.poles.rigid_alignment import align_rigid
from middeck.systems.state_space.modal_system import ModalSystem
from plant_builders import unit_weights
from structure_builders import node, structure

rng = np.random.default_rng(30)
LEGS = rng.standard_normal((3, 3))
J = LEGS @ LEGS.T + np.trace(LEGS @ LEGS.T) * np.eye(3)  # a body's: no principal value exceeds the two others
AXIS = np.array([-0.5, 0.8, 0.3]) / np.linalg.norm([-0.5, 0.8, 0.3])
OTHER = np.array([0.0, 0.6, -0.8])


WEIGHTS = unit_weights(("torque",), 1e-6, process=1e-2)


def free_body(sensed: np.ndarray = AXIS) -> Plant:
    """One torque and one angle of a body in orbit."""
    article = structure(
        [node("hub", (0, 0, 0), Body(5.0, np.array([0.3, -0.1, 0.2]), (J + J.T) / 2))],
        actuators=[Actuator(name="torque", frame="hub", axis=AXIS)],
        sensors=[Sensor(name="angle", frame="hub", axis=sensed)],
    )
    modes = solve_modes(solve_equilibrium(article, md.Environment.orbit()))
    groups = {"w": ["torque"], "u": ["torque"], "z": ["angle"], "y": ["angle"]}
    return build_plant(modes, inputs=["torque"], outputs=["angle"], **groups)


def test_one_torque_leaves_two_combinations_of_rotations_aside():
    part = partition_modes(free_body())
    modal = part.active.modal
    assert modal is not None
    assert len(part.inert) == 5
    assert part.inert[:3] == ("translation x", "translation y", "translation z")
    assert all(name.startswith("a combination of rotation ") for name in part.inert[3:])
    assert modal.phi @ modal.psi == pytest.approx(AXIS @ np.linalg.solve(J, AXIS), rel=1e-12)


@pytest.mark.parametrize("delay_s", [0.0, 0.01])
def test_a_compensator_for_one_axis_is_that_of_its_double_integrator(delay_s: float):
    """The poles are those of LQG for 1/(J s^2), with a Pade approximation of a delay too."""
    gain = AXIS @ np.linalg.solve(J, AXIS)
    groups = {"w": ["torque"], "u": ["torque"], "z": ["angle"], "y": ["angle"]}
    ports = {"inputs": ["torque [N m]"], "outputs": ["angle [rad]"]}
    alone = md.make_plant([[0.0, 1.0], [0.0, 0.0]], [[0.0], [gain]], [[1.0, 0.0]], **ports, **groups)
    loops = []
    for plant in (free_body(), alone):
        rational = md.approximate_delays(md.delay_plant(plant, delay_s), 3) if delay_s else plant
        law = md.design_lqg(rational, WEIGHTS, 10.0)
        poles = np.linalg.eigvals(md.close_loop(rational, law).system.A)
        loops.append(poles[np.lexsort((poles.imag, poles.real))])
    np.testing.assert_allclose(loops[0], loops[1], rtol=1e-6)


def test_a_rotation_that_is_seen_but_not_reached_is_still_refused():
    plant = free_body(sensed=OTHER)
    assert len(partition_modes(plant).inert) == 4
    with pytest.raises(NotStabilisableError, match="no control input"):
        md.design_lqg(plant, WEIGHTS, 10.0)


@pytest.mark.parametrize("ports", [1, 2, 3, 4])
def test_as_many_are_inert_as_the_rank_of_the_ports_leaves(ports: int):
    """In any basis; where the ports take all of them, the very same system."""
    mixed = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    into, out = rng.standard_normal((4, 1)), rng.standard_normal((ports - 1, 4))
    modal = ModalSystem(
        omega=np.array([0.0, 0.0, 0.0, 0.0, 3.0]),
        zeta=np.array([0.0, 0.0, 0.0, 0.0, 0.01]),
        psi=np.vstack([mixed @ into, [[1.0]]]),
        phi=np.zeros((ports - 1, 5)),
        phi_rate=np.column_stack([out @ mixed.T, np.ones(ports - 1)]),
        names=("a", "b", "c", "d", "bending"),
    )
    aligned = align_rigid(modal)
    assert inert_modes(aligned).sum() == 4 - ports
    assert (aligned is modal) == (ports == 4)
    assert aligned.names[-1] == "bending"
    assert len(set(aligned.names)) == 5
    np.testing.assert_allclose(
        aligned.phi_rate @ aligned.psi, modal.phi_rate @ modal.psi, rtol=1e-12, atol=1e-13
    )
