"""Pins of a bar (PA, PB) are in its element coordinates, also where its principal axes are others (I12)."""

import numpy as np
import pytest
import scipy.linalg

import middeck as md
from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units

E, L, M = 7e10, 1.25, 2.0
ALL = "123456"


@pytest.mark.parametrize(("pin", "free"), [(6, 0), (5, 1)])
def test_a_pin_is_about_the_axis_of_the_element_not_the_principal_one(tmp_path, pin, free):
    """A mass on a guided end: 12 B / L^3 less what the slope of one plane gives way at the pin."""
    second = np.array([[3e-8, 1e-8], [1e-8, 2e-8]])
    rows = [
        *("SOL 103", "CEND", "SPC = 1", "BEGIN BULK", f"MAT1,1,{E:.1e},,.3", f"GRID,1\nGRID,2,,{L},0.,0."),
        f"PBAR,1,1,2.-4,{second[0, 0]:.1e},{second[1, 1]:.1e},3.-8\n,\n,,,{second[0, 1]:.1e}",
        f"CBAR,1,1,1,2,0.,1.,0.,,\n,{pin}",
        *(f"CONM2,9,2,,{M}", "SPC1,1,123456,1", "SPC1,1,1456,2", "ENDDATA"),
    ]
    (tmp_path / "a.dat").write_text("\n".join(rows))
    made = convert_deck(read_deck(tmp_path / "a.dat"), parse_units("m-kg-s-N"), "consistent", "a")
    (tmp_path / "a.toml").write_text(document_text(made.document, "a"))
    (tmp_path / "e.toml").write_text(document_text(made.environment, "e"))
    modes = md.solve_modes(md.solve_equilibrium(*md.load_setup(tmp_path / "a.toml", tmp_path / "e.toml")))
    bend = E * second
    stiffness = (12.0 * bend - 9.0 * np.outer(bend[free], bend[free]) / bend[free, free]) / L**3
    want = np.sqrt(np.linalg.eigvalsh(stiffness) / M)
    np.testing.assert_allclose(modes.omega[modes.omega > 0.0][:2], want, rtol=1e-8)


@pytest.mark.parametrize("second", ["456", "6", "56"])
@pytest.mark.parametrize(("axes", "inertia"), [(0, ""), (7, ""), (0, ",.1,,.1,,,.1")])
def test_turns_that_pins_of_all_bars_leave_loose_are_held(tmp_path, second, axes, inertia):
    """Two spans are pinned to a grid where they meet: a note says that its turn is held, as by AUTOSPC."""
    for first in ("", "6"):
        rows = [
            *("SOL 103", "CEND", "SPC = 1", "BEGIN BULK", f"MAT1,1,{E:.1e},,.3"),
            *("PBAR,1,1,2.-4,3.-8,2.-8,3.-8", "CORD2R,7,,0.,0.,0.,1.,1.,1.", ",1.,0.,.3"),
            *("GRID,1", f"GRID,2,,{L},,,{axes}", f"GRID,3,,{2 * L}", f"CONM2,9,2,,{M}\n{inertia or ','}"),
            *("CBAR,1,1,1,2,0.,1.,0.,BGG", f",,{first}", "CBAR,2,1,2,3,0.,1.,0.,BGG", f",{second}"),
            *("SPC1,1,123456,1,3", "ENDDATA"),
        ]
        (tmp_path / "a.dat").write_text("\n".join(rows))
        made = convert_deck(read_deck(tmp_path / "a.dat"), parse_units("m-kg-s-N"), "consistent", "a")
        (tmp_path / "a.toml").write_text(document_text(made.document, "a"))
        (tmp_path / "e.toml").write_text(document_text(made.environment, "e"))
        parts = md.load_setup(tmp_path / "a.toml", tmp_path / "e.toml")
        omega = md.solve_modes(md.solve_equilibrium(*parts)).omega
        want = np.sqrt(2 * 3.0 * E * 3e-8 / L**3 / M)
        assert np.abs(omega / want - 1.0).min() < 1e-8 or (
            inertia and not first
        )  # where it turns with a span
        assert any("rotations of grid '2'" in note for note in made.notes) == bool(first)


@pytest.mark.parametrize("pins", ["456,456", "45,456", "456,56"])
def test_a_platform_on_six_legs_pinned_to_its_rim_turns_on_them(tmp_path, pins):
    """Legs reach the grid by offsets and hold its turns by these, whatever turns their pins release."""
    rng = np.random.default_rng(3)
    rows, K = ["SOL 103", "CEND", "SPC = 1", "BEGIN BULK", f"MAT1,1,{E:.1e},,.3", "GRID,1"], np.zeros((6, 6))
    rows += [
        "PBAR,1,1,2.-4,3.-13,2.-13,3.-13",
        "CONM2,9,1,,2.,,,,,\n,.3,,.4,,,.5",
        f"SPC1,1,{ALL},11,THRU,16",
    ]
    for k in range(6):
        foot, rim = rng.uniform(-1.0, 1.0, 3) - [0.0, 0.0, 1.5], rng.uniform(-0.3, 0.3, 3)
        a, b = (",".join(map(repr, place.tolist())) for place in (foot, rim))
        rows += [f"GRID,{11 + k},,{a}", f"CBAR,{k},1,{11 + k},1,.3,1.,.2\n,{pins},,,,{b}"]
        along = (rim - foot) / np.linalg.norm(rim - foot)
        line = np.concatenate([along, np.cross(rim, along)])
        K += E * 2e-4 / np.linalg.norm(rim - foot) * np.outer(line, line)
    (tmp_path / "a.dat").write_text("\n".join([*rows, "ENDDATA"]).replace("CBAR,0", "CBAR,7"))
    made = convert_deck(read_deck(tmp_path / "a.dat"), parse_units("m-kg-s-N"), "consistent", "a")
    assert [clamp["node"] for clamp in made.environment["clamp"]] == [f"g{n}" for n in range(11, 17)]
    (tmp_path / "a.toml").write_text(document_text(made.document, "a"))
    (tmp_path / "e.toml").write_text(document_text(made.environment, "e"))
    modes = md.solve_modes(md.solve_equilibrium(*md.load_setup(tmp_path / "a.toml", tmp_path / "e.toml")), 6)
    want = np.sqrt(scipy.linalg.eigh(K, np.diag([2.0, 2.0, 2.0, 0.3, 0.4, 0.5]), eigvals_only=True))
    bends = (
        1e-3 if pins != "456,456" else 1e-9
    )  # a leg held in a turn at one end bends little beside its pull
    np.testing.assert_allclose(modes.omega, want, rtol=bends)
