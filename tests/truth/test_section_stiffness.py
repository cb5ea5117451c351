"""Members with coupled sections, centres off the node line, tension and taper, against independent truths."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np
import pytest
import scipy.linalg as sla
from scipy.optimize import brentq

import middeck as md
from middeck.errors import ConfigError
from middeck.files.articles.build import build_section
from middeck.files.articles.form import MaterialForm, SectionForm
from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.model.article import Actuator, ActuatorKind, PointLoad, Sensor, SensorKind, Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.section import Section, coupled_section, section_between, shifted_section
from middeck.structure.sensitivity.frequency_derivatives import differentiate_frequencies
from middeck.structure.sensitivity.parameters import find_parameters, set_parameter
from middeck.structure.summary.summary import summarise
from repeats import LONG, repeats
from structure_builders import TUBE, clamped_matrices, member, node, straight_beam, structure

L = 2.0
AL = {"al": MaterialForm(E_pa=7e10, nu=0.3, rho_kg_m3=2700.0)}
RIGID = [0, 3, 4, 5]  # of (extension, shears, twist, curvatures), what a section rigid in shear has
INERTIA = {"rho_A": 0.5, "rho_I_y": 2e-3, "rho_I_z": 3e-3}
BARE = {"rho_A": 0.0, "rho_I_y": 0.0, "rho_I_z": 0.0}
FULL = Section(EA=2e4, GJ=30.0, EI_y=50.0, EI_z=80.0, **INERTIA)


def positive(seed: int, size: int) -> np.ndarray:
    """A well coupled stiffness with entries of the sizes that beams have."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((size, 2 * size))
    unit = A @ A.T
    scale = np.sqrt(np.array([2e4, 4e4, 3e4, 30.0, 50.0, 80.0])[RIGID if size == 4 else slice(None)])
    d = scale / np.sqrt(np.diag(unit))
    return unit * np.outer(d, d)


def compliance(stiffness: np.ndarray, centre: tuple[float, float]) -> np.ndarray:
    """6x6 strains on the node line per section force, shears taken at ``centre``."""
    C = np.zeros((6, 6))
    rows = RIGID if len(stiffness) == 4 else list(range(6))
    C[np.ix_(rows, rows)] = np.linalg.inv(stiffness)
    T = np.eye(6)
    # The displacement of the centre is that of the line + twist x arm; its shears are those less that turn.
    T[1, 3], T[2, 3] = centre[1], -centre[0]
    return T @ C @ T.T


def tip_flexibility(*parts: np.ndarray | Callable[[float], np.ndarray]) -> np.ndarray:
    """Of a cantilever of equally long ``parts``: work of the strains under tip loads, Gauss quadrature.

    A compliance may be one of the place, from 0 to 1 over its part.
    """
    points, weights = np.polynomial.legendre.leggauss(12)
    F, step = np.zeros((6, 6)), L / len(parts)
    for k, C in enumerate(parts):
        for s, w in zip(0.5 * (points + 1.0), 0.5 * step * weights, strict=True):
            B = np.eye(6)
            B[4, 2], B[5, 1] = -(L - (k + s) * step), L - (k + s) * step  # moments of the tip's forces
            F += w * B.T @ (C(s) if callable(C) else C) @ B
    return F


def off_the_nodes(section: Section, shear=(0.0, 0.0), mass=(0.0, 0.0)) -> Section:
    (y, z), (a, b) = shear, mass
    return dataclasses.replace(section, shear_centre_y=y, shear_centre_z=z, mass_centre_y=a, mass_centre_z=b)


def cantilever(section: Section, elements: int, **more: object) -> Structure:
    beam = straight_beam(section, L, elements)
    return dataclasses.replace(beam, members=(dataclasses.replace(beam.members[0], **more),))


