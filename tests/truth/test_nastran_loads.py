"""Load sets of decks, selected in subcases, summed, and in other axes: worked by hand."""

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units

SI = parse_units("m-kg-s-N")
# System 5 has its z along basic x and its x along basic -z; 6 is round the line x = 0, y = -1.
BULK = """\
MAT1,1,7.+10,,.3,2700.
PBAR,1,1,1.-4,1.-9,2.-9,2.-9
GRID,1
GRID,2,,1.
GRID,3,,2.
CBAR,11,1,1,2,0.,1.,0.
CBAR,12,1,2,3,0.,1.,0.
SPC1,1,123456,1
CORD2R,5,,0.,0.,0.,1.,0.,0.
,0.,0.,-1.
CORD2C,6,,0.,-1.,0.,0.,-1.,1.
,1.,-1.,0.
FORCE,10,3,5,2.,1.,2.,3.
FORCE,11,3,6,2.,1.
GRAV,20,5,9.81,-2.
GRAV,21,,1.,0.,0.,-3.
LOAD,30,2.,1.,10,.5,11
LOAD,32,1.,1.,20,2.,21
"""


def convert(tmp_path, case, *more):
    path = tmp_path / "a.dat"
    lines = ["SOL 101", "CEND", "SPC = 1", *case, f"BEGIN BULK\n{BULK}", *more, "ENDDATA", ""]
    path.write_text("\n".join(lines))
    return convert_deck(read_deck(path), SI, "consistent", "a")


def test_forces_in_turned_and_round_axes_are_summed_with_their_factors(tmp_path):
    (case,) = convert(tmp_path, ["LOAD = 30"]).document["load_case"]
    assert case["name"] == "load30"
    first, second = (load["force_n"] for load in case["load"])
    np.testing.assert_allclose(first, 2.0 * 1.0 * 2.0 * np.array([3.0, 2.0, -1.0]), atol=1e-12)
    np.testing.assert_allclose(second, 2.0 * 0.5 * 2.0 * np.array([2.0, 1.0, 0.0]) / 5.0**0.5, atol=1e-12)


@pytest.mark.parametrize(("name", "key"), [("FORCE", "force_n"), ("MOMENT", "moment_nm")])
def test_grids_give_a_direction_along_a_line_or_across_two(tmp_path, name, key):
    """Quick Reference Guide, FORCE1 and FORCE2: F times the unit vector of G1 G2, or of G1 G2 times G3 G4."""
    grids = ["GRID,7,,3.,-2.,6.", "GRID,8,6,1.,90.,2."]  # the latter at (0, 0, 2)
    cards = [f"{name}1,40,3,-14.,1,7", f"{name}2,40,2,3.,1,7,3,8", "LOAD,41,2.,.5,40"]
    (case,) = convert(tmp_path, ["LOAD = 41"], *grids, *cards).document["load_case"]
    across = np.cross([3.0, -2.0, 6.0], [-2.0, 0.0, 2.0])
    expected = [[-6.0, 4.0, -12.0], 3.0 * across / np.linalg.norm(across)]
    assert [load["frame"] for load in case["load"]] == ["g3", "g2"]
    for load, vector in zip(case["load"], expected, strict=True):
        np.testing.assert_allclose(load[key], vector, atol=1e-12)


def test_gravity_is_summed_in_any_axes_whatever_the_length_of_its_vector(tmp_path):
    made = convert(tmp_path, ["LOAD = 32"])
    assert made.environment["constants"]["gravity_m_s2"] == pytest.approx(2.0 * 9.81 - 2.0 * 3.0)
    np.testing.assert_allclose(made.environment["constants"]["gravity_direction"], [0.0, 0.0, 1.0])


@pytest.mark.parametrize("other", ["32", "30"])
def test_gravity_of_each_subcase_counts_though_another_sums_it(tmp_path, other):
    case = ["SUBCASE 1", "LOAD = 20", "SUBCASE 2", f"LOAD = {other}"]
    made = convert(tmp_path, case)
    refused = [row[0] for row in made.left_out if "[" in row[2]]
    if other == "32":
        assert refused == ["gravity of load set 20", "gravity of load set 32"]
        assert "constants" not in made.environment
    else:
        assert made.environment["constants"]["gravity_m_s2"] == pytest.approx(19.62)


@pytest.mark.parametrize(
    ("card", "message"),
    [
        ("FORCE,40,3,,2.", r"a.dat:24: FORCE 40 field 6 \(N1\): its direction is zero"),
        ("MOMENT,40,3,,2.,0.,0.", r"a.dat:24: MOMENT 40 field 6 \(N1\) = 0.: its direction is zero"),
        ("GRAV,40,,2.", r"a.dat:24: GRAV 40 field 5 \(N1\): its direction is zero"),
        (
            "FORCE1,40,3,2.,1,1",
            r"a.dat:24: FORCE1 40 field 6 \(G2\) = 1: its direction is zero: grids",
        ),
        ("MOMENT1,40,3,2.,1,9", r"a.dat:24: MOMENT1 40 field 6 \(G2\) = 9: there is no grid 9"),
        (
            "FORCE2,40,3,2.,1,2,1,3",
            r"a.dat:24: FORCE2 40 field 8 \(G4\) = 3: its direction is zero: two",
        ),
        ("MOMENT2,40,3,2.,1,2,3,3", r"a.dat:24: MOMENT2 40 field 8 \(G4\) = 3: its direction is zero: two"),
        ("MOMENT2,40,3,2.,1,2,3", r"a.dat:24: MOMENT2 40 field 8 \(G4\): missing"),
        ("LOAD,30,1.,1.,11", r"a.dat:24: LOAD 30 field \d+ .*: a second LOAD 30 with other content"),
        ("FORCE,30,3,,2.,1.", r": LOAD 30 field 2 \(SID\) = 30: FORCE 30 has the same number: which of them"),
    ],
)
def test_loads_that_say_nothing_or_two_things_are_refused(tmp_path, card, message):
    with pytest.raises(ConfigError, match=message):
        convert(tmp_path, [], card)


@pytest.mark.parametrize(
    "card",
    [
        "FORCE1,40,3,10.,7,8",
        "MOMENT1,40,3,10.,8,7",
        "FORCE2,40,3,10.,1,2,7,8",
        "FORCE2,40,3,10.,7,1,1,8",
        "MOMENT2,40,3,10.,7,8,1,2",
    ],
)
@pytest.mark.parametrize("far", [False, True])
def test_rounding_of_places_gives_no_direction(tmp_path, card, far):
    """One place by two systems is one to rounding, also where the origin of one is far off."""
    x = 100000000.3 if far else 0.0
    round_z = f"CORD2C,7,,{x},0.,0.,{x},0.,1.\n,{x + 1.0},0.,0."
    places = (
        ("GRID,7,,.3,0.,2.", "GRID,8,7,-1.+8,0.,2.") if far else ("GRID,7,,0.,1.,2.", "GRID,8,7,1.,90.,2.")
    )
    with pytest.raises(ConfigError, match="its direction is zero"):
        convert(tmp_path, ["LOAD = 40"], round_z, *places, card)


@pytest.mark.parametrize("card", ["FORCE,40,3,,0.", "FORCE1,40,3,0.,1,1", "MOMENT2,40,3,0.,1,2,1,3"])
def test_a_load_of_size_zero_needs_no_direction(tmp_path, card):
    assert convert(tmp_path, ["LOAD = 40"], card).document["load_case"][0]["name"] == "load40"
