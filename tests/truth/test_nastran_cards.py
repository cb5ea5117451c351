"""Numbers, fields, continuations, coordinate systems and sections of a Nastran deck."""

import itertools

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.files.nastran.deck.cards import join_cards
from middeck.files.nastran.deck.coordinates import System, place_grids
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.entries import read_entries
from middeck.files.nastran.deck.nastran_numbers import integer, real
from middeck.files.nastran.deck.units import guess_units, parse_units
from middeck.files.nastran.members.section_shapes import section_shape

REALS = {
    "6.894+7": 6.894e7, "2.74-6": 2.74e-6, "1.D3": 1e3, ".5": 0.5, "-.5": -0.5, "+7.": 7.0, "1.E5": 1e5,
    "1.E+05": 1e5, "7.0-1": 0.7, "70.-1": 7.0, "1.5D-03": 1.5e-3, "0.": 0.0, "-0.0": 0.0, "1.+300": 1e300,
}  # fmt: skip
NO_REALS = [
    "7",
    "1E5",
    "nan",
    "inf",
    "1_0.",
    "1.+999",
    "1.E",
    "1.-",
    "-",
    "+",
    ".",
    "1..2",
    "1.2.3",
    "0x1.8",
    "1.0F",
    "1,5",
    "1.+2+3",
    "١.٥",
    "1.0e400",
]
NO_INTEGERS = ["1.", "1.0", "1_0", "0x1", "1e3", "--", "+", "²", "١", "1-1"]


def cards(text):
    return join_cards([(line, "a.dat", i + 1) for i, line in enumerate(text.strip("\n").split("\n"))])


def entries(text):
    return read_entries(cards(text))


def refused(text):
    with pytest.raises(ConfigError) as error:
        entries(text)
    return str(error.value)


def test_reals_are_those_of_a_table():
    assert {text: real(text) for text in REALS} == REALS
    assert [text for text in NO_REALS if real(text.upper()) is not None] == []


def test_integers_have_no_point():
    assert (integer("-12"), integer("+3"), integer("0"), integer("00012")) == (-12, 3, 0, 12)
    assert [text for text in NO_INTEGERS if integer(text) is not None] == []


@pytest.mark.parametrize("blank", [False, True])
def test_a_column_of_many_cards_is_read_as_its_texts_are_one_by_one(blank):
    """Columns are read at once: plain numbers, others among them, blanks, and what is no number."""
    good = [f"{k}.{k}" for k in range(80)]
    for text in [*REALS, *NO_REALS, "1 2.", ""]:
        column = [*good, text, *([""] if blank else [])]
        if "," in text:
            continue
        deck = "\n".join(f"GRID,{i},,{x}" for i, x in enumerate(column, 1))
        value = 0.0 if text == "" else real(text.upper())
        if value is None:
            assert "a.dat:81: GRID 81 field 4 (X1)" in refused(deck)
        else:
            found = [entry["x1"] for entry in entries(deck).of("GRID")]
            assert found == [*map(float, good), value, *([0.0] if blank else [])]


@pytest.mark.parametrize("texts", [*itertools.product(("", "0", "00", "7"), repeat=2), ("", "0", "", "12")])
def test_few_integers_among_blanks_are_read_one_by_one(texts):
    deck = entries("\n".join(f"CONM2,{i},1,{x},1.\nGRID,{i},{x}" for i, x in enumerate(texts, 1)))
    assert [entry["cid"] for entry in deck.of("CONM2")] == [int(x or 0) for x in texts]
    assert [entry["cp"] for entry in deck.of("GRID")] == [int(x) if x else None for x in texts]


GRID = ("12", "", "1.5", "-2.5+1", "", "3")
FORMATS = {
    "small": "GRID          12             1.5  -2.5+1               3",
    "lower case": "grid          12             1.5  -2.5+1               3",
    "free": "GRID,12,,1.5,-2.5+1,,3",
    "free with blanks and lower case": "grid , 12, ,1.5, -2.5+1,, 3",
    "tabs": "GRID\t12\t\t1.5\t-2.5+1\t\t3",
    "large": f"{'GRID*':<8}{'12':>16}{'':16}{'1.5':>16}{'-2.5+1':>16}*\n{'*':<8}{'':16}{'3':>16}",
    "large, named": f"{'GRID*':<8}{'12':>16}{'':16}{'1.5':>16}{'-2.5+1':>16}*G1\n{'*G1':<8}{'':16}{'3':>16}",
    "large and free": "GRID*,12,,1.5,-2.5+1\n*,,3",
    "left": "GRID    12              1.5     -2.5+1          3",
}  # fmt: skip


