"""Robust designs for uncertain plants, and their verification on other plants."""

from middeck.control.h2.law_form import LawForm, Station
from middeck.control.law.uncertainty import (
    ModeShift,
    Uncertainty,
    corner_positions,
    draw_positions,
    end_positions,
    finished_plants,
    parameter_names,
    perturb_plant,
    without_delays,
)
from middeck.control.robust.designs.exchange import design_for_worst
from middeck.control.robust.designs.multimodel import MultiModelCompensator, design_multimodel
from middeck.control.robust.designs.popov import PopovCompensator, design_popov
from middeck.control.robust.designs.sampled_plant import plant_as_sampled
from middeck.control.robust.designs.sensitivity_weighted import (
    SensitivityWeightedCompensator,
    design_sensitivity_weighted,
)
from middeck.control.robust.problem.result import RobustCompensator, Stage
from middeck.control.robust.verification.comparison import ComparedDesign, DesignComparison, compare_designs
from middeck.control.robust.verification.monte_carlo import (
    PlantOutcomes,
    Verification,
    outcomes_on,
    stable_share,
    verify_robustness,
    worst_db,
)
from middeck.systems.plants.mode_shift import shift_modes

__all__ = [
    "ComparedDesign",
    "DesignComparison",
    "LawForm",
    "ModeShift",
    "MultiModelCompensator",
    "PlantOutcomes",
    "PopovCompensator",
    "RobustCompensator",
    "SensitivityWeightedCompensator",
    "Stage",
    "Station",
    "Uncertainty",
    "Verification",
    "compare_designs",
    "corner_positions",
    "design_for_worst",
    "design_multimodel",
    "design_popov",
    "design_sensitivity_weighted",
    "draw_positions",
    "end_positions",
    "finished_plants",
    "outcomes_on",
    "parameter_names",
    "perturb_plant",
    "plant_as_sampled",
    "shift_modes",
    "stable_share",
    "verify_robustness",
    "without_delays",
    "worst_db",
]
