"""What a deck may not hold or what cannot be converted: named and located, and nothing is written."""

import numpy as np
import pytest

from cli_runner import ROOT, middeck
from middeck.errors import ConfigError, MiddeckError
from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units

HEAD = ["SOL 103", "CEND", "METHOD = 1", "BEGIN BULK"]
TEXT = """\
MAT1,1,7.+10,,.3,2700.
PBAR,1,1,1.-4,1.-9,2.-9,2.-9
GRID,1
GRID,2,,1.
GRID,3,,1.,.2
GRID,4,,2.
CBAR,11,1,1,2,0.,1.,0.
CBAR,12,1,3,4,0.,1.,1.
RBE2,13,2,123456,3
CONM2,14,4,,2.5"""
BULK = TEXT.split("\n")
SI = parse_units("m-kg-s-N")


def write(tmp_path, *more, bulk=BULK, case=(), name="a.dat"):
    path = tmp_path / name
    path.write_text("\n".join([*HEAD[:3], *case, HEAD[3], *bulk, *more, "ENDDATA", ""]))
    return path


def convert(path, formulation="consistent"):
    return convert_deck(read_deck(path), SI, formulation, "a")


def test_the_deck_is_sound(tmp_path):
    made = convert(write(tmp_path))
    assert [n["name"] for n in made.document["node"]] == ["g1", "g2", "g4"]
    assert [a["name"] for a in made.document["attach"]] == ["g3"]


BAR = "\nCBAR,21,2,1,4,0.,1.,0."
BEAM = "\nCBEAM,21,2,1,4,0.,1.,0."
BUSH = "\nCBUSH,20,2,1,4,,,,0"


@pytest.mark.parametrize(
    ("card", "place"),
    [
        ("MAT1,2,7.+10,,.7,2700.\nPBAR,2,2,1." + BAR, "a.dat:15: MAT1 2 field 5 (NU) = .7: "),
        ("MAT1,2,0.,,.3,2700.\nPBAR,2,2,1." + BAR, "a.dat:15: MAT1 2 field 3 (E) = 0.: "),
        ("MAT1,2,1.,,.3,-2.\nPBAR,2,2,1." + BAR, "a.dat:15: MAT1 2 field 6 (RHO) = -2.: "),
        ("PBAR,2,9,1." + BAR, "a.dat:15: PBAR 2 field 3 (MID) = 9: "),
        ("PBAR,2,1,0.,1.,1." + BAR, "a.dat:15: PBAR 2 field 4 (A) = 0.: "),
        ("PBAR,2,1,1.,1.,-1." + BAR, "a.dat:15: PBAR 2 field 6 (I2) = -1.: "),
        ("PBAR,2,1,1.,1.,1.,1.,-1." + BAR, "a.dat:15: PBAR 2 field 8 (NSM) = -1.: "),
        ("PBAR,2,1,1.,1.,1.\n,\n,1.,-1." + BAR, "a.dat:17: PBAR 2 field 23 (K2) = -1.: "),
        ("PBEAM,2,1,1.,1.,1.,,-1." + BEAM, "a.dat:15: PBEAM 2 field 8 (J) = -1.: "),
        ("PBEAM,2,1,1.,1.,1.,1.,1." + BEAM, "a.dat:15: PBEAM 2 field 7 (I12) = 1.: "),
        ("CBUSH,20,2,1,4,,,,0", "a.dat:15: CBUSH 20 field 3 (PID) = 2: "),
        ("PBUSH,2,K,1.,-1." + BUSH, "a.dat:15: PBUSH 2 field 5 (REST) = -1.: "),
        ("PBUSH,2,K,1.\n,,K,1.,-1." + BUSH, "a.dat:16: PBUSH 2 field 15 (REST) = -1.: "),
        ("PBUSH,2,K,1." + BUSH.replace(",4,", ",9,"), "a.dat:16: CBUSH 20 field 5 (GB) = 9: "),
        ("PBUSH,2,K,1." + BUSH[:-1] + "7", "a.dat:16: CBUSH 20 field 9 (CID) = 7: "),
        ("PBUSH,2,K,1.,1.\nCBUSH,20,2,1,4", "a.dat:16: CBUSH 20 field 9 (CID): "),
        ("PELAS,2,-1.\nCELAS1,20,2,1,1", "a.dat:15: PELAS 2 field 3 (K) = -1.: "),
        ("CELAS2,20,1.,1,1,9,1", "a.dat:15: CELAS2 20 field 6 (G2) = 9: "),
        ("CONM2,20,1,,2.\n,-1.,,1.,,,1.", "a.dat:16: CONM2 20 field 12 (I11) = -1.: "),
        ("CONM2,20,1,,-2.", "a.dat:15: CONM2 20 field 5 (M) = -2.: "),
        ("CMASS2,20,-1.,1,1", "a.dat:15: CMASS2 20 field 3 (M) = -1.: "),
    ],
)
def test_a_complaint_names_the_field_of_the_card_that_is_wrong(tmp_path, card, place):
    """Once, although two bars refer to that card."""
    again = card.split("\n")[-1].replace("BAR,21,", "BAR,23,")
    card += f"\n{again}" * (again not in card)
    with pytest.raises(ConfigError) as error:
        convert(write(tmp_path, *card.split("\n")))
    assert str(error.value).count(place) == 1


@pytest.mark.parametrize(
    ("line", "skips"),
    [
        ("GRID\t9\t\t0.123456\t0.5", True),
        ("GRID\t9\t\t0.12345\t0.5", False),
        ("GRID\t9\t\t0.123456", False),
        ("GRID\t9\t\t0.123456\t", False),
        ("GRID    9               0.123456\t0.5", True),
        ("GRID*\t9\t\t\t\t0.123456\t0.5", False),
        ("GRID*\t9\t\t\t\t0.12345678901234\t0.5", True),
    ],
)
def test_a_tab_behind_a_full_field_is_refused(tmp_path, line, skips):
    """By columns it skips a field; whoever wrote it means the next."""
    path = write(tmp_path, line, "CBAR,20,1,1,9,0.,0.,1.")
    if skips:
        with pytest.raises(ConfigError, match=r"a\.dat:15: .*a tab behind a full field"):
            read_deck(path)
    else:
        x = read_deck(path).entries.of("GRID")[-1]
        assert (x["x1"], x["x2"]) == (float(line.split()[2]), float((line.split()[3:] or ["0"])[0]))


