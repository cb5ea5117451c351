"""What is drawn against closed forms of beams, and the motion of points against moved articles."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from reduced import bent_beam, with_component

import middeck as md
from middeck.files.exchange.vtu import PARTS, write_vtu
from middeck.plot.shapes import AZIMUTH, ELEVATION, factor_of, turned, upright
from middeck.structure.assembly.environment_loads import no_loads
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.elements.beam import beam_properties
from middeck.structure.elements.beam_centre_line import beam_curve
from middeck.structure.elements.frames import Configuration, move
from middeck.structure.model.article import AttachPoint, Body, PointLoad, Section, Spring
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.component import Component
from middeck.structure.model.environment import AnchoredSpring
from middeck.structure.model.links import Interpolation, Link, Share
from middeck.structure.model.section import MemberMass
from middeck.structure.modes.results.article_drawing import Drawing, build_mode_drawing, build_rest_drawing
from middeck.structure.rest.equilibrium import Equilibrium
from repeats import repeats
from structure_builders import (
    TUBE,
    body,
    member,
    node,
    random_configuration,
    rigid_bar,
    straight_beam,
    structure,
)

ROOT = Path(__file__).parents[2]
L, P = 2.0, 1e-4


def clamped(
    section: Section, elements: int, load: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Equilibrium:
    beam = straight_beam(section, L, elements)
    if any(load):
        beam = dataclasses.replace(beam, loads=(PointLoad(name="tip", frame="b", force=np.array(load)),))
    return md.solve_equilibrium(beam, md.Environment.clamped("a", gravity=0.0))


def of_member(drawing: Drawing) -> slice:
    (line,) = [line for line in drawing.lines if line.what == "member"]
    return slice(line.first, line.last)


@pytest.mark.parametrize("axis", [1, 2])
@pytest.mark.parametrize("GA", [np.inf, 900.0])
@pytest.mark.parametrize("elements", repeats([1, 3]))
def test_a_cantilever_is_drawn_with_its_own_deflection(axis: int, GA: float, elements: int) -> None:
    """P x^2 (3L - x)/(6 EI) + P x/GA: one element has it whole, between its ends too."""
    load = (0.0, P, 0.0) if axis == 1 else (0.0, 0.0, P)
    drawing = build_rest_drawing(clamped(dataclasses.replace(TUBE, GA_y=GA, GA_z=GA), elements, load))
    x, at_rest = drawing.drawn[of_member(drawing)], drawing.rest[of_member(drawing)]
    s = x[:, 0]
    expected = P * s**2 * (3.0 * L - s) / (6.0 * 100.0) + P * s / GA
    np.testing.assert_allclose(at_rest[:, axis] - x[:, axis], expected, rtol=1e-6, atol=1e-15)
    assert [m.what for m in drawing.marks] == ["clamp", "force"]


def test_a_member_of_one_element_is_curved_beside_one_of_many() -> None:
    """Each member has its own points, as many as its elements leave to draw; diamonds are few on any."""
    nodes = [node(name, (x, 0.0, 0.0)) for name, x in (("a", 0.0), ("b", 0.4 * L), ("c", L))]
    parts = [member("a", "b", TUBE, 1), member("b", "c", TUBE, 24)]
    load = PointLoad(name="tip", frame="c", force=np.array([0.0, P, 0.0]))
    beam = dataclasses.replace(structure(nodes, parts), loads=(load,))
    drawing = build_rest_drawing(md.solve_equilibrium(beam, md.Environment.clamped("a", gravity=0.0)))
    lines = [line for line in drawing.lines if line.what == "member"]
    assert [line.last - line.first for line in lines] == [17, 25]
    for line in lines:
        x, at_rest = (points[line.first : line.last] for points in (drawing.drawn, drawing.rest))
        s = x[:, 0]
        assert np.all(np.diff(s) > 0.0)
        expected = P * s**2 * (3.0 * L - s) / (6.0 * 100.0)
        np.testing.assert_allclose(at_rest[:, 1] - x[:, 1], expected, rtol=1e-6, atol=1e-15)
    rings = [line.name for line in drawing.lines if line.what == "section"]
    assert [rings.count(name) for name in ("a-b", "b-c")] == [2, 9]


def test_a_bending_mode_is_the_closed_form_between_the_nodes() -> None:
    """Clamped and free: cosh - cos - 0.7341 (sinh - sin) with beta L = 1.8751; the mesh is good to 1e-4."""
    modes = md.solve_modes(clamped(TUBE, 4), 2)
    drawing = build_mode_drawing(modes, [0])
    s = drawing.drawn[of_member(drawing), 0] * 1.8751040687 / L
    exact = np.cosh(s) - np.cos(s) - 0.7340955 * (np.sinh(s) - np.sin(s))
    motion = drawing.motion[0, of_member(drawing)]
    size = np.linalg.norm(motion, axis=1)
    np.testing.assert_allclose(size / size[-1], exact / exact[-1], atol=2e-4)
    assert drawing.strain[0].sum() == pytest.approx(1.0)


@pytest.mark.parametrize("seed", repeats(range(12), 2))
def test_points_move_as_the_article_does(seed: int) -> None:
    """About a bent state every point moves as central differences of the drawing say."""
    rng = np.random.default_rng([3, seed])
    article = md.load_structure(ROOT / "articles/mace-simple.toml", ["mesh.elements_per_strut=2"])
    environment = md.load_environment(ROOT / "environments/lab.toml")
    hung = md.solve_equilibrium(article, environment)
    bent = random_configuration(hung.model, rng, 0.05)
    bare = Configuration(bent.x, bent.R, bent.angle)
    shape = rng.standard_normal((hung.model.tree.size, 1))
    modes = md.solve_modes(hung, 1)
    at = dataclasses.replace(hung, config=bare)
    drawing = build_mode_drawing(dataclasses.replace(modes, equilibrium=at, shapes=shape), [0])
    h = 1e-6
    moves = [move(hung.model.tree, bare, sign * h * shape[:, 0]) for sign in (1.0, -1.0)]
    ends = [build_rest_drawing(dataclasses.replace(at, config=config)) for config in moves]
    moved = (ends[0].rest - ends[1].rest) / (2.0 * h)
    cables = {i for line in drawing.lines if line.what == "cable" for i in range(line.first, line.last)}
    rows = [i for i in range(len(moved)) if i not in cables]  # cut off at a length, not at a point
    np.testing.assert_allclose(drawing.motion[0, rows], moved[rows], atol=2e-7)


def test_all_that_stands_there_is_drawn() -> None:
    modes = md.solve_modes(md.solve_equilibrium(*md.load_setup(
        ROOT / "articles/mace-dm.toml", ROOT / "environments/lab.toml")))  # fmt: skip
    drawing = build_mode_drawing(modes, range(10))
    names = {what: [n.name for n in drawing.lines if n.what == what] for what in PARTS}
    assert names["member"] == ["n1-n2", "n2-n3", "n3-n4", "n4-n5"]
    assert names["cable"] == ["n1", "n3", "n5"]
    assert names["body"] == ["n1", "n2", "n3", "n4", "n5", "pri_x", "pri_z"]
    for line in (n for n in drawing.lines if n.what == "cable"):
        assert drawing.motion[:, line.last - 1].max() < drawing.motion[:, line.first].max()
    torsion = build_mode_drawing(modes, [modes.name.index("first torsion")])
    section = max(
        np.abs(torsion.motion[0, n.first : n.last]).max() for n in torsion.lines if n.what == "section"
    )
    assert section > 1e-3  # torsion is seen


def test_a_file_for_paraview_has_the_same_arrays(tmp_path: Path) -> None:
    modes = md.solve_modes(clamped(TUBE, 2), 3)
    drawing = build_mode_drawing(modes)
    write_vtu(tmp_path / "a.vtu", drawing)
    piece = ElementTree.parse(tmp_path / "a.vtu").getroot().find(".//Piece")
    assert piece is not None
    arrays = {a.get("Name"): np.array((a.text or "").split(), dtype=float) for a in piece.iter("DataArray")}
    assert int(piece.get("NumberOfPoints", 0)) == len(drawing.rest)
    np.testing.assert_allclose(arrays["points"].reshape(-1, 3), drawing.rest, atol=1e-8)
    titles = [name for name in arrays if name and name.startswith("mode 1: ")]
    assert titles == [f"mode 1: {modes.frequency_hz[1]:.6g} Hz, {modes.name[1]}"]
    shape = next(a for a in piece.iter("DataArray") if a.get("Name") == titles[0])
    found = np.array((shape.text or "").split(), dtype=float).reshape(-1, 3)
    np.testing.assert_allclose(found, drawing.motion[1], rtol=1e-8, atol=1e-300)
    cells = arrays["connectivity"].reshape(-1, 2).astype(int)
    assert len(cells) == int(piece.get("NumberOfCells", 0)) == len(arrays["part"]) == len(arrays["types"])
    assert [tuple(c) for c in cells] == [
        (i, i + 1) for n in drawing.lines for i in range(n.first, n.last - 1)
    ]


def test_an_article_without_members_is_drawn() -> None:
    rest = md.solve_equilibrium(rigid_bar(2.0, 1.0, (0.1, 0.2, 0.3)), md.Environment.orbit())
    drawing = build_mode_drawing(md.solve_modes(rest))
    assert [n.what for n in drawing.lines] == ["rigid", "rigid", "body"]  # the arms to its two ends
    assert np.isfinite(drawing.motion).all()
    assert mesh_structure(rest.model.structure).frames == rest.model.frames


def linked(turn: tuple[str, str]) -> md.Structure:
    """Two members with a link over the gap between them, which is all that joins them."""
    places = {"a": (0.0, 0.0, 0.0), "b": (1.0, 0.0, 0.0), "c": (1.0, 0.5, 0.2), "d": (2.0, 0.5, 0.2)}
    nodes = [node(name, place, body(1.0)) for name, place in places.items()]
    article = structure(nodes, [member("a", "b", TUBE, 1), member("c", "d", TUBE, 1)])
    along, about = turn
    arm = np.array([0.0, 0.1, 0.0])
    tie = Link(name="tie", first="b", second="c", along=along, about=about, offset=arm)
    follow = Interpolation(name="mean", frame="e", shares=(Share(frame="a", about="xyz"), Share(frame="d")))
    far = node("e", (1.0, 1.0, 0.0), body(0.0))
    return dataclasses.replace(article, nodes=(*article.nodes, far), links=(tie, follow))


def test_a_rigid_link_is_drawn_and_stays_as_long_as_it_is() -> None:
    """From the first frame to its point on the second, then to that; its ends move as one body."""
    held = md.Environment.clamped("a", gravity=0.0)
    drawing = build_mode_drawing(md.solve_modes(md.solve_equilibrium(linked(("xyz", "xyz")), held), 4))
    (line,) = [line for line in drawing.lines if line.name == "tie"]
    assert line.what == "rigid"
    x = drawing.drawn[line.first : line.last]
    np.testing.assert_allclose(x, [(1.0, 0.0, 0.0), (1.0, 0.6, 0.2), (1.0, 0.5, 0.2)], atol=1e-12)
    for motion in drawing.motion:
        moved = motion[line.first : line.last]
        size = np.abs(moved).max()
        for i, j in ((0, 1), (0, 2), (1, 2)):
            stretch = (moved[j] - moved[i]) @ (x[j] - x[i]) / np.linalg.norm(x[j] - x[i])
            assert abs(stretch) < 1e-9 * size
    spider = [line for line in drawing.lines if line.name == "mean"]
    assert [line.what for line in spider] == ["link", "link"]
    ends = [drawing.drawn[line.last - 1].tolist() for line in spider]
    assert ends == [[0.0, 0.0, 0.0], [2.0, 0.5, 0.2]]


def test_links_are_in_every_kind_of_picture(tmp_path: Path) -> None:
    held = md.Environment.clamped("a", gravity=0.0)
    drawing = build_mode_drawing(md.solve_modes(md.solve_equilibrium(linked(("xyz", "xy")), held), 2))
    assert {line.what for line in drawing.lines if line.name in ("tie", "mean")} == {"link"}
    write_vtu(tmp_path / "a.vtu", drawing)
    cells = ElementTree.parse(tmp_path / "a.vtu").find(".//DataArray[@Name='part']")
    assert cells is not None
    count = sum(line.last - line.first - 1 for line in drawing.lines if line.what == "link")
    assert (cells.text or "").split().count(str(PARTS.index("link"))) == count == 4
    (legend,) = md.plot.draw_shapes(drawing).legends
    assert "link that leaves some motion free, or average" in [text.get_text() for text in legend.get_texts()]


def test_a_body_with_products_of_inertia_is_a_box_in_its_principal_axes():
    """Of a turned box of known sides the corners are those of the box."""
    sides, mass = np.array([0.1, 0.2, 0.3]), 4.0
    axes = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0]
    own = np.diag(mass / 12.0 * (np.sum(sides**2) - sides**2))
    inertia = axes @ own @ axes.T
    turned = Body(mass, np.array([0.05, 0.0, 0.0]), 0.5 * (inertia + inertia.T))
    far = node("far", (3.0, 0.0, 0.0), body(1.0))
    article = structure([node("b", (0.0, 0.0, 0.0), turned), far], [member("b", "far", TUBE, 1)])
    drawing = build_rest_drawing(md.solve_equilibrium(article, md.Environment.orbit()))
    (line,) = [line for line in drawing.lines if line.what == "body" and line.name == "b"]
    found = (drawing.drawn[line.first : line.last] - [0.05, 0.0, 0.0]) @ axes
    np.testing.assert_allclose(np.abs(found), np.tile(0.5 * sides, (len(found), 1)), rtol=1e-12)


@pytest.mark.parametrize("seed", repeats(range(6)))
def test_a_component_is_drawn_as_what_it_was_reduced_from(seed: int) -> None:
    """With all of its modes kept: its grids, a recovered node and its centre of mass are the members' own."""
    whole, part = bent_beam(np.random.default_rng(seed))
    turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    reduced = with_component(whole, part, count=1000, recover=["m"])
    own = reduced.components[0]
    moved = dataclasses.replace(own, positions=own.positions @ turn, axes=turn, **_turned(own, turn))
    orbit = md.Environment.orbit()
    full = md.solve_modes(md.solve_equilibrium(whole, orbit), 10)
    drawing = build_mode_drawing(md.solve_modes(md.solve_equilibrium(dataclasses.replace(
        reduced, components=(moved,)), orbit), 10), range(6, 10))  # fmt: skip
    lines = [n for n in drawing.lines if n.what == "component"]
    still = build_rest_drawing(full.equilibrium), build_rest_drawing(md.solve_equilibrium(reduced, orbit))
    assert [len(d.motion) for d in still] == [0, 0]  # no mode, and no fault
    assert not [n for n in drawing.lines if "/q" in n.name]
    model, bare = full.equilibrium.model, mesh_structure(part)
    at = np.array([model.frames.index(f) for f in bare.frames])
    u = full.shapes[:, 6:].reshape(len(model.frames), 6, -1)
    M = mass_matrix(bare, bare.rest, no_loads())
    weight = sum((M @ np.eye(bare.tree.size)).reshape(-1, 6, bare.tree.size)[:, :3])
    centre = (weight @ u[at].reshape(bare.tree.size, -1)).T / own.weight
    ends = {"a": u[model.frames.index("a"), :3].T, "b": u[model.frames.index("b"), :3].T}
    ends["m"] = u[model.frames.index("m"), :3].T
    assert len(lines) == 3
    for line, name in zip(lines, "mab", strict=True):
        place = next(n.position for n in whole.nodes if n.name == name)
        np.testing.assert_allclose(drawing.drawn[line.last - 1], place, atol=1e-9)
        for found, exact in ((line.first, centre), (line.last - 1, ends[name])):
            sign = np.sign(np.sum(drawing.motion[:, found] * exact, axis=1, keepdims=True))
            np.testing.assert_allclose(
                sign * drawing.motion[:, found], exact, atol=1e-5 * np.abs(ends["b"]).max()
            )
    np.testing.assert_allclose(drawing.strain[:, -1] + drawing.strain[:, 0], 1.0, atol=1e-6)


