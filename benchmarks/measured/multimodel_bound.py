"""The frozen case of multi-model control: how far its law is above what no linear law of any order passes."""

from __future__ import annotations

import importlib
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from measured.rows import row
from middeck.control.law.uncertainty import finished_plants
from middeck.control.robust.designs.multimodel import design_multimodel
from middeck.updating.promise.performance_bound import bound_worst

# The frozen case is shared with the tests.
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "truth"))
case = importlib.import_module("multimodel_reference")

LEVEL_DB = 1.0


def rows(_: str) -> list[dict[str, Any]]:
    """On the three models of the design, and on the grid that shifts two modes apart."""
    plant = case.reference_plant()
    law = design_multimodel(plant, case.WEIGHTS, case.AUTHORITY, uncertainty=case.TOGETHER)
    sets = {
        "three models": finished_plants(plant, case.TOGETHER, np.array([[-1.0], [0.0], [1.0]])),
        "9x9 grid": finished_plants(plant, case.APART, case.grid()),
    }
    made: list[dict[str, Any]] = []
    for name, plants in sets.items():
        start = time.process_time()
        found = bound_worst(plants, law, case.WEIGHTS)
        seconds = time.process_time() - start
        title = f"multimodel, three-model law, {name}"
        above = found.worst_db - found.no_linear_law_below_db
        made += [
            row(title, "worst decibel", "dB", found.worst_db),
            row(title, "above the bound of its effort", "dB", above, LEVEL_DB),
            row(title, f"the bound on {len(plants)} plants", "CPU s", seconds),
        ]
    return made