@pytest.mark.parametrize(
    ("card", "words"),
    [
        ("RBE2,20,4,123456,3", "RBE2 20 field 5 (GM) = 3: grid 3 is dependent twice; first by RBE2 13 at"),
        ("RBE2,20,3,123456,2", "these rigid links close on themselves"),
        ("RBE2,20,4,123456,4", "these rigid links close on themselves"),
        ("RBE2,20,4,123456,77", "there is no grid 77"),
        ("RBE2,20,4,123,3", "RBE2 20 field 5 (GM) = 3: component 1 of grid 3 depends on grid 2 already"),
        ("RBE2,20,4,123,1\nRBE2,21,2,35,1", "component 3 of grid 1 is dependent twice; first by RBE2 20 at"),
        ("RBE2,20,4,123,77", "there is no grid 77"),
        ("RBAR,20,4,1,123456,,12", "independent and dependent at once: component 1 of grid 4"),
        ("RBAR,20,4,1,,123456,,3", "independent and dependent at once: component 3 of grid 1"),
        ("RBE1,20,4,123456,,,,,,+A\n+A,UM,1,123,2", "2 (blank) is no grid and components"),
        ("RBE1,20,4,123456\n,UM,1,,2", "1 (blank) is no grid and components"),
        ("RBE1,20,4,123456\n,UM,1,,123", "1 (blank) is no grid and components"),
        ("RBE1,20,4,123456,1.-5\n,UM,1,123", "1.-5 (blank) is no grid and components"),
        ("RBE1,20,4,123456\n,UM,1,123,4,1", "independent and dependent at once: component 1 of grid 4"),
        ("RBE1,20,4,123456\n,UM,4,1", "independent and dependent at once: component 1 of grid 4"),
        ("RBE2,20,4,123,1,4", "RBE2 20 field 5 (GM) = 1: grid 4 follows itself"),
        ("RBAR,20,4,4,123456,,,12", "grid 4 follows itself"),
        ("GRID,9,,1.,,,-1", "GRID 9 field 7 (CD) = -1: there is no coordinate system -1"),
        ("CORD2R,5,,0.,0.,1.,0.,0.,2.", "CORD2R 5 field 12 (C1): its third point is missing"),
        ("CORD2R,5,,1.,0.,0.,1.,0.,1.\n+", "CORD2R 5 field 12 (C1): its third point is missing"),
        (
            f"{'CORD2R*':8}{5:<16}{0:<16}{'1.':16}{'0.':16}\n{'*':8}{'0.':16}{'1.':16}{'0.':16}{'1.':16}",
            "a.dat:16: CORD2R 5 field 12 (C1): its third point is missing",
        ),
        ("RBAR,20,4,1,123,45", "5 independent components that do not say how a rigid body moves"),
        ("RBAR,20,4,1,123,156", "6 independent components that do not say how a rigid body moves"),
        ("RBE1,20,4,123456", "UM is missing"),
        ("RBE1,20,4,123456,,,,,\n,UM,1,129", "1 129 is no grid and components"),
        ("RBE1,20,4,123456,,,,,\n,UM,77,123", "there is no grid 77"),
        ("RBE3,20,,1,123456,1.,123,2,99", "there is no grid 99"),
        ("RBE3,20,,1,123456,123,2,4", "the first weight is missing"),
        ("RBE3,20,,1,123456,1.,127,2,4", "a group is a weight > 0, components and grids"),
        ("RBE3,20,,1,123456,1.,123,1,4", "RBE3 20 field 6 (REST) = 1.: grid 1 follows itself"),
        (
            "GRID,8,,5.\nCONM2,9,8,,1.\nRBE3,20,,8,123,1.,123,2,4,+\n+,.5,456,2",
            "RBE3 20 field 6 (REST) = 1.: grids that are not named equally often, while turns count",
        ),
        ("CBAR,21,1,1,9,0.,1.,0.", "CBAR 21 field 5 (GB) = 9: there is no grid 9"),
        ("CBAR,21,5,1,4,0.,1.,0.", "there is no PBAR or PBARL 5"),
        (
            "CBAR,21,1,1,4,1.,0.,0.",
            "its orientation vector is zero or along the member",
        ),
        ("CBAR,21,1,1,4", "no orientation"),
        ("CBAR,21,1,1,1,0.,1.,0.", "a member of no length"),
        ("CBAR,21,1,1,4,0.,1.,0.\n,7", "no list of components 1 to 6"),
        ("CBAR,21,1,1,4,0.,1.,0.,GEE\n,,,.1", "then G or O for each offset"),
        ("CBAR,21,1,1,4,1.,0.,0.,GOO\n,,,.0,.1", "which grids and orientation do not give"),
        ("BAROR,,1,,,1.,0.,0.\nCBAR,21,1,1,4,,1.", "an orientation of which BAROR gives a part"),
        ("PBAR,2,9,1.\nCBAR,21,2,1,4,0.,1.,0.", "there is no MAT1 9"),
        ("MAT1,2,7.+10,.33,2.7+3\nPBAR,2,2,1.\nCBAR,21,2,1,4,0.,1.,0.", "MAT1 2 has Poisson's ratio 2700.0"),
        ("PBAR,2,1\nCBAR,21,2,1,4,0.,1.,0.", "without area"),
        ("PBAR,2,1,1.,1.,1.,1.\n,\n,,,2.\nCBAR,21,2,1,4,0.,1.,0.", "I1 I2 > I12^2"),
        ("PBARL,2,1,,TUBE3\n,1.,1.\nCBAR,21,2,1,4,0.,1.,0.", "shape TUBE3 is not converted yet"),
        (
            "PBARL,2,1,,DBOX\n,.2,.1,.1,.01,.01,.01,.01,.02\n,.02,.01\nCBAR,21,2,1,4,0.,1.,0.",
            "programs may draw its sides otherwise",
        ),
        ("PBEAML,2,1,,ROD\n,1.,,NO,.5,1.\nCBEAM,21,2,1,4,0.,1.,0.", "no station at end B, X/XB = 1.0"),
        (
            "PBEAML,2,1,,ROD\n,1.,,2.,1.,1.\nCBEAM,21,2,1,4,0.,1.,0.",
            "field 14 (DIMS) = 2.: must be YES",
        ),
        ("PBARL,2,1,,BOX\n,1.,1.,.1\nCBAR,21,2,1,4,0.,1.,0.", "BOX needs 4 real dimensions"),
        (
            "PBEAM,2,1,1.,1.,1.,,1.\n,\n,YES,1.,0.\nCBEAM,21,2,1,4,0.,1.,0.",
            "without area",
        ),
        ("PBEAM,2,1,1.,1.,1.,,1.\n,NO,.5,2.\nCBEAM,21,2,1,4,0.,1.,0.", "no station at end B"),
        (
            "PBEAM,2,1,1.,1.,1.,,1.\n,NO,1.,2.\n,NO,1.,2.\nCBEAM,21,2,1,4,0.,1.,0.",
            "a.dat:17: PBEAM 2 field 23 (REST) = 1.: must be > 0 and at most 1, once for each station",
        ),
        ("CELAS2,20,1.+5,1,1,4,2", "components of different directions"),
        ("CELAS2,20,1.+5,1,2,4,2", "across the line between its grids"),
        ("CELAS2,20,-1.,1,1", "a negative stiffness"),
        ("CELAS2,20,1.,1,0", "grid 1 has components, 1 to 6: which? only scalar points have none"),
        ("CELAS1,20,3,1,1", "there is no PELAS 3"),
        ("CBUSH,20,2,1,4", "there is no PBUSH 2"),
        ("PBUSH,2,K,RIGID\nCBUSH,20,2,1,4,,,,0", "PBUSH 2 has K"),
        ("PBUSH,2,K,1.\n,,M,2.\nCBUSH,20,2,1,4,,,,0", "PBUSH 2 has M"),
        (
            "PBUSH,2,K,1.\n,B,2.\nCBUSH,20,2,1,4,,,,0",
            "PBUSH 2 has B in field 2 of a continuation: its place is",
        ),
        ("PBUSH,2,K,1.\n,B\nCBUSH,20,2,1,4,,,,0", "PBUSH 2 has B in field 2 of a continuation: its place is"),
        ("PBUSH,2,K,1.,1.\nCBUSH,20,2,1,4", "only K1 and K4"),
        ("PBUSH,2,K,1.,1.\nCBUSH,20,2,2,3,,,,0\n,.5,5", "there is no coordinate system 5 (OCID)"),
        ("PBUSH,2,K,1.,1.\nCBUSH,20,2,2,3,,,,0\n,.5,0,.1", "by OCID is measured from its origin by some"),
        ("PBUSH,2,K,1.,1.\nCBUSH,20,2,2,3,,,,0\n,1.5", "S is 1.5; must be 0 to 1"),
        ("PBUSH,2,K,1.,1.\nCBUSH,20,2,2", "to the ground needs a CID, 0 for the basic system: field 9"),
        ("PBUSH,2,K,1.,1.\nCBUSH,20,2,2,,,,,0,+B\n+B,,0,.1", "an elastic point by OCID"),
        (
            "PBEAM,2,1,1.,1.,1.,,1.\n,\n,1.,1.,.2\nCBEAM,21,2,1,4,0.,1.,0.",
            ".2: shear relief S1",
        ),
        (
            "PBEAM,2,1,1.,1.,1.,,1.\n,\n,1.,1.\n,.1,x\nCBEAM,21,2,1,4,0.,1.,0.",
            "33 (REST) = X: must be",
        ),
        ("PBEAM,2,1,1.,1.,1.,.5,1.\n,\n,1.,0.\nCBEAM,21,2,1,4,0.,1.,0.", "rigid in shear in one plane alone"),
        ("RBE2,20,1,123456,5,6,7,8,9,10", "a number, 10, where the mark of a continuation stands"),
        ("RBE2    20      1       123456  5       6       7       8       9       10", "a number, 10, where"),
        (f"{'GRID*':8}{8:<32}{5.0:<16}{0.0:<16}1.5\n*       {0.0:<16}", "a number, 1.5, where"),
        (
            "GRID,8,,5.,,,,5\nRBE3,30,,8,123456,1.,123,1,2",
            "RBE3 30 field 4 (REFGRID) = 8: component 5 of grid 8 is dependent and held by the ground",
        ),
        ("FORCE,5,9,,1.,1.", "grid 9 has no element or mass"),
        ("FORCE,5,1,7,1.,1.", "there is no coordinate system 7"),
        ("LOAD,5,1.,,8", "no factor and set of loads"),
        ("LOAD,5,1.,1.,8", "load set 8 has no load"),
        ("LOAD,5,1.,1.,8\nLOAD,8,1.,1.,9\nGRAV,9,,1.,0.,0.,1.", "load set 8 is a LOAD itself"),
        ("GRAV,5,7,9.8,,,-1.", "GRAV 5 field 3 (CID) = 7: there is no rectangular coordinate system 7"),
        ("CQUAD4,20,1,1,2,3,4", "reduce the part"),
        ("CMASS4,20,1.,1", "grid 1 has components, 1 to 6: which? only scalar points have none"),
        ("SELOC,3,1,2,3,4,1,2", "it puts a superelement elsewhere, which is not read"),
        ("SEMPLN,3,PLANE,1,2,3", "it mirrors a superelement, which is not read"),
        ("RELEASE,3,1,2", "it parts a superelement from the rest in some components"),
        ("CBUSH1D,20,1,1,2", "not converted yet, and without it the modes would be others"),
        ("CMASS2,20,1.,1,1", "the masses of grid 1 differ by direction, [1.0, 0.0, 0.0]: no body has them"),
        ("CMASS2,20,1.,1,1,2,1", "a mass between two grids"),
        ("CMASS2,20,1.,9,1", "there is no grid 9"),
        ("CMASS2,20,-1.,1,1", "a negative mass"),
        ("CMASS1,20,8,1,1", "there is no PMASS 8"),
        ("PMASS,8,1.,9,x\nCMASS1,20,8,1,1", "no number and mass: ['9', 'X']"),
        ("CONM2,20,9,,1.", "there is no grid 9"),
        ("CONM2,20,1,8,1.", "there is no coordinate system 8"),
        ("CONM2,20,1,,-1.", "no body has mass -1"),
        ("GRID,8,,5.\nGRID,9,,6.\nCBAR,20,1,8,9,0.,1.,0.", "joins grid '8', '9' to the rest"),
        (
            "GRID,8,,5.,,,9\nCBAR,20,1,8,1,0.,1.,0.",
            "GRID 8 field 7 (CD) = 9: there is no coordinate system 9",
        ),
        (
            "GRID,8,,5.,,,,5\nRBE2,20,1,123456,8",
            "its components 5 are held (SPC or its PS) and depend on grid 1 too",
        ),
        ("CONM1,20,1,,1.,,2.", "no rigid body"),
    ],
)
def test_what_cannot_be_converted(tmp_path, card, words):
    with pytest.raises(ConfigError) as error:
        convert(write(tmp_path, *card.split("\n")))
    assert words in str(error.value)
    assert "a.dat:" in str(error.value)


