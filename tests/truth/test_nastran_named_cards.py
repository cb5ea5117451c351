"""Cards that a deck may have and that few decks have: each against what it says or leaves as it was."""

import numpy as np
import pytest

from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.cards import join_cards
from middeck.files.nastran.deck.coordinates import place_grids
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.entries import read_entries
from middeck.files.nastran.deck.units import parse_units
from nastran_decks import components, skew

BAR = """\
MAT1,1,7.+10,,.3,2700.
PBAR,1,1,1.-4,1.-9,2.-9,2.-9
GRID,1
GRID,2,,1.
CBAR,11,1,1,2,0.,1.,0.
"""
SETS = "sets of a reduction: the article is not reduced"
FREE = "free or held, an article needs no reference supports"
LISTED = {
    "SUPORT,1,123456": FREE, "SUPORT1,4,1,1": FREE, "ASET,1,123": SETS, "ASET1,123,2": SETS,
    "BSET,2,123456": SETS, "BSET1,123456,2": SETS, "CSET,2,4": SETS, "CSET1,4,2": SETS, "QSET,2,1": SETS,
    "QSET1,123,1,THRU,2": SETS, "DTI,SPSEL,0": "no effect on stiffness and mass",
    "DTI,SPSEL,1,5,1.,ENDREC": "no effect on stiffness and mass",
}  # fmt: skip


def converted(folder, bulk):
    path = folder / "a.dat"
    path.write_text(f"SOL 103\nCEND\nBEGIN BULK\n{BAR}{bulk}\nENDDATA\n")
    return convert_deck(read_deck(path), parse_units("m-kg-s-N"), "consistent", "a")


@pytest.mark.parametrize("card", LISTED)
def test_a_card_without_a_part_is_listed_and_changes_nothing(tmp_path, card):
    made, bare = converted(tmp_path, card), converted(tmp_path, "")
    assert str((made.document, made.environment)) == str((bare.document, bare.environment))
    name = card.split(",")[0]
    assert set(made.left_out) - set(bare.left_out) == {(name, 1, LISTED[card])}
    reduces = f"the deck reduces to its {name.removesuffix('1')}: the article keeps all degrees of freedom"
    assert set(made.notes) - set(bare.notes) == ({reduces} if LISTED[card] is SETS else set())


def test_a_deck_that_reduces_to_several_sets_names_them_once(tmp_path):
    notes = converted(tmp_path, "QSET1,4,2\nASET,1,123\nASET1,123,2\nOMIT1,5,2").notes
    assert [n for n in notes if "reduces" in n] == [
        "the deck reduces to its ASET, QSET: the article keeps all degrees of freedom"
    ]


@pytest.mark.parametrize("kind", "RCS")
@pytest.mark.parametrize("first", [True, False])
def test_axes_by_three_grids(kind, first):
    """Origin, a point of the third axis, one in the half plane of the first; one or two systems on a card."""
    rng = np.random.default_rng(3)
    A, B, C = points = rng.uniform(-2.0, 2.0, (3, 3))
    z = (B - A) / np.linalg.norm(B - A)
    x = (C - A) - ((C - A) @ z) * z
    x /= np.linalg.norm(x)
    r, a, b = inside = {"R": (1.2, -0.4, 0.7), "C": (1.2, 35.0, 0.7), "S": (1.2, 40.0, 25.0)}[kind]
    s, t = np.radians(a), np.radians(b)
    at = {
        "R": np.array(inside),
        "C": np.array([r * np.cos(s), r * np.sin(s), b]),
        "S": r * np.array([np.sin(s) * np.cos(t), np.sin(s) * np.sin(t), np.cos(s)]),
    }[kind]
    lines = ["GRID,{},,{!r},{!r},{!r}".format(4 + i, *p.tolist()) for i, p in enumerate(points)]
    lines.append(f"CORD1{kind},8,4,5,6" if first else f"CORD1{kind},9,6,5,4,8,4,5,6")
    lines.append("GRID,10,8,{},{},{}".format(*inside))
    places = place_grids(read_entries(join_cards([(text, "a.dat", i) for i, text in enumerate(lines, 1)])))
    np.testing.assert_allclose(places.grids[10], A + at @ np.array([x, np.cross(z, x), z]), atol=1e-14)


