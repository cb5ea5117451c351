"""Springs to a held grid on which nothing else stands are springs to the ground, as those with a blank GB."""

import numpy as np
import pytest
import scipy.linalg

import middeck as md
from middeck.errors import ConfigError
from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units
from middeck.structure.gravity.budget import build_budget
from middeck.structure.plants.damping import estimate_damping
from middeck.structure.rest.equilibrium import rest_warnings
from nastran_decks import turned

SI = parse_units("m-kg-s-N")
# A boom on two bungees; system 7 is turned about z, 8 is cylindrical about a line beside the boom.
BOOM = """\
MAT1,1,7.+10,,.3,2700.
PBAR,1,1,1.-4,1.-8,2.-8,2.-8
GRID,1,,-.5
GRID,2,,0.
GRID,3,,1.
CBAR,11,1,1,2,0.,1.,0.
CBAR,12,1,2,3,0.,1.,0.
CONM2,21,2,,.3,0.,0.,-.1
CORD2R,7,,0.,0.,0.,0.,0.,1.
,1.,.5,0.
CORD2C,8,,0.,-1.,0.,0.,-1.,1.
,1.,-1.,0.
PBUSH,5,K,100.,200.,1100.,1.,2.,.5
PBUSH,6,K,100.,200.,1100.
GRAV,30,,9.81,0.,0.,-1.
"""
HERE = "GRID,901,,-.5\nGRID,902,,1.\n"
ABOVE = "GRID,901,,-.5,0.,2.\nGRID,902,,1.,0.,2.\n"
BLANK = "CBUSH,31,5,1,,,,,7\nCBUSH,32,5,3,,,,,0\n"
TO_GRIDS = "CBUSH,31,5,1,901,,,,7\nCBUSH,32,5,3,902,,,,0\n"
SPC1 = "SPC1,1,123456,901,902\n"


def convert(tmp_path, *more):
    path = tmp_path / "a.dat"
    case = ["SPC = 1"] if any("SPC" in text for text in more) else []
    path.write_text("\n".join(["SOL 103", "CEND", *case, "BEGIN BULK", BOOM, *more, "ENDDATA", ""]))
    return convert_deck(read_deck(path), SI, "consistent", "a")


def setup(tmp_path, made):
    paths = [tmp_path / "article.toml", tmp_path / "environment.toml"]
    for path, document in zip(paths, (made.document, made.environment), strict=True):
        path.write_text(document_text(document, "a"))
    return md.load_setup(*paths)