@pytest.mark.parametrize("flag", ["1", "2", "0", ""])
def test_orientation_by_an_integer_flag_is_that_of_older_decks(tmp_path, flag):
    plain, old = "CBAR,21,1,1,4,1.,1.,0.", f"CBAR,21,1,1,4,1.,1.,0.,{flag}"
    made = [convert(write(tmp_path, card)).document["strut"][-1] for card in (plain, old)]
    assert str(made[0]) == str(made[1])


def test_only_selected_constraints_of_many_points_are_converted(tmp_path):
    cards = "MPC,5,4,1,1.,1,1,-1."
    made = convert(write(tmp_path, cards))
    assert ("MPC", 1, "not selected by case control") in made.left_out
    for case, more in ((["MPC = 5"], []), (["SUBCASE 1", "  MPC 6"], ["MPCADD,6,5"])):
        (made,) = convert(write(tmp_path, cards, *more, case=case)).document["equation"]
        assert made["term"] == [
            {"frame": "g4", "direction": "x", "coefficient": 1.0},
            {"frame": "g1", "direction": "x", "coefficient": -1.0},
        ]
    for wrong in ("MPC,5,4,1,0.,1,1,-1.", "MPC,5,4,7,1.,1,1,-1.", "MPC,5,4,1,1.,1,1,-1.,9", "MPC,5,4,12,1."):
        with pytest.raises(ConfigError, match="MPC 5 field 3"):
            convert(write(tmp_path, wrong, case=["MPC = 5"]))


def test_one_subcase_of_several_that_differ(tmp_path):
    """A subcase overrides what stands before the first; sums of subcases hold nothing."""
    cards = ["SPC1,5,4,1", "SPC1,6,123,1", "FORCE,7,1,,1.,1.,0.,0.", "FORCE,8,1,,1.,1.,0.,0."]
    case = ["SPC = 5", "LOAD = 7", "SUBCASE 1", "SUBCASE = 12", "SPC = 6", "LOAD = 8", "SUBCOM 20", "SPC = 9"]
    path = write(tmp_path, *cards, case=case)
    for number, held, loads in ((1, ("", "x"), ["load7"]), (12, ("xyz", ""), ["load8"])):
        made = convert_deck(read_deck(path, number), parse_units("m-kg-s-N"), "consistent", "deck")
        assert [(c["along"], c["about"]) for c in made.environment["clamp"] if c["node"] == "g1"] == [held]
        assert [case["name"] for case in made.document["load_case"]] == loads
    with pytest.raises(ConfigError, match=r"no subcase 3\n.*it has 1, 12"):
        read_deck(path, 3)
    (tmp_path / "bulk").mkdir()
    with pytest.raises(ConfigError, match=r"no subcase 1\n.*it has none"):
        read_deck(write(tmp_path / "bulk", *cards), 1)


