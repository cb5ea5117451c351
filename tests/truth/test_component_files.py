"""Components in files: NPZ, MAT, OUTPUT4 with cards, punched DMIG; what does not fit is named."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from reduced import bent_beam, with_component

import middeck as md
from cli_runner import middeck
from middeck.errors import ConfigError, DataError, NumericalError
from middeck.files.articles.components import load_component, write_component
from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.components.external import read_external
from middeck.files.nastran.components.external_write import write_external
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units
from middeck.files.nastran.output4.matrices import Op4Matrix, op4_by_name, write_op4
from middeck.files.promises.plans import load_plan
from middeck.files.refinements.promised_loads import load_promised_loads
from middeck.files.studies.documents import load_study
from middeck.structure.model.component import NEGATIVE, component_faults, rigid_vectors
from middeck.structure.summary.summary import summarise

SI = parse_units("m-kg-s-N")
DATA = Path("data/nastran-superelement").resolve()


@pytest.fixture(scope="module")
def component():
    part = with_component(*bent_beam(np.random.default_rng(4)), count=3, recover=["m"], residual=["m"])
    made = part.components[0]
    return dataclasses.replace(made, damping=2e-5 * made.stiffness)


@pytest.mark.parametrize("ending", ["npz", "mat"])
def test_there_and_back(tmp_path, component, ending):
    write_component(tmp_path / f"a.{ending}", component)
    back = load_component(tmp_path / f"a.{ending}")
    for key in ("grids", "positions", "stiffness", "mass", "damping", "outputs", "recovery"):
        assert np.array_equal(getattr(back, key), getattr(component, key)), key


def test_there_and_back_as_a_superelement(tmp_path, component):
    write_external(tmp_path / "part", component)
    back = read_external([tmp_path / "part.pch"], tmp_path / "part.op4", SI)
    assert back.grids == ("1", "2")
    np.testing.assert_array_equal(back.stiffness, component.stiffness)
    np.testing.assert_array_equal(back.mass, component.mass)
    np.testing.assert_array_equal(back.damping, component.damping)
    np.testing.assert_allclose(back.positions, component.positions, atol=1e-9)  # ten digits
    deck = (
        "ASSIGN INPUTT4='part.op4',\n  UNIT=101\nSOL 103\nCEND\nBEGIN BULK\nINCLUDE 'part.asm'\n"
        "CONM2,5,2,,0.25\nINCLUDE 'part.pch'\nENDDATA\n"
    )
    (tmp_path / "join.dat").write_text(deck.replace("CONM2,5,2,,0.25\n", ""))
    from middeck.files.nastran.components.assembly import read_assembly

    deck, parts = read_assembly(tmp_path / "join.dat", SI, "join")
    made = convert_deck(deck, SI, "consistent", "join", parts)
    assert [node["name"] for node in made.document["node"]] == ["g1", "g2"]
    np.testing.assert_array_equal(parts["join-se101.npz"].stiffness, component.stiffness)


@pytest.mark.parametrize(
    ("fields", "frames"),
    [
        ("101,0,,NO,,,,,1,THRU,2,11,THRU,12", ("g11", "g12")),
        ("0,101,,NO,,,,,11,THRU,12,1,THRU,2", ("g11", "g12")),
        ("101,0,,NO,,,,,1,12,2,11", ("g12", "g11")),
        ("101,0,,NO,,,,,1,THRU,2,11,THRU,13", "unequal or backward ranges"),
        ("101,0,,NO,,,,,1,THRU,3,11,THRU,13", "THRU over numbers that are no boundary grids"),
        ("101,0,,NO,,,,,2,THRU,1,12,THRU,11", "unequal or backward ranges"),
        ("101,0,,NO,,,,,1,THRU,2,11", "no pairs of grids"),
        ("101,0,,NO,,,,,1,THRU,2,11,12,13", "no pairs of grids"),
    ],
)
def test_superelements_are_joined_by_pairs_and_ranges(tmp_path, component, fields, frames):
    from middeck.files.nastran.components.assembly import read_assembly

    write_external(tmp_path / "part", component)
    head, last = fields[: fields.index(",,,,,")], fields[fields.index(",,,,,") + 5 :]
    bulk = f"SEBULK,101,EXTOP4,,MANUAL,,,101\nSECONCT,{head}\n,{last}\nGRID,11\nGRID,12\n"
    deck = f"ASSIGN INPUTT4='part.op4',UNIT=101\nSOL 103\nCEND\nBEGIN BULK\n{bulk}INCLUDE 'part.pch'\n"
    (tmp_path / "join.dat").write_text(deck + "ENDDATA\n")
    if isinstance(frames, str):
        with pytest.raises(ConfigError, match=frames):
            read_assembly(tmp_path / "join.dat", SI, "join")
    else:
        _, parts = read_assembly(tmp_path / "join.dat", SI, "join")
        assert parts["join-se101.npz"].frames == frames


def joined_masses(folder, component, places, joins, method="MANUAL", tol=""):
    """A deck of the component with bodies of 1 and 0.1 on its grids, whose own cards print ``places``."""
    from middeck.files.nastran.components.assembly import read_assembly

    write_external(folder / "part", component)
    cards = (folder / "part.pch").read_text().splitlines()
    grids = iter(f"GRID,{k + 1},,{','.join(place)}" for k, place in enumerate(places))
    kept = [line for line in cards if not line.startswith("* ")]
    own = "\n".join(next(grids) if line.startswith("GRID*") else line for line in kept)
    (folder / "part.pch").write_text(own + "\n")
    bulk = f"SEBULK,101,EXTOP4,,{method},{tol},,101\n"
    bulk += "" if method == "AUTO" else "SECONCT,101,0,,NO\n,1,11,2,12\n"
    bulk += "".join(
        f"GRID,{k + 11},,{','.join(at)}\nCONM2,{k + 1},{k + 11},,1.\n,0.1,,0.1,,,0.1\n"
        for k, at in enumerate(joins)
    )
    deck = f"ASSIGN INPUTT4='part.op4',UNIT=101\nSOL 103\nCEND\nBEGIN BULK\n{bulk}INCLUDE 'part.pch'\n"
    (folder / "join.dat").write_text(deck + "ENDDATA\n")
    deck, parts = read_assembly(folder / "join.dat", SI, "join")
    made = convert_deck(deck, SI, "consistent", "join", parts)
    for file, part in parts.items():
        write_component(folder / file, part)
    (folder / "join.toml").write_text(document_text(made.document, "joined"))
    modes = md.solve_modes(
        md.solve_equilibrium(md.load_structure(folder / "join.toml"), md.Environment.orbit())
    )
    return modes.frequency_hz, deck.notes


def printed(places, digits):
    return [[f"{x:.{digits}g}" + "." * (f"{x:.{digits}g}".isdigit()) for x in place] for place in places]


@pytest.mark.parametrize("digits", [5, 6, 7])
@pytest.mark.parametrize("method", ["AUTO", "MANUAL"])
def test_places_of_few_digits_join_as_the_matrices_do(tmp_path, component, digits, method):
    """Nastran makes coordinates equal, whatever the places: the pencil of the matrices with both bodies."""
    away = dataclasses.replace(
        component, positions=component.positions + np.array([3.1234567, -0.31234567, 1.1234567])
    )
    M = component.mass.copy()
    M[:12, :12] += np.diag(np.tile(np.repeat([1.0, 0.1], 3), 2))
    squared = scipy.linalg.eigh(component.stiffness, M, eigvals_only=True)
    places = printed(away.positions, digits)
    found, notes = joined_masses(tmp_path, component, places, places, method)
    np.testing.assert_allclose(found[6:], np.sqrt(squared[6:]) / (2.0 * np.pi), rtol=10.0 ** (1 - digits))
    assert np.all(found[:6] < 1e-3 * found[6])
    assert digits == 7 or any("of se101 is joined to g1" in note for note in notes)


def test_grids_within_a_tolerance_are_joined_over_it(tmp_path, component):
    """TOL of SEBULK, in units of the deck; beyond it grids that do not coincide are refused."""
    places = printed(component.positions, 12)
    beside = [[f"{float(places[0][0]) + 1e-3:.9f}", *places[0][1:]], places[1]]
    with pytest.raises(ConfigError, match=r"grid 2 stands 0\.001 m from frame 'g12'"):
        joined_masses(tmp_path, component, places, beside)
    _, notes = joined_masses(tmp_path, component, places, beside, tol="0.01")
    assert any("over a distance of 0.001 (m-kg-s-N)" in note for note in notes)


def punch(name, matrix, points, digits=10):
    """Nastran's DMIG of a symmetric matrix: one triangle, large fields."""
    lines = [f"DMIG    {name:8}{0:8d}{6:8d}{2:8d}{0:8d}"]
    for j, (g, c) in enumerate(points):
        rows = [
            (f"{matrix[i, j]:16.{digits - 1}E}", *points[i]) for i in range(j, len(points)) if matrix[i, j]
        ]
        if rows:
            lines.append(f"DMIG*   {name:16}{g:16d}{c:16d}")
            lines += [f"*       {p:16d}{d:16d}{value}".replace("E", "D") for value, p, d in rows]
    return lines


