"""Sections by matrix, centres, tension and stations in article files: read, and refused with the line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.files.setups import load_structure

WING = """schema = 1
name = "wing"
node = [{name = "root", x_m = 0.0}, {name = "tip", x_m = 2.0, mass_kg = 0.2}]

[[strut]]
section = "spar"
from = "root"
to = "tip"
tension_n = 3.0
elements = 4
stations = [{at = 0.5, section = "spar"}, {at = 1.0, section = "end"}]

[section.spar]
stiffness = [[1e6, 0, 0, 1e3], [0, 80, 2, 0], [0, 2, 100, 0], [1e3, 0, 0, 101]]
rho_A_kg_per_m = 0.5
mass_centre_m = [0.0, 0.01]

[section.end]
EA_n = 1.0e6
GJ_nm2 = 60.0
EI_y_nm2 = 100.0
EI_z_nm2 = 100.0
rho_A_kg_per_m = 0.5
centroid_m = [-0.001, 0.0]
shear_centre_m = [0.0, 0.02]
"""


def load(folder: Path, text: str):
    (folder / "wing.toml").write_text(text)
    return load_structure(folder / "wing.toml")


def test_sections_of_a_file(tmp_path: Path):
    (spar,) = load(tmp_path, WING).members
    assert spar.tension == 3.0
    root, end = spar.section, spar.stations[1][1]
    # The same bending about the node line, by the matrix and by its centroid.
    assert end.stiffness[5] == pytest.approx(root.stiffness[5])
    assert root.stiffness[0, 5] == 1e3
    assert root.coupling[3, 4] == 2.0
    assert (root.mass_centre_z, end.shear_centre_z) == (0.01, 0.02)
    assert [s.GJ for s in spar.sections] == [80.0, 80.0, 75.0, 65.0]
    assert np.isinf(root.GA_y)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[1e3, 0, 0, 101]", "[1.2e3, 0, 0, 101]", "14: section.spar.stiffness.*not symmetric"),
        ("0, 0, 101]", "0, 0, 0.5]", "14: section.spar.stiffness.*indefinite"),
        ("[1e3, 0, 0, 101]]", "[1e3, 0, 0]]", "not a 4x4 nor a 6x6"),
        ("rho_A_kg_per_m = 0.5\nmass", "GA_y_n = 1.0\nmass", "a section by its matrix has no such key"),
        ("at = 0.5", "at = 1.0", "must be > 1"),
        ("at = 1.0", "at = 0.9", "the last one is at 1"),
        ('"spar"}, {', '"spat"}, {', "no section of this name"),
        ("GJ_nm2", "GA_y_n = 1e5\nGJ_nm2", "rigid in shear at some stations only"),
        ("3.0", "nan", "tension_n.*finite"),
    ],
)
def test_what_cannot_be_is_refused_with_its_line(tmp_path: Path, old: str, new: str, message: str):
    assert old in WING
    with pytest.raises(ConfigError, match=f"(?s){message}"):
        load(tmp_path, WING.replace(old, new))