@pytest.mark.parametrize("of", ["SUPER = ALL", "SUPER=0", "SUPER ALL", "SUPER = 0, 3"])
def test_a_subcase_of_the_residual_structure_holds_it(tmp_path, of):
    held = convert(write(tmp_path, "SPC1,5,4,1", case=["SUBCASE 1", of, "SPC = 5"]))
    assert [c["node"] for c in held.environment["clamp"]] == ["g1"]


@pytest.mark.parametrize("of", ["SUPER = 3", "SUPER 10"])
def test_a_subcase_of_a_superelement_holds_nothing_here(tmp_path, of):
    assert not convert(write(tmp_path, "SPC1,5,4,1", case=["SUBCASE 1", of, "SPC = 5"])).holds


def test_a_range_of_one_is_one(tmp_path):
    one = convert(write(tmp_path, "SPC1,5,4,1,THRU,1", case=["SPC = 5"]))
    assert [(c["node"], c["about"]) for c in one.environment["clamp"]] == [("g1", "x")]
    with pytest.raises(ConfigError, match="4 THRU 1 in a list of grids"):
        convert(write(tmp_path, "SPC1,5,4,4,THRU,1", case=["SPC = 5"]))


def test_only_selected_clamps_are_converted(tmp_path):
    """PS holds in any case; SPC where case control selects it, once, at grids of its own."""
    cards = ["SPC1,5,4,1", "SPC1,6,13,1,THRU,4", "GRID,8,,0.,9.,,,2"]
    free = convert(write(tmp_path, *cards))
    assert not free.holds
    assert ("SPC1", 2, "not selected by case control") in free.left_out
    held = convert(write(tmp_path, "SPC1,5,4,1", "SPC,5,2,123456", case=["SPC = 5"]))
    found = {c["node"]: (c["along"], c["about"]) for c in held.environment["clamp"]}
    assert found == {"g1": ("", "x"), "g2": ("xyz", "xyz")}
    for case, words in (
        (["SPC = 6"], r"GRID 3: its components 13 are held \(SPC or its PS\) and depend on grid 2 too"),
        (["SUBCASE 1", "SPC = 5", "SUBCASE 2", "SPC = 6"], r"different ones, 5 in 1, 6 in 2"),
        (["SUBCASE 1", "MPC = 5", "SUBCASE 2"], r"different ones, 5 in 1, none in 2"),
        (["SPC = 5", "SUBCASE 1", "SPC = 6", "SUBCASE 2"], r"different ones, 6 in 1, 5 in 2"),
        (["SPC = ONE"], "'ONE' is not the number of a set"),
        (["STATSUB = 1"], "without it the modes would be others"),
        (["DSCOEFFICIENT = DEFAULT"], "DSCOEFFICIENT.*without it the modes would be others"),
        (["BGSET = 1"], "BGSET.*without it the modes would be others"),
        (["BCONTACT = ALLBODY"], "BCONTACT.*without it the modes would be others"),
    ):
        with pytest.raises(ConfigError, match=words):
            convert(write(tmp_path, *cards, case=case))
    with pytest.raises(ConfigError, match="there is no grid 99"):
        convert(write(tmp_path, "SPC1,5,4,99", case=["SPC = 5"]))
    with pytest.raises(ConfigError, match="displacement that is not zero"):
        convert(write(tmp_path, "SPC,5,1,1,.1", case=["SPC = 5"]))


def test_load_sets_are_converted_whole_or_listed(tmp_path):
    cards = ["FORCE,5,1,,1.,1.", "FORCE,6,1,,1.,1.", "PLOAD4,6,1,2.", "GRAV,7,,9.81,0.,0.,-1."]
    made = convert(write(tmp_path, *cards))
    assert [case["name"] for case in made.document["load_case"]] == ["load5"]
    assert [row[0] for row in made.left_out if "load" in row[0]] == ["load set 6", "gravity of load set 7"]
    assert any("load set '7' 9.81 m/s^2 along [0.0, 0.0, -1.0]" in note for note in made.notes)
    assert "load_case" not in convert(write(tmp_path, *cards, case=["LOAD = 6"])).document


def test_the_word_about_up(tmp_path):
    """One gravity is the environment's, several are listed; a note says whether the vertical is known."""
    spc, down = "SPC1,5,123456,1", "GRAV,7,,9.81,0.,0.,-1."
    held = {"case": ["SPC = 5"]}
    silent = convert(write(tmp_path, spc, **held))
    assert "constants" not in silent.environment
    assert any("which would define the vertical" in note for note in silent.notes)
    unselected = convert(write(tmp_path, spc, down, "FORCE,8,1,,1.,1.", case=["SPC = 5", "LOAD = 8"]))
    assert "constants" not in unselected.environment
    assert any("down is [0.0, 0.0, -1.0] by a GRAV that is not selected" in n for n in unselected.notes)
    one = convert(write(tmp_path, spc, down, "FORCE,8,1,,1.,1.", **held))
    assert one.environment["constants"]["gravity_m_s2"] == 9.81
    assert one.environment["constants"]["gravity_direction"].tolist() == [0.0, 0.0, -1.0]
    assert any("load case 'load8' has no gravity in the deck" in note for note in one.notes)
    assert one.converted["gravity"] == 1
    two = convert(write(tmp_path, spc, down, "GRAV,9,,9.81,0.,1.", **held))
    assert "constants" not in two.environment
    assert [row[0] for row in two.left_out if "gravity" in row[0]] == [
        "gravity of load set 7",
        "gravity of load set 9",
    ]
    assert not any("does not say" in note for note in two.notes)


def test_a_held_deck_needs_an_environment(capfd, tmp_path):
    path = write(tmp_path, "SPC1,5,123456,1", case=["SPC = 5"])
    article, held = tmp_path / "a.toml", tmp_path / "held.toml"
    ended = middeck(capfd, "convert", path, "--units", "m-kg-s", "-o", article)
    assert (ended.code, article.exists()) == (2, False)
    assert "--environment" in ended.err
    ended = middeck(capfd, "convert", path, "--units", "m-kg-s", "-o", article, "--environment", held)
    assert (ended.code, article.exists(), held.exists()) == (0, True, True)
    before = article.read_text()
    ended = middeck(capfd, "convert", path, "--units", "m-kg-s", "-o", article, "--environment", article)
    assert (ended.code, article.read_text()) == (2, before)


def test_a_range_of_constraints_may_reach_beyond_the_grids(tmp_path):
    """Grids of a range that are not there are passed over, its ends too; a range without any is a slip."""
    case = ["SPC = 1"]
    made = convert(write(tmp_path, "SPC1,1,3,4,THRU,9", case=case))
    assert [clamp["node"] for clamp in made.environment["clamp"]] == ["g4"]
    with pytest.raises(ConfigError, match="no grid of this range is there"):
        convert(write(tmp_path, "SPC1,1,3,5,THRU,9", case=case))
    with pytest.raises(ConfigError, match="there is no grid 9"):
        convert(write(tmp_path, "SPC1,1,3,2,9", case=case))