def alike(a, b):
    """Whether two documents have the same tables, with numbers to rounding."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(alike(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)) and a and not isinstance(a[0], (float, int)):
        return len(a) == len(b) and all(map(alike, a, b))
    if isinstance(a, (str, bool)):
        return a == b
    return np.allclose(a, b, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    "cards",
    [
        HERE + TO_GRIDS + SPC1,
        HERE + TO_GRIDS + "SPC,1,901,123456,0.,902,123456\n",
        HERE + TO_GRIDS + "SPC1,1,123,901,902\nSPC1,1,456,901,THRU,902\n",
        HERE.replace("-.5", "-.5,0.,0.,0,123456").replace(",1.\n", ",1.,,,,123456\n") + TO_GRIDS,
        "GRID,901,,-.5,0.,0.,8\nGRID,902,,1.,0.,0.,7\n" + TO_GRIDS + SPC1,
        HERE + "CBUSH,31,5,901,1,,,,7\nCBUSH,32,5,902,3,,,,0\n" + SPC1,  # the ground first
        ABOVE + "CBUSH,31,5,1,901,,,,7\n,0.\nCBUSH,32,5,3,902,,,,0\n,0.\n" + SPC1,
        ABOVE + "CBUSH,31,5,901,1,,,,7\n,1.\nCBUSH,32,5,902,3,,,,0\n,1.\n" + SPC1,
        # A frame that the ground holds at one grid.
        "GRID,900,,9.,9.,9.\n" + HERE + TO_GRIDS + "RBE2,40,900,123456,901,902\nSPC1,1,123456,900\n",
        HERE + TO_GRIDS + SPC1 + "FORCE,30,901,,1.,0.,0.,1.\n",  # it pushes the ground
    ],
)
def test_a_spring_to_a_held_grid_is_one_with_a_blank_grid(tmp_path, cards):
    blank, made = convert(tmp_path, BLANK), convert(tmp_path, cards)
    assert alike(made.document, blank.document)
    assert alike(made.environment, blank.environment)
    assert made.converted["springs to the ground"] == 2
    (note,) = [note for note in made.notes if "bush31" in note]
    assert "'bush31', 'bush32'" in note
    assert "springs to the ground" in note


def test_a_spring_between_held_grids_is_left_out_by_name(tmp_path):
    made = convert(tmp_path, HERE, TO_GRIDS, SPC1, "CBUSH,33,5,901,902,,,,0\nCBUSH,34,5,902,,,,,0")
    assert alike(made.environment, convert(tmp_path, BLANK).environment)
    (to_ground,) = [note for note in made.notes if "springs to the ground" in note]
    (left_out,) = [note for note in made.notes if "left out" in note]
    assert to_ground.startswith("'bush31', 'bush32': ")
    assert left_out == "'bush33', 'bush34': left out, SPC or PS hold all of its ends"


def test_what_a_spring_does_not_resist_need_not_be_held(tmp_path):
    """Without K4 to K6 a grid at the elastic point that may turn is as good as one that may not."""
    springs = TO_GRIDS.replace(",5,", ",6,")
    made = convert(tmp_path, HERE, springs, "SPC1,1,123,901,902")
    assert alike(made.environment, convert(tmp_path, BLANK.replace(",5,", ",6,")).environment)
    # In axes of the grid that lie across those of the spring, and with the elastic point off the grid.
    for grids, held in ((HERE, "123"), (HERE, "12456"), (ABOVE, "123")):
        which = TO_GRIDS if held == "123" and grids is HERE else springs
        made = convert(tmp_path, grids, which, f"SPC1,1,{held},901,902")
        assert made.converted["springs to the ground"] == 0
        (note,) = [note for note in made.notes if "bush31" in note]
        assert "'bush31', 'bush32': SPC or PS hold only part of what they resist at grid '901', '902'" in note


@pytest.mark.parametrize(
    "more",
    [
        "CONM2,22,901,,.1",
        "GRID,903,,-.5,1.\nCBAR,13,1,901,903,0.,0.,1.\nSPC1,1,123456,903",
        "GRID,903,,-.5,0.,1.\nRBE2,40,901,123456,903\nCONM2,22,903,,.1",
        "GRID,903,,-.5,0.,1.\nCONM2,22,903,,.1\nRBE2,40,901,123,903",
    ],
)
def test_a_held_grid_with_more_than_springs_stays_in_the_article(tmp_path, more):
    made = convert(tmp_path, HERE, TO_GRIDS, SPC1, more)
    assert [row["name"] for row in made.document["bushing"]] == ["bush31"]
    assert [row["name"] for row in made.environment["bushing"]] == ["bush32"]
    (note,) = [note for note in made.notes if "bush31" in note]
    assert "'bush31': SPC or PS hold grid '901', where more than springs stands" in note


@pytest.mark.parametrize(
    ("stiffness", "is_felt"),
    [("1.+5,1.+3,1.+5,.3,9.,90.", True), ("1.+5,1.+5,1.+5,.3,9.,90.", False)],
)
def test_axes_that_turn_with_the_first_grid_are_named_where_that_is_felt(tmp_path, stiffness, is_felt):
    """A body whose centre lies beside a soft hinge rolls over; the other grid is held, with a mass on it."""
    reported, hz = [], []
    for first, last in ((1, 2), (2, 1)):
        cards = ["GRID,1", "GRID,2", "CONM2,11,1,,1.,0.,.1,0.\n,.1,,.2,,,.3", "CONM2,12,2,,1."]
        cards += [f"PBUSH,5,K,{stiffness}", f"CBUSH,31,5,{first},{last},,,,0"]
        cards += ["SPC1,1,123456,2", "GRAV,30,,9.81,0.,0.,-1."]
        path = tmp_path / "a.dat"
        path.write_text("\n".join(["SOL 103", "CEND", "SPC = 1", "BEGIN BULK", *cards, "ENDDATA", ""]))
        rest = md.solve_equilibrium(*setup(tmp_path, convert_deck(read_deck(path), SI, "consistent", "a")))
        message = "with its first frame 'g1', while its second, 'g2', stayed"
        reported.append(any(message in text for text in rest_warnings(rest)))
        assert any("the article turned by" in text for text in rest_warnings(rest))
        hz.append(md.solve_modes(rest).frequency_hz)
    assert reported == [is_felt, False]
    assert np.allclose(*hz, rtol=1e-6, atol=0.0) != is_felt


def test_springs_that_alone_join_the_deck_stay_in_it(tmp_path):
    """Two bodies that only a held grid joins: without it they would be two structures."""
    cards = [HERE, TO_GRIDS, SPC1, "GRID,4,,-.6", "CONM2,22,4,,.1", "CBUSH,33,5,4,901,,,,0"]
    made = convert(tmp_path, *cards)
    assert [row["name"] for row in made.document["bushing"]] == ["bush31", "bush33"]
    assert [row["name"] for row in made.environment["bushing"]] == ["bush32"]
    assert any("'bush31', 'bush33': SPC or PS hold grid '901', which alone joins" in n for n in made.notes)
    setup(tmp_path, made)


def test_a_spring_between_held_grids_is_left_out(tmp_path):
    made = convert(tmp_path, HERE, TO_GRIDS, SPC1, "CBUSH,33,5,901,902,,,,0")
    assert alike(made.environment, convert(tmp_path, BLANK).environment)


@pytest.mark.parametrize(
    ("cards", "held"),
    [
        ("CBUSH,33,5,903,904,,,,0", "123456"),
        ("CBUSH,33,6,903,904,,,,0", "123"),  # all that it resists
        ("CBUSH,33,5,903,,,,,0", "123456"),
        ("CELAS2,33,100.,903,1,904,1", "123456"),
        ("CELAS2,33,100.,903,1", "1"),
        ("CBUSH,33,5,903,904,,,,0\nFORCE,30,903,,1.,0.,0.,1.", "123456"),
        ("CBUSH,33,5,905,904,,,,0\nGRID,905,,3.\nRBE2,40,903,123456,905", "123456"),
    ],
)
def test_a_spring_that_the_ground_holds_at_both_ends_is_no_second_structure(tmp_path, cards, held):
    """It does nothing, whatever else stands in the deck."""
    grids = f"GRID,903,,2.\nGRID,904,,2.\nSPC1,1,{held},903,904\n"
    for here, springs in ((HERE + SPC1, TO_GRIDS), ("", BLANK)):
        made, bare = convert(tmp_path, here, springs, grids, cards), convert(tmp_path, here, springs)
        assert alike(made.document, bare.document)
        assert alike(made.environment, bare.environment)
        row = (cards.partition(",")[0], 1, "no stiffness, or the ground holds all of its ends")
        assert row in made.left_out


def test_a_deck_of_which_the_ground_holds_everything_is_refused(tmp_path):
    cards = ["GRID,1", "GRID,2,,1.", "PBUSH,5,K,1.,1.,1.", "CBUSH,3,5,1,2,,,,0", "SPC1,1,123456,1,2"]
    path = tmp_path / "a.dat"
    path.write_text("\n".join(["SOL 103", "CEND", "SPC = 1", "BEGIN BULK", *cards, "ENDDATA", ""]))
    with pytest.raises(ConfigError, match="the ground holds all"):
        convert_deck(read_deck(path), SI, "consistent", "a")


def test_a_spring_between_the_ground_and_a_held_member_is_one_to_the_ground(tmp_path):
    """It does nothing while the clamp holds, and is named once."""
    member = "GRID,4,,-.5,.5\nCBAR,14,1,1,4,0.,0.,1.\nSPC1,1,123456,4\n"
    made = convert(tmp_path, HERE, TO_GRIDS, SPC1, member, "CBUSH,35,5,4,901,,,,0")
    assert [row["name"] for row in made.environment["bushing"]] == ["bush31", "bush32", "bush35"]
    assert sum("bush35" in note for note in made.notes) == 1
    held = md.solve_modes(md.solve_equilibrium(*setup(tmp_path, made)), 3)
    without = convert(tmp_path, HERE, TO_GRIDS, SPC1, member)
    same = md.solve_modes(md.solve_equilibrium(*setup(tmp_path, without)), 3)
    np.testing.assert_allclose(held.frequency_hz, same.frequency_hz, rtol=1e-9)


def test_a_load_on_a_grid_with_nothing_is_still_refused(tmp_path):
    with pytest.raises(ConfigError, match="grid 903 has no element or mass"):
        convert(tmp_path, HERE, TO_GRIDS, SPC1, "GRID,903", "FORCE,30,903,,1.,1.")


@pytest.mark.parametrize("seed", range(3))
def test_frequencies_are_those_of_a_body_on_springs(tmp_path, seed):
    """K and M (6, 6) by hand: axes by CID or orientation, elastic points by S or OCID, either order."""
    rng = np.random.default_rng([41, seed])
    lines, K = ["CONM2,1,1,,2.,.1,0.,0.", ",.3,,.4,,,.5", "GRID,1"], np.zeros((6, 6))
    for k in range(3):
        ends = rng.uniform(-1.0, 1.0, (2, 3))
        values, s = 10.0 ** rng.uniform(3, 4, 6), float(rng.choice([0.0, 0.3, 1.0]))
        first, last = ((10 + k, 20 + k), (20 + k, 10 + k))[k % 2]
        a, b = ends if k % 2 == 0 else ends[::-1]
        axes, point, rest = turned(rng), a + s * (b - a), f",.0,.0,.0,{k + 1}"
        if seed == 1:
            point = a + axes @ [0.1, -0.2, 0.3]
            rest += f"\n,.5,{k + 1},.1,-.2,.3"
        elif seed == 2:
            x, up = (b - a) / np.linalg.norm(b - a), rng.standard_normal(3)
            z = np.cross(x, up) / np.linalg.norm(np.cross(x, up))
            axes, rest = np.column_stack([x, np.cross(z, x), z]), "," + ",".join(map(repr, up.tolist()))
            rest += f"\n,{s!r}"
        else:
            rest += f"\n,{s!r}"
        rest = rest.replace(",.0,.0,.0", ",,,")
        points = np.concatenate([a, a + axes[:, 2], a + axes[:, 0]]).tolist()
        shown = [",".join(map(repr, part)) for part in (points[:6], points[6:], *ends.tolist())]
        lines += [f"CORD2R,{k + 1},0,{shown[0]}", f",{shown[1]}"]
        lines += [
            f"GRID,{10 + k},,{shown[2]}",
            f"GRID,{20 + k},,{shown[3]}",
            f"RBE2,{50 + k},1,123456,{10 + k}",
        ]
        lines += [f"PBUSH,{30 + k},K,{','.join(map(repr, values.tolist()))}"]
        lines += [f"CBUSH,{30 + k},{30 + k},{first},{last}{rest}", f"SPC1,1,123456,{20 + k}"]
        carried = np.eye(6)
        carried[:3, 3:] = np.cross(np.eye(3), point)
        turn = np.kron(np.eye(2), axes).T @ carried
        K += turn.T @ np.diag(values) @ turn
    path = tmp_path / "a.dat"
    path.write_text("\n".join(["SOL 103", "CEND", "SPC = 1", "BEGIN BULK", *lines, "ENDDATA", ""]))
    made = convert_deck(read_deck(path), SI, "consistent", "a")
    shift = np.cross(np.eye(3), [0.1, 0.0, 0.0])
    M = np.diag([2.0, 2.0, 2.0, 0.3, 0.4, 0.5])
    M[:3, 3:], M[3:, :3], M[3:, 3:] = 2.0 * shift, 2.0 * shift.T, M[3:, 3:] + 2.0 * shift.T @ shift
    body, hung = setup(tmp_path, made)
    modes = md.solve_modes(md.solve_equilibrium(body, hung), 6)
    expected = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)) / (2.0 * np.pi)
    np.testing.assert_allclose(modes.frequency_hz, expected, rtol=1e-9)
    assert set(modes.kind) == {"suspension"}


def test_the_modes_of_a_boom_on_such_springs_are_those_of_a_suspension(tmp_path):
    made = convert(tmp_path, HERE, TO_GRIDS, SPC1)
    boom, bungees = setup(tmp_path, made)
    hung = md.solve_modes(md.solve_equilibrium(boom, bungees), 8)
    free = md.solve_modes(md.solve_equilibrium(boom, md.Environment.orbit()), 8)
    assert hung.kind == ("suspension",) * 6 + ("flexible",) * 2
    assert free.kind == ("rigid",) * 6 + ("flexible",) * 2
    assert not any("bush" in name for name in hung.name)
    np.testing.assert_allclose(estimate_damping(hung).zeta[:6], boom.damping.suspension, rtol=0.05)
    budget = build_budget(free, hung, 8)
    np.testing.assert_allclose(budget.frequency_hz[6:, 0], free.frequency_hz[6:], rtol=1e-9)
    assert np.all(budget.share_hz[:6, 0] > 0.1)


def test_an_elastic_point_on_a_grid_to_rounding_turns_nothing(tmp_path):
    """S of 1 at a grid that is held but for one turn: what rounding leaves of an arm is no stiffness."""
    cards, K, values = ["GRID,1", "CONM2,1,1,,2.,,,,\n,.3,,.4,,,.5"], np.zeros((6, 6)), [500.0, 400.0, 600.0]
    a, b = np.array([-0.80991, -0.27974, -0.81585]), np.array([-0.15645, -0.01633, 0.81848])
    other = np.array([0.5, -0.25, 0.4])
    assert np.any(a + 1.0 * (b - a) != b)
    cards += [f"GRID,10,,{','.join(map(repr, a.tolist()))}", f"GRID,200,,{','.join(map(repr, b.tolist()))}"]
    cards += [f"GRID,11,,{','.join(map(repr, other.tolist()))}", "RBE2,40,1,123456,10,11"]
    cards += ["PBUSH,5,K,500.,400.,600.", "CBUSH,31,5,10,200,,,,0\n,1.", "SPC1,1,1356,200"]
    cards += ["PBUSH,6,K,500.,400.,600.,70.,80.,90.", "CBUSH,32,6,11,,,,,0"]
    for point, law in ((b, [*values, 0.0, 0.0, 0.0]), (other, [*values, 70.0, 80.0, 90.0])):
        carried = np.eye(6)
        carried[:3, 3:] = np.cross(np.eye(3), point)
        if point is b:  # grid 200 gives way along y
            law = [500.0, 0.0, 600.0, 0.0, 0.0, 0.0]
        K += carried.T @ np.diag(law) @ carried
    path = tmp_path / "a.dat"
    path.write_text("\n".join(["SOL 103", "CEND", "SPC = 1", "BEGIN BULK", *cards, "ENDDATA", ""]))
    made = convert_deck(read_deck(path), SI, "consistent", "a")
    assert any("nothing holds rotations of grid '200'" in note for note in made.notes)
    modes = md.solve_modes(md.solve_equilibrium(*setup(tmp_path, made)), 6)
    M = np.diag([2.0, 2.0, 2.0, 0.3, 0.4, 0.5])
    expected = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)) / (2.0 * np.pi)
    np.testing.assert_allclose(modes.frequency_hz, expected, rtol=1e-9)
