"""The summary of an article: masses against the mass matrix, scales against solutions, doubts where due."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.files.setups import load_structure
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.environment_loads import no_loads
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.eigenproblem.eigen import solve_lowest
from middeck.structure.elements.frames import rigid_columns
from middeck.structure.model.article import Body, Section, Structure
from middeck.structure.model.environment import Environment
from middeck.structure.model.section import MemberMass
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.structure.summary.summary import summarise
from structure_builders import body, joint, member, node, straight_beam, structure

TUBE = Section(EA=2e4, GJ=30.0, EI_y=50.0, EI_z=80.0, rho_A=0.5, rho_I_y=2e-4, rho_I_z=3e-4)
# Aluminium tube, 40 x 2 mm.
ALUMINIUM = Section(
    EA=1.67e7, GJ=4.7e3, EI_y=6.05e3, EI_z=6.05e3, rho_A=0.645, rho_I_y=2.3e-4, rho_I_z=2.3e-4
)


def tilted_article() -> Structure:
    """Members in all directions, node sizes, off-centre bodies, a chain of joints held at angles."""
    nodes = [
        node("a", (0, 0, 0), body(2.0, (0.02, -0.03, 0.01), (0.03, 0.01, 0.02)), size=0.1),
        node("b", (1, 0.2, 0.3), body(1.0, (0.0, -0.05, 0.02), (0.03, 0.02, 0.02)), size=0.06),
        node("c", (0.5, 1.0, -0.4)),
    ]
    turned = joint("g", "a", np.eye(3)[0], body(0.5, (0, 0.01, 0)), offset=(0, -0.1, 0.05), angle=0.5)
    full = Body(
        1.5, np.array([0.05, -0.2, 0.1]), np.array([[3.0, 0.4, 0.1], [0.4, 2.0, 0.2], [0.1, 0.2, 2.5]]) / 100
    )
    inner = joint("h", "g", (0.6, 0.0, 0.8), full, offset=(0.03, 0, 0.02), angle=-0.7)
    return structure(nodes, [member("a", "b", TUBE, 2), member("b", "c", TUBE, 3)], [turned, inner])


@pytest.mark.parametrize("mass", MemberMass)
def test_mass_centre_and_inertia_are_those_of_the_mass_matrix(mass: MemberMass):
    parts = tilted_article()
    if mass in (MemberMass.ROD, MemberMass.COUPLED_ROD):  # straight, without rotary inertia
        section = dataclasses.replace(TUBE, mass=mass, rho_I_y=0.0, rho_I_z=0.0)
        straight = tuple(dataclasses.replace(m, section=section) for m in parts.members)
        parts = dataclasses.replace(parts, members=straight)
    found = summarise(parts)
    model = mesh_structure(parts)
    M = mass_matrix(model, model.rest)
    about = rigid_columns(model.tree, model.rest, found.centre)
    rigid = about.T @ (M @ about)
    # Cubic elements move rigidly exactly: rounding.
    assert rigid[:3, :3] == pytest.approx(found.mass * np.eye(3), rel=1e-12, abs=1e-12)
    assert rigid[3:, 3:] == pytest.approx(found.inertia, rel=1e-12, abs=1e-12)
    assert rigid[:3, 3:] == pytest.approx(np.zeros((3, 3)), abs=1e-12)
    assert found.mass == pytest.approx(parts.mass, rel=1e-12)
    assert found.coordinates == model.tree.size
    assert found.warnings == ()


def test_size_is_that_of_everything_that_has_a_place():
    nodes = [node("a", (0, 0, 0), body(1.0, (0, -0.5, 0)), size=0.2), node("b", (2, 0, 0), size=0.1)]
    parts = structure(nodes, [member("a", "b", TUBE, 1)])
    # Half a node beyond either end, half a node above, the centre of mass below.
    assert summarise(parts).size == pytest.approx([2.15, 0.6, 0.2], rel=1e-12)


def test_scale_of_a_uniform_beam_is_its_first_free_free_frequency():
    beam = straight_beam(
        Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=130.0, rho_A=0.5, rho_I_y=0.0, rho_I_z=0.0), 2.0, 4
    )
    found = summarise(beam)
    assert found.bending_hz == pytest.approx(22.3733 / (2 * np.pi) * np.sqrt(100 / 0.5) / 4.0, rel=1e-5)
    assert found.slenderness == pytest.approx((50.0, 50.0))  # 0.5 m of sqrt(100/1e6)


def lattice(bays: int) -> Structure:
    """Square cells of 0.5 m with a diagonal in every face."""
    shape = (bays + 1, 2, 2)
    nodes = [
        node("n" + "".join(f"_{i}" for i in at), 0.5 * np.array(at), body(0.3, inertia=(1e-4,) * 3))
        for at in np.ndindex(shape)
    ]
    name = {at: n.name for at, n in zip(np.ndindex(shape), nodes, strict=True)}
    pairs = []
    for at in np.ndindex(shape):
        for step in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1)):
            end = tuple(np.add(at, step))
            if end in name:
                pairs.append((name[at], name[end]))
    up = (0.31, 0.8, 0.51)
    return structure(nodes, [member(a, b, ALUMINIUM, 1, up=up) for a, b in pairs])


@pytest.mark.parametrize("make", [
    lambda: lattice(12),
    lambda: load_structure("articles/mace-dm.toml"),
    lambda: load_structure("articles/mace-simple.toml"),
])  # fmt: skip
def test_scale_of_an_article_is_of_the_order_of_its_first_flexible_frequency(make):
    parts = make()
    modes = solve_modes(solve_equilibrium(parts, Environment.orbit()))
    first = modes.frequency_hz[[k == "flexible" for k in modes.kind]][0]
    # An estimate by decades: lumped bodies lower, shear lowers, rigid nodes raise it.
    assert 0.5 < summarise(parts).bending_hz / first < 2.0


def first_frequency(elements: int) -> float:
    """Of a free beam whose polar inertia keeps the torsion far above."""
    model = mesh_structure(sliced_beam(elements))
    pairs = solve_lowest(assemble(model, model.rest, no_loads()).tangent, mass_matrix(model, model.rest), 8)
    assert pairs is not None
    omega = np.sqrt(np.abs(pairs.lam))
    return float(omega[np.argmin(np.abs(omega - 79.09))])


def sliced_beam(elements: int) -> Structure:
    return straight_beam(
        Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=130.0, rho_A=0.5, rho_I_y=1e-5, rho_I_z=1e-5), 2.0, elements
    )


def test_slicing_costs_digits_as_the_summary_says():
    """0.05 eps (L/h)^4: half of eps |phi|'|K||phi| / omega^2 of a uniform beam, a bound on what is found."""
    coarse, parts = first_frequency(100), []
    for fine in (1100, 1400, 1700):
        bound = summarise(sliced_beam(fine)).rounding
        expected = 24.0 / 500.5639 * np.finfo(float).eps * fine**4
        assert bound == pytest.approx(expected, rel=1e-9)
        parts.append(abs(first_frequency(fine) / coarse - 1.0) / bound)
    # The mesh of 100 is right to 3e-9, below 3e-4 of each bound. Rounding stays within the bound; the worst
    # of three sums comes within a factor of a hundred.
    assert 1e-2 < max(parts) < 1.0
    warning = summarise(sliced_beam(1400)).warnings[0]
    assert "sliced too finely: member 'a-b'" in warning
    assert f"(L/h)^4 = {1400**4:.1e}" in warning
    assert "adding members" in warning
    assert summarise(straight_beam(ALUMINIUM, 2.0, 200)).warnings == ()


