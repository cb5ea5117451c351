"""MAC, COMAC, orthogonality, reduced masses and effective masses against what they must be."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla

import middeck as md
from cli_runner import ROOT
from middeck.structure.assembly.energy import assemble
from middeck.structure.correlation.assurance import (
    coordinate_assurance,
    modal_assurance,
    nearest_basis,
    orthogonality,
    phase_collinearity,
)
from middeck.structure.correlation.effective_mass import measure_effective_mass
from middeck.structure.correlation.measured_modes import every_channel, sensor_rows
from middeck.structure.correlation.reduction import Reduction, reduce_mass
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.model.article import AttachPoint, Section
from middeck.structure.model.environment import AnchoredSpring, Clamp, Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from repeats import repeats
from structure_builders import TUBE, body, joint, member, node, straight_beam, structure

ROUNDING = 1e-12


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture(scope="module")
def lab() -> Modes:
    files = (ROOT / "articles/mace-simple.toml", ROOT / "environments/lab.toml")
    return md.solve_modes(md.solve_equilibrium(*md.load_setup(*files)))


def random_mass(rng: np.random.Generator, size: int) -> np.ndarray:
    A = rng.standard_normal((size, size))
    return A @ A.T + np.eye(size)


# Identities


def test_shapes_agree_with_themselves_at_any_scale_and_phase(rng: np.random.Generator):
    a = rng.standard_normal((12, 4))
    b = a * (rng.uniform(0.1, 9.0, 4) * np.exp(2j * np.pi * rng.random(4)))
    mass = random_mass(rng, 12)
    assert np.diag(modal_assurance(a, b)) == pytest.approx(1.0, abs=ROUNDING)
    assert coordinate_assurance(a, b) == pytest.approx(1.0, abs=ROUNDING)
    assert np.diag(orthogonality(a, b, mass)) == pytest.approx(1.0, abs=ROUNDING)
    assert phase_collinearity(b) == pytest.approx(1.0, abs=ROUNDING)


def test_scales_and_phases_change_nothing(rng: np.random.Generator):
    a, b = rng.standard_normal((2, 12, 4))
    mass = random_mass(rng, 12)
    c = b * (rng.uniform(0.1, 9.0, 4) * np.exp(2j * np.pi * rng.random(4)))
    assert modal_assurance(a, c) == pytest.approx(modal_assurance(a, b), abs=ROUNDING)
    assert coordinate_assurance(a, c) == pytest.approx(coordinate_assurance(a, b), abs=ROUNDING)
    assert orthogonality(a, c, mass) == pytest.approx(orthogonality(a, b, mass), abs=ROUNDING)


def test_turned_axes_change_nothing(rng: np.random.Generator):
    """All triads turned by one rotation: shapes in new components, the mass with them."""
    a, b = rng.standard_normal((2, 12, 4))
    mass = random_mass(rng, 12)
    R = np.kron(np.eye(4), rotation_exp(np.array([0.3, -1.1, 0.7])))
    turned = R @ mass @ R.T
    assert modal_assurance(R @ a, R @ b) == pytest.approx(modal_assurance(a, b), abs=ROUNDING)
    assert orthogonality(R @ a, R @ b, turned) == pytest.approx(orthogonality(a, b, mass), abs=ROUNDING)


def test_shapes_that_are_orthogonal_in_the_metric_score_zero(rng: np.random.Generator):
    mass = random_mass(rng, 12)
    _, phi = sla.eigh(random_mass(rng, 12), mass)
    # The mass has a condition of about 50.
    assert orthogonality(phi, phi, mass) == pytest.approx(np.eye(12), abs=1e-11)
    assert modal_assurance(np.eye(3), np.eye(3)) == pytest.approx(np.eye(3))


def test_mac_of_two_shapes_is_the_square_of_the_cosine():
    a = np.array([[1.0], [0.0]])
    for angle in (0.1, 0.7, 2.0):
        b = np.array([[np.cos(angle)], [np.sin(angle)]])
        assert modal_assurance(a, b)[0, 0] == pytest.approx(np.cos(angle) ** 2, abs=ROUNDING)


def test_comac_finds_the_channel_that_is_wrong(rng: np.random.Generator):
    a = rng.standard_normal((12, 6))
    b = a.copy()
    b[5] = rng.standard_normal(6)
    comac = coordinate_assurance(a, b)
    assert np.argmin(comac) == 5
    a[3] = b[3] = 0.0  # a channel that rests on both sides agrees
    assert coordinate_assurance(a, b)[3] == 1.0


def test_a_travelling_shape_has_no_collinear_phases():
    around = np.exp(2j * np.pi * np.arange(8) / 8)[:, None]
    assert phase_collinearity(around) == pytest.approx(0.0, abs=ROUNDING)


def test_channels_read_translations_rotations_angles_and_travels():
    """A unit of each coordinate of a body with a hinged arm and a slide on it, as the channels see it."""
    hinge = joint("h", "a", np.eye(3)[2], body(1.0, inertia=(0.1,) * 3), offset=(0.5, 0, 0))
    slide = joint("s", "a", np.eye(3)[1], body(1.0, inertia=(0.1,) * 3), slides=True)
    parts = structure([node("a", (1, 2, 3), body(2.0, inertia=(0.1,) * 3))], joints=[hinge, slide])
    modes = solve_modes(solve_equilibrium(parts, Environment.orbit()))
    model = modes.equilibrium.model
    at = every_channel(model)
    assert at[6:] == [("h", "angle"), ("s", "travel")]
    assert seen_by(modes, at).toarray() == pytest.approx(np.eye(8))
    # The hinge's frame is 0.5 m along x from the node: it swings along y when the node turns about z.
    assert seen_by(modes, [("h", "y"), ("h", "rz")]).toarray() == pytest.approx(
        np.array([[0, 1, 0, 0, 0, 0.5, 0, 0], [0, 0, 0, 0, 0, 1, 1, 0]])
    )


# Reduced masses


def massless_frame() -> Modes:
    """Bodies on massless, bent beams: all inertia is at the four nodes."""
    tube = Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=70.0, rho_A=0.0, rho_I_y=0.0, rho_I_z=0.0)
    places = ((0, 0, 0), (1, 0, 0), (1, 0.8, 0), (1, 0.8, 0.9))
    nodes = [
        node(n, x, body(1.0 + i, (0.01, 0.02, -0.03), (0.02, 0.03, 0.04)))
        for i, (n, x) in enumerate(zip("abcd", places, strict=True))
    ]
    ups = ((0, 1, 0), (1, 0, 0), (1, 0, 0))
    members = [member(a, b, tube, 3, up) for (a, b), up in zip(("ab", "bc", "cd"), ups, strict=True)]
    return solve_modes(solve_equilibrium(structure(nodes, members), Environment.orbit()))


def seen_by(modes: Modes, at: list[tuple[str, str]]):
    return sensor_rows(modes, [n for n, _ in at], [d for _, d in at])


@pytest.mark.parametrize("reduction", [Reduction.GUYAN, Reduction.IRS])
def test_static_reduction_is_exact_where_nothing_has_mass_but_what_is_seen(reduction: Reduction):
    modes = massless_frame()
    rows = seen_by(modes, every_channel(modes.equilibrium.model))
    mass = reduce_mass(modes, rows, reduction).mass
    shapes = rows @ modes.shapes
    assert shapes.shape == (24, 24)
    # The modes themselves are orthogonal to 1e-9 (test_modes.py).
    assert shapes.T @ mass @ shapes == pytest.approx(np.eye(24), abs=1e-8)


@pytest.mark.parametrize("kept", [3, 8, 16])
def test_serep_returns_its_modes_exactly(lab: Modes, kept: int):
    rows = seen_by(lab, every_channel(lab.equilibrium.model)[::2])
    reduced = reduce_mass(lab, rows, Reduction.SEREP, range(10, 10 + kept))
    shapes = rows @ lab.shapes[:, 10 : 10 + kept]
    # Rounding times the condition of the sensor set, squared.
    assert shapes.T @ reduced.mass @ shapes == pytest.approx(np.eye(kept), abs=1e-15 * reduced.condition**2)
    assert np.linalg.matrix_rank(reduced.mass) == kept


def by_partition(modes: Modes, improved: bool) -> np.ndarray:
    """Guyan 1965 and O'Callahan 1989 as printed, dense: the channels are the first coordinates."""
    rest = modes.equilibrium
    at = 6 * len(rest.model.structure.nodes)
    K = assemble(rest.model, rest.config, rest.loads).tangent.toarray()
    M = modes.mass.toarray()
    flexibility = np.linalg.inv(K[at:, at:])
    T = np.vstack([np.eye(at), -flexibility @ K[at:, :at]])
    if improved:
        correction = np.zeros_like(K)
        correction[at:, at:] = flexibility
        M_static, K_static = T.T @ M @ T, T.T @ K @ T
        T = T + correction @ M @ T @ np.linalg.solve(M_static, K_static)
    return T.T @ M @ T