def test_known_points_of_a_component_are_joined_by_the_shortest_lines() -> None:
    """A line of nodes, recovered in any order, is drawn as that line again; names say whose strain it is."""
    names = [f"n{k}" for k in range(6)]
    light = body(0.1, (0.0, 0.0, 0.0), (1e-3, 1e-3, 1e-3))
    nodes = [node(name, (0.3 * k, 0.0, 0.0), light) for k, name in enumerate(names)]
    part = structure(nodes, [member(a, b, TUBE, 1) for a, b in pairwise(names)])
    made = md.reduce_structure(part, ["n0", "n5"], count=8, recover=["n3", "n1", "n4", "n2"], name="boom")
    ends = structure([node(nodes[k].name, nodes[k].position) for k in (0, 5)], [])
    article = dataclasses.replace(ends, components=(made.component,))
    modes = md.solve_modes(md.solve_equilibrium(article, md.Environment.orbit()), 9)
    drawing = build_mode_drawing(modes, range(6, 9))
    lines = [(line.first, line.last - 1) for line in drawing.lines if line.what == "component"]
    joined = {tuple(sorted(np.rint(drawing.drawn[list(pair), 0] / 0.3).astype(int))) for pair in lines}
    assert joined == set(pairwise(range(6)))
    assert [name.split(" ", 1)[1] for name in modes.name[6:]] == ["deformation of component boom"] * 3