@pytest.mark.parametrize("size", [4, 6])
@pytest.mark.parametrize("seed", repeats(range(40), 3))
def test_coupled_cantilever_under_tip_loads(size: int, seed: int):
    stiffness, centre = positive(seed, size), tuple(np.random.default_rng(seed).uniform(-0.1, 0.1, 2))
    section = off_the_nodes(coupled_section(stiffness, **BARE), shear=centre)
    exact = tip_flexibility(compliance(stiffness, centre))
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    for elements in (1, 3):
        K, _, keep = clamped_matrices(mesh_structure(straight_beam(section, L, elements)))
        found = np.linalg.inv(K)[np.ix_(*2 * [np.searchsorted(keep, np.arange(6, 12))])]
        assert np.abs((found - exact) / scale).max() < 1e-8  # rounding times condition


def end_flexibility(beam: Structure) -> np.ndarray:
    K, _, keep = clamped_matrices(mesh_structure(beam))
    return np.linalg.inv(K)[np.ix_(*2 * [np.searchsorted(keep, np.arange(6, 12))])]


@pytest.mark.parametrize("size", [4, 6])
@pytest.mark.parametrize("seed", repeats(range(20), 2))
def test_coupled_cantilever_through_stations(size: int, seed: int):
    """Halves of a full stiffness and shear centre of their own are exact, a taper to second order."""
    rng = np.random.default_rng([seed, 5])
    stiffness = [positive(100 + 2 * seed + k, size) for k in (0, 1)]
    centres = [tuple(rng.uniform(-0.1, 0.1, 2)) for _ in stiffness]
    inner, outer = (
        off_the_nodes(coupled_section(K, **BARE), shear=at) for K, at in zip(stiffness, centres, strict=True)
    )
    exact = tip_flexibility(*(compliance(K, at) for K, at in zip(stiffness, centres, strict=True)))
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    halves = cantilever(inner, 4, stations=((0.5, inner), (0.5 + 1e-12, outer), (1.0, outer)))
    assert np.abs((end_flexibility(halves) - exact) / scale).max() < 1e-8
    if size == 6:  # what lies between two stiffnesses with shear is a matter of definition
        return
    ends = [off_the_nodes(section, shear=centres[0]) for section in (inner, outer)]
    exact = tip_flexibility(lambda s: compliance((1.0 - s) * stiffness[0] + s * stiffness[1], centres[0]))
    errors = [
        np.abs((end_flexibility(cantilever(ends[0], n, stations=((1.0, ends[1]),))) - exact) / scale).max()
        for n in (8, 16)
    ]
    assert errors[1] < 3e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)


def test_pull_off_the_centroid_bends():
    """N e L^2 / 2 EI: the centroid is below the node line, so that a pull on it lowers the tip."""
    section = shifted_section(dataclasses.replace(FULL, **BARE), (-0.02, 0.0))
    K, _, keep = clamped_matrices(mesh_structure(straight_beam(section, L, 2)))
    pull = np.zeros(len(keep))
    pull[np.searchsorted(keep, 6)] = 1.0
    down = np.linalg.solve(K, pull)[np.searchsorted(keep, 7)]
    assert down == pytest.approx(-0.02 * L**2 / (2 * 80.0), rel=1e-10)


def transfer(C: np.ndarray, M: np.ndarray, omega: float) -> float:
    """Determinant whose zeros are the frequencies of a cantilever: exact for any C and M of its section."""
    A = np.zeros((12, 12))
    A[1, 5], A[2, 4] = 1.0, -1.0  # u' = turn x e1 + shear
    A[:6, 6:] = C
    A[6:, :6] = -(omega**2) * M
    A[10, 8], A[11, 7] = 1.0, -1.0  # M' = -e1 x N
    scale = np.array([1.0] * 6 + [1e3] * 6)
    return float(np.linalg.det(sla.expm(A * L * scale / scale[:, None])[6:, 6:]))


