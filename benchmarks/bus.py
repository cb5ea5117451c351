"""The suspended bus of the frozen cases, without payload, as plain arrays for the peers and as a `Structure`.

Its numbers are those of the cross-check (`tests/cross/suspended_bus/case.py`), and so is the `Structure`.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np

from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment

TESTS = Path(__file__).resolve().parents[1] / "tests"
sys.path[:0] = [str(TESTS), str(TESTS / "cross")]
cross = importlib.import_module("test_suspended_bus")
CASE = cross.CASE
VARIANT = CASE.VARIANTS["bare_1g"]
# Elements in each half of the tube, by degrees of freedom: 6 (2 n + 1).
SIZES = {"1e2": 8, "1e3": 83}


def structure_of_bus(elements: int) -> tuple[Structure, Environment]:
    """For the product; ``elements`` in each half."""
    return cross.bus(VARIANT, elements), cross.environment(VARIANT)


def frame_of_bus(elements: int) -> dict[str, np.ndarray]:
    """What the peers read; ``elements_per_half`` for a program that builds chains of its own."""
    count = 2 * elements + 1
    x = np.zeros((count, 3))
    x[:, 0] = np.linspace(CASE.BODY_X[0], CASE.BODY_X[2], count)
    at = np.array([0, elements, 2 * elements])
    anchors = x[at] + [0.0, CASE.ANCHOR_HEIGHT, 0.0]
    return {
        "elements_per_half": np.array(elements),
        "x": x,
        "ends": np.stack([np.arange(count - 1), np.arange(1, count)], axis=1),
        "EA": np.array(CASE.EA),
        "GJ": np.array(CASE.GJ),
        "EI": np.array(CASE.EI),
        "GA": np.array(CASE.KGA),
        "rho_A": np.array(CASE.MASS_PER_LENGTH),
        "rho_I": np.array(CASE.RHO_I),
        "body_node": at,
        "body_mass": np.array(CASE.BODY_MASS),
        "body_cg": np.tile(CASE.BODY_CG, (3, 1)),
        "body_inertia": np.array(CASE.BODY_INERTIA),
        "spring_node": at,
        "spring_anchor": anchors,
        "spring_stiffness": np.array(CASE.SPRING_STIFFNESS),
        "spring_free_length": np.full(3, CASE.SPRING_FREE_LENGTH),
        "gravity": np.array([0.0, -CASE.GRAVITY, 0.0]),
    }