@pytest.mark.parametrize("reduction", [Reduction.GUYAN, Reduction.IRS])
def test_static_reductions_equal_the_partitioned_formulas(reduction: Reduction):
    nodes = [node(n, (x, 0, 0), body(1.0, (0.1, 0, 0.05), (0.1,) * 3)) for n, x in (("a", 0.0), ("b", 1.3))]
    tube = Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=100.0, rho_A=0.5, rho_I_y=1e-4, rho_I_z=1e-4)
    modes = solve_modes(solve_equilibrium(structure(nodes, [member("a", "b", tube, 5)]), Environment.orbit()))
    at = every_channel(modes.equilibrium.model)
    mass = reduce_mass(modes, seen_by(modes, at), reduction).mass
    expected = by_partition(modes, reduction is Reduction.IRS)
    # Two ways to solve with a stiffness whose condition is 1e8.
    assert mass == pytest.approx(expected, abs=1e-8 * np.abs(expected).max())


def test_irs_is_nearer_to_the_modes_than_guyan(lab: Modes):
    """What the channels do not see has mass: IRS gives it the inertia of the static shapes."""
    at = [(n.name, d) for n in lab.equilibrium.model.structure.nodes for d in ("x", "y", "z", "rx")]
    at += [(joint.name, "angle") for joint in lab.equilibrium.model.structure.joints]
    rows = seen_by(lab, at)
    chosen = list(range(10, 18))
    shapes = rows @ lab.shapes[:, chosen]
    off = {}
    for reduction in Reduction:
        mass = reduce_mass(lab, rows, reduction, chosen).mass
        off[reduction] = np.abs(orthogonality(shapes, shapes, mass) - np.eye(8)).max()
    assert off[Reduction.SEREP] < 1e-10
    assert off[Reduction.IRS] < 0.1 * off[Reduction.GUYAN]


