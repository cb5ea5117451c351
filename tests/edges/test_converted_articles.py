"""What somebody meets with an article of their own: told before a number misleads."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import middeck as md
from cli_runner import middeck
from middeck.cli.shown.screen import WITHOUT, ScreenTable
from middeck.cli.verbs import compare
from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units
from middeck.structure.correlation.measured_modes import measure_modes, sensor_rows
from middeck.structure.correlation.placing import place_channels

TEXT = """\
schema = 1
name = "tower"
wheel_node = "top"
[section.tube]
EA_n = 1e6
GJ_nm2 = 80.0
EI_y_nm2 = 100.0
EI_z_nm2 = 110.0
rho_A_kg_per_m = 0.5
[[node]]
name = "foot"
x_m = 0.0
mass_kg = 2.0
inertia_kg_m2 = [0.02, 0.02, 0.02]
[[node]]
name = "top"
x_m = 0.0
z_m = 1.0
mass_kg = 1.0
inertia_kg_m2 = [0.01, 0.01, 0.01]
[[strut]]
from = "foot"
to = "top"
section = "tube"
[[attach]]
name = "g7"
frame = "top"
offset_m = [0.2, 0.1, 0.0]
[[attach]]
name = "g8"
frame = "top"
offset_m = [-0.2, 0.1, 0.1]
[[attach]]
name = "g9"
frame = "foot"
offset_m = [0.0, 0.3, 0.0]
"""


@pytest.fixture
def tower(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """In a folder without environments."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "tower.toml"
    file.write_text(TEXT)
    return file


def test_the_laboratory_of_nobody_says_where_it_hangs_an_article(
    tower: Path, capfd: pytest.CaptureFixture[str]
):
    """The article does not say where it hangs: the default takes every attach point."""
    message = middeck(capfd, "modes", tower).err
    assert "hangs this article by every attach point ('g7', 'g8', 'g9')" in message
    chosen = tower.with_name("chosen.toml")
    own = '[suspension]\nnodes = ["top"]\noffsets_m = [[0.0, 0.0, 0.0]]\n[[attach]]'
    chosen.write_text(TEXT.replace("[[attach]]", own, 1))
    assert "every attach point" not in middeck(capfd, "modes", chosen).err
    assert "every attach point" not in middeck(capfd, "modes", tower, "--environment", "orbit").err
    slack = tower.with_name("slack.toml")
    slack.write_text(
        TEXT.replace("[-0.2, 0.1, 0.1]", "[0.3, 0.1, 0.1]").replace("[0.0, 0.3, 0.0]", "[0.5, 0.3, 0.0]")
    )
    refused = middeck(capfd, "modes", slack)
    assert refused.code != 0
    assert refused.err.count("the default environment") == 1


@pytest.mark.parametrize(
    ("asked", "is_default"),
    [((), True), (("--environment", "lab"), False), (("--environment=lab",), False)],
)
def test_an_environment_that_was_typed_is_not_called_the_default(
    tower: Path, capfd: pytest.CaptureFixture[str], asked: tuple[str, ...], is_default: bool
):
    """In the warning on where it hangs, and in the hint of what cannot be solved there."""
    slack = tower.with_name("slack.toml")
    slack.write_text(
        TEXT.replace("[-0.2, 0.1, 0.1]", "[0.3, 0.1, 0.1]").replace("[0.0, 0.3, 0.0]", "[0.5, 0.3, 0.0]")
    )
    for article in (tower, slack):
        message = middeck(capfd, "modes", article, *asked).err
        assert ("'lab', the default environment," in message) == is_default
        assert ("'lab', the built-in environment," in message) != is_default


def test_the_laboratory_stands_where_nobody_made_one(tower: Path, capfd: pytest.CaptureFixture[str]):
    """Outside the project its name is enough, and it is the default."""
    for asked, place, held in (
        ((), "lab", "suspension"),
        (("--environment", "lab"), "lab", "suspension"),
        (("--environment", "orbit"), "orbit", "rigid"),
    ):
        ended = middeck(capfd, "modes", tower, "--count", 9, *asked, "--json")
        assert ended.code == 0, ended.err
        found = json.loads(ended.out)
        assert (found["environment"], found["kind"]) == (place, [held] * 6 + ["flexible"] * 3)
        shown = [w for w in found["warnings"] if "hangs this article by every attach point" in w]
        assert len(shown) == (place == "lab")


def test_every_verb_says_that_an_article_hangs_far_from_level(capfd: pytest.CaptureFixture[str]):
    """The offset that levels the simple article taken away (`middeck level`)."""
    article = ("articles/mace-simple.toml", "--environment", "lab")
    assert "tilted by" in middeck(capfd, "modes", *article, "--set", "suspension.offsets.0.2=0").err
    assert "tilted by" not in middeck(capfd, "modes", *article).err


def test_a_sensor_may_stand_on_an_attach_point(tower: Path):
    modes = md.solve_modes(md.solve_equilibrium(md.load_structure(tower), md.Environment.orbit()))
    turn = sensor_rows(modes, ["top"] * 6, ["x", "y", "z", "rx", "ry", "rz"]) @ modes.shapes
    offset = np.array([0.2, 0.1, 0.0])
    by_hand = turn[:3] + np.cross(turn[3:].T, offset).T
    np.testing.assert_allclose(
        sensor_rows(modes, ["g7"] * 3, ["x", "y", "z"]) @ modes.shapes, by_hand, atol=1e-12
    )
    seen = measure_modes(modes, [("g7", "x"), ("g8", "y"), ("top", "z"), ("foot", "x")])
    numbered = md.MeasuredModes(
        frequency_hz=seen.frequency_hz, damping=seen.damping, node=("1", "2", "3", "4"),
        direction=seen.direction, shape=seen.shape, position_m=seen.position_m,
    )  # fmt: skip
    assert place_channels(modes.equilibrium.model, numbered).node == ("g7", "g8", "top", "foot")