@pytest.mark.parametrize("name", FORMATS)
def test_one_card_in_every_format(name):
    (found,) = entries(FORMATS[name]).of("GRID")
    assert found.values == (12, None, 1.5, -25.0, 0.0, 3, None, None)


def test_a_row_of_large_fields_is_whole_before_a_small_one():
    """Half a row is filled with blanks: the components stand in the row after it."""
    text = f"{'RBE2*':<8}{'1':>16}{'2':>16}{'123456':>16}{'3':>16}*\n{'+':<8}{'4':>8}"
    (found,) = entries(text).of("RBE2")
    assert found["gm"] == ["3", None, None, None, None, "4"]


def test_lines_may_be_numbered_in_columns_73_to_80():
    """Where all are and the numbers rise, as editors once wrote them; a lone one is a field too many."""
    lines = [f"{f'GRID    {n:<8}        {n}.':72}{10 * n:08d}" for n in range(1, 13)]
    assert [entry["x1"] for entry in entries("\n".join(lines)).of("GRID")] == [*map(float, range(1, 13))]
    lines[4] = lines[4][:72]
    assert "11 errors" in (message := refused("\n".join(lines)))
    assert "a number, 00000010, where the mark of a continuation stands" in message
    assert "numbers of lines must stand on all without commas, and rise" in message


@pytest.mark.parametrize("tail", ["+1", "1", "*1", "00000010"])
@pytest.mark.parametrize("head", ["", "+"])
def test_what_stands_before_a_continuation_without_a_name_is_its_mark(tail, head):
    first = f"{'PBAR           1       2      3.      4.      5.      6.':72}{tail}\n"
    (found,) = entries(f"{first}{head:<8}\n{head:<8}      .5      .6").of("PBAR")
    assert (found["j"], found["k1"], found["k2"]) == (6.0, 0.5, 0.6)


@pytest.mark.parametrize("numbers", [range(2), range(10, 100, 10), range(7, 16)])
def test_few_lines_may_be_numbered_too(numbers):
    lines = [f"{f'GRID    {n:<8}        {n}.':72}{n:08d}" for n in numbers if n]
    lines += [f"{'PBAR           1       2      3.      4.      5.      6.':72}{100:08d}"]
    lines += [f"{'':72}{101:08d}", f"{'              .5      .6':72}{102:08d}"]
    (found,) = entries("\n".join(lines)).of("PBAR")
    assert (found["j"], found["k1"], found["k2"]) == (6.0, 0.5, 0.6)


@pytest.mark.parametrize(
    "text",
    [
        "RBE2,20,1,123456,5,6,7,8,9,10\n,11",
        f"{'GRID    1               1.':72}10\n{'GRID    2               2.':72}10",
        f"{'GRID    1               1.':72}20\n{'GRID    2               2.':72}10",
        f"{'GRID    1               1.':72}20\nGRID,2,,2.,,,,,,30\n{'GRID    3               2.':72}40",
        f"{'PBAR           1       2      3.':72}1.5\n+              .5",
        "RBE3           1               2  123456      1.     123       3       4       5\n+              6",
        "SPC1           1     123       3       4       5       6       7       8       9+\n              10",
        f"{'GRID*                 12               0':56}{'3.':>16}      12\n*",
    ],
)
def test_a_number_that_may_be_a_field_too_many_is_reported(text):
    assert "where the mark of a continuation stands" in refused(text)


@pytest.mark.parametrize(
    "text",
    [f"{'CBAR           3       1       3       4      0.      0.      1.     GGG':80}     456",
     "CBAR\t3\t1\t3\t4\t0.\t0.\t1.\tGGG\t\t456",
     f"{'GRID*                 12               0              1.':80}2."],
)  # fmt: skip
def test_a_number_behind_the_last_column_is_reported(text):
    assert "behind column 80, where no field is" in refused(text)
    assert entries(f"{'GRID    1               1.':80}  as drawn").of("GRID")