def test_the_condition_of_a_sensor_set_is_one_for_orthogonal_sights():
    """Two free bodies on a rod: each channel sees one of them; together or apart, they move as much."""
    nodes = [node(n, (x, 0, 0), body(2.0, inertia=(0.1,) * 3)) for n, x in (("a", 0.0), ("b", 1.0))]
    tube = Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=100.0, rho_A=0.0, rho_I_y=0.0, rho_I_z=0.0)
    modes = solve_modes(solve_equilibrium(structure(nodes, [member("a", "b", tube, 1)]), Environment.orbit()))
    both = [modes.name.index("translation x"), modes.name.index("first axial")]
    rows = seen_by(modes, [("a", "x"), ("b", "x")])
    assert reduce_mass(modes, rows, Reduction.SEREP, both).condition == pytest.approx(1.0, rel=1e-9)
    # Equal bodies move by (1, 1) and (1, -1) over the square root of their mass together.
    assert reduce_mass(modes, rows, Reduction.SEREP, both).mass == pytest.approx(2.0 * np.eye(2), abs=1e-9)


# Effective mass


def test_effective_masses_of_all_modes_add_up_to_the_rigid_body(lab: Modes):
    effective = measure_effective_mass(lab)
    mass = lab.equilibrium.model.structure.mass
    assert effective.rigid[:3] == pytest.approx(mass, rel=1e-12)
    assert np.all(effective.rigid[3:] > 0.0)
    # Every mode is there; those without mass carry none. Rounding of the highest modes: 1e-11.
    assert effective.completeness == pytest.approx(1.0, abs=1e-9)