def section_mass(s: Section) -> np.ndarray:
    arm = np.zeros((3, 6))
    arm[:, :3] = np.eye(3)
    y, z = s.mass_centre_y, s.mass_centre_z
    arm[0, 4], arm[0, 5], arm[1, 3], arm[2, 3] = z, -y, -z, y
    own = np.diag([0.0, 0.0, 0.0, s.rho_I_y + s.rho_I_z, s.rho_I_y, s.rho_I_z])
    return s.rho_A * arm.T @ arm + own


@pytest.mark.parametrize("seed", [1])
def test_coupled_frequencies(seed: int):
    """Bending, torsion and axial motion, coupled by stiffness and centres; one extrapolation of order two."""
    centre, mass = (0.03, -0.05), (-0.04, 0.06)
    stiffness = positive(seed, 6)
    section = off_the_nodes(coupled_section(stiffness, **INERTIA), shear=centre, mass=mass)
    C, M = compliance(stiffness, centre), section_mass(section)
    found = []
    for elements in (12, 24):
        K, mass_matrix, _ = clamped_matrices(mesh_structure(straight_beam(section, L, elements)))
        found.append(np.sqrt(sla.eigh(K, mass_matrix, eigvals_only=True)[:6]))
    limit = (4.0 * found[1] - found[0]) / 3.0
    for omega in limit:
        exact = brentq(lambda w: transfer(C, M, w), 0.995 * omega, 1.005 * omega, xtol=1e-12)
        assert omega == pytest.approx(exact, rel=1e-4)


def test_shifted_section_is_an_offset_member():
    """Centroid, shear centre and mass centre off the node line are a member offset from its nodes, bent far.

    To the square of the strain on the node line, offset times curvature: 1.5 % here.
    """
    y, z = 0.01, -0.012
    stiff = dataclasses.replace(FULL, GA_y=4e4, GA_z=3e4)
    shifted = dataclasses.replace(
        shifted_section(stiff, (y, z)),
        shear_centre_y=y,
        shear_centre_z=z,
        mass_centre_y=y,
        mass_centre_z=z,
    )
    load = md.LoadCase(name="tip", loads=(PointLoad(name="tip", frame="b", force=np.array([3.0, -25, 18])),))
    tips, modes = [], []
    arm = np.array([0.0, y, z])
    for section, offset in ((stiff, 0.0 * arm), (stiff, arm), (shifted, 0.0 * arm)):
        beam = cantilever(section, 10, start_offset=offset, end_offset=offset)
        rest = md.solve_equilibrium(beam, md.Environment.clamped("a"), load)
        tips.append(rest.config.x[1])
        modes.append(md.solve_modes(rest, 4).frequency_hz)
    assert np.linalg.norm(tips[2] - [L, 0.0, 0.0]) > 0.4 * L
    assert np.linalg.norm(tips[2] - tips[1]) < 0.02 * np.linalg.norm(tips[2] - tips[0])
    assert modes[2] == pytest.approx(modes[1], rel=6e-4)


def test_weight_off_the_line_twists():
    section = dataclasses.replace(FULL, mass_centre_z=0.03)
    g = 1e-4  # so weak that geometry stays linear
    rest = md.solve_equilibrium(straight_beam(section, L, 4), md.Environment.clamped("a", gravity=g))
    twist = 0.5 * (rest.config.R[1][2, 1] - rest.config.R[1][1, 2])
    assert twist == pytest.approx(0.03 * 0.5 * g * L**2 / (2 * 30.0), rel=1e-6)


