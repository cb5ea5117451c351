"""Decks that join superelements, written otherwise or damaged: the same components, or a refusal."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cli_runner import ROOT, middeck
from middeck.errors import ConfigError
from middeck.files.nastran.components.assembly import read_assembly
from middeck.files.nastran.deck.units import parse_units
from middeck.files.nastran.output4.matrices import op4_by_name, write_op4

FOLDER, MAIN = ROOT / "data" / "nastran-superelement", "assemble.dat"
UNITS = parse_units("mm-kg-s-mN")
OUTER = "INCLUDE 'outboard.pch'"
POINTS = "SPOINT   1995017"
PAIRS = "       3       3      11      11"


def copied(folder: Path, *edits: tuple[str, str, str]) -> Path:
    shutil.copytree(FOLDER, folder, dirs_exist_ok=True)
    for file, old, new in edits:
        text = (folder / file).read_text()
        assert old in text
        (folder / file).write_text(text.replace(old, new, 1))
    return folder / MAIN


def in_a_folder(folder: Path) -> Path:
    """The second file lies in another folder, with the one that includes it by its own name."""
    main = copied(folder, (MAIN, OUTER, "INCLUDE 'parts/all.blk'"))
    (folder / "parts").mkdir()
    (folder / "outboard.pch").rename(folder / "parts" / "outboard.pch")
    (folder / "parts" / "all.blk").write_text(OUTER + "\n")
    return main


ALIKE: dict[str, Callable[[Path], Path]] = {
    "BEGIN BULK SUPER": lambda f: copied(f, ("outboard.pch", "\nBEGIN SUPER  ", "\nBEGIN BULK SUPER = ")),
    "a path over two lines": lambda f: copied(f, (MAIN, OUTER, "INCLUDE 'out\n   board.pch' $ here")),
    "no quotes, a comment": lambda f: copied(f, (MAIN, OUTER, "include outboard.pch $ here")),
    "beside the file that includes it": in_a_folder,
}


@pytest.mark.parametrize("name", ALIKE)
def test_other_writings_are_the_same_deck(name: str, tmp_path: Path) -> None:
    deck, parts = read_assembly(ALIKE[name](tmp_path / "a"), UNITS, "a")
    reported, known = read_assembly(copied(tmp_path / "b"), UNITS, "a")
    assert deck.cards == reported.cards
    for file, part in known.items():
        np.testing.assert_array_equal(parts[file].stiffness, part.stiffness)
        assert parts[file].frames == part.frames


@pytest.mark.parametrize(
    ("edits", "message"),
    [
        ([(MAIN, "INCLUDE 'inboard.pch'\n\nENDDATA\n", "")], r"there is no BEGIN SUPER"),
        ([(MAIN, "INCLUDE 'inboard.pch'\n\nENDDATA\n", "GRID")], r"dat:\d+: the file ends within this line"),
        ([(MAIN, OUTER, "INCLUDE 'gone.pch'")], r"assemble\.dat:\d+: INCLUDE = gone\.pch: there is no such"),
        ([("outboard.asm", PAIRS, f"{PAIRS}\nINCLUDE 'gone.blk'")], r"\.asm:\d+: INCLUDE = gone\.blk: there"),
        ([(MAIN, OUTER, f"{OUTER}\nBEGIN SUPER=ALL")], r"BEGIN SUPER=ALL"),
        ([(MAIN, OUTER, f"INCLUDE '{'x' * 300}'")], r"assemble\.dat:\d+: INCLUDE = x+: there is no such"),
        ([("outboard.pch", POINTS, f"ENDDATA\n{POINTS}")], "this file has an ENDDATA, and cards"),
        ([("outboard.pch", POINTS, f"{OUTER}\n{POINTS}")], "includes itself"),
    ],
)  # fmt: skip
def test_a_deck_that_is_not_whole_is_refused(
    edits: list[tuple[str, str, str]], message: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=message):
        read_assembly(copied(tmp_path / "a", *edits), UNITS, "a")


def test_grids_that_are_joined_elsewhere_write_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    crossed = "       3      11      11       3"
    main = copied(tmp_path / "a", ("outboard.asm", PAIRS, crossed))
    target = tmp_path / "a" / "made.toml"
    ended = middeck(capfd, "convert", main, "--units", "mm-kg-s-mN", "-o", target)
    assert ended.code == 2
    assert "grid 11 stands 0.6 m from frame 'g3'" in ended.err
    assert not target.exists()
    assert not list(tmp_path.glob("**/made*"))


@pytest.mark.parametrize("factor", [1.0, 386.1])
def test_modal_masses_that_are_no_mass_of_the_deck_are_reported(tmp_path: Path, factor: float) -> None:
    main = copied(tmp_path / "a")
    path = main.with_name("outboard.op4")
    held = op4_by_name(path)
    scaled = [m._replace(value=m.value * (factor if m.name == "MXX" else 1.0)) for m in held.values()]
    write_op4(path, scaled)
    deck, _ = read_assembly(main, UNITS, "a")
    warnings = [note for note in deck.notes if "modal masses" in note]
    assert bool(warnings) == (factor != 1.0)
    assert not warnings or "se101 has modal masses of 386.1, Nastran writes 1" in warnings[0]


BY_PLACE = (
    ("outboard.asm", "MANUAL", "AUTO  "),
    ("outboard.asm", f"{PAIRS}      19      19      27      27", "         1995001 1995001"),
)
THIRD = "GRID*                  3"
TWIN = ("outboard.asm", THIRD, f"GRID          99            600.      0.    300.\n{THIRD}")


@pytest.mark.parametrize(
    ("edits", "message"),
    [
        ((TWIN,), "boundary grid 3 stands at several grids: (3, 99|99, 3)"),
        ((("outboard.asm", "AUTO          ", "AUTO         x"),), r"TOL = X is no distance"),
        ((("outboard.asm", "AUTO          ", "AUTO       -1."),), r"TOL = -1\. is no distance"),
        (
            (("outboard.asm", "AUTO          ", "AUTO      400."),),
            "boundary grid 3 stands at several grids",
        ),
    ],
)
def test_places_that_tell_no_one_grid_are_refused(
    edits: tuple[tuple[str, str, str], ...], message: str, tmp_path: Path
) -> None:
    """The grids of the main bulk data are 300 mm apart."""
    _, parts = read_assembly(copied(tmp_path / "a", *BY_PLACE), UNITS, "a")
    assert parts["a-se101.npz"].frames == ("g3", "g11", "g19", "g27")
    with pytest.raises(ConfigError, match=message):
        read_assembly(copied(tmp_path / "b", *BY_PLACE, *edits), UNITS, "a")


def test_a_grid_beside_the_place_is_not_at_it(tmp_path: Path) -> None:
    """TOL is 1e-5 mm, of the digits that places may lack 0.03 mm: the grid at the place itself is meant."""
    beside = ("outboard.asm", THIRD, f"GRID,99,,600.02,0.,300.\n{THIRD}")
    _, parts = read_assembly(copied(tmp_path / "a", *BY_PLACE, beside), UNITS, "a")
    assert parts["a-se101.npz"].frames == ("g3", "g11", "g19", "g27")
    wide = ("outboard.asm", "AUTO          ", "AUTO      0.05")
    with pytest.raises(ConfigError, match="boundary grid 3 stands at several grids"):
        read_assembly(copied(tmp_path / "b", *BY_PLACE, beside, wide), UNITS, "a")


@pytest.mark.parametrize(("far", "stays"), [(30.0, True), (60.0, False)])
def test_one_grid_apart_moves_no_component_in_silence(tmp_path: Path, far: float, stays: bool) -> None:
    """Within TOL the three others stay where they are (the mean moved all); beyond it the move is told."""
    edits = [
        (f"{name}.asm", old, new)
        for name in ("inboard", "outboard")
        for old, new in (
            (" 0.600000000E+03 0.000000000E+00", f" 0.{600 + int(far)}000000E+03 0.000000000E+00"),
            ("MANUAL        ", "MANUAL     50."),
        )
    ]
    deck, parts = read_assembly(copied(tmp_path / "a", *edits), UNITS, "a")
    reported, offsets = " ".join(deck.notes), parts["a-se101.npz"].fixed_at
    assert stays == ("se101 is moved" not in reported)
    assert stays == (np.count_nonzero(np.linalg.norm(offsets, axis=1)) == 1)
    assert f"over a distance of {far if stays else 0.75 * far:.2g} (" in reported


def test_a_component_that_its_grids_take_elsewhere_is_reported(tmp_path: Path) -> None:
    away = [("outboard.pch", "0.600000000E+03 ", "0.500000000E+03 ")] * 4
    deck, parts = read_assembly(copied(tmp_path / "a", *away), UNITS, "a")
    assert "se101 is moved by (100, 0, 0)" in " ".join(deck.notes)
    assert not np.any(parts["a-se101.npz"].fixed_at)