@pytest.mark.parametrize("kind", "RC")
def test_a_mass_matrix_in_turned_axes_is_that_of_a_body(tmp_path, kind):
    """CONM1 has the lower half of a rigid body's matrix, CONM2 its mass, centre and products of inertia."""
    m, c, own = (
        2.0,
        np.array([0.1, -0.05, 0.2]),
        np.array([[0.3, 0.02, -0.01], [0.02, 0.4, 0.03], [-0.01, 0.03, 0.5]]),
    )
    M = np.block([[m * np.eye(3), -m * skew(c)], [m * skew(c), own - m * skew(c) @ skew(c)]])
    low = [repr(float(v)) for v in M[np.tril_indices(6)]]
    axes = f"CORD2{kind},5,,1.,0.,.5,2.,1.,1.5\n,1.,3.,.1\n"
    halves = axes + "\n".join(
        ["CONM1,20,2,5," + ",".join(low[:5]), "," + ",".join(low[5:13]), "," + ",".join(low[13:])]
    )
    found = converted(tmp_path, halves).document["node"][1]
    # The axes at the grid, by the definition of CORD2.
    origin, z, x = (
        np.array([1.0, 0.0, 0.5]),
        np.array([1.0, 1.0, 1.0]) / np.sqrt(3.0),
        np.array([0.0, 3.0, -0.4]),
    )
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    turn = np.column_stack([x, np.cross(z, x), z])
    R = np.column_stack([components(kind, origin, turn, np.array([1.0, 0.0, 0.0]), e) for e in np.eye(3)]).T
    assert found["mass_kg"] == pytest.approx(m, rel=1e-15)
    np.testing.assert_allclose(found["cg_m"], R @ c, atol=1e-15)
    np.testing.assert_allclose(found["inertia_kg_m2"], R @ own @ R.T, atol=1e-15)
    body = converted(
        tmp_path,
        f"{axes}CONM2,20,2,5,{m},{c[0]},{c[1]},{c[2]}\n,{own[0, 0]},{-own[1, 0]},{own[1, 1]},"
        f"{-own[2, 0]},{-own[2, 1]},{own[2, 2]}",
    ).document["node"][1]
    for key in ("mass_kg", "cg_m", "inertia_kg_m2"):
        np.testing.assert_allclose(found[key], body[key], atol=1e-15)


@pytest.mark.parametrize("shape", ["BAR", "TUBE", "ROD"])
def test_a_shape_gives_a_bar_its_section(tmp_path, shape):
    """PBARL: I1 bends in the plane of the orientation vector; J of the rectangle is by its series."""
    E, G, nsm = 7e10, 7e10 / 2.6, 0.3
    wide, high, r, s = 0.02, 0.05, 0.03, 0.025
    n = np.arange(1, 60, 2)
    series = np.sum(np.tanh(n * np.pi * high / (2.0 * wide)) / n**5)
    ring = {"TUBE": (r, s), "ROD": (r, 0.0)}.get(shape, (0.0, 0.0))
    area, quarter = np.pi * (ring[0] ** 2 - ring[1] ** 2), 0.25 * np.pi * (ring[0] ** 4 - ring[1] ** 4)
    A, I1, I2, J = {
        "BAR": (
            wide * high,
            wide * high**3 / 12.0,
            high * wide**3 / 12.0,
            high * wide**3 / 3.0 * (1.0 - 192.0 * wide / (np.pi**5 * high) * series),
        )
    }.get(shape, (area, quarter, quarter, 2.0 * quarter))
    dims = {"BAR": f"{wide},{high}", "TUBE": f"{r},{s}", "ROD": f"{r}"}[shape]
    bulk = f"PBARL,2,1,,{shape}\n,{dims},{nsm}\nGRID,3,,0.,1.\nCBAR,12,2,2,3,0.,0.,1."
    document = converted(tmp_path, bulk).document
    (bar,) = [strut for strut in document["strut"] if strut["name"] == "bar12"]
    section = document["section"][bar["section"]]
    np.testing.assert_allclose(bar["up"], [0.0, 0.0, 1.0], atol=1e-15)
    given = [section[key] for key in ("EA_n", "EI_z_nm2", "EI_y_nm2", "rho_A_kg_per_m")]
    np.testing.assert_allclose(given, [E * A, E * I1, E * I2, 2700.0 * A + nsm], rtol=1e-14)
    assert section["GJ_nm2"] == pytest.approx(G * J, rel=2e-3 if shape == "BAR" else 1e-14)