def test_a_fixed_field_reaches_to_the_next_one():
    (found,) = entries("PARAM   COUPMASS1").of("PARAM")
    assert found.values == ("COUPMASS", "1", [])


CONTINUED = {
    "implicit": "PBAR,1,2,3.,4.,5.,6.\n,\n,.5,.6",
    "plus": "PBAR,1,2,3.,4.,5.,6.\n+\n+,.5,.6",
    "named": "PBAR,1,2,3.,4.,5.,6.,,,+A\n+A,,,,,,,,,+B\n+B,.5,.6",
    "out of order": "PBAR,1,2,3.,4.,5.,6.,,,+A\n+B,.5,.6\nMAT1,2,7.+10\n+A,,,,,,,,,+B",
    "before all cards": "+B,.5,.6\n+A,,,,,,,,,+B\nMAT1,2,7.+10\nPBAR,1,2,3.,4.,5.,6.,,,+A",
    "small and named": "PBAR           1       2      3.      4.      5.      6.                +A\n"
                       "+A                                                                      +B\n"
                       "+B            .5      .6",
    "as Nastran's echo": "PBAR           1       2      3.      4.      5.      6.                 +000001\n"
                         "++000001                                                                +000002\n"
                         "++000002      .5      .6",
    "any column 73": "PBAR           1       2      3.      4.      5.      6.                KA\n"
                     "+A                                                                      LB\n"
                     "+B            .5      .6",
    "plus and number": "PBAR,1,2,3.,4.,5.,6.,,,+1\n+1,,,,,,,,,2\n+2,.5,.6",
    "comments between": "PBAR,1,2,3.,4.,5.,6.\n,\n,.5,.6",
}  # fmt: skip


@pytest.mark.parametrize("name", CONTINUED)
def test_continuations(name):
    (found,) = entries(CONTINUED[name]).of("PBAR")
    assert (found["a"], found["j"], found["k1"], found["k2"]) == (3.0, 6.0, 0.5, 0.6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (",1.\nGRID,1", "a continuation of nothing"),
        ("+A,1.\nGRID,1", "a continuation 'A' of no card"),
        ("PBAR,1,2,3.\nGRID,1\n+A,1.", "a continuation 'A' of no card"),
        ("PBAR,1,2,3.,,,,,,+A\nGRID,1", "the continuation '+A' is missing"),
        ("PBAR,1,2,3.,,,,,,+\nGRID,1", "the continuation '+' is missing"),
        (f"{'PBAR*':<72}*\nGRID,1", "the continuation '*' is missing"),
        ("PBAR,1,2,3.,,,,,,+A\nGRID,1\n+A,1.\nGRID,2\n+A,2.", "a second continuation 'A'"),
        ("GRID,1,,0.,0.,0.,0,,,,5", "more than 8 fields"),
        ("GRID,1,,0", "a.dat:1: GRID 1 field 4 (X1) = 0: must be a real number"),
        ("GRID,1,,0.,1 2", "field 5 (X2)"),
        ("GRID,,,0.", "field 2 (ID): missing"),
        ("GRID           2              10.      0.      0.", "X2) = .      0: must be a real number"),
        (
            "GRID           2              10.      0.      0.",
            "columns, large ones sixteen; is the line shifted?",
        ),
        ("GRID,-3", "must be an integer > 0"),
        ("GRID,1,,1.0.", "field 4 (X1) = 1.0."),
        ("GRID,1,,,,,,7", "components"),
        ("GRID,1,,,,,,10", "components"),
        ("RBE2,1,2,0,3", "field 4 (CM) = 0: must be components"),
        ("RBE2,1,2,12340,3", "field 4 (CM) = 12340: must be components"),
        ("RBE3,1,,2,0,1.,123,3", "field 5 (REFC) = 0: must be components"),
        ("CONM2,1,2,,1.,,,,5.", "field 9 = 5.: must be blank"),
        ("GRDI,1", "did you mean 'GRID'?"),
        ("GRID 1 0 0. 0. 0.", "columns of eight, or commas"),
        ("GRID,1,,1.\nGRID,1,,2.", "a second grid 1 with other content; the first is GRID 1 at a.dat:1"),
        ("CBAR,1,1,1,2,0.,1.,0.\nRBE2,1,2,123,3", "a second element 1"),
        ("CONM2,1,2,,3.\nCMASS2,1,3.,2,1", "a second mass element 1"),
        ("PBAR,1,1,1.\nPBARL,1,1,,ROD,,,,,\n,1.", "a second property 1"),
        ("PARAM,WTMASS,1.\nPARAM,WTMASS,2.", "a second PARAM WTMASS"),
        ("CQUAD4,1,1,1,2,3,4\nCQUAD4,2,1,1,2,3,4", "shells and solids are not read (2 of them)"),
    ],
)
def test_complaints_name_line_card_and_field(text, words):
    assert words in refused(text)


