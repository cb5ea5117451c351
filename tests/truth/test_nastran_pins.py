"""Pins of a bar (PA, PB) are in its element coordinates, also where its principal axes are others (I12)."""

import numpy as np
import pytest

import middeck as md
from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units

E, L, M = 7e10, 1.25, 2.0


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