@pytest.mark.parametrize("in_one_file", [True, False])
def test_punched_matrices(tmp_path, component, in_one_file):
    """In the component's own units, and with a grid whose coordinates are turned (CD)."""
    x = component.positions[1] * 1e3
    points = [(g, c) for g in (7, 9) for c in range(1, 7)] + [(100 + k, 0) for k in range(component.modal)]
    # A right-handed system with x' = y, y' = z, z' = x, for grid 9 alone.
    turn = np.eye(len(points))
    turn[6:12, 6:12] = np.kron(np.eye(2), np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    unit = np.diag(np.concatenate([np.tile(np.repeat([1e-3, 1.0], 3), 2), np.ones(component.modal)])) * 1e3
    K, M = (turn @ unit @ A @ unit @ turn.T for A in (component.stiffness, component.mass))
    cards = [
        "GRID,7,,0.,0.,0.",
        f"GRID*,9,,{x[0]:.9f},{x[1]:.9f}\n*,{x[2]:.9f},4",
        "CORD2R,4,,0.,0.,0.,1.,0.,0.\n,0.,1.,0.",
    ]
    matrices = [*punch("KAAX", K, points), *punch("MAAX", M, points)]
    apart = [] if in_one_file else matrices
    (tmp_path / "part.dat").write_text("\n".join([*apart, ""]))
    (tmp_path / "part.pch").write_text("\n".join(["BEGIN SUPER=3", *cards, *matrices[len(apart) :], ""]))
    files = [tmp_path / "part.dat", tmp_path / "part.pch"]
    back = read_external(files, None, parse_units("mm-kg-s-mN"))
    assert (back.grids, back.modal) == (("7", "9"), component.modal)
    size = np.sqrt(np.diagonal(component.stiffness))
    assert np.abs((back.stiffness - component.stiffness) / np.outer(size, size)).max() < 1e-8
    np.testing.assert_allclose(back.mass, component.mass, atol=1e-8 * np.abs(component.mass).max())


@pytest.mark.parametrize("digits", [7, 10])
@pytest.mark.parametrize("held", [0.0, 1e6])
def test_what_printed_digits_leave_of_nothing_holds_no_free_part(tmp_path, component, digits, held):
    """Neither a negative stiffness of a rigid motion nor a positive one; a spring beyond the digits stays."""
    points = [(g, c) for g in (7, 9) for c in range(1, 7)] + [(100 + k, 0) for k in range(component.modal)]
    K = component.stiffness.copy()
    K[0, 0] += held
    x = component.positions
    grids = [f"GRID*,{n},,{p[0]:.12f},{p[1]:.12f}\n*,{p[2]:.12f}" for n, p in zip((7, 9), x, strict=True)]
    cards = [*grids, *punch("KAAX", K, points, digits), *punch("MAAX", component.mass, points)]
    (tmp_path / "part.pch").write_text("\n".join(["BEGIN SUPER=3", *cards, ""]))
    if held:
        with pytest.raises(DataError, match=r"resists a motion as one body .*, most at grid 7"):
            read_external([tmp_path / "part.pch"], None, SI)
        return
    back = read_external([tmp_path / "part.pch"], None, SI)
    squared = scipy.linalg.eigh(back.stiffness, back.mass, eigvals_only=True)
    exact = scipy.linalg.eigh(component.stiffness, component.mass, eigvals_only=True)
    assert np.abs(squared[:6]).max() < 1e-10 * exact[-1]
    np.testing.assert_allclose(squared[6:], exact[6:], rtol=100.0 * 10.0 ** (1 - digits))


def test_a_rigid_motion_that_is_rounding_is_not_the_lowest_elastic_one():
    """Rounding gives omega^2 of either sign to rigid motions: that of one is no scale for that of another."""
    part = with_component(*bent_beam(np.random.default_rng(0)), count=1).components[0]
    K, M = part.stiffness, part.mass
    lowest = scipy.linalg.eigh(K, M, eigvals_only=True)[6]
    moved = M @ rigid_vectors(part.positions, len(M))[:, :2]  # along x and y
    soft = np.diag([0.9, -0.9]) * NEGATIVE * lowest / part.weight
    assert not [*component_faults(dataclasses.replace(part, stiffness=K + moved @ soft @ moved.T))]
    (fault,) = component_faults(dataclasses.replace(part, stiffness=K + 2.0 * moved @ soft @ moved.T))
    assert "an omega^2 of -1.8e-06 times the lowest elastic one (-1e-06 is allowed" in fault


def test_punched_matrices_beside_others(tmp_path, component):
    """Loads by column (form 9) and complex matrices that nobody asks for change nothing; a rival is told."""
    points = [(g, c) for g in (7, 9) for c in range(1, 7)] + [(100 + k, 0) for k in range(component.modal)]
    x = component.positions[1]
    cards = ["GRID,7,,0.,0.,0.", f"GRID*,9,,{x[0]:.9f},{x[1]:.9f}\n*,{x[2]:.9f}"]
    matrices = [*punch("KAAX", component.stiffness, points), *punch("MAAX", component.mass, points)]
    others = ["DMIG,PAX,0,9,2,0,,,2", "DMIG,PAX,1,0,,7,1,1.", "DMIG,PAX,2,0,,9,3,1."]
    others += ["DMIG,B2PP,0,6,3,0", "DMIG,B2PP,7,1,,7,1,1.,2."]
    part = tmp_path / "part.pch"
    part.write_text("\n".join([*cards, *others, *matrices, ""]))
    units = parse_units("m-kg-s-N")
    np.testing.assert_allclose(read_external([part], None, units).mass, component.mass, atol=1e-7)
    part.write_text("\n".join([*cards, *matrices, *punch("KXX", 2.0 * component.stiffness, points), ""]))
    with pytest.raises(DataError, match="KXX and KAAX, which differ: either may be the stiffness"):
        read_external([part], None, units)
    part.write_text("\n".join([*cards, *others, *matrices, ""]).replace("MAAX", "MASS"))
    with pytest.raises(DataError, match="MXX, MAAX, MAA; there are KAAX, PAX, B2PP, MASS"):
        read_external([part], None, units)


def article(folder, text=""):
    (folder / "a.toml").write_text(
        'schema = 1\nname = "a"\n[[node]]\nname = "a"\nx_m = 0.0\n[[node]]\nname = "b"\n'
        f'POSITION\n[[component]]\nname = "part"\nfile = "part.npz"\nnodes = {{ a = "a", b = "b" }}\n{text}'
    )
    return folder / "a.toml"


def with_positions(path, x):
    keys = "\n".join(f"{axis}_m = {float(value)!r}" for axis, value in zip("xyz", x, strict=True))
    path.write_text(path.read_text().replace("POSITION", keys))
    return path


def test_a_promise_and_a_study_name_the_files_of_components(tmp_path, component, capfd):
    """Their matrices are what the article is made of: a changed file is another article."""
    write_component(tmp_path / "part.npz", component)
    path = with_positions(article(tmp_path), component.positions[1])
    for name in ("promise.toml", "mace-simple-lab.json"):
        shutil.copy(DATA.parent / "virtual-survey" / name, tmp_path)
    survey = '[[survey]]\nname = "s"\nmodes = "mace-simple-lab.json"\nenvironment = "orbit"\n'
    unknown = '[[unknown]]\nname = "m"\nparameters = ["members.E"]\nspread = 0.1\n'
    (tmp_path / "refine.toml").write_text(f'schema = "middeck.refinement/1"\n{survey}{unknown}')
    loaded = load_plan(tmp_path / "promise.toml", path)
    assert tmp_path / "part.npz" in loaded.files
    (tmp_path / "loads.toml").write_text(
        'schema = "middeck.promised-loads/1"\nrefinement = "refine.toml"\nenvironment = "orbit"\n'
        '[[load_case]]\nname = "push"\n[[load_case.load]]\nframe = "a"\nforce_n = [1.0, 0.0, 0.0]\n'
        '[[gauge]]\nname = "g"\nat = "b"\ndirection = [1.0, 0.0, 0.0]\n'
    )
    assert tmp_path / "part.npz" in load_promised_loads(tmp_path / "loads.toml", path).files
    assert middeck(capfd, "new", tmp_path / "own").code == 0
    shutil.copy(tmp_path / "part.npz", tmp_path / "own")
    with (tmp_path / "own/article.toml").open("a") as text:
        text.write('[[component]]\nname = "part"\nfile = "part.npz"\nnodes = { a = "n1", b = "n2" }\n')
    assert "part.npz" in dict(load_study(tmp_path / "own/study.toml").inputs)


def panel(**keys):
    """The outboard component of the truss on nodes of its own, by its table."""
    table = {"name": "outboard", "file": f"{DATA}/outboard.op4", "cards": [f"{DATA}/outboard.pch"]}
    places = {"g3": (0.0, 0.3), "g11": (0.3, 0.3), "g19": (0.3, 0.0), "g27": (0.0, 0.0)}
    nodes = [{"name": name, "x_m": 0.6, "y_m": y, "z_m": z} for name, (y, z) in places.items()]
    table |= {"units": "mm-kg-s-mN", "nodes": {"3": "g3", "11": "g11", "19": "g19", "27": "g27"}} | keys
    return document_text({"schema": 1, "name": "panel", "node": nodes, "component": [table]}, "")


def test_output4_without_cards_names_what_is_missing(tmp_path):
    (tmp_path / "panel.toml").write_text(panel(cards=[]))
    with pytest.raises(ConfigError, match="does not say which row is which") as caught:
        md.load_structure(tmp_path / "panel.toml")
    assert "component 'outboard'" in str(caught.value)
    assert f'cards = ["{DATA}/outboard.pch"]' in str(caught.value)


@pytest.mark.parametrize(
    ("units", "scale", "reported"), [("mm-kg-s-mN", 1.0, 0), ("mm-t-s-N", 1.0, 1), ("m-kg-s-N", 1000.0, 1)]
)
def test_a_component_in_wrong_units_is_reported(tmp_path, units, scale, reported):
    """1.59 kg of truss, 1.6 m long: as tonnes it is near to solid iron, and still as soft as a truss."""
    text = panel(units=units)
    for place in (0.6, 0.3):
        text = text.replace(f"_m = {place}", f"_m = {place * scale}")
    (tmp_path / "panel.toml").write_text(text)
    found = summarise(md.load_structure(tmp_path / "panel.toml")).warnings
    assert sum("'outboard'" in text and "are its units" in text for text in found) == reported


@pytest.mark.parametrize(("count", "hz", "reported"), [(8, 3000.0, 0), (6, 5.0, 0), (8, 5.0, 1)])
def test_blocks_of_steel_and_lumps_on_springs_are_no_wrong_units(tmp_path, count, hz, reported):
    """A cube of 0.4 m has its modes at kHz; one on springs has six slow ones; no cube has eight."""
    mass, stiffness = np.zeros((2, 6 + count, 6 + count))
    weight = 7850.0 * 0.4**3
    mass[:6, :6] = weight * np.diag([1.0] * 3 + [0.4**2 / 6.0] * 3)
    mass[6:, 6:], stiffness[6:, 6:] = np.eye(count), (2.0 * np.pi * hz) ** 2 * np.eye(count)
    np.savez(tmp_path / "cube.npz", mass=mass, stiffness=stiffness, grids=["a"], positions=[[0.0, 0.0, 0.0]])
    node, table = {"name": "n", "x_m": 0.0}, {"name": "cube", "file": "cube.npz", "nodes": {"a": "n"}}
    document = {"schema": 1, "name": "cube", "node": [node], "component": [table]}
    (tmp_path / "cube.toml").write_text(document_text(document, ""))
    found = summarise(md.load_structure(tmp_path / "cube.toml")).warnings
    assert sum("are its units" in text for text in found) == reported


def test_a_study_hashes_what_the_cards_of_a_component_include(tmp_path, component, capfd):
    """A changed include is another article, as a changed deck is."""
    assert middeck(capfd, "new", tmp_path / "own").code == 0
    own = tmp_path / "own"
    write_external(own / "part", component)
    (own / "part.pch").rename(own / "inner.pch")
    (own / "part.pch").write_text("INCLUDE 'inner.pch'\n")
    with (own / "article.toml").open("a") as text:
        text.write(
            '[[component]]\nname = "part"\nfile = "part.op4"\ncards = ["part.pch"]\nunits = "m-kg-s-N"\n'
            'nodes = { 1 = "n1", 2 = "n2" }\n'
        )
    first = dict(load_study(own / "study.toml").inputs)
    assert {"part.op4", "part.pch", "inner.pch"} <= set(first)
    with (own / "inner.pch").open("a") as text:
        text.write("$\n")
    assert dict(load_study(own / "study.toml").inputs)["inner.pch"] != first["inner.pch"]


def test_an_article_finds_its_component_beside_itself(tmp_path, component, capfd):
    write_component(tmp_path / "part.npz", component)
    path = with_positions(article(tmp_path), component.positions[1])
    structure = md.load_structure(path)
    assert structure.mass == pytest.approx(component.weight)
    modes = md.solve_modes(md.solve_equilibrium(structure, md.Environment.orbit()))
    assert modes.kind[:7] == (*["rigid"] * 6, "flexible")
    ended = middeck(capfd, "modes", str(path), "--environment", "orbit", "--count", "8", "--json")
    assert ended.code == 0
    # Damping in proportion to stiffness: the ratio grows with frequency.
    from middeck.structure.plants.damping import estimate_damping

    found = estimate_damping(modes, count=8)
    np.testing.assert_allclose(found.device[6:8], 1e-5 * modes.omega[6:8], rtol=1e-9)
    out = md.structure.recover_outputs(modes, "part")
    assert out.names[0] == "m x"
    assert np.abs(out.rest).max() < 1e-12
    assert out.modes.shape == (6, len(modes.omega))


def test_modes_writes_the_points_inside_a_component(tmp_path, component, capfd):
    write_component(tmp_path / "part.npz", component)
    path = with_positions(article(tmp_path), component.positions[1])
    file = tmp_path / "shapes.json"
    ended = middeck(capfd, "modes", path, "--environment", "orbit", "--count", "9", "-o", file)
    assert ended.code == 0
    found = md.load_measured_modes(file)
    modes = md.solve_modes(md.solve_equilibrium(md.load_structure(path), md.Environment.orbit()))
    rows = [i for i, node in enumerate(found.node) if node == "m"]
    assert [found.direction[i] for i in rows] == ["x", "y", "z", "rx", "ry", "rz"]
    true = md.structure.recover_outputs(modes, "part").modes[:, 6:9]
    signs = np.sign(np.sum(found.shape[rows] * true, axis=0))
    np.testing.assert_allclose(found.shape[rows] * signs, true, atol=1e-6 * np.abs(true).max())


def test_recovered_motion_is_that_of_the_whole():
    whole, part = bent_beam(np.random.default_rng(4))
    orbit = md.Environment.orbit()
    full = md.solve_modes(md.solve_equilibrium(whole, orbit))
    made = md.solve_modes(md.solve_equilibrium(with_component(whole, part, count=500, recover=["m"]), orbit))
    seen = md.structure.recover_outputs(made, "part").modes[:, 6:10]
    true = full.shapes[6:12, 6:10]
    signs = np.sign(np.sum(seen * true, axis=0))
    np.testing.assert_allclose(seen * signs, true, atol=1e-6 * np.abs(true).max())


def test_residual_modes_make_the_flexibility_at_their_nodes_exact():
    """With the boundary held, the reduced part answers a load at m as the whole does (MacNeal 1971)."""
    _, part = bent_beam(np.random.default_rng(5))
    errors = []
    for residual in ((), ("m",)):
        flexibility = []
        for count in (2, 500):
            made = md.reduce_structure(
                part, ["a", "b"], count=count, residual=residual, recover=["m"]
            ).component
            T = made.recovery[:, 12:]
            flexibility.append(T @ np.linalg.solve(made.stiffness[12:, 12:], T.T))
        errors.append(np.abs(flexibility[0] - flexibility[1]).max() / np.abs(flexibility[1]).max())
    assert errors[0] > 1e-3
    assert errors[1] < 1e-9


def test_reduce_from_the_command_line(tmp_path, capfd):
    target = tmp_path / "bus.npz"
    arguments = (
        "reduce",
        "articles/mace-simple.toml",
        "--boundary",
        "n1,n5",
        "--modes",
        "6",
        "-o",
        str(target),
    )
    ended = middeck(capfd, *arguments)
    assert ended.code == 0
    assert {p.name for p in tmp_path.iterdir()} == {"bus.npz", "bus.op4", "bus.pch", "bus.asm"}
    back = load_component(target)
    assert back.weight == pytest.approx(md.load_structure("articles/mace-simple.toml").mass)
    assert middeck(capfd, "reduce", "articles/mace-simple.toml", "--boundary", "n9", "--modes", "6").code == 2
    assert middeck(capfd, "reduce", "articles/mace-simple.toml", "--boundary", "n1").code == 2


# ---- what does not fit
# ---------------------------------------------------------------------------------------

UNITS = parse_units("mm-kg-s-mN")


def read(folder, name="inboard", units=UNITS):
    return read_external([folder / f"{name}.pch"], folder / f"{name}.op4", units)


@pytest.fixture
def folder(tmp_path):
    for name in ("inboard.pch", "inboard.op4", "outboard.op4"):
        shutil.copy(DATA / name, tmp_path / name)
    return tmp_path


def test_matrices_of_another_component(folder):
    shutil.copy(folder / "outboard.op4", folder / "inboard.op4")
    with pytest.raises(DataError, match="46 rows for 32 coordinates") as error:
        read(folder)
    assert "inboard.op4" in error.value.where


def test_places_of_other_grids(folder):
    text = (
        (folder / "inboard.pch")
        .read_text()
        .replace("0.600000000E+03 0.300000000E+03", "0.600000000E+03 0.400000000E+03")
    )
    (folder / "inboard.pch").write_text(text)
    with pytest.raises(DataError, match=r"resists a motion as one body|differs by direction|moments of mass"):
        read(folder)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("EXTRN          3  123456", "EXTRN          3     123", "32 rows for 29 coordinates"),
        ("EXTRN          3  123456", "EXTRN          3  123457", "no grid and components"),
        ("      27  123456\n         2995001", "      29  123456\n         2995001", "no GRID 29"),
        ("EXTRN ", "OMIT1 ", "no EXTRN card"),
        ("          11               0 0.6", "          11               9 0.6", "coordinate system 9"),
    ],
)  # fmt: skip
def test_cards_that_do_not_fit(folder, old, new, message):
    text = (folder / "inboard.pch").read_text()
    assert old in text
    (folder / "inboard.pch").write_text(text.replace(old, new))
    with pytest.raises((DataError, ConfigError), match=message):
        read(folder)