def test_equal_duplicates_pass():
    assert len(entries("GRID,1,,1.,2.\ngrid,1,,1.0,2.+0,0.").of("GRID")) == 1
    assert len(entries("GRID,1,,1.\nGRID,1,0,1.,,,0").of("GRID")) == 1
    assert "second grid 1" in refused("GRDSET,,4\nGRID,1,,1.\nGRID,1,0,1.,,,0")


def test_numbers_that_cannot_be_read_are_reported_once():
    assert "second" not in refused("CONM2,1 1,2,,3.\nCONM2,1 2,2,,4.")


def test_a_mass_may_have_the_number_of_another_element():
    """As in MSC Nastran's own example of a wing with its masses on rigid bars."""
    assert len(entries("RBAR,111,110,111,123456\nCONM2,111,111,0,600.").of("RBAR", "CONM2")) == 2


def test_places_follow_chains_of_systems():
    """A point whose place is known by hand: a cylinder on a sphere on a turned frame."""
    found = place_grids(
        entries(
            """
CORD2R,1,,1.,0.,0.,1.,0.,1.
,1.,1.,0.
CORD2S,2,1,0.,0.,0.,0.,0.,1.
,1.,0.,0.
CORD2C,3,2,2.,90.,0.,4.,90.,0.
,2.,90.,90.
GRID,1,1,1.,2.,3.,3
GRID,2,2,2.,90.,90.
GRID,3,3,1.,90.,5.
GRID,4,,9.,9.,9.
GRID,5,,9.,9.,10.
GRID,6,,10.,9.,9.
CORD1R,7,4,5,6
GRID,7,7,1.,2.,3.
"""
        )
    )
    # x of 1 is basic y, its y is basic -x.
    expected = {1: (-1.0, 1.0, 3.0), 2: (-1.0, 0.0, 0.0), 7: (10.0, 11.0, 12.0)}
    for grid, place in expected.items():
        np.testing.assert_allclose(found.grids[grid], place, atol=1e-15)
    # System 3 stands at (1, 2, 0); its z is basic y, its x points from there towards (-1, 0, 0).
    np.testing.assert_allclose(found.grids[3], (1.0, 7.0, 1.0), atol=1e-14)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("CORD2R,1,2,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nCORD2R,2,1,0.,0.,0.,0.,0.,1.\n,1.,0.,0.", "a circle"),
        ("CORD1R,1,1,2,3\nGRID,1,1\nGRID,2,,1.\nGRID,3,,,1.", "a circle"),
        ("CORD2R,1,5,0.,0.,0.,0.,0.,1.\n,1.,0.,0.", "there is no coordinate system 5"),
        ("CORD2R,1,,0.,0.,0.,0.,0.,1.\n,0.,0.,2.", "on one line"),
        ("GRID,1,4", "there is no coordinate system 4"),
        ("CORD1C,1,1,2,3", "there is no grid 1"),
    ],
)
def test_systems_that_are_none(text, words):
    with pytest.raises(ConfigError, match=words):
        place_grids(entries(text))


def test_directions_of_components_are_gradients_of_coordinates():
    rng = np.random.default_rng(4)
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    axes[:, 2] *= np.linalg.det(axes)
    for kind in "CS":
        system = System(kind, rng.standard_normal(3), axes)
        place = np.array([1.3, 40.0, 25.0])
        columns = []
        for i in range(3):
            step = 1e-5 * np.eye(3)[i]
            d = system.to_basic(place + step) - system.to_basic(place - step)
            columns.append(d / np.linalg.norm(d))
        np.testing.assert_allclose(
            system.axes_at(system.to_basic(place)), np.stack(columns, axis=1), atol=1e-9
        )