@pytest.mark.parametrize("share", [-0.5, 2.0])
def test_pretensioned_beam(share: float):
    """Between hinges rho_A omega^2 = EI k^4 + N k^2; let go at one end it shortens by N/EA and is slack."""
    force = share * np.pi**2 * 100.0 / L**2
    beam = cantilever(TUBE, 16, tension=force)
    hinged = dataclasses.replace(
        md.Environment.orbit(), clamps=(Clamp(node="a", about="x"), Clamp(node="b", about="x"))
    )
    rest = md.solve_equilibrium(beam, hinged)
    exact = np.sqrt((100.0 * (np.pi / L) ** 4 + force * (np.pi / L) ** 2) / 0.5) / (2 * np.pi)
    assert md.solve_modes(rest, 1).frequency_hz[0] == pytest.approx(exact, rel=1e-5)
    let_go = md.solve_equilibrium(beam, md.Environment.clamped("a", gravity=0.0))
    assert let_go.config.x[1, 0] == pytest.approx(L * (1.0 - force / TUBE.EA), rel=1e-12)
    slack = md.solve_modes(let_go, 1).frequency_hz[0]
    assert slack == pytest.approx(1.8751040687**2 / L**2 * np.sqrt(200.0) / (2 * np.pi), rel=1e-3)


@pytest.mark.parametrize("share", [-0.5, 2.0])
def test_plant_and_derivatives_of_a_pretensioned_beam(share: float):
    """A force at the middle of a hinged beam under N: static gain and d omega^2/dN = k^2 / rho_A."""
    force = share * np.pi**2 * 100.0 / L**2
    x, z = np.eye(3)[[0, 2]]
    nodes = [node(name, at * L * x) for name, at in (("a", 0.0), ("m", 0.5), ("b", 1.0))]
    bars = [dataclasses.replace(member(p, q, TUBE, 8), tension=force) for p, q in (("a", "m"), ("m", "b"))]
    beam = dataclasses.replace(
        structure(nodes, bars),
        actuators=(Actuator(name="push", kind=ActuatorKind.FORCE, frame="m", axis=z),),
        sensors=(Sensor(name="moves", kind=SensorKind.DISPLACEMENT, frame="m", axis=z),),
    )
    hinged = dataclasses.replace(
        md.Environment.orbit(), clamps=(Clamp(node="a", about="x"), Clamp(node="b", about="x"))
    )
    modes = md.solve_modes(md.solve_equilibrium(beam, hinged), 6)
    plant = md.build_plant(modes, inputs=["push"], outputs=["moves"], static=True).system
    gain = (plant.D - plant.C @ np.linalg.solve(plant.A, plant.B))[0, 0]
    root = np.sqrt(complex(force / 100.0))  # imaginary in compression: tanh becomes tan
    exact = (L / (4.0 * force) - np.tanh(0.5 * root * L) / (2.0 * force * root)).real
    assert gain == pytest.approx(exact, rel=1e-5)
    tensions = find_parameters(beam, hinged, ["member.a-m.tension", "member.m-b.tension"])
    found = differentiate_frequencies(modes, tensions, 1).d_lambda[:, 0]
    np.testing.assert_allclose(found, 0.5 * (np.pi / L) ** 2 / TUBE.rho_A, rtol=1e-4)