def test_a_deck_in_place_of_an_article_is_called_one(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    deck = tmp_path / "a.bdf"
    deck.write_text("SOL 103\nCEND\nBEGIN BULK\nGRID,1\nENDDATA\n")
    ended = middeck(capfd, "modes", deck)
    assert ended.code == 2
    assert "a Nastran deck" in ended.err
    assert f"middeck convert {deck}" in ended.err


def test_points_that_strain_the_article_are_distinguished_from_a_slack_cable(
    tower: Path, capfd: pytest.CaptureFixture[str]
):
    """Three points within 0.2 mm of each other on one body, all held."""
    near = TEXT.replace("[-0.2, 0.1, 0.1]", "[0.2, 0.1001, 0.0]").replace(
        "[0.0, 0.3, 0.0]", "[0.2, 0.1002, 0.0]"
    )
    tower.write_text(near)
    message = middeck(capfd, "modes", tower).err
    assert "held, the points strain the article between them" in message


def test_the_report_of_a_deck_names_defaults_and_whose_choice_they_are(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    """Damping of an article without [damping]; gravity that no LOAD selects; which grids the size is of."""
    cards = ["GRID,1", "GRID,2,,1.", "MAT1,1,7.+10,,.3,2700.", "PBAR,1,1,1.-4,1.-8,2.-8,2.-8"]
    cards += ["CBAR,1,1,1,2,0.,1.,0.", "SPC1,1,123456,1", "GRAV,3,,9.81,0.,0.,-1."]
    for case, reported in (([], True), (["LOAD = 3"], False)):
        deck = tmp_path / "a.dat"
        deck.write_text("\n".join(["SOL 103", "CEND", "SPC = 1", *case, "BEGIN BULK", *cards, "ENDDATA", ""]))
        out = middeck(capfd, "convert", deck, "--units", "m-kg-s-N").out
        assert (
            "load set '3', 9.81 m/s^2 along [0.0, 0.0, -1.0], though case control selects no LOAD" in out
        ) == reported
        assert "damping      1% of strain, 3% of suspension and weight: defaults" in out
        assert "size         1  0  0 m, box of nodes and boundary grids of components" in out
    written = tmp_path / "a.toml"
    middeck(
        capfd, "convert", deck, "--units", "m-kg-s-N", "-o", written, "--environment", tmp_path / "e.toml"
    )
    article = md.load_structure(written)
    assert article.up.tolist() == [0.0, 0.0, 1.0]
    damping = article.damping
    assert (damping.flexible, damping.suspension) == (0.01, 0.03)


@pytest.mark.parametrize(
    ("case", "loads", "up"),
    [
        (["LOAD = 20"], "", [0.0, 0.0, 1.0]),
        (["LOAD = 30"], "LOAD,30,1.,2.,20", [0.0, 0.0, 1.0]),
        ([], "", None),
        (["LOAD = 40"], "FORCE,40,2,,1.,1.", None),
    ],
)
def test_up_is_against_the_gravity_that_is_converted(tmp_path: Path, case, loads, up) -> None:
    """A deck may have an acceleration of launch before its weight: of several none is down by itself."""
    cards = ["GRID,1", "GRID,2,,1.", "MAT1,1,7.+10,,.3,2700.", "PBAR,1,1,1.-4,1.-8,2.-8,2.-8"]
    cards += ["CBAR,1,1,1,2,0.,1.,0.", "SPC1,1,123456,1", "GRAV,10,,98.,1.", "GRAV,20,,9.81,0.,0.,-1.", loads]
    deck = tmp_path / "a.dat"
    deck.write_text("\n".join(["SOL 103", "CEND", "SPC = 1", *case, "BEGIN BULK", *cards, "ENDDATA", ""]))
    document = convert_deck(read_deck(deck), parse_units("m-kg-s-N"), "consistent", "a").document
    assert document.get("up") == up
    assert (f"\nup = {up}\n" in document_text(document, "a")) == (up is not None)


@pytest.mark.parametrize(("cost", "marked"), [([0.12, 0.0, 0.03], True), ([0.0] * 3, False)])
def test_a_comparison_marks_every_mode_that_lacks_geometric_stiffness(cost, marked) -> None:
    """Those of the suspension too, and the note stands where a column does."""
    kinds = {"orbit": ["rigid", "rigid", "flexible"], "lab": ["suspension", "suspension", "flexible"]}
    sides = {
        side: {"kind": kind, "name": ["a", "b", "c"], "frequency_hz": [1.0, 2.0, 3.0]}
        for side, kind in kinds.items()
    }
    document = sides | {"article": "a", "environment": "lab", "pairs": [(2, 2)], "ratio": [1.0]}
    document |= {"matrix": np.eye(3), "mac": np.eye(3), "left_out_stiffness": cost, "clamped": []}
    document |= {"gravity_m_s2": 9.81, "subspace_angle_deg": [], "unpaired": {"orbit": [], "lab": []}}
    tables = compare._tables(document)
    _, hung, pairs = (part for part in tables if isinstance(part, ScreenTable))
    shown = [["12 %", ""], ["3 %"]] if marked else [["a", "b"], ["c"]]
    assert [[row[-1] for row in table.rows] for table in (hung, pairs)] == shown
    assert (WITHOUT in tables) == marked