def test_slices_that_are_members_of_their_own_are_slices_too():
    n = 1600
    nodes = [node(f"n{i}", (2.0 * i / n, 0, 0)) for i in range(n + 1)]
    members = [member(a.name, b.name, ALUMINIUM, 1) for a, b in itertools.pairwise(nodes)]
    sliced = summarise(structure(nodes, members))
    whole = summarise(straight_beam(ALUMINIUM, 2.0, n))
    assert sliced.rounding == pytest.approx(whole.rounding, rel=1e-9)
    assert any("sliced too finely" in text for text in sliced.warnings)


def simple(**changes) -> Structure:
    """Two bodies on a tube."""
    section = dataclasses.replace(ALUMINIUM, **changes.pop("section", {}))
    scale, heavy = changes.pop("scale", 1.0), changes.pop("heavy", 1.0)
    inertia = changes.pop("inertia", 1.0)
    nodes = [
        node(n, (scale * x, 0, 0), body(5.0 * heavy, inertia=(0.05 * inertia,) * 3), 0.05 * scale)
        for n, x in (("a", 0.0), ("b", 1.5))
    ]
    return structure(nodes, [member("a", "b", section, 4)])


DOUBTS = {
    "positions in millimetres? they are read as m": simple(scale=1e4),
    "member 'a-b' is 1450 m long": simple(scale=1e3),
    "kg/m^3: masses are read in kg": simple(heavy=1e6),
    "'a' has an inertia of 5e+04 kg m^2, 5 kg at 100 m": simple(inertia=1e6),
    "lowest bending frequency would be of the order of": simple(section={"EI_y": 1e-9, "EA": 1e-5}),
    "sound would travel at 5.09 m/s": simple(section={"EA": 16.7}),
    "material of 2.7 kg/m^3: is rho in kg/m^3?": simple(section={"density": 2.7}),
    "diameters in millimetres": simple(section={"EI_y": 6e9, "EI_z": 6e9}),
    "the article has no mass": structure([node("a", (0, 0, 0))]),
}


