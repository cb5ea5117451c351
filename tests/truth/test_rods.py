"""A force in a rod acts along the chord between its ends, however these turn."""

from __future__ import annotations

import numpy as np
import pytest

import middeck as md

G, LENGTH = 9.80665, 1.3
BENT = """rho_A_kg_per_m = 0.1
[[node]]
name = "top"
x_m = 0.0
[[node]]
name = "bob"
x_m = 1.3
mass_kg = 1.0
[[strut]]
section = "rod"
from = "top"
to = "bob"
elements = 1
[[load_case]]
name = "push"
load = [{{frame = "bob", force_n = [-{load}, 0.0, 0.0]}}]
"""
ROD = """schema = 1
name = "rods"
[section.rod]
EA_n = 1.0e8
GJ_nm2 = 0.0
EI_y_nm2 = 0.0
EI_z_nm2 = 0.0
mass = "rod"
"""
WORLD = """schema = 1
name = "held"
constants = {{gravity_m_s2 = {}, gravity_direction = [0.0, 0.0, -1.0]}}
clamp = [{}]
"""
TURNS = '{{node = "{}", along = ""}}'
HELD = '{{node = "{}"}}'


def lowest(folder, parts: str, gravity: float, *clamps: str, count: int = 2) -> np.ndarray:
    (folder / "rods.toml").write_text(ROD + parts)
    (folder / "held.toml").write_text(WORLD.format(gravity, ", ".join(clamps)))
    rest = md.solve_equilibrium(*md.load_setup(folder / "rods.toml", folder / "held.toml"))
    assert all(np.abs(clamp.moment).max() < 1e-9 for clamp in rest.reactions)
    return md.solve_modes(rest, count).frequency_hz[:count]


@pytest.mark.parametrize(
    ("tip", "rod", "arm"),
    [(3.0, 0.0, LENGTH), (0.0, 0.4, 2.0 * LENGTH / 3.0), (0.4, 0.3, LENGTH * (0.4 + 0.13) / (0.4 + 0.195))],
)
def test_a_rod_that_hangs_is_a_pendulum(tmp_path, tip, rod, arm):
    """Of a point mass g/L, of the rod's own mass 3 g/(2 L), and of both the reduced length of the pair."""
    parts = f"""rho_A_kg_per_m = {rod}
[[node]]
name = "top"
x_m = 0.0
[[node]]
name = "bob"
x_m = 0.0
z_m = -{LENGTH}
mass_kg = {tip}
[[strut]]
section = "rod"
from = "top"
to = "bob"
elements = 1
"""
    found = lowest(tmp_path, parts, G, HELD.format("top"), TURNS.format("bob"))
    assert found == pytest.approx(np.sqrt(G / arm) / (2.0 * np.pi), rel=3e-6)


def test_a_mass_between_two_taut_rods(tmp_path):
    """m w^2 = T/a + T/b for both motions across, with the turns of all three nodes held."""
    mass, tension, a, b = 2.0, 800.0, 0.7, 1.1
    parts = f"""rho_A_kg_per_m = 0.0
[[node]]
name = "left"
x_m = 0.0
[[node]]
name = "middle"
x_m = {a}
mass_kg = {mass}
[[node]]
name = "right"
x_m = {a + b}
[[strut]]
section = "rod"
from = "left"
to = "middle"
elements = 1
tension_n = {tension}
[[strut]]
section = "rod"
from = "middle"
to = "right"
elements = 1
tension_n = {tension}
"""
    found = lowest(tmp_path, parts, 0.0, HELD.format("left"), HELD.format("right"), TURNS.format("middle"))
    assert found == pytest.approx(np.sqrt(tension * (1.0 / a + 1.0 / b) / mass) / (2.0 * np.pi), rel=1e-9)


@pytest.mark.parametrize(("share", "stable"), [(0.98, True), (1.02, False)])
def test_a_rod_with_bending_stiffness_buckles_as_a_beam(tmp_path, share, stable):
    """One element with a cubic line: 2.4860 E I / L^2 beside Euler's 2.4674 (Przemieniecki 1968, 15.3)."""
    text = ROD + BENT.format(load=share * 2.4860 * 100.0 / LENGTH**2)
    for key, value in (("GJ", 80.0), ("EI_y", 300.0), ("EI_z", 100.0)):
        text = text.replace(f"{key}_nm2 = 0.0", f"{key}_nm2 = {value}")
    (tmp_path / "rods.toml").write_text(text)
    (tmp_path / "held.toml").write_text(WORLD.format(0.0, HELD.format("top")))
    setup = md.load_setup(tmp_path / "rods.toml", tmp_path / "held.toml")
    assert md.solve_equilibrium(*setup, "push").stable == stable