def test_matrices_are_refused_where_selected(tmp_path):
    dmig = "DMIG,KAAX,0,6,1,0"
    assert ("DMIG", 1, "not selected by case control") in convert(write(tmp_path, dmig)).left_out
    with pytest.raises(ConfigError, match="DMIG KAAX: has no entries"):
        convert(write(tmp_path, dmig, case=["K2GG = KAAX"]))


def test_masses_of_sets_that_are_not_selected_are_left_out(tmp_path):
    sets = [(f"NSM{kind}", f"NSM{kind},9,PBAR,1,5.") for kind in ("", "1", "L", "L1")]
    made = convert(write(tmp_path, *(card for _, card in sets)))
    assert {name for name, _ in sets} <= {row[0] for row in made.left_out}
    with pytest.raises(ConfigError, match="NSM = 9: NSM sets are not converted yet"):
        convert(write(tmp_path, sets[2][1], case=["NSM = 9"]))


@pytest.mark.parametrize(
    "case", ["TEMPERATURE = 5", "temp(mate) 5", "TEMP ( BOTH ) = 5", "TEMPERATURE(INIT)=5"]
)
def test_moduli_by_temperature_are_refused_where_a_temperature_is_selected(tmp_path, case):
    """Without one MATT1 has no effect (Quick Reference Guide, MATT1), and loads alone change no modulus."""
    cards = ["MATT1,1,8", "TABLEM1,8\n,0.,7.+10,100.,5.+10,ENDT", "TEMPD,5,100."]
    with pytest.raises(ConfigError, match=r"a.dat:4: TEMPERATURE = 5: sets the moduli of materials by MATT1"):
        convert(write(tmp_path, *cards, case=[case]))
    for harmless in (
        (),
        ("TEMPERATURE(LOAD) = 5",),
        ("SUBCASE 1", "TEMP(LOAD)=5", "SUBCASE 2", "TEMP(LOAD)=6"),
    ):
        convert(write(tmp_path, *cards, case=harmless))
    convert(write(tmp_path, *cards[2:], case=[case]))


def test_damping_that_is_left_out_is_counted(tmp_path):
    cards = [
        "PBUSH,40,K,1.,1.,1.,1.,1.,1.\n,,GE,.04",
        "PBUSH,41,K,1.",
        "PBUSH,42,K,1.\n,,B,2.",
        "PBUSH,43,K,1.\n,,B,0.\n,,GE,,0.",  # none
        "PARAM,G,.02",
    ]
    rows = {row[0]: row[1] for row in convert(write(tmp_path, *cards)).left_out}
    assert rows == {"PBUSH B, GE": 2, "PARAM G": 1}


def test_links_and_averages_that_nothing_stands_on_are_left_out(tmp_path):
    made = convert(
        write(tmp_path, "GRID,8,,9.", "RBE3,30,,8,123456,1.,123,1,2", "GRID,9,,9.", "RBE2,31,1,12,9")
    )
    assert {row[0] for row in made.left_out} == {"RBE3", "RBE2", "GRID"}


def test_a_deck_that_is_cut_off(tmp_path):
    path = write(tmp_path)
    path.write_text(path.read_text().split("BEGIN BULK")[0])
    with pytest.raises(ConfigError, match=r"a.dat:3: the deck ends here without BEGIN BULK"):
        convert(path)


# Cards whose ends mean another model: a number, a grid, a continuation of each kind.
ENDING = """\
GRID,20,,1.25,0.,0.375
CONM2,40,4,,1.5,,,,,+C1
+C1,.125,,.25,,,.325
GRID*,21,,1.5
*,.75
CONM2         41       4              .5
              .1              .1                      .1
"""


@pytest.mark.parametrize("kind", ["deck", "include", "bulk data alone"])
def test_a_file_cut_off_anywhere_is_refused_or_whole_to_its_last_line(tmp_path, kind):
    """Cut at each byte: whole lines of whole cards alone are read, with a note where ENDDATA lacks.

    Includes are read, with a note, where their last line does not end: many writers leave it so.
    """
    head = {"deck": f"{HEAD[0]}\nCEND\nBEGIN BULK\n{TEXT}\n"}.get(kind, f"{TEXT}\n")
    cut, path = tmp_path / ("b.blk" if kind == "include" else "a.dat"), tmp_path / "a.dat"
    path.write_text(f"{HEAD[0]}\nCEND\nBEGIN BULK\nINCLUDE 'b.blk'\nENDDATA\n")
    whole, read = f"{head}{ENDING}", []
    for at in range(len(head), len(whole) + 1):
        cut.write_text(whole[:at])
        try:
            made = convert(path)
        except ConfigError as error:
            message = str(error)
        else:
            message = ""
            torn = any(f"{cut.name}:" in n and "ends within this line" in n for n in made.notes)
            assert torn == (whole[at - 1] != "\n")
            assert not torn or kind == "include"
            read += [] if torn else [len(ENDING[: at - len(head)].split("\n")) - 1]
            assert any("no ENDDATA" in note for note in made.notes) == (kind != "include")
        assert not message or f"{cut.name}:" in message
        ends = (",+C1\n", ",+C1") if kind == "include" else ",+C1\n"
        assert "the continuation '+C1' is missing" in message or not whole[:at].endswith(ends)
    assert read == [0, 1, 3, 4, 5, 6, 7]  # lines of the ending


def test_a_whole_deck_without_its_end_is_read_with_a_note(tmp_path):
    path = write(tmp_path)
    whole = convert(path)
    path.write_text(path.read_text().replace("ENDDATA\n", "\n$ the end"))
    made = convert(path)
    assert document_text(made.document, "") == document_text(whole.document, "")
    cards, last = read_deck(path).cards, len(path.read_text().split("\n")) - 2
    message = f"no ENDDATA: {cards} cards to the last line, {path}:{last}; are these all?"
    assert made.notes == (message, *whole.notes)


def test_includes_that_are_missing_or_close(tmp_path):
    with pytest.raises(ConfigError, match=r"a.dat:15: INCLUDE = gone.blk: there is no such file"):
        read_deck(write(tmp_path, "INCLUDE 'gone.blk'"))
    with pytest.raises(ConfigError, match=r"a.dat:15: INCLUDE = x+: there is no such file"):
        read_deck(write(tmp_path, f"INCLUDE '{300 * 'x'}'"))  # longer than a name can be
    (tmp_path / "c.blk").write_text("GRID,7\nENDDATA\n")
    assert read_deck(write(tmp_path, "INCLUDE 'c.blk'", "$ end")).entries.numbered("GRID")[7]
    with pytest.raises(ConfigError, match=r"a.dat:15: INCLUDE: this file has an ENDDATA, and cards follow"):
        read_deck(write(tmp_path, "INCLUDE 'c.blk'", "GRID,8"))
    with pytest.raises(ConfigError, match="includes itself"):
        read_deck(write(tmp_path, "INCLUDE 'a.dat'"))
    with pytest.raises(ConfigError, match="cannot be read"):
        read_deck(tmp_path / "none.dat")
    (tmp_path / "b.dat").write_bytes(b"GRID\0")
    with pytest.raises(ConfigError, match="binary"):
        read_deck(tmp_path / "b.dat")