def test_damaged_stiffness_is_not_taken(folder, campaign):
    """Any entry of the boundary that is off by a thousandth of its diagonal, mirrored or not, is refused."""
    found = op4_by_name(folder / "inboard.op4")
    K = found["KXX"].value.toarray()
    for seed in (
        *campaign(400),
        2325,
    ):  # a turn of the boundary and a modal coordinate, units of kg m^2 and of kg
        rng = np.random.default_rng(seed)
        i, j = rng.integers(24), rng.integers(32)
        by = 1e-3 * np.sqrt(K[i, i] * K[j, j])
        bad = K.copy()
        bad[i, j] += by
        if rng.random() < 0.7:
            bad[j, i] = bad[i, j]
        write_op4(folder / "inboard.op4", [Op4Matrix("KXX", 2, sp.csc_array(bad)), found["MXX"]])
        with pytest.raises(DataError):
            read(folder)
        write_op4(folder / "inboard.op4", [Op4Matrix("KXX", 6, sp.csc_array(K)), found["MXX"]])
    read(folder)


@pytest.mark.parametrize("grids", [[101.0, 102.0], [101, 102], [b"101", b"102"], ["101", "102"]])
def test_names_of_grids_are_what_other_programs_make_of_them(tmp_path, component, grids):
    arrays = {"K": component.stiffness, "M": component.mass, "grids": grids, "positions": component.positions}
    np.savez(tmp_path / "a.npz", **arrays)
    assert load_component(tmp_path / "a.npz").grids == ("101", "102")


