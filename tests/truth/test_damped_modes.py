"""Complex modes and their derivatives against matrices written by hand, complex stiffness and differences."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla
import updating_case as case
from test_damping import SOFT, TUBE, beam, mass, orbit_modes, tangent, two_bars

import middeck as md
from middeck.errors import NumericalError
from middeck.structure.model.article import Damper, DamperPlace, Damping, DampingTable
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damped_modes import DampedModes, solve_damped
from middeck.structure.plants.damping import estimate_damping
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.structure.sensitivity.damping_derivatives import differentiate_pencil
from middeck.structure.sensitivity.parameters import list_parameters
from middeck.updating.unknowns.unknowns import Unknown, bind, change
from repeats import repeats

COUNT = 24


@pytest.mark.parametrize("k", [40.0, 0.5, 0.02])
def test_two_masses_and_a_damper_of_one(k: float):
    """To rounding, however near the two frequencies are; a ratio for each alone is off by up to a half."""
    modes, damping = two_bars(0.4, k)
    K = np.array([[50.0 + k, -k], [-k, 50.0 + k]])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-K / 2.0, -np.diag([0.4, 0.0]) / 2.0]])
    pole = np.linalg.eigvals(A)
    pole = pole[pole.imag > 0.0]
    found = solve_damped(modes, damping).s[-2:]
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(pole), rtol=1e-9)


def test_a_mode_that_does_not_oscillate_is_refused():
    """Each ratio alone is below one; together the damped mass creeps."""
    modes, damping = two_bars(21.0, 0.01)
    assert estimate_damping(modes, damping).zeta.max() < 1.0
    with pytest.raises(NumericalError, match="does not oscillate"):
        solve_damped(modes, damping)


def test_two_materials_are_those_of_complex_stiffness():
    """K_1 (1 + j eta_1) + K_2 (1 + j eta_2), to rounding of the highest modes, whatever the loss."""
    modes = orbit_modes(beam(TUBE, SOFT))
    K = tangent(modes.equilibrium)
    twice = dataclasses.replace(TUBE, EA=2 * TUBE.EA, GJ=2 * TUBE.GJ, EI_y=2 * TUBE.EI_y, EI_z=2 * TUBE.EI_z)
    K1 = tangent(solve_equilibrium(beam(twice, SOFT), Environment.orbit())) - K
    found = solve_damped(modes, Damping(loss_factor=(("a-b", 0.2), ("b-c", 0.02))))
    lam = sla.eigvals(K + 0.2j * (K1 + 0.1 * (K - K1)), mass(modes))
    exact = 1j * np.sqrt(lam[np.argsort(lam.real)][6:14])
    np.testing.assert_allclose(found.s[6:14], exact, rtol=1e-6)


def lossy_sheet(rule: str) -> Damping:
    article, _ = case.sheet()
    joints = tuple(Damper(DamperPlace.JOINT, name, 0.02) for name in ("pri_x", "pri_z"))
    eta = tuple((m.name, 0.01 * (1 + k)) for k, m in enumerate(article.members))
    if rule == "table":
        table = DampingTable(np.array([0.1, 3.0, 100.0]), np.array([0.03, 0.01, 0.02]), hold=True)
        return Damping(table=table, dampers=joints)
    ratios = Damping(flexible=0.01, suspension=0.02, loss_factor=eta, dampers=joints, by_rank=rule == "rank")
    return dataclasses.replace(ratios, by_mode=((9, 0.013),)) if rule == "given" else ratios


UNKNOWNS = [
    Unknown(name=name, parameters=(name,), spread=0.1)
    for name in (
        "members.E",
        "joint.pri_z.inertia.xx",
        "joint.pri_z.cg.y",
        "environment.cable_length",
        "damping.joint.pri_x.c",
        "damping.loss_factor.n1-n2",
        "damping.suspension",
        "damping.mode.9",
    )
]


@pytest.mark.parametrize("rule", repeats(["given", "table", "shares", "rank"]))
def test_derivatives_are_differences(rule: str):
    """Of ln s by parameters of stiffness, mass, suspension and damping; dampers couple modes 1 % apart."""
    article, lab = case.sheet()
    article = dataclasses.replace(article, damping=lossy_sheet(rule))
    known = {p.name for p in list_parameters(article, lab)}
    asked = [u for u in UNKNOWNS if u.name in known]
    bound = bind(asked, article, lab)

    def at(x: np.ndarray) -> tuple[Modes, DampedModes]:
        modes = md.solve_modes(md.solve_equilibrium(*change(article, lab, bound, x)))
        return modes, solve_damped(modes, count=COUNT)

    modes, damped = at(np.zeros(len(asked)))
    assert rule == "table" or np.abs(damped.zeta - estimate_damping(modes, count=COUNT).zeta).max() > 5e-4
    pencil = differentiate_pencil(modes, [p for b in bound for p in b.parameters], len(damped.s))
    slopes = pencil.log_roots(damped.s, damped.shapes, damped.losses)
    for k, one in enumerate(np.eye(len(asked))):
        wide, narrow = (
            (np.log(at(h * one)[1].s) - np.log(at(-h * one)[1].s)) / (2.0 * h) for h in (2e-3, 1e-3)
        )
        exact = bound[k].parameters[0].value * slopes[k]
        # Without the square of the step; rest states leave 1e-9 of a root, over this step.
        assert np.abs(exact - (4.0 * narrow - wide) / 3.0).max() < 3e-6
        assert np.abs(exact).max() > 1e-4