def test_nothing_half_written(capfd, tmp_path):
    target = tmp_path / "a.toml"
    target.write_text("old")
    ended = middeck(capfd, "convert", write(tmp_path, "CMASS2,20,1.,1,1"), "--units", "m-kg-s", "-o", target)
    assert (ended.code, target.read_text()) == (2, "old")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.dat", "a.toml"]


def test_nothing_is_written_that_cannot_be_used(capfd, tmp_path):
    """An average of two grids turns with none about their line."""
    path, article = (
        write(tmp_path, "GRID,9,,1.,1.", "RBE3,7,,9,123456,1.,123,1,2", "CONM2,8,9,,1."),
        tmp_path / "a.toml",
    )
    ended = middeck(capfd, "convert", path, "--units", "m-kg-s", "-o", article)
    assert (ended.code, article.exists()) == (2, False)
    assert "determine no turn along" in ended.err
    assert str(path) in ended.err


def test_masses_by_weight_and_length(tmp_path):
    """WTMASS goes to every mass: density, mass per length and bodies."""
    plain = convert(write(tmp_path, "PBAR,1,1,1.-4,1.-9,2.-9,2.-9,.1", bulk=[BULK[0], *BULK[2:]]))
    double = convert(
        write(tmp_path, "PBAR,1,1,1.-4,1.-9,2.-9,2.-9,.1", "PARAM,WTMASS,2.", bulk=[BULK[0], *BULK[2:]])
    )
    for made, factor in ((plain, 1.0), (double, 2.0)):
        section = made.document["section"]["pbar1"]
        assert section["rho_A_kg_per_m"] == pytest.approx(factor * 0.37)
        assert section["rho_I_y_kg_m"] == pytest.approx(factor * 2700.0 * 2e-9)
        assert section["EI_z_nm2"] == pytest.approx(70.0)
        assert made.document["node"][2]["mass_kg"] == pytest.approx(factor * 2.5)


@pytest.mark.parametrize(
    ("card", "message"),
    [
        ("EIGRL,1,,200.,12", "EIGRL 1 asks for 12 modes up to 200 Hz: middeck modes --count 12"),
        ("EIGR,1,LAN,1.,50.", "EIGR 1 asks for modes up to 50 Hz, at most: see middeck modes --count"),
        ("EIGR,1,MGIV,,,,7", "EIGR 1 asks for 7 modes: middeck modes --count 7"),
        ("EIGR,1,AHOU", ""),
        ("EIGR,1,AHOU,,,,100000", "EIGR 1 asks for all modes: middeck modes --count 18"),
        ("EIGRL,3,,200.,12", ""),
    ],
)
def test_what_the_deck_asks_of_its_solver_is_a_hint(tmp_path, card, message):
    """Of four grids one is rigid with another: the article has three nodes, and at most 18 modes."""
    notes = [n for n in convert(write(tmp_path, card)).notes if "asks for" in n]
    assert notes == [message] * bool(message)


def test_json_and_settings(capfd, tmp_path):
    path = write(tmp_path)
    by_set = middeck(
        capfd, "convert", path, "--set", "units=mm-kg-s", "--set", "mass_formulation=lumped", "--json"
    )
    assert by_set.code == 0, by_set.err
    assert '"mass_formulation": "lumped"' in by_set.out
    with pytest.raises(MiddeckError):
        parse_units("")


def test_a_deck_that_only_rounding_refuses_says_so(capfd, tmp_path):
    """Grids in one place by two systems, and a spring across: apart in single precision."""
    place = [f"{0.8 * f(np.radians(37.0)):.12f}" for f in (np.cos, np.sin)]
    bulk = PLAIN + "CORD2C,8,,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nGRID,8,8,.8,37.,0.\nRBE2,8,1,123456,8\n"
    bulk += f"GRID*,9,,{place[0]},{place[1]}\n*,0.\nCONM2,9,9,,1.\nCELAS2,9,50.,8,1,9,1\n"
    path = tmp_path / "a.dat"
    path.write_text(f"BEGIN BULK\n{bulk}ENDDATA\n")
    ask = ("convert", path, "--units", "m-kg-s-N", "--reals")
    assert middeck(capfd, *ask, "double").code == 0
    ended = middeck(capfd, *ask, "single")
    assert ended.code == 2
    assert "CELAS2 9: a spring across the line between its grids" in ended.err
    assert "try: --reals double" in ended.err
    path.write_text(f"BEGIN BULK\n{bulk}CBAR,7,77,1,8,0.,1.,0.\nENDDATA\n")
    assert "--reals" not in middeck(capfd, *ask, "single").err


def test_reals_in_single_precision(capfd, tmp_path):
    """Of fields, lists (PBARL) and parameters; not of matrices, and none that single precision lacks."""
    bulk = PLAIN + "GRID,8,,.1\nMAT1,8,7.1+10,,.3,2701.\nPBARL,8,8,,BAR\n,.1,.3\nCBAR,8,8,1,8,0.,1.,0.\n"
    bulk += "PARAM,WTMASS,.7\nDMIG,K,0,6,2,0\nDMIG,K,8,1,,8,1,100.1\n"
    path = tmp_path / "a.dat"
    path.write_text(f"CEND\nK2GG=K\nBEGIN BULK\n{bulk}ENDDATA\n")
    kept, cut = (convert_deck(read_deck(path, single=s), SI, "consistent", "a") for s in (False, True))

    def numbers(made):
        section, (tie,) = made.document["section"]["pbar8"], made.environment["bushing"]
        place = next(node["x_m"] for node in made.document["node"] if node["name"] == "g8")
        return [place, section["EA_n"], section["rho_A_kg_per_m"], tie["stiffness"][0]]

    np.testing.assert_allclose(
        numbers(kept), [0.1, 7.1e10 * 0.1 * 0.3, 0.7 * 2701.0 * 0.03, 100.1], rtol=1e-15
    )
    x, E, b, h, w = (float(np.float32(v)) for v in (0.1, 7.1e10, 0.1, 0.3, 0.7))
    np.testing.assert_allclose(numbers(cut), [x, E * b * h, w * 2701.0 * b * h, 100.1], rtol=1e-15)
    ask = ("convert", path, "--units", "m-kg-s-N", "--json")
    assert '"reals": "single"' in middeck(capfd, *ask, "--reals", "single").out
    path.write_text(f"BEGIN BULK\n{PLAIN}MAT1,9,7.+10,,.3,,1.+39\nENDDATA\n")
    assert middeck(capfd, *ask).code == 0
    ended = middeck(capfd, *ask, "--set", "reals=single")
    assert ended.code == 2
    assert "MAT1 9: a number that single precision has no place for" in ended.err
    super_deck = ROOT / "data/nastran-superelement/assemble.dat"
    ended = middeck(capfd, "convert", super_deck, "--units", "mm-kg-s-mN", "--reals", "single")
    assert "in the precision of their files" in ended.err


def test_the_superelement_of_a_grid_is_listed(tmp_path):
    bar = "CBAR,20,1,4,9,0.,1.,0."
    made = convert(write(tmp_path, "GRID,9,,3.,,,,,5", bar))
    plain = convert(write(tmp_path, "GRID,9,,3.", bar))
    assert ("GRID SEID", 1, "which superelement they are in: the article is not divided") in made.left_out
    assert str(made.document) == str(plain.document)