@pytest.mark.parametrize("kind", ["C", "S"])
@pytest.mark.parametrize("along", [-7.3, 0.0, 1e-3, 30.0])
def test_directions_on_the_polar_axis_are_those_of_zero_degrees(kind, along):
    """Whatever rounding leaves of a place on it: the origin is far, and the axes are askew."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        axes[:, 2] *= np.linalg.det(axes)
        system = System(kind, 1e3 * rng.standard_normal(3), axes)
        x, y, z = axes.T
        if kind == "C":
            place, expected = [0.0, 0.0, along], [x, y, z]
        else:
            place = [abs(along), 180.0 if along < 0.0 else 0.0, 0.0]
            expected = [-z, -x, y] if along < 0.0 else [z, x, y]
        found = system.axes_at(system.to_basic(np.array(place)))
        np.testing.assert_allclose(found, np.stack(expected, axis=1), atol=1e-6)


def moments(inside, half):
    """Area and second moments of the points where ``inside`` holds, by a fine grid of midpoints."""
    n = 1200
    y = (np.arange(n) + 0.5) / n * 2 * half[0] - half[0]
    z = (np.arange(n) + 0.5) / n * 2 * half[1] - half[1]
    Y, Z = np.meshgrid(y, z, indexing="ij")
    cell = 4 * half[0] * half[1] / n**2
    on = inside(Y, Z)
    Y, Z = Y - (on * Y).sum() / on.sum(), Z - (on * Z).sum() / on.sum()
    return cell * on.sum(), cell * (on * Y**2).sum(), cell * (on * Z**2).sum(), cell * (on * Y * Z).sum()


def square(y, z):
    return np.maximum(abs(y) / 1.5, abs(z)) < 1.0


def i_beam(y, z):
    return square(y, z) & ((abs(y) > 1.2) | (abs(z) < 0.2))


def ring(y, z):
    return (y**2 + z**2 < 1.5**2) & (y**2 + z**2 > 1.0)


SHAPES = {
    ("ROD", (1.5,)): lambda y, z: y**2 + z**2 < 1.5**2,
    ("TUBE", (1.5, 1.0)): ring,
    ("TUBE2", (1.5, 0.5)): ring,
    ("BAR", (2.0, 3.0)): square,
    ("BOX", (2.0, 3.0, 0.3, 0.2)): lambda y, z: square(y, z) & ((abs(z) > 0.8) | (abs(y) > 1.2)),
    ("I", (3.0, 2.0, 2.0, 0.4, 0.3, 0.3)): i_beam,
    ("I1", (1.6, 0.4, 2.4, 3.0)): i_beam,
    ("I", (3.0, 2.0, 1.0, 0.4, 0.3, 0.2)): lambda y, z: (
        (y < -1.2) | ((y < 1.3) & (abs(z) < 0.2)) | ((y >= 1.3) & (abs(z) < 0.5))
    ),
    ("T", (2.0, 3.0, 0.3, 0.4)): lambda y, z: (y > 1.2) | (abs(z) < 0.2),
    ("T2", (2.0, 3.0, 0.3, 0.4)): lambda y, z: (y < -1.2) | (abs(z) < 0.2),
    ("T1", (3.0, 1.7, 0.3, 0.4)): lambda y, z: (z > 0.7) | (abs(y) < 0.2),
    ("CHAN", (2.0, 3.0, 0.4, 0.3)): lambda y, z: (z < -0.6) | (abs(y) > 1.2),
    ("CHAN1", (1.6, 0.4, 2.4, 3.0)): lambda y, z: (z < -0.6) | (abs(y) > 1.2),
    ("CHAN2", (0.4, 0.3, 3.0, 2.0)): lambda y, z: (y < -1.2) | (abs(z) > 0.6),
    ("BOX1", (2.0, 3.0, 0.3, 0.2, 0.1, 0.1)): lambda y, z: (abs(z) > 0.9) | (y > 1.2) | (y < -1.3),
    ("CROSS", (1.7, 0.3, 3.0, 0.4)): lambda y, z: (abs(z) < 0.15) | (abs(y) < 0.2),
    ("H", (1.4, 0.6, 3.0, 0.4)): lambda y, z: (abs(z) > 0.7) | (abs(y) < 0.2),
    ("BOX1", (2.0, 3.0, 0.3, 0.2, 0.1, 0.4)): lambda y, z: (z > 0.9) | (z < -0.6) | (y > 1.2) | (y < -1.3),
    ("L", (2.0, 3.0, 0.3, 0.4)): lambda y, z: (z < -0.6) | (y < -1.2),
    ("Z", (0.8, 0.4, 2.4, 3.0)): lambda y, z: (
        (abs(z) < 0.2) | ((y > 1.2) & (z < 0.0)) | ((y < -1.2) & (z > 0.0))
    ),
    ("HAT", (3.0, 0.2, 1.2, 0.4)): lambda y, z: (
        ((y > 1.3) & (abs(z) < 0.6)) | ((abs(z) > 0.4) & (abs(z) < 0.6)) | ((y < -1.3) & (abs(z) > 0.4))
    ),
    ("HEXA", (0.5, 2.0, 3.0)): lambda y, z: abs(z) < 1.0 - 0.5 * abs(y) / 1.5,
    ("HAT1", (2.0, 3.0, 1.2, 0.2, 0.3)): lambda y, z: (
        (y < -1.2) | ((y < -1.0) & (abs(z) > 0.4)) | ((abs(z) > 0.4) & (abs(z) < 0.6))
        | ((y > 1.3) & (abs(z) < 0.6))
    ),
    ("DBOX", (2.0, 3.0, 0.8, 0.1, 0.2, 0.3, 0.15, 0.25, 0.35, 0.2)): lambda y, z: (
        (z < -0.9) | (abs(z + 0.2) < 0.1) | (z > 0.7)
        | ((z < -0.2) & ((y > 1.35) | (y < -1.25))) | ((z > -0.2) & ((y > 1.15) | (y < -1.3)))
    ),
}  # fmt: skip


@pytest.mark.parametrize(("name", "dims"), SHAPES)
def test_moments_of_shapes_are_integrals(name, dims):
    shape = section_shape(name, list(dims))
    found = moments(SHAPES[name, dims], (1.5, 1.0) if name not in ("ROD", "TUBE", "TUBE2") else (1.6, 1.6))
    given = shape.area, shape.i1, shape.i2
    np.testing.assert_allclose(given, found[:3], rtol=1e-2)  # cells of 0.003
    assert abs(shape.i12 - found[3]) < 1e-2 * shape.i2


def shear_flow_centre(points, thick, closed):
    """Where shear forces twist nothing: moments of the shear flow q' = -t (a y + b z) along a thin wall.

    Where it is ``closed``, one flow more makes the twist zero.
    """
    fine = 2000
    s = ((np.arange(fine) + 0.5) / fine)[:, None]
    a, b = points[:-1], points[1:]
    y, z = (a + s[:, :, None] * (b - a)).transpose(2, 1, 0).reshape(2, -1)
    t, step, swept = (
        np.repeat(x, fine)
        for x in (thick, np.linalg.norm(b - a, axis=1) / fine, (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / fine)
    )
    w = t * step
    y, z = y - w @ y / w.sum(), z - w @ z / w.sum()
    moment = []
    for force in np.eye(2):
        slope = np.linalg.solve([[w @ y**2, w @ (y * z)], [w @ (y * z), w @ z**2]], force) @ [y, z]
        q = -np.cumsum(slope * w) + 0.5 * slope * w
        if closed:
            q = q - (q * step / t).sum() / (step / t).sum()
        moment.append(q @ swept)
    return np.array([moment[1], -moment[0]])


@pytest.mark.parametrize(
    ("name", "dims", "points", "thick"),
    [
        (
            *("HAT", (3.0, 1e-4, 1.2, 0.4)),
            *(((0, -1), (0, -0.6), (3, -0.6), (3, 0.6), (0, 0.6), (0, 1)), [1e-4] * 5),
        ),
        ("L", (2.0, 3.0, 2e-4, 1e-4), ((3, 0), (0, 0), (0, 2)), [1e-4, 2e-4]),
        ("Z", (0.8, 1e-4, 3.0, 3.0002), ((1.5, -0.8), (1.5, 0), (-1.5, 0), (-1.5, 0.8)), [1e-4] * 3),
        ("CHAN", (2.0, 3.0, 1e-4, 2e-4), ((3, 2), (3, 0), (0, 0), (0, 2)), [2e-4, 1e-4, 2e-4]),
        (
            *("BOX1", (2.0, 3.0, 2e-4, 1e-4, 3e-4, 5e-4), ((0, 0), (0, 2), (3, 2), (3, 0), (0, 0))),
            [1e-4, 3e-4, 2e-4, 5e-4],
        ),
    ],
)
def test_shear_centres_are_where_shear_flow_twists_nothing(name, dims, points, thick):
    points = np.array(points, dtype=float)
    weight = np.linalg.norm(np.diff(points, axis=0), axis=1) * thick
    centroid = weight @ (points[:-1] + points[1:]) / (2.0 * weight.sum())
    expected = centroid - shear_flow_centre(points, thick, name == "BOX1")
    np.testing.assert_allclose(section_shape(name, list(dims)).centroid, expected, atol=1e-3)


def test_torsion_constants():
    """A rectangle by its series (Timoshenko and Goodier 1970, article 109), and thin walls."""
    long, short = 3.0, 1.0
    n = np.arange(1, 40, 2)
    exact = (
        long
        * short**3
        / 3
        * (1 - 192 * short / (np.pi**5 * long) * np.sum(np.tanh(n * np.pi * long / (2 * short)) / n**5))
    )
    assert abs(section_shape("BAR", [3.0, 1.0]).j / exact - 1.0) < 2e-3
    side, t = 2.0, 1e-4
    assert abs(section_shape("BOX", [side, side, t, t]).j / (side**3 * t) - 1.0) < 3e-4
    assert section_shape("ROD", [1.0]).j == np.pi / 2
    thin = section_shape("I", [1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3]).j
    assert abs(thin / (3 * 1e-9 / 3) - 1.0) < 2e-3
    assert abs(section_shape("BOX1", [side, side, t, t, t, t]).j / (side**3 * t) - 1.0) < 3e-4
    assert abs(section_shape("HEXA", [1e-9, 3.0, 1.0]).j / exact - 1.0) < 1e-5
    regular = section_shape("HEXA", [0.5, 2.0, 3.0**0.5]).j  # Young (1989), table 20: 1.0355 of the side^4
    assert abs(regular - 1.0355) < 1e-4


def test_two_cells_twist_together():
    """Their flows q: G J times the twist is 4 sum of area times flow, each cell's twist one (Bredt)."""
    width, height, middle = 2.0, 3.0, 0.8
    left, between, right, *covers = t = np.array([1.0, 2.0, 3.0, 1.5, 2.5, 3.5, 2.0]) * 1e-5
    spans = middle, width - middle
    own = [height / side + span * (1 / up + 1 / low) for side, span, up, low in
           zip((left, right), spans, covers[::2], covers[1::2], strict=True)]  # fmt: skip
    shared = height / between
    area = np.multiply(height, spans)
    flow = np.linalg.solve([[own[0] + shared, -shared], [-shared, own[1] + shared]], 2.0 * area)
    found = section_shape("DBOX", [width, height, middle, *t]).j
    assert abs(found / (2.0 * area @ flow) - 1.0) < 1e-4
    closed = 4.0 * (3.0 * 1.2) ** 2 / ((2 * 3.0 + 1.2) / 2e-5 + 1.2 / 3e-5)
    assert abs(section_shape("HAT1", [2.0, 3.0, 1.2, 2e-5, 3e-5]).j / closed - 1.0) < 1e-4


