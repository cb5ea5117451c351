"""A cable of next to no bending stiffness, hung from its upper end: the zeros of the Bessel function J0.

Work-equivalent gravity moments on cubic elements make the lower end of every element fall sideways, and the
last one has no neighbour to hold it: with 20 elements and EI = 1e-4 N m^2 they make unstable modes that are
not there (`beam_weight` says how the line's own length mends that).
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import jn_zeros

from middeck.errors import UnstableEquilibriumError
from middeck.structure.model.article import AttachPoint, Section
from middeck.structure.model.environment import AnchoredSpring
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from structure_builders import lab, member, node, structure

G, LENGTH, RHO, EA = 9.80665, 2.0, 0.5, 1e6
STRETCH = RHO * G * LENGTH / EA  # 1e-5: what an inextensible chain leaves out
PIN = 1e7  # N/m, of no free length: the same in all directions


def hung_chain(EI: float, elements: int) -> Modes:
    cable = Section(EA=EA, GJ=1e-2, EI_y=EI, EI_z=EI, rho_A=RHO, rho_I_y=1e-9, rho_I_z=1e-9)
    parts = structure(
        [node("top", (0, 0, 0)), node("end", (0, -LENGTH, 0))],
        [member("top", "end", cable, elements, up=(1, 0, 0))],
        attach=[AttachPoint("top", "top", np.zeros(3))],
    )
    return solve_modes(
        solve_equilibrium(
            parts,
            lab(AnchoredSpring(name="pin", attach="top", anchor=np.zeros(3), stiffness=PIN, free_length=0.0)),
        )
    )


def swings(modes: Modes, count: int) -> np.ndarray:
    """Angular frequencies of the lowest swings, each of which comes in two planes."""
    omega = modes.omega[modes.omega > 0.0]
    np.testing.assert_allclose(omega[1 : 2 * count : 2], omega[: 2 * count : 2], rtol=1e-7)  # rounding
    return omega[: 2 * count : 2]


@pytest.mark.parametrize("elements", [10, 20, 40])
@pytest.mark.parametrize("EI", [1e-8, 1e-4, 1e-2, 1.0])
def test_every_mode_of_a_hanging_cable_is_stable(EI: float, elements: int):
    """`solve_modes` raises for a mode that grows; one rigid mode is left, the turn about the cable."""
    modes = hung_chain(EI, elements)
    assert modes.kind.count("rigid") == 1
    assert np.all(modes.omega[1:] > 0.0)


def test_chain_swings_at_the_zeros_of_the_bessel_function():
    """omega = j_n / 2 sqrt(g/L): cubic elements find five of them within the stretch of the chain."""
    exact = 0.5 * jn_zeros(0, 5) * np.sqrt(G / LENGTH)
    assert swings(hung_chain(1e-8, 40), 5) == pytest.approx(exact, rel=0.5 * STRETCH)


def test_chain_converges_with_order_four_or_better():
    exact = 0.5 * jn_zeros(0, 5)[4] * np.sqrt(G / LENGTH)
    errors = [abs(swings(hung_chain(1e-8, n), 5)[4] / exact - 1.0) for n in (10, 20)]
    assert np.log2(errors[0] / errors[1]) > 3.8


def test_a_column_under_its_own_weight_buckles_by_name():
    """Greenhill 1881: q L^3 = 7.837 EI. Just above it the member is named, not the motion it is like."""
    critical = RHO * G * LENGTH**3 / 7.8373
    corners = {
        f"foot {i}": 0.3 * np.array(p) for i, p in enumerate(([1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]))
    }
    foot = [AttachPoint(name, "foot", p) for name, p in corners.items()]
    pins = [
        AnchoredSpring(name=name, attach=name, anchor=p, stiffness=PIN, free_length=0.0)
        for name, p in corners.items()
    ]

    def stand(EI: float) -> Modes:
        column = Section(EA=EA, GJ=1e3, EI_y=EI, EI_z=EI, rho_A=RHO, rho_I_y=1e-9, rho_I_z=1e-9)
        parts = structure(
            [node("foot", (0, 0, 0)), node("top", (0, LENGTH, 0))],
            [member("foot", "top", column, 8, up=(1, 0, 0))],
            attach=foot,
        )
        return solve_modes(solve_equilibrium(parts, lab(*pins)))

    assert stand(critical * 1.01).omega[0] > 0.0
    with pytest.raises(UnstableEquilibriumError, match="member 'foot-top' buckles"):
        stand(critical * 0.99)