@pytest.mark.parametrize(
    ("card", "hint"),
    [("CBUR,20,1", "did you mean 'CBAR'?"), ("ZZZZ,20,1", "docs/how-to/your-nastran-deck.md lists")],
)
def test_an_unknown_card_is_reported_the_same_way_in_every_process(tmp_path, card, hint):
    with pytest.raises(ConfigError) as caught:
        convert(write(tmp_path, card))
    (fault,) = caught.value.data["faults"]
    assert fault.hint.startswith(hint)
    assert "TABRNDG" not in fault.hint  # cards that are passed over, in the order of a set


def test_rotors_and_dampers_that_are_passed_over_say_what_an_article_has_for_them(tmp_path):
    made = convert(write(tmp_path, "ROTORG,1,1", "CDAMP2,30,5.,1,1", "TABDMP1,1"))
    why = {card: reason for card, _, reason in made.left_out}
    assert "[[wheel]]" in why["ROTORG"]
    assert "[damping]" in why["CDAMP2"]
    assert why["TABDMP1"] == "no effect on stiffness and mass"


@pytest.mark.parametrize("command", ["B2GG", "B2PP", "K42GG"])
def test_damping_by_direct_input_is_left_out_as_other_damping_is(tmp_path, command):
    """It moves no undamped mode: nothing else of the article may change."""
    damping = ("DMIG,BB,0,6,1,0", "DMIG,BB,4,1,,4,1,5.")
    made, without = (convert(write(tmp_path, *damping, case=c)) for c in ([f"{command}=BB"], []))
    assert document_text(made.document, "a") == document_text(without.document, "a")
    rows = {card: (count, why) for card, count, why in made.left_out}
    assert rows[f"DMIG of {command}"] == (2, "damping: give it in the article's [damping]")


DAMPER = ("DMIG,BB,0,6,1,0", "DMIG,BB,4,1,,4,1,5.")
OF_B2GG = ("DMIG of B2GG", 2, "damping: give it in the article's [damping]")


@pytest.mark.parametrize(
    ("case", "row", "absent"),
    [
        ("B2GG=BX", ("DMIG", 2, "not selected by case control"), "B2GG BX"),
        (
            "B2GG=2.0*BB, 0.5*BX",
            ("DMIG of B2GG", 2, "damping: give it in the article's [damping]"),
            "B2GG BX",
        ),
        ("B2GG=2.0*BB", OF_B2GG, ""),
    ],
)
def test_damping_matrices_that_case_control_names_otherwise(tmp_path, case, row, absent):
    """In sums, with factors, or not there: those of stiffness are refused, these are told."""
    made = convert(write(tmp_path, *DAMPER, "PARAM,CK2,2.", case=[case]))
    assert [r for r in made.left_out if r[0].startswith("DMIG")] == [row]
    reported = [note for note in made.notes if "B2GG" in note]
    assert reported == ([f"case control selects {absent}, which is not there"] if absent else [])


@pytest.mark.parametrize("back", [-500.0, 0.0, 500.0])
def test_gyroscopic_terms_are_no_damping(tmp_path, back):
    """A matrix in two triangles is damping if they are equal; else it moves frequencies, as a wheel does."""
    cards = ("DMIG,BB,0,1,1,0", "DMIG,BB,4,5,,4,6,500.", *([f"DMIG,BB,4,6,,4,5,{back}"] if back else []))
    path = write(tmp_path, *cards, case=["B2PP=BB"])
    if back == 500.0:
        assert ("DMIG of B2PP", 3, "damping: give it in the article's [damping]") in convert(path).left_out
        return
    with pytest.raises(ConfigError, match=r"a\.dat:4: B2PP = BB: DMIG BB is not symmetric"):
        convert(path)


PLAIN = "".join(f"{card}\n" for card in (*BULK[:4], BULK[6]))


@pytest.mark.parametrize(
    ("case", "bulk", "message"),
    [
        ("SPC=5\n", "SPC,5,1,3,0.,,1\n", r"SPC 5 field 7 \(C2\) = 1: no grid whose components 1"),
        (
            "",
            "GRDSET,,,,,,,126\nGRDSET,,,,,,,12\n",
            r":10: GRDSET field 8 \(PS\) = 12: a second GRDSET with .* is GRDSET at .*:9",
        ),
        (
            "",
            "BAROR,,,,,0.,1.,0.\nBAROR,,,,,0.,0.,1.\n",
            r":10: BAROR field 7 \(X2\) = 0.: a second BAROR with other content",
        ),
        ("K2GG=K\n", "DMIG,K,0,6,2,0\nDMIG,K,1,1,,1,1,A\n", r"a.dat:11: DMIG K: no grid, component and real"),
        ("K2GG=K\nM2GG=K\n", "DMIG,K,0,6,2,0\nDMIG,K,1,1,,1,1,A\n", r"a.dat:12: DMIG K: no grid, component"),
        ("", "PARAM,CK1,2.\n", r"PARAM CK1 field 3 \(V1\) = 2.: scales matrices or loads"),
        ("PARAM,CM1,.5\n", "", r":3: PARAM CM1 = .5: scales matrices or loads"),
        ("", "PARAM,CP1,ABC\n", r"PARAM CP1 field 3 \(V1\) = ABC: scales matrices or loads"),
    ],
)
def test_what_changed_the_model_in_silence_is_refused(tmp_path, case, bulk, message):
    path = tmp_path / "a.dat"
    path.write_text(f"SOL 103\nCEND\n{case}BEGIN BULK\n{PLAIN}{bulk}ENDDATA\n")
    with pytest.raises(ConfigError, match=message):
        convert_deck(read_deck(path), SI, "consistent", "a")


def test_parameters_that_nothing_is_made_of_are_named(tmp_path):
    """A slip in a name, WTMAS for WTMASS, moves every frequency."""
    path = tmp_path / "a.dat"
    read = "PARAM,CK1,1.\nPARAM,CM2,2.\nPARAM,COUPMASS,1\n"
    bulk = f"{PLAIN}{read}PARAM,WTMAS,.00259\nPARAM,POST,-1\nGRDSET,,,,,,,,2\n"
    path.write_text(f"SOL 103\nCEND\nPARAM,PRGPST,NO\nBEGIN BULK\n{bulk}ENDDATA\n")
    rows = convert_deck(read_deck(path), SI, "consistent", "a").left_out
    assert ("PARAM WTMAS, POST, PRGPST", 3, "not read") in rows
    assert [row[:2] for row in rows if row[0] == "GRID SEID"] == [("GRID SEID", 2)]


LACKS = "SPC1,8,123,1\nSPCADD,7,8\nSPCADD,1,8,9,7\nMPCADD,2,3\nFORCE,4,1,,1.,1.\nEIGRL,5\nEIGB,6\n"


