"""Figures 4 and 5: what gravity and suspension do to the modes."""

from __future__ import annotations

from middeck.structure.article import Structure
from middeck.structure.comparison import ModeComparison, compare_modes
from middeck.structure.environment import Environment
from middeck.structure.equilibrium import solve_equilibrium
from middeck.structure.modes import Modes, solve_modes


def find_modes(structure: Structure, environment: Environment) -> Modes:
    """Rest state and modes of ``structure`` in ``environment``."""
    return solve_modes(solve_equilibrium(structure, environment))


def study_gravity(structure: Structure, orbit: Environment, lab: Environment, count: int) -> ModeComparison:
    """The lowest ``count`` modes in orbit beside those in the laboratory."""
    return compare_modes(find_modes(structure, orbit), find_modes(structure, lab), count)