@pytest.mark.parametrize("message", DOUBTS)
def test_what_can_hardly_be_meant_is_doubted(message: str):
    assert any(message in text for text in summarise(DOUBTS[message]).warnings), summarise(
        DOUBTS[message]
    ).warnings


@pytest.mark.parametrize(
    ("density", "E", "doubted"),
    [
        (1900.0, 20e9, False),  # glass in epoxy
        (1900.0, 20e6, True),  # its E in kPa: no material
        (2170.0, 0.45e9, False),  # PTFE
        (2170.0, 0.45e6, True),
        (1100.0, 2.3e9, False),  # ABS
        (1100.0, 2.3e6, False),  # its E in kPa is that of a polyurethane rubber
        (1500.0, 8e6, False),  # silicone with a filler
        (930.0, 2e6, False),  # natural rubber
    ],
)
def test_a_modulus_is_doubted_where_no_material_of_its_density_has_it(density, E, doubted):
    """Moduli and densities of Ashby (2011), Materials Selection in Mechanical Design, appendix A."""
    section = {"density": density, "EA": E * ALUMINIUM.rho_A / density}
    assert any("is E in Pa" in text for text in summarise(simple(section=section)).warnings) is doubted


def test_nothing_is_doubted_of_ordinary_articles():
    for parts in (
        simple(),
        lattice(4),
        *(load_structure(f"articles/mace-{n}.toml") for n in ("dm", "simple")),
    ):
        assert summarise(parts).warnings == ()


@pytest.mark.parametrize("rounding", [0.0, 1e-12])
def test_a_flat_frame_below_a_tall_body_is_no_beam_along_it(rounding: float):
    """Its mass is long across the frame, whose nodes stand at one height: 8e9 Hz were told of such a one."""
    tube = Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=100.0, rho_A=0.5, rho_I_y=1e-4, rho_I_z=1e-4)
    tall = body(3.0, cg=(0.25, 0.4 / 3.0, 0.6), inertia=(1.0, 1.0, 0.05))
    places = {"a": (0.0, 0.0), "b": (0.5, 0.0), "c": (0.25, 0.4)}
    nodes = [node(n, (x, y, rounding * x), tall if n == "a" else body(0.1)) for n, (x, y) in places.items()]
    members = [member(i, j, tube, 2, up=(0.0, 0.0, 1.0)) for i, j in ("ab", "bc", "ca")]
    summary = summarise(structure(nodes, members))
    assert summary.bending_hz is None
    assert not [warning for warning in summary.warnings if "bending frequency" in warning]


def test_a_single_body_has_a_summary_without_bending():
    found = summarise(structure([node("a", (1, 2, 3), body(4.0, (0.1, 0, 0), (1, 2, 2.5)))]))
    assert (found.bending_hz, found.slenderness, found.rounding) == (None, None, 0.0)
    assert found.centre.tolist() == [1.1, 2.0, 3.0]
    assert np.diag(found.inertia).tolist() == [1.0, 2.0, 2.5]


def test_what_cannot_be_meshed_has_no_summary():
    loose = simple()
    with pytest.raises(ConfigError, match="no member or spring joins node 'c' to the rest"):
        summarise(dataclasses.replace(loose, nodes=(*loose.nodes, node("c", (9, 0, 0), body(1.0)))))