def test_tapered_cantilever():
    """EI linear from 100 to 40: tip flexibility by its integral; every mesh has the mass to rounding."""
    ends = TUBE, dataclasses.replace(TUBE, EI_z=40.0, rho_A=0.1)
    s = np.linspace(0.0, L, 20001)
    exact = np.trapezoid((L - s) ** 2 / (100.0 - 60.0 * s / L), s)
    errors = []
    middle = dataclasses.replace(TUBE, EI_z=70.0, rho_A=0.3)
    for elements in (8, 16):
        beam = cantilever(ends[0], elements, stations=((0.5, middle), (1.0, ends[1])))
        assert beam.mass == pytest.approx(0.3 * L, rel=1e-12)
        assert summarise(beam).mass == pytest.approx(0.3 * L, rel=1e-12)
        K, _, keep = clamped_matrices(mesh_structure(beam))
        at = np.searchsorted(keep, 7)
        errors.append(abs(np.linalg.inv(K)[at, at] / exact - 1.0))
    assert errors[1] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_a_tube_tapers_by_its_diameters():
    """From 40 to 20 mm outside, 30 to 16 inside: EI with the fourth powers, mass with the squares."""
    tubes = [
        build_section(SectionForm(material="al", outer_diameter_m=d, inner_diameter_m=h), AL)
        for d, h in ((0.04, 0.03), (0.02, 0.016))
    ]
    s = np.linspace(0.0, 1.0, 20001)
    d, h = 0.04 - 0.02 * s, 0.03 - 0.014 * s
    E, rho = 7e10, 2700.0
    bends = np.trapezoid((L * (1.0 - s)) ** 2 / (E * np.pi / 64.0 * (d**4 - h**4)), s) * L
    mass = np.trapezoid(rho * np.pi / 4.0 * (d**2 - h**2), s) * L
    beam = cantilever(tubes[0], 32, stations=((1.0, tubes[1]),))
    K, _, keep = clamped_matrices(mesh_structure(beam))
    at = np.searchsorted(keep, 7)
    assert np.linalg.inv(K)[at, at] == pytest.approx(bends, rel=1e-3)  # of 32 steps, 6e-4
    assert beam.mass == pytest.approx(mass, rel=3e-4)
    halved = section_between(*(dataclasses.replace(t, EI_z=0.5 * t.EI_z) for t in tubes), 0.3)
    assert halved.EI_z == pytest.approx(0.5 * section_between(*tubes, 0.3).EI_z, rel=1e-14)


def test_tubes_of_one_area_taper_by_their_diameters_too():
    """40 to 24 mm at one end, the solid of that area at the other: between them there is more."""
    tubes = [
        build_section(SectionForm(material="al", outer_diameter_m=d, inner_diameter_m=h), AL)
        for d, h in ((0.0390625, 0.0234375), (0.03125, 0.0))
    ]
    assert tubes[0].EA == tubes[1].EA
    area = np.pi / 4.0 * (0.03515625**2 - 0.01171875**2)
    assert pytest.approx(7e10 * area, rel=1e-12) == section_between(*tubes, 0.5).EA


def test_a_centroid_that_crosses_the_node_line_adds_no_stiffness_there():
    """The same member runs aslant between offset ends: 10 mm to either side, to the square of its slope."""
    ends = [shifted_section(dataclasses.replace(FULL, **BARE), (y, 0.0)) for y in (0.01, -0.01)]
    aslant = cantilever(
        dataclasses.replace(FULL, **BARE),
        1,
        start_offset=np.array([0, 0.01, 0]),
        end_offset=np.array([0, -0.01, 0]),
    )
    flat = cantilever(ends[0], 64, stations=((1.0, ends[1]),))
    found, want = (
        np.linalg.inv(K)[np.ix_(*2 * [np.searchsorted(keep, np.arange(6, 12))])]
        for K, _, keep in (clamped_matrices(mesh_structure(beam)) for beam in (flat, aslant))
    )
    size = np.sqrt(np.outer(np.diag(want), np.diag(want)))
    assert np.abs((found - want) / size).max() < 0.01
    assert np.diag(found)[1] == pytest.approx(np.diag(want)[1], rel=3e-4)


def test_summary_has_the_mass_where_it_is():
    """Against the mass matrix under rigid motions."""
    first = dataclasses.replace(FULL, mass_centre_y=0.05, mass_centre_z=-0.1)
    beam = cantilever(first, 8, stations=((1.0, dataclasses.replace(first, rho_A=0.1, mass_centre_y=-0.2)),))
    summary, model = summarise(beam), mesh_structure(beam)
    _, M, _ = clamped_matrices(model, fixed=())
    x = model.rest.x - summary.centre
    rigid = np.zeros((len(x), 6, 6))
    rigid[:, :3, :3] = rigid[:, 3:, 3:] = np.eye(3)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        rigid[:, k, 3 + i], rigid[:, j, 3 + i] = x[:, j], -x[:, k]
    whole = (R := rigid.reshape(-1, 6)).T @ M @ R
    expected = sla.block_diag(summary.mass * np.eye(3), summary.inertia)
    assert whole == pytest.approx(expected, abs=1e-9)