def test_a_free_article_gives_all_to_its_rigid_modes(lab: Modes):
    modes = solve_modes(solve_equilibrium(lab.equilibrium.model.structure, Environment.orbit()))
    effective = measure_effective_mass(modes)
    rigid = [i for i, k in enumerate(modes.kind) if k == "rigid"]
    assert effective.fraction[rigid].sum(axis=0) == pytest.approx(1.0, abs=1e-9)
    # Momentum of a flexible mode is orthogonality to the rigid ones: 1e-9 of the root, 1e-18 of the mass.
    assert effective.fraction[len(rigid) : 20].max() < 1e-14


# It bends about its own y, along z, long before it does anything else.
CANTILEVER = Section(EA=1e8, GJ=80.0, EI_y=1.0, EI_z=1e4, rho_A=0.5, rho_I_y=1e-6, rho_I_z=1e-6)


def clamped(beam, stiffness: float = 1e9):
    """Node "a" on twelve stiff springs, three each at four points around it, all unstretched."""
    corners = [np.array(p, dtype=float) for p in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]
    points = [AttachPoint(f"c{i}", "a", c) for i, c in enumerate(corners)]
    springs = [
        AnchoredSpring(
            name=f"{p.name}{axis}",
            attach=p.name,
            anchor=p.offset + step,
            stiffness=stiffness,
            free_length=1.0,
        )
        for p in points
        for axis, step in zip("xyz", np.eye(3), strict=True)
    ]
    held = dataclasses.replace(beam, attach_points=tuple(points))
    return solve_modes(
        solve_equilibrium(
            held, Environment(title="clamp", gravity=np.zeros(3), suspension=None, springs=tuple(springs))
        )
    )


def test_effective_masses_of_a_cantilever():
    """0.613, 0.188, 0.065, 0.033 of the mass, and their parts of the inertia about the middle.

    With cos lambda cosh lambda = -1 and phi of unit mean square (Blevins 1979), the integral of phi
    is 2 sigma L / lambda, that of x phi 2 L^2 / lambda^2.
    """
    modes = clamped(straight_beam(CANTILEVER, 2.0, 24))
    effective = measure_effective_mass(modes)
    found = effective.fraction[effective.fraction[:, 2] > 0.02][:4]
    roots = np.array([1.875104068711961, 4.694091132974174, 7.854757438237612, 10.99554073487547])
    sigma = (np.sinh(roots) - np.sin(roots)) / (np.cosh(roots) + np.cos(roots))
    mass, inertia = (2.0 * sigma / roots) ** 2, 12.0 * (2.0 / roots**2 - sigma / roots) ** 2
    assert mass == pytest.approx([0.613, 0.188, 0.065, 0.033], abs=5e-4)
    # The consistent mass of 24 elements errs by (lambda h / L)^4 / 720 = 6e-5 at the fourth, the springs by
    # 1e-8; rotary inertia, which Blevins leaves out, is 5e-7 of rho A L^2.
    assert found[:, 2] == pytest.approx(mass, rel=1e-4)
    assert found[:, 4] == pytest.approx(inertia, rel=1e-4)
    # The stiff springs of the clamp, 1e8 times the beam, leave up to 5e-9 by rounding, by the processor.
    assert effective.completeness[:3] == pytest.approx(1.0, abs=2e-8)