def test_files_that_hold_no_component(tmp_path, component):
    arrays = {"stiffness": component.stiffness, "mass": component.mass}
    whole = arrays | {"grids": ["a", "b"], "positions": component.positions}
    for more, warning in (
        ({"K": component.stiffness}, "stiffness under two"),
        ({"grids": ["a", "a"]}, "one name"),
    ):
        np.savez(tmp_path / "a.npz", **(whole | more))
        with pytest.raises(DataError, match=warning):
            load_component(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(DataError, match="no grids, positions"):
        load_component(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", **arrays, grids=["a", "b", "c"], positions=component.positions)
    with pytest.raises(DataError, match="3 grids of six coordinates"):
        load_component(tmp_path / "b.npz")
    (tmp_path / "c.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:200])
    for name, warning in (("c.npz", "truncated"), ("d.npz", "no such file"), ("e.txt", "no ending")):
        with pytest.raises(DataError, match=warning):
            load_component(tmp_path / name)
    with pytest.raises(ConfigError, match=r"name it .npz or .mat"):
        write_component(tmp_path / "f.txt", component)
    assert not (tmp_path / "f.txt").exists()


def test_articles_name_what_their_component_lacks(tmp_path, component):
    write_component(tmp_path / "part.npz", component)
    path = with_positions(article(tmp_path), component.positions[1])
    good = path.read_text()
    for old, new, warning in (
        ('b = "b" }', 'c = "b" }', "no grid c"),
        (', b = "b" }', " }", "an unconnected node"),
        ('b = "b" }', 'b = "z" }', "no frame of this name"),
        ('file = "part.npz"', 'file = "part.op4"', "do not state their units"),
        ('name = "part"\n', "", "missing"),
        ('"part.npz"', '"part.npz"\ncards = ["part.pch"]', r"not of \.npz"),
    ):
        path.write_text(good.replace(old, new))
        with pytest.raises((ConfigError, DataError), match=warning):
            md.load_structure(path)


@pytest.mark.parametrize("ending", ["npz", "mat"])
def test_a_file_in_other_units(tmp_path, component, ending):
    """Matrices in mm, t and ms, each entry by its dimension: forces of shifts, moments of turns."""
    length, mass, time = 1e-3, 1e3, 1e-3
    arms = np.array([0, 0, 0, 1, 1, 1] * 2 + [1] * component.modal)  # powers of length, of row and column
    per = length ** (arms[:, None] + arms) * mass
    assert component.outputs == ("m x", "m y", "m z", "m turn about x", "m turn about y", "m turn about z")
    lengths = np.array([1, 1, 1, 0, 0, 0])
    write_component(
        tmp_path / f"part.{ending}",
        dataclasses.replace(
            component,
            positions=component.positions / length,
            stiffness=component.stiffness / (per / time**2),
            mass=component.mass / per,
            damping=component.damping / (per / time),
            recovery=component.recovery * length ** (1.0 - arms) / length ** lengths[:, None],
        ),
    )
    path = with_positions(article(tmp_path), component.positions[1])
    path.write_text(path.read_text().replace('"part.npz"', f'"part.{ending}"\nunits = "mm-t-ms"'))
    (found,) = md.load_structure(path).components
    for key in ("positions", "stiffness", "mass", "damping", "recovery"):
        np.testing.assert_allclose(getattr(found, key), getattr(component, key), rtol=1e-12, err_msg=key)


def test_outputs_in_other_units_are_what_they_are_not_what_they_are_called(tmp_path, component):
    """A stress along x was taken for a length; one that is no motion as one body must state its kind."""
    stress = np.vstack([1e3 * component.stiffness[0], component.recovery[0], component.recovery[5]])
    names = ("stress x", "tip", "way z")
    write_component(
        tmp_path / "part.npz", dataclasses.replace(component, outputs=names, recovery=stress, damping=None)
    )
    path = with_positions(article(tmp_path), 1e-3 * component.positions[1])
    path.write_text(path.read_text().replace('"part.npz"', '"part.npz"\nunits = "mm-t-s"'))
    with pytest.raises(ConfigError, match="of what kind is its output 'stress x'"):
        md.load_structure(path)
    arrays = dict(np.load(tmp_path / "part.npz"))
    np.savez(tmp_path / "part.npz", **arrays, kinds=["stress", "length", "angle"])
    (found,) = md.load_structure(path).components
    step = np.ones(len(component.stiffness))
    step[[0, 1, 2, 6, 7, 8]] = 1e3  # a coordinate of the file per metre
    by_hand = np.array([1e6, 1e-3, 1.0])[:, None] * stress * step  # 1 t/(mm s^2) = 1e6 Pa
    np.testing.assert_allclose(found.recovery, by_hand, rtol=1e-12)
    np.savez(tmp_path / "part.npz", **arrays, kinds=["stress", "length"])
    with pytest.raises(ConfigError, match="2 kinds of outputs"):
        md.load_structure(path)


@pytest.mark.parametrize("form", [1, 2])
def test_matrices_that_are_not_said_to_be_symmetric(tmp_path, component, form):
    """Written by DMAP of other programs as square or rectangular; damping so written was left out."""
    write_external(tmp_path / "part", component)
    names = {"KXX": component.stiffness, "MXX": component.mass, "BXX1": component.damping}
    write_op4(tmp_path / "part.op4", [Op4Matrix(n, form, sp.csc_array(m)) for n, m in names.items()])
    back = read_external([tmp_path / "part.pch"], tmp_path / "part.op4", SI)
    np.testing.assert_array_equal(back.stiffness, component.stiffness)
    np.testing.assert_array_equal(back.damping, component.damping)
    K = component.stiffness.copy()
    K[0, 7] *= 1.01
    write_op4(
        tmp_path / "part.op4",
        [Op4Matrix("KXX", form, sp.csc_array(K)), Op4Matrix("MXX", 6, sp.csc_array(component.mass))],
    )
    with pytest.raises(DataError, match="its stiffness is not symmetric"):
        read_external([tmp_path / "part.pch"], tmp_path / "part.op4", SI)
    K4 = Op4Matrix("K4XX", form, sp.csc_array(1e-2 * component.stiffness))
    others = [Op4Matrix(n, 6, sp.csc_array(m)) for n, m in names.items()]
    write_op4(tmp_path / "part.op4", [*others, K4])
    with pytest.raises(DataError, match="structural damping"):
        read_external([tmp_path / "part.pch"], tmp_path / "part.op4", SI)


def averaged(folder, seed, *more):
    """A mass on some components of an average, in turned axes that the ``seed`` draws."""
    beam = ["CEND", "BEGIN BULK", "MAT1,1,7.+10,,.3,2700.", "PBAR,1,1,4.-4,1.3-8,1.9-8,2.3-8"]
    beam += [f"CBAR,{i},1,{i},{i + 1},.3,1.,.2" for i in (1, 2, 3)]
    beam += ["RBE3,90,,5,123456,1.,123,1,2", ",3,4", "RBE2,91,5,1346,6", "CONM2,80,6,,1.", ",.1,,.1,,,.1"]
    rng = np.random.default_rng(seed)
    places, axes = rng.uniform(-1.0, 1.0, (6, 3)), np.linalg.qr(rng.standard_normal((3, 3)))[0]
    rows = [places[5], places[5] + axes[2], places[5] + axes[0], *places]
    a, b, c, *grids = (",".join(f"{value:.6f}" for value in row) for row in rows)
    cards = [f"GRID,{k},,{at}{',5' * (k > 4)}" for k, at in enumerate(grids, 1)]
    text = "\n".join([*beam[:2], f"CORD2R,5,0,{a},{b}", f",{c}", *cards, *beam[2:], *more, "ENDDATA"])
    (folder / "a.dat").write_text(text)
    made = convert_deck(read_deck(folder / "a.dat"), SI, "consistent", "a")
    (folder / "a.toml").write_text(document_text(made.document, "a"))
    return md.load_structure(folder / "a.toml")


def test_links_inside_an_article_do_not_keep_it_from_being_reduced(tmp_path):
    """The boundary has a part in them that is rounding only."""
    springs = "CBUSH,70,7,5,6,,,,0", "PBUSH,7,K,1.+4,1.+4,1.+4,1.+4,1.+4,1.+4"
    for seed in range(12):
        reduced = md.reduce_structure(averaged(tmp_path, seed, *springs), ["g1"], count=6)
        assert reduced.component.modal == 6


@pytest.mark.parametrize("seed", [1, 17])
def test_what_is_loose_inside_is_reported_however_its_pivots_round(tmp_path, seed):
    with pytest.raises(NumericalError, match="still loose"):
        md.reduce_structure(averaged(tmp_path, seed), ["g1"], count=6)


def test_grids_are_written_in_ascending_order(tmp_path, component):
    """The rows of a boundary follow the numbers of its grids, whatever order the component has."""
    named = dataclasses.replace(component, grids=("n12", "n3"))
    write_external(tmp_path / "part", named)
    back = read_external([tmp_path / "part.pch"], tmp_path / "part.op4", SI)
    assert back.grids == ("3", "12")
    np.testing.assert_allclose(back.positions, component.positions[::-1], atol=1e-9)
    n = len(component.mass)
    rows = [*range(6, 12), *range(6), *range(12, n)]
    for key in ("stiffness", "mass", "damping"):
        np.testing.assert_array_equal(getattr(back, key), getattr(component, key)[np.ix_(rows, rows)])