def test_derivatives_by_couplings_and_centres():
    section = off_the_nodes(coupled_section(positive(3, 6), **INERTIA), mass=(0.02, 0.01), shear=(0.01, 0.03))
    beam = cantilever(section, 3, tension=5.0)
    world = md.Environment.clamped("a", gravity=1.0)
    names = ("coupling.15", "coupling.24", "mass_centre_y", "shear_centre_z", "tension", "E", "rho")
    parameters = find_parameters(beam, world, [f"member.a-b.{name}" for name in names])
    found = differentiate_frequencies(md.solve_modes(md.solve_equilibrium(beam, world), 3), parameters)
    # Steps that move the frequencies alike, so that none hides another.
    strongest = np.abs(found.d_hz).max(axis=1)
    steps = np.minimum(1e-5 * found.frequency_hz[0] / strongest, 1e-2)
    # Each by itself in `make test-all`; else all of them together, in two ways of random signs.
    ways = np.eye(len(steps)) if LONG else np.random.default_rng(7).choice([-1.0, 1.0], (2, len(steps)))
    for way in ways:
        ends = []
        for side in (1.0, -1.0):
            moved = beam, world
            for p, h in sorted(zip(parameters, side * way * steps, strict=True), key=lambda x: x[0].scales):
                moved = set_parameter(*moved, p, p.value + h)
            ends.append(md.solve_modes(md.solve_equilibrium(*moved), 3).frequency_hz)
        each = way[:, None] * steps[:, None] * found.d_hz
        limit = 1e-4 * np.abs(each).max(axis=0) + 1e-6 * steps.min()
        assert np.all(np.abs(each.sum(axis=0) - 0.5 * (ends[0] - ends[1])) <= limit)


def test_impossible_stiffness_is_refused():
    K = positive(1, 4)
    wrong = K.copy()
    wrong[0, 3] *= 1.01
    indefinite = K.copy()
    indefinite[0, 3] = indefinite[3, 0] = 1.2 * np.sqrt(K[0, 0] * K[3, 3])
    for bad, word in ((wrong, "not symmetric"), (indefinite, "indefinite"), (K[:3, :3], "4x4 or 6x6")):
        with pytest.raises(ConfigError, match=word):
            coupled_section(bad, **BARE)
    for section, word in (
        (dataclasses.replace(TUBE, coupling=_entry(1, 5, 3.0)), "infinite stiffness"),
        (dataclasses.replace(TUBE, coupling=_entry(0, 5, 2e4)), "indefinite"),
    ):
        with pytest.raises(ConfigError, match=f"member 'a-b': .*{word}"):
            mesh_structure(straight_beam(section, L, 2))
    for stations in (((0.5, TUBE),), ((0.5, TUBE), (0.4, TUBE), (1.0, TUBE))):
        with pytest.raises(ConfigError, match="stations"):
            mesh_structure(cantilever(TUBE, 2, stations=stations))
    with pytest.raises(ConfigError, match="tension"):
        mesh_structure(cantilever(TUBE, 2, tension=np.nan))


def _entry(i: int, j: int, value: float) -> np.ndarray:
    out = np.zeros((6, 6))
    out[i, j] = out[j, i] = value
    return out


def test_semidefinite_sections_are_taken():
    """Rods that do not bend, and a section that couples to its limit."""
    for i, j in itertools.pairwise((0, 4, 5)):
        K = np.diag([4.0, np.inf, np.inf, 1.0, 9.0, 16.0])
        off = _entry(i, j, np.sqrt(K[i, i] * K[j, j]))
        section = Section(EA=4.0, GJ=1.0, EI_y=9.0, EI_z=16.0, coupling=off, **BARE)
        assert np.all(np.isfinite(mesh_structure(straight_beam(section, L, 2)).beams.stiffness))