@pytest.mark.parametrize("at_clamp", [0.0, 3.0])
def test_mass_at_a_clamp_belongs_to_no_mode(at_clamp: float):
    """One element, clamped: m L/6 [[2, 1], [1, 2]] leaves (m L/2)^2 / (m L/3) = 3/4 of its mass along it."""
    beam = straight_beam(CANTILEVER, 2.0, 1)
    if at_clamp:
        heavy = node("a", (0, 0, 0), body(at_clamp, inertia=(1.0, 1.0, 1.0)))
        beam = dataclasses.replace(beam, nodes=(heavy, *beam.nodes[1:]))
    held = Environment(title="clamp", gravity=np.zeros(3), suspension=None, clamps=(Clamp(node="a"),))
    effective = measure_effective_mass(solve_modes(solve_equilibrium(beam, held)))
    assert effective.rigid[0] == pytest.approx(1.0 + at_clamp, rel=1e-12)
    assert effective.completeness[0] == pytest.approx(0.75 / (1.0 + at_clamp), rel=1e-9)
    # Across it: loads of 1/2 and L/12 on 156, 22 L and 4 L^2 of 420.
    load, own = np.array([0.5, -1 / 12]), np.array([[156.0, -22.0], [-22.0, 4.0]]) / 420.0
    across = load @ np.linalg.solve(own, load)
    assert effective.completeness[2] == pytest.approx(across / (1.0 + at_clamp), rel=1e-4)


@pytest.mark.parametrize("seed", repeats(range(6)))
def test_modes_of_one_frequency_are_compared_in_any_basis(seed: int) -> None:
    """A round cantilever bends in any plane alike: a test may find its modes in any two."""
    rng = np.random.default_rng([31, seed])
    tube = dataclasses.replace(TUBE, rho_I_y=1e-4, rho_I_z=1e-4)
    nodes = [node(f"n{i}", (0.4 * i, 0.0, 0.0)) for i in range(5)]
    article = structure(nodes, [member(f"n{i}", f"n{i + 1}", tube, 1) for i in range(4)])
    modes = md.solve_modes(md.solve_equilibrium(article, md.Environment.clamped("n0", gravity=0.0)))
    at = [(f"n{i}", d) for i in range(1, 5) for d in "yz"]
    plain = md.structure.measure_modes(modes, at=at, chosen=[0, 1, 2, 3])
    shape = np.array(plain.shape)
    for pair in ([0, 1], [2, 3]):
        angle, phase = rng.uniform(0.0, 2.0 * np.pi), np.exp(1j * rng.uniform(0.0, 2.0 * np.pi, 2))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        shape[:, pair] = shape[:, pair] @ turn * phase
    turned = dataclasses.replace(plain, shape=shape)
    found = [
        md.correlate_modes(
            modes, test, md.structure.find_profile("ecss-e-st-32-11c"), rng=np.random.default_rng(0),
            noise=md.structure.MeasurementNoise(1e-3, 0.02), runs=20,
        )
        for test in (plain, turned)
    ]  # fmt: skip
    assert found[0].passed
    assert found[1].passed
    mac = found[1].evaluation.mac
    pairs = found[1].evaluation.pairs
    np.testing.assert_allclose(mac[pairs[:, 0], pairs[:, 1]], 1.0, atol=1e-9)
    np.testing.assert_allclose(np.diag(found[1].evaluation.cross_orthogonality), 1.0, atol=1e-9)


def test_one_of_a_pair_and_a_complex_one():
    a = np.linalg.qr(np.random.default_rng(1).standard_normal((7, 3)))[0]
    b = a @ [[0.6], [0.0], [0.8]] * np.exp(2.3j)
    turned = nearest_basis(a, b)
    np.testing.assert_allclose(turned.T @ turned, np.eye(3), atol=1e-12)
    assert modal_assurance(turned, b)[0, 0] == pytest.approx(1.0)
