"""Columns beyond their critical load, and beams bent far, against the elastica."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from middeck.errors import UnstableEquilibriumError
from middeck.structure.assembly.factorisation import factorise
from middeck.structure.model.article import AttachPoint, LoadCase, PointLoad, Section
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import AnchoredSpring, Environment, GroundBushing
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import Equilibrium, rest_warnings, solve_equilibrium
from repeats import repeats
from structure_builders import body, lab, member, node, structure

G, EI = 9.80665, 10.0
EULER, GREENHILL = np.pi**2 / 4.0, 7.837347438943  # P L^2/EI and q L^3/EI of a column clamped at its foot
CROSS = ((0.1, 0, 0), (-0.1, 0, 0), (0, 0, 0.1), (0, 0, -0.1), (0, 0.1, 0))
TENS = 40


def clamped(
    tip: tuple[float, float, float],
    weight: float,
    tilt: float = 0.0,
    own: bool = False,
    k: float = 1e9,
    EA: float = 1e6,
) -> Equilibrium:
    """A beam of length 1 from the origin, ``weight`` in EI at its tip or along it, gravity out of plumb."""
    section = Section(
        EA=EA,
        GJ=8.0,
        EI_y=1.2 * EI,
        EI_z=EI,
        rho_A=weight * EI / G if own else 1e-6,
        rho_I_y=0.0,
        rho_I_z=0.0,
    )
    attach = [AttachPoint(f"p{i}", "a", np.array(o, dtype=float)) for i, o in enumerate(CROSS)]
    springs = (
        AnchoredSpring(name=p.name, attach=p.name, anchor=p.offset, stiffness=k, free_length=0.0)
        for p in attach
    )
    nodes = [node("a", (0, 0, 0)), node("b", tip, body(0.0 if own else weight * EI / G))]
    parts = structure(
        nodes, [member("a", "b", section, 10, up=(1, 0, 0) if tip[1] else (0, 1, 0))], attach=attach
    )
    return solve_equilibrium(parts, lab(*springs, gravity=G * np.array([np.sin(tilt), -np.cos(tilt), 0.0])))


def moved(rest: Equilibrium) -> np.ndarray:
    return (rest.config.x - rest.model.rest.x)[1, :2]


def elastica(load: float, tilt: float) -> tuple[float, float]:
    """(sideways, drop) of a column's tip, EI psi'' = -P sin(psi + tilt), psi'(1) = 0: by shooting."""

    def bend(curvature: float) -> np.ndarray:
        def slope(_: float, y: np.ndarray) -> list[float]:
            return [y[1], -load * np.sin(y[0] + tilt), np.sin(y[0]), 1.0 - np.cos(y[0])]

        return solve_ivp(slope, (0.0, 1.0), [0.0, curvature, 0.0, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]

    # Of the branch that bends downhill, without a turn of its curvature before the tip.
    trial = np.linspace(1e-6, 2.0 * np.sqrt(load), 80)
    left = [bend(c)[1] for c in trial]
    first = max(i for i in range(len(trial) - 1) if left[i] < 0.0 < left[i + 1]) if left[0] < 0.0 else -1
    root = brentq(lambda c: bend(c)[1], trial[first] if first >= 0 else 0.0, trial[first + 1], xtol=1e-13)
    return bend(root)[2], bend(root)[3]


def upright(ratio: float) -> tuple[float, float]:
    """The same without tilt, by elliptic integrals (Love 1927, section 263)."""
    K = 0.5 * np.pi * np.sqrt(ratio)
    m = brentq(lambda m: ellipk(m) - K, 1e-12, 1.0 - 1e-12, xtol=1e-15)
    return 2.0 * np.sqrt(m) / K, 2.0 - 2.0 * ellipe(m) / K


@pytest.mark.parametrize(
    ("ratio", "tilt"), repeats([(1.001, 1e-6), (2.0, 1e-6), (1.01, 1e-5), (1.1, 1e-7)], 2)
)
def test_a_column_beyond_its_critical_load_settles_on_the_bent_branch(ratio: float, tilt: float):
    rest = clamped((0, 1, 0), ratio * EULER, tilt)
    assert rest.converged
    assert rest.stable
    assert len(rest.history) <= TENS
    side, drop = upright(ratio)
    # The compression of 2.5e-5 and the mesh's 1e-6 of the load shift the bend by their part of ratio - 1;
    # so does the tilt.
    rel = 2e-3 + 2.0 * (2e-5 + tilt / side) / (ratio - 1.0)
    assert np.abs(moved(rest)) == pytest.approx((side, drop), rel=rel)


@pytest.mark.parametrize(("EA", "ratio"), repeats([(1e8, 2.0), (1e7, 1.001), (1e8, 1.2)]))
def test_a_column_that_is_stiff_along_settles_too(EA: float, ratio: float):
    """EA L^2/EI to 1e7: its nodes are carried by one of them, and keep their forces in its tangent."""
    rest = clamped((0, 1, 0), ratio * EULER, 1e-6, EA=EA)
    assert rest.converged
    assert rest.stable
    assert len(rest.history) <= TENS
    side, drop = upright(ratio)
    rel = 2e-3 + 2.0 * (2e-5 + 1e-6 / side) / (ratio - 1.0)
    assert np.abs(moved(rest)) == pytest.approx((side, drop), rel=rel)


@pytest.mark.parametrize("ratio", repeats([1.0, 0.99, 1.05]))
def test_a_column_out_of_plumb(ratio: float):
    rest = clamped((0, 1, 0), ratio * EULER, 1e-2)
    assert len(rest.history) <= TENS
    # Compressed by 2.5e-5, the mesh of ten elements.
    assert np.abs(moved(rest)) == pytest.approx(elastica(ratio * EULER, 1e-2), rel=2e-3)


@pytest.mark.parametrize("ratio", repeats([1.001, 2.0, 1.1], 2))
def test_a_mast_beyond_its_critical_weight_settles_bent(ratio: float):
    """Moments balance about the foot of what stands there; the branch leaves with the root of ratio - 1."""
    rest = clamped((0, 1, 0), ratio * GREENHILL, 1e-6, own=True)
    assert rest.stable
    assert len(rest.history) <= TENS
    side, _ = np.abs(moved(rest))
    assert side > 0.9 * np.sqrt(ratio - 1.0) if ratio < 1.01 else side > 0.5


@pytest.mark.parametrize(("own", "load"), [(False, EULER), (True, GREENHILL)])
def test_a_straight_column_beyond_its_critical_load_is_reported(own: bool, load: float):
    """Nothing pushes it: it stays upright, and is not called stable."""
    rest = clamped((0, 1, 0), 1.1 * load, own=own)
    assert not rest.stable
    assert abs(moved(rest)[0]) < 1e-9
    assert any("not stable" in text for text in rest_warnings(rest))
    with pytest.raises(UnstableEquilibriumError, match="buckles"):
        solve_modes(rest)
    below = clamped((0, 1, 0), 0.9 * load, own=own)
    assert below.stable
    assert rest_warnings(below) == ()


def grows(weight: float, length: float, stiffness: float) -> tuple[bool, bool]:
    """What the rest state of an upright column with a kilogram on top says, and what its modes say."""
    section = Section(
        EA=1e8, GJ=stiffness, EI_y=stiffness, EI_z=1.2 * stiffness, rho_A=1e-3, rho_I_y=1e-7, rho_I_z=1e-7
    )
    top = node("b", (0, length, 0), body(1.0, inertia=(1e-3, 1e-3, 1e-3)))
    parts = structure([node("a", (0, 0, 0)), top], [member("a", "b", section, 4, up=(1, 0, 0))])
    held = Environment(
        title="clamped", gravity=np.array([0.0, -weight, 0.0]), suspension=None, clamps=(Clamp(node="a"),)
    )
    rest = solve_equilibrium(parts, held)
    try:
        solve_modes(rest)
    except UnstableEquilibriumError:
        return not rest.stable, True
    return not rest.stable, False


@pytest.mark.parametrize(("length", "stiffness"), repeats([(10.0, 0.1), (1.0, 10.0), (0.05, 1e-3)]))
def test_rest_states_and_modes_agree_on_what_is_stable(length: float, stiffness: float):
    """To 1e-9 of the critical load, however slowly the column would fall."""
    euler = EULER * stiffness / length**2
    critical = brentq(
        lambda w: 1.0 if grows(w, length, stiffness)[1] else -1.0, 0.99 * euler, 1.01 * euler, rtol=2e-10
    )
    for beyond in (1e-2, 1e-5, 1e-9):
        assert grows(critical * (1.0 + beyond), length, stiffness) == (True, True)
        assert grows(critical * (1.0 - beyond), length, stiffness) == (False, False)


@pytest.mark.parametrize("k", [1e4, 1e8, 1e10, 1e12])
def test_a_beam_bent_to_sixty_percent_on_a_support_of_any_stiffness(k: float):
    """P L^2/EI = 3 (Mattiasson 1981, IJNME 17); the support gives way by less than 0.3 % from 1e8 N/m on."""
    rest = clamped((1, 0, 0), 3.0, k=k)
    assert rest.converged
    assert len(rest.history) <= TENS
    if k > 1e4:
        assert -moved(rest) == pytest.approx((0.25442, 0.60325), rel=2e-3)


@pytest.mark.parametrize("k", repeats([1e12, 1e5], 2))
def test_a_bend_of_45_degrees_turns_out_of_its_plane_on_a_support_of_any_stiffness(k: float):
    """Bathe and Bolourchi 1979: a square of 1, E 1e7, radius 100, 600 across its plane.

    On 16 straight elements. The tip is by shooting on the equation of the rod from a support that does not
    give (`benchmarks/measured/bent.py`).
    """
    section = Section(
        EA=1e7, GJ=7.02885e5, EI_y=1e7 / 12.0, EI_z=1e7 / 12.0, rho_A=1e-6, rho_I_y=0.0, rho_I_z=0.0
    )
    angles = np.linspace(0.0, np.pi / 4.0, 17)
    nodes = [node(f"n{i}", (100.0 * (1.0 - np.cos(a)), 100.0 * np.sin(a), 0.0)) for i, a in enumerate(angles)]
    members = [member(f"n{i}", f"n{i + 1}", section, 1, up=(0, 0, 1)) for i in range(16)]
    parts = structure(nodes, members, attach=[AttachPoint("foot", "n0", np.zeros(3))])
    stiffness = k * np.diag([1.0, 1.0, 1.0, 100.0, 100.0, 100.0])
    held = Environment(
        title="spring",
        gravity=np.zeros(3),
        suspension=None,
        bushings=(GroundBushing(name="ground", attach="foot", stiffness=stiffness),),
    )
    push = PointLoad(name="push", frame="n16", force=np.array([0.0, 0.0, 600.0]))
    rest = solve_equilibrium(parts, held, LoadCase(name="push", loads=(push,)))
    assert rest.converged
    assert len(rest.history) <= TENS
    if k > 1e5:
        assert rest.config.x[16] == pytest.approx((15.558, 46.894, 53.604), abs=0.03)


def test_a_factor_leaves_its_matrix_as_it_was():
    """SuperLU sorts the rows of what it is given, which may share its indices with the matrix."""
    K = sp.csr_array((np.array([1.0, 4.0, 3.0, 1.0]), np.array([1, 0, 1, 0]), np.array([0, 2, 4])))
    dense = K.toarray()
    factor = factorise(K)
    assert factor is not None
    np.testing.assert_array_equal(K.toarray(), dense)
    np.testing.assert_allclose(factor.solve(dense @ [1.0, -2.0]), [1.0, -2.0], rtol=1e-14)