@pytest.mark.parametrize(
    ("name", "dims", "webs"),
    [  # lengths and thicknesses of thin walls, to the middle of those that they meet
        ("T", (2.0, 3.0, 0.02, 0.01), ((2.0, 0.02), (2.99, 0.01))),
        ("T1", (2.0, 3.0, 0.02, 0.01), ((2.0, 0.02), (3.01, 0.01))),
        ("CHAN", (2.0, 3.0, 0.01, 0.02), ((1.995, 0.02), (1.995, 0.02), (2.98, 0.01))),
        ("CHAN2", (0.02, 0.01, 2.0, 3.0), ((1.995, 0.02), (1.995, 0.02), (2.98, 0.01))),
        ("CROSS", (2.0, 0.01, 3.0, 0.02), ((3.0, 0.01), (2.01, 0.02))),
        ("H", (2.0, 0.02, 3.0, 0.01), ((3.0, 0.01), (3.0, 0.01), (2.005, 0.01))),
        ("L", (2.0, 3.0, 0.02, 0.01), ((1.995, 0.02), (2.99, 0.01))),
        ("Z", (1.0, 0.01, 3.0, 3.04), ((1.005, 0.02), (1.005, 0.02), (3.02, 0.01))),
        ("HAT", (2.0, 0.01, 1.0, 0.5), ((0.99, 0.01), (2 * 1.99, 0.01), (2 * 0.505, 0.01))),
    ],
)
def test_open_sections_twist_by_their_walls(name, dims, webs):
    expected = sum(length * t**3 for length, t in webs) / 3.0
    assert abs(section_shape(name, list(dims)).j / expected - 1.0) < 2e-3