@pytest.mark.parametrize(
    ("bulk", "message"),
    [
        ("GRID,8,,1.\nGRID,8,,1.,2.\n", r"a.dat:10: GRID 8 field 5 \(X2\) = 2.: a second grid 8 with"),
        ("PBAR,8,1,1.\nPROD,8,1,1.\n", r"PROD 8 field 2 \(PID\) = 8: a second property 8 with"),
        ("MPCADD,8,1,2\nMPCADD,8,1,2,3\n", r"MPCADD 8 field 5 \(SETS\) = 3: a second MPCADD 8"),
        ("MPCADD,8,1,2,3\nMPCADD,8,1,2\n", r"MPCADD 8 field 5 \(SETS\): a second MPCADD 8"),
        ("PELAS,7,1.,,,8,2.\nPELAS,8,3.\n", r":10: PELAS 8 field 3 \(K\) = 3.: a second property 8"),
        ("+A,1.\n", r":9: field 1 = \+A: a continuation 'A' of no card"),
        ("GRID,8\n+A,1.\nGRID,9\n+A,2.\n", r":12: field 1 = \+A: a second continuation 'A'"),
        ("PBAR,8,1,1.,,,,,,+A\n", r":9: PBAR 8 field 10 = \+A: the continuation '\+A' is missing"),
        ("PBAR,8,1,1.,,,,,,7.\n", r":9: PBAR 8 field 10 = 7.: a number, 7., where the mark"),
        (
            "PBAR,8,1,1.,,,,,,+A\nPBAR,9,1,1.,,,,,,+A\nGRID,9\n+A,1.\n",
            r":10: PBAR 9 field 10 = \+A: a second card",
        ),
        ("PBAR,8,1,1.,,,,,,,3.\n", r":9: PBAR 8 field 10: more than 8 fields in one line"),
    ],
)
def test_second_numbers_and_lost_continuations_name_their_field(tmp_path, bulk, message):
    path = tmp_path / "a.dat"
    path.write_text(f"SOL 103\nCEND\nBEGIN BULK\n{PLAIN}{bulk}ENDDATA\n")
    with pytest.raises(ConfigError, match=message):
        read_deck(path)


@pytest.mark.parametrize(
    ("case", "bulk", "message"),
    [
        ("SPC=99\n", "", r"a.dat:3: SPC = 99: there is no SPC or SPC1 of this number"),
        ("SUBCASE 1\nMPC=98\n", "", r"a.dat:4: MPC = 98: there is no MPC of this number"),
        ("SUBCASE 1\nLOAD=4\nSUBCASE 2\nLOAD=97\n", LACKS, r"a.dat:6: LOAD = 97: there is no load of this"),
        ("SPC=1\n", LACKS, r"SPCADD 1 field 4 \(SETS\) = 9: there is no SPC 9\n"),
        ("SPC=1\n", LACKS, r"SPCADD 1 field 5 \(SETS\) = 7: there is no SPC 7; a union names no union"),
        ("MPC=2\n", LACKS, r"MPCADD 2 field 3 \(SETS\) = 3: there is no MPC 3"),
        (
            "",
            "SPCADD,7,8\nSPCADD,7,9\n",
            r"SPCADD 7 field 3 \(SETS\) = 9: a second SPCADD 7 with other content",
        ),
    ],
)
def test_a_selected_set_that_is_not_there_is_refused(tmp_path, case, bulk, message):
    """As Nastran stops there (UFM 2047, 2053); what is not selected may lack anything, and set 0 is none."""
    path = tmp_path / "a.dat"
    path.write_text(f"SOL 103\nCEND\n{case}BEGIN BULK\n{PLAIN}{bulk}ENDDATA\n")
    with pytest.raises(ConfigError, match=message):
        convert_deck(read_deck(path), SI, "consistent", "a")
    none = "SPC=0\nMPC=0\nLOAD=0\nMETHOD=0\n"
    if "second" not in message:
        path.write_text(
            f"SOL 103\nCEND\n{none}SUBCASE 1\nSUBCASE 2\nSPC=0\nBEGIN BULK\n{PLAIN}{bulk}ENDDATA\n"
        )
        made = convert_deck(read_deck(path), SI, "consistent", "a")
        assert not made.holds
        assert not [note for note in made.notes if "not there" in note]


@pytest.mark.parametrize(("bulk", "reported"), [("", 2), ("EIGR,3,LAN\nSUPORT1,4,1,1\n", 0), ("EIGB,3\n", 0)])
def test_a_hint_that_is_not_there_is_reported(tmp_path, bulk, reported):
    path = tmp_path / "a.dat"
    path.write_text(f"SOL 103\nCEND\nMETHOD=3\nSUPORT1=4\nBEGIN BULK\n{PLAIN}{bulk}ENDDATA\n")
    notes = convert_deck(read_deck(path), SI, "consistent", "a").notes
    assert len([note for note in notes if "which is not there" in note]) == reported


@pytest.mark.parametrize("order", [1, -1])
def test_a_union_goes_before_constraints_of_its_own_number(tmp_path, order):
    """MSC Nastran, Quick Reference Guide, SPCADD, remark 3, and MPCADD: only the union is used."""
    path = tmp_path / "a.dat"
    bulk = [
        "SPCADD,1,8",
        "SPC1,8,12,1",
        "SPC1,1,456,1",
        "MPCADD,1,8",
        "MPC,8,2,1,1.,1,2,1.",
        "MPC,1,2,3,1.,1,3,1.",
    ]
    cards = "\n".join(bulk[::order])
    path.write_text(f"SOL 103\nCEND\nSPC=1\nMPC=1\nBEGIN BULK\n{PLAIN}{cards}\nENDDATA\n")
    made = convert_deck(read_deck(path), SI, "consistent", "a")
    assert [(c["along"], c["about"]) for c in made.environment["clamp"]] == [("xy", "")]
    assert [table["term"][0]["direction"] for table in made.document["equation"]] == ["x"]
    assert {("SPC1", 1, "not selected by case control"), ("MPC", 1, "not selected by case control")} <= set(
        made.left_out
    )


def test_cards_of_stiffness_by_frequency_are_not_said_to_have_no_effect(tmp_path):
    path = tmp_path / "a.dat"
    bulk = f"{PLAIN}PBUSHT,1,K,5\nPELAST,1,5\nTABLED1,5\n,0.,1.,9.,2.,ENDT\n"
    path.write_text(f"SOL 103\nCEND\nBEGIN BULK\n{bulk}ENDDATA\n")
    rows = {card: why for card, _, why in convert_deck(read_deck(path), SI, "consistent", "a").left_out}
    for card in ("PBUSHT", "PELAST"):
        assert rows[card] == "stiffness by frequency or load: the article has that of PBUSH, PELAS"
    assert rows["TABLED1"] == "no effect on stiffness and mass"
    # A mass and a glue that wait for their selection.
    path.write_text(f"SOL 103\nCEND\nBEGIN BULK\n{PLAIN}NSM1,7\nBGSET,7\nENDDATA\n")
    rows = {card: why for card, _, why in convert_deck(read_deck(path), SI, "consistent", "a").left_out}
    assert rows["NSM1"] == rows["BGSET"] == "not selected by case control"


@pytest.mark.parametrize(("card", "by"), [("ASET1,123,2", "to its ASET"), ("OMIT1,456,2", "by OMIT")])
def test_a_reduction_of_the_deck_is_reported(tmp_path, card, by):
    path = tmp_path / "a.dat"
    path.write_text(f"SOL 103\nCEND\nBEGIN BULK\n{PLAIN}{card}\nENDDATA\n")
    notes = convert_deck(read_deck(path), SI, "consistent", "a").notes
    assert f"the deck reduces {by}: the article keeps all degrees of freedom" in notes