def _turned(part: Component, turn: np.ndarray) -> dict[str, np.ndarray]:
    """Matrices of a component in axes turned by ``turn``, outputs too."""
    assert part.recovery is not None
    T = np.eye(len(part.mass))
    T[:12, :12] = np.kron(np.eye(4), turn)
    return {
        "stiffness": T.T @ part.stiffness @ T,
        "mass": T.T @ part.mass @ T,
        "recovery": np.kron(np.eye(2), turn.T) @ part.recovery @ T,
    }


@pytest.mark.parametrize("places", [
    [(0.6, 0.0, 0.0)], [(0.6, 0.0, 0.0), (0.6, 0.0, 2.0)], [(0.0, 1.0, 0.0), (0.0, -2.0, 0.0)],
    [(3.0, y, z) for y in (0.0, 1.0) for z in (0.0, 1.0)],
    [(x, 2.0, z) for x in (0.0, 1.0) for z in (0.0, 1.0)],
    [(0.1 + 0.2, 1.0, 0.0), (0.3, 1.0, 1e-17)],
])  # fmt: skip
def test_a_picture_is_drawn_whatever_has_no_extent(places: list[tuple[float, float, float]]) -> None:
    """One point, a line along each axis or along the view, a plane across each, points apart by rounding."""
    eye = (turned(AZIMUTH, ELEVATION) @ upright([]))[2]
    for where in (places, [tuple(i * eye) for i in range(len(places))]):
        nodes = [node(f"n{i}", p, body(1.0)) for i, p in enumerate(where)]
        springs = tuple(AnchoredSpring(name=f"s{i}{k}", attach=f"p{i}", anchor=np.array(p) + e, stiffness=9.0,
                                       free_length=1.0)
                        for i, p in enumerate(where) for k, e in enumerate(np.eye(3)))  # fmt: skip
        points = tuple(AttachPoint(f"p{i}", f"n{i}", np.zeros(3)) for i in range(len(where)))
        chain = tuple(Spring(name=f"c{i}", start=f"p{i}", end=f"p{i + 1}", stiffness=9.0, free_length=0.0)
                      for i in range(len(where) - 1))  # fmt: skip
        article = dataclasses.replace(structure(nodes, []), attach_points=points, springs=chain)
        tied = md.Environment(title="tied", gravity=np.zeros(3), springs=springs,
                              clamps=tuple(Clamp(node=n.name, along="") for n in nodes))  # fmt: skip
        drawing = build_mode_drawing(md.solve_modes(md.solve_equilibrium(article, tied)))
        figure = md.plot.draw_shapes(drawing)
        assert np.all(np.isfinite([*figure.get_size_inches(), *figure.axes[0].get_xlim()]))
        assert drawing.size > 0.5
        assert factor_of(drawing, 0) * np.linalg.norm(drawing.motion[0], axis=1).max() > 0.05


def test_a_rod_is_drawn_straight_however_its_ends_turn() -> None:
    """A cubic leaves the chord by an eighth of the length times the angle of one end; a rod does not."""
    rod = dataclasses.replace(TUBE, EI_y=0.0, EI_z=0.0, mass=MemberMass.ROD)
    x, turn = np.array([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]]), 1e-3
    T = np.stack([np.eye(3), np.array([[1.0, -turn, -turn], [turn, 1.0, 0.0], [turn, 0.0, 1.0]])])[None]
    for section, off in ((TUBE, -2.0 * turn / 8.0), (rod, 0.0)):
        middle = beam_curve(beam_properties([section], np.array([2.0])), x, T, np.array([0.5]))[0, 0]
        np.testing.assert_allclose(middle, [1.0, off, off], atol=1e-6)