@pytest.mark.parametrize(
    ("name", "dims"),
    [("BOX", [1.0, 1.0, 0.5, 0.1]), ("TUBE", [1.0, 1.0]), ("BAR", [1.0]), ("ROD", [-1.0]),
     ("T", [1.0, 0.1, 0.2, 0.1]), ("CHAN", [0.1, 1.0, 0.2, 0.1]), ("I", [0.2, 1.0, 2.0, 0.1, 0.1, 0.1]),
     ("BOX1", [1.0, 2.0, 0.1, 1.9, 0.1, 0.2]), ("L", [1.0, 2.0, 0.1, 1.0]), ("Z", [1.0, 0.1, 2.0, 2.0]),
     ("HAT", [1.0, 0.5, 2.0, 1.0]), ("HAT1", [1.0, 2.0, 1.0, 0.1, 0.1]),
     ("DBOX", [1.0, 2.0, 0.5, 0.4, 0.2, *[0.1] * 5]), ("HEXA", [1.0, 2.0, 1.0])],
)  # fmt: skip
def test_shapes_that_close_over_nothing(name, dims):
    with pytest.raises(ValueError, match=r"dimension|walls"):
        section_shape(name, dims)


def test_units_are_consistent_or_refused():
    assert parse_units("mm-kg-s-mN").force == pytest.approx(1e-3)
    assert parse_units("in-lbf-s").mass == pytest.approx(parse_units("in-slinch-s-lbf").mass)
    for text in ("mm-kg-s-N", "mm-s", "mm-cm-kg-s", "kg", ""):
        with pytest.raises(ConfigError):
            parse_units(text)
    steel = {"mm-t-s-N": (2.1e5, 7.85e-9), "m-kg-s-N": (2.1e11, 7850.0), "in-slinch-s-lbf": (3e7, 7.3e-4),
             "mm-kg-s-mN": (2.1e8, 7.85e-6), "mm-kg-ms-kN": (210.0, 7.85e-6)}  # fmt: skip
    for name, material in steel.items():
        assert guess_units([material], 1.0 / parse_units(name).length)[0].name == name


def test_a_deck_of_three_files_and_sections(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "a.dat").write_text(
        "include 'gone.v9'\nSOL 103\nCEND\nMPC = 701\nSPC=5\nBEGIN BULK\n"
        "INCLUDE 'sub/\n  b.blk'\nENDDATA\nrubbish\n"
    )
    (tmp_path / "sub/b.blk").write_text("GRID,1\ninclude c.blk $ beside\nGRID,2\n")
    (tmp_path / "sub/c.blk").write_bytes(b"GRID,3\r\n$ \xe9t\xe9\r\nMPC,702,1,1,1.,2,1,-1.\r\n")
    deck = read_deck(tmp_path / "a.dat")
    assert [entry.id for entry in deck.entries.of("GRID")] == [1, 3, 2]
    assert deck.selection.sets == {"MPC": {701}, "SPC": {5}}
    assert deck.selected("MPC") == []
    assert len(deck.notes) == 1
    assert "gone.v9" in deck.notes[0]
