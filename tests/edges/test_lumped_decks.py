"""Decks whose mass is in CONM2: numbers for form's sake are not doubted, numbers in another unit are."""

import pytest

from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units
from middeck.files.setups import load_structure
from middeck.structure.summary.summary import summarise

SI, MM = "m-kg-s-N", "mm-t-s-N"


def doubts(tmp_path, rho="0.", masses=("1.08",) * 11, inertia="", span=10.0, units=SI, E="7.+10"):
    """Warnings and notes of a boom whose grids carry ``masses`` with one ``inertia`` about all axes."""
    thin = ("400.", "2.+4", "4.+4") if units == MM else ("4.-4", "2.-8", "4.-8")
    rows = ["SOL 103", "CEND", "METHOD = 1", "BEGIN BULK", f"MAT1,1,{E},,.3,{rho}"]
    rows += [f"PBAR,1,1,{thin[0]},{thin[1]},{thin[1]},{thin[2]}"]
    last = len(masses) - 1
    for k, mass in enumerate(masses):
        rows.append(f"GRID,{k + 1},,{span * k / last:.6f},0.,0.")
        rows.append(f"CONM2,{1000 + k},{k + 1},,{mass}")
        if inertia:
            rows[-1] += f"\n,{inertia},,{inertia},,,{inertia}"
    rows += [f"CBAR,{k + 1},1,{k + 1},{k + 2},0.,1.,0." for k in range(last)]
    (tmp_path / "a.dat").write_text("\n".join([*rows, "ENDDATA", ""]))
    made = convert_deck(read_deck(tmp_path / "a.dat"), parse_units(units), "consistent", "a")
    (tmp_path / "a.toml").write_text(document_text(made.document, "a"))
    notes = tuple(note for note in made.notes if "are the units" in note)
    return summarise(load_structure(str(tmp_path / "a.toml"))).warnings + notes


BOX = ("300.", *["0.5"] * 100)


@pytest.mark.parametrize(
    "deck",
    [
        {},
        {"rho": "1.-6"},
        {"rho": "1."},
        {"inertia": "1.-6"},
        {"inertia": "1.-3"},
        {"rho": "1.-6", "masses": ("50.", *["0.2"] * 9, "80."), "inertia": "2.5-5"},
        {"rho": "1.-9", "masses": ("1.08-3",) * 11, "inertia": "1.-3", "units": MM, "E": "7.+4", "span": 1e4},
        {"masses": BOX, "span": 5.0},
        {"rho": "2700.", "inertia": "1.-4"},
    ],
)
def test_a_clean_lumped_deck_is_not_doubted(tmp_path, deck):
    assert doubts(tmp_path, **deck) == ()


@pytest.mark.parametrize(
    ("deck", "words"),
    [
        ({"rho": "2.7-9"}, "material of 2.7e-09 kg/m^3"),
        ({"rho": "2.7"}, "material of 2.7 kg/m^3"),
        ({"rho": "2.7-9", "inertia": "1.-6"}, "material of 2.7e-09 kg/m^3"),
        ({"E": "7.+4"}, "MAT1 1 has a Young's modulus of 7e+04 Pa"),
        ({"masses": ("1080.",) * 11, "inertia": "1.-6"}, "masses are read in kg"),
        ({"masses": ("1.08+6",) * 11, "inertia": "1.-6"}, "a solid steel cube of it"),
        ({"masses": ("3.+5", *["0.5"] * 100), "span": 5.0}, "a solid steel cube of it"),
        ({"inertia": "6.3-6"}, "with the inertia of a box of"),
        ({"masses": (".01",) * 11, "inertia": "1."}, "with the inertia of a box of"),
        ({"masses": ("1.08-3",) * 11, "E": "7.+4", "span": 1e4}, "are its positions in millimetres"),
    ],
)
def test_a_slip_in_a_lumped_deck_is_doubted(tmp_path, deck, words):
    found = doubts(tmp_path, **deck)
    assert any(words in text for text in found), found
    assert len(found) <= 5  # many bodies with one fault are one sentence


