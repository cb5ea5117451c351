"""What is found once for a configuration is its model's; no pull escapes the verdict on the unstrained."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import middeck as md
import structure_builders as build
from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.assembly.places import poses_at
from middeck.structure.model.article import Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment
from middeck.structure.model.section import Section

EI, LENGTH = 40.0, 1.5
COLUMN = Section(EA=1e5, GJ=60.0, EI_y=EI, EI_z=2.0 * EI, rho_A=0.3, rho_I_y=0.0, rho_I_z=0.0)
EULER = 4.0 * np.pi**2 * EI / LENGTH**2  # of both ends held (Euler 1744)


def column(tension: float) -> Structure:
    nodes = [build.node("a", (0, 0, 0)), build.node("b", (LENGTH, 0, 0))]
    member = dataclasses.replace(build.member("a", "b", COLUMN, 12), tension=tension)
    return build.structure(nodes, [member])


@pytest.mark.parametrize(("share", "stands"), [(0.0, True), (-0.98, True), (-1.02, False)])
def test_a_column_compressed_as_drawn_stands_to_eulers_load(share: float, stands: bool):
    """Without gravity nothing strains it as drawn, and nothing but its compression can bend it."""
    held = Environment(title="held", gravity=np.zeros(3), clamps=(Clamp(node="a"), Clamp(node="b")))
    rest = md.solve_equilibrium(column(share * EULER), held)
    straight = np.abs(rest.config.x - rest.model.rest.x).max() < 1e-6
    assert (rest.stable and straight) == stands


def test_two_models_of_one_configuration_have_their_own_places():
    one, other = mesh_structure(column(0.0)), mesh_structure(column(0.0))
    arm = dataclasses.replace(
        other, points=dataclasses.replace(other.points, offset=other.points.offset + 1.0)
    )
    first = poses_at(one, one.rest)
    assert poses_at(one, one.rest) is first
    np.testing.assert_allclose(poses_at(arm, one.rest).world, first.world + 1.0)
    np.testing.assert_array_equal(poses_at(one, one.rest).world, first.world)
    with pytest.raises(ValueError, match="read-only"):
        first.world[0] = 0.0
