"""Figures 4 and 5 in numbers.json."""

import numpy as np

from middeck.files.json.results import mode_numbers, rest_numbers
from middeck.structure.gravity.compare_modes import ModeComparison
from middeck.study.words import Numbers


def figure_4(comparison: ModeComparison) -> Numbers:
    """Frequencies in both environments, pairs of flexible modes and their ratios."""
    sides = {"orbit": comparison.orbit, "lab": comparison.lab}
    return {
        **{
            name: {**mode_numbers(side, comparison.count), **rest_numbers(side.equilibrium)}
            for name, side in sides.items()
        },
        "pairs": comparison.pairs,
        "ratio": comparison.ratio,
        "subspace_angle_deg": np.degrees(comparison.subspace_angle),
    }


def figure_5(comparison: ModeComparison) -> Numbers:
    """Cross-orthogonality [orbit][lab], absolute values, and the MAC."""
    return {"matrix": comparison.cross_orthogonality, "mac": comparison.mac}