def lumped_doubts(tmp_path, entry, spokes, offset, more=()):
    """Warnings of spokes along x, y, z ... from one hub, each with its own offset, whose mass is lumped."""
    kind = "PBAR,1,1,4.-4,2.-8,2.-8,4.-8" if entry == "CBAR" else "PBEAM,1,1,4.-4,2.-8,2.-8,,4.-8"
    rows = ["SOL 103", "CEND", "METHOD = 1", "BEGIN BULK", "MAT1,1,7.+10,,.3,2700.", kind, "GRID,1,,0.,0.,0."]
    for k in range(spokes):
        way = ["0.", "0.", "0."]
        way[k % 3] = ("1.", "-1.")[k // 3]
        up = ["0.", "0.", "0."]
        up[(k + 1) % 3] = "1."
        shift = ["0.", "0.", "0."]
        shift[(k + 1 + k // 3) % 3] = f"{offset * (1 + k):.4f}"
        rows += [f"GRID,{k + 2},,{','.join(way)}", f"{entry},{k + 1},1,1,{k + 2},{','.join(up)}"]
        rows[-1] += f"\n,,,{','.join(2 * shift)}"
    (tmp_path / "a.dat").write_text("\n".join([*rows, *more, "ENDDATA", ""]))
    made = convert_deck(read_deck(tmp_path / "a.dat"), parse_units(SI), "lumped", "a")
    (tmp_path / "a.toml").write_text(document_text(made.document, "a"))
    return summarise(load_structure(str(tmp_path / "a.toml"))).warnings


@pytest.mark.parametrize("entry", ["CBAR", "CBEAM"])
@pytest.mark.parametrize(("spokes", "offset"), [(1, 0.0), (3, 0.0), (3, 0.01), (6, 0.01)])
def test_lumped_halves_of_members_are_not_taken_for_a_small_body(tmp_path, entry, spokes, offset):
    assert lumped_doubts(tmp_path, entry, spokes, offset) == ()


def test_a_slip_beside_lumped_halves_is_doubted(tmp_path):
    """A mass in grams, and an inertia in another unit that is far too large."""
    heavy = lumped_doubts(tmp_path, "CBEAM", 3, 0.01, ("CONM2,99,1,,1.+6",))
    assert any("a solid steel cube of it" in warning for warning in heavy), heavy
    wide = lumped_doubts(tmp_path, "CBEAM", 3, 0.01, ("CONM2,99,2,,1.\n,300.,,300.,,,300.",))
    assert any(
        "is its inertia in kg" in warning or "is the inertia in kg mm^2" in warning for warning in wide
    ), wide


@pytest.mark.parametrize(
    ("param", "says"),
    [
        ("PARAM,COUPMASS,1", "by its PARAM COUPMASS the deck's own program uses coupled mass"),
        ("PARAM,COUPMASS,-1", "by its PARAM COUPMASS the deck's own program uses lumped mass"),
        ("", "without a PARAM COUPMASS the deck's own program uses lumped mass"),
    ],
)
def test_a_note_on_mass_speaks_of_a_param_that_is_there(tmp_path, param, says):
    rows = ["SOL 103", "CEND", "METHOD = 1", "BEGIN BULK", param, "MAT1,1,7.+10,,.3,2700."]
    rows += ["PBAR,1,1,4.-4,2.-8,2.-8,4.-8", "GRID,1,,0.,0.,0.", "GRID,2,,1.,0.,0.", "CBAR,1,1,1,2,0.,1.,0."]
    (tmp_path / "a.dat").write_text("\n".join([*filter(None, rows), "ENDDATA", ""]))
    made = convert_deck(read_deck(tmp_path / "a.dat"), parse_units(SI), "consistent", "a")
    (note,) = [note for note in made.notes if "COUPMASS" in note]
    assert note.startswith(says)
