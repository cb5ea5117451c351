"""What several features do at once: a rigid tie inside a hung, loaded, spinning article changes nothing."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest

from middeck.structure.model.article import AddedMass, AttachPoint, LoadCase, Section, Structure, Wheel
from middeck.structure.model.environment import Environment, Suspension
from middeck.structure.model.links import AnyLink, Interpolation, Link, Share
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.whirl_modes import solve_gyroscopic_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from structure_builders import GRAVITY, body, member, node, structure

TUBE = Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=120.0, rho_A=0.5, rho_I_y=1e-4, rho_I_z=1e-4)
LAB = Environment(
    title="lab",
    gravity=GRAVITY,
    suspension=Suspension(
        attach=("a", "b", "d"), held=("yz", "xyz", "yz"), cable_length=3.0, bounce_hz=0.3, moving_mass=0.02
    ),
    wheel_speeds=(("w", 400.0),),
)
TIES = {
    "link": Link(name="tie", first="c", second="twin"),
    "average": Interpolation(name="tie", frame="twin", shares=(Share(frame="c", about="xyz"),)),
}


def bus(tie: AnyLink | None) -> Structure:
    """a-b-c-d under three cables; with a tie the last member and an added mass are at a twin of c."""
    places = {"a": (0, 0.02, 0), "b": (0.8, -0.03, 0.01), "c": (1.6, 0.01, 0.02), "d": (2.4, 0, -0.02)}
    nodes = [node(n, p, body(1.0, (0.01, -0.02, 0.02), (0.01, 0.012, 0.013))) for n, p in places.items()]
    end = "twin" if tie else "c"
    nodes += [node("twin", places["c"])] if tie else []
    members = [member(*ends, TUBE, 1) for ends in (("a", "b"), ("b", "c"), (end, "d"))]
    attach = [AttachPoint(n, n, np.array([0.0, 0.05, 0.0])) for n in "abd"]
    mass = AddedMass(name="ballast", frame=end, body=body(0.5, (0.0, -0.05, 0.0)))
    return dataclasses.replace(
        structure(nodes, members, attach=attach),
        links=(tie,) if tie else (),
        wheels=(Wheel(name="w", frame="b", axis=np.array([0.0, 0.0, 1.0]), inertia=0.004),),
        load_cases=(LoadCase(name="ballasted", masses=(mass,)),),
    )


@functools.cache
def solved(tie: str) -> Modes:
    return solve_modes(solve_equilibrium(bus(TIES.get(tie)), LAB, "ballasted"), standstill=True)


@pytest.mark.parametrize("tie", TIES)
def test_a_rigid_tie_changes_no_tension_and_no_whirl(tie: str) -> None:
    bare, tied = solved("none"), solved(tie)
    assert tied.equilibrium.tension == pytest.approx(bare.equilibrium.tension, rel=1e-11)
    np.testing.assert_allclose(tied.omega, bare.omega, rtol=1e-8)
    assert (tied.kind, tied.name[:8]) == (bare.kind, bare.name[:8])
    spun, still = solve_gyroscopic_modes(tied), bare.omega
    np.testing.assert_allclose(spun.omega, solve_gyroscopic_modes(bare).omega, rtol=1e-8)
    assert np.abs(spun.omega / still - 1.0).max() > 1e-3
