"""The study's compensators: LQG of Figure 7, five motors and fourteen sensors, at the rig's rate."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.control.law.pd_loops import PDLoops, close_inner_loop
from middeck.control.lqg.design import design_lqg
from middeck.control.sampled.emulation import emulate
from middeck.files.studies.documents import load_study
from middeck.study.chapters.zero_g_control.computation import (
    control_plant,
    design_weights,
    study_zero_g_control,
)
from middeck.study.shared import compare_environments

STUDY = Path(__file__).resolve().parents[2] / "studies" / "mace-1993.toml"


@cache
def study_laws() -> dict[str, Compensator]:
    """By "log10 authority", all that are stable by themselves."""
    study = load_study(STUDY)
    control, comparison = study.control, compare_environments(study)
    psd = study_zero_g_control({"orbit": comparison.orbit, "lab": comparison.lab}, study).disturbance_psd
    pd = PDLoops(control.pd_loops, np.array(control.pd_kp_nm_per_rad), np.array(control.pd_kd_nms_per_rad))
    plant = close_inner_loop(control_plant(comparison.orbit, study), pd)
    weights = design_weights(study, psd)
    levels = np.linspace(control.log10_authority_first, control.log10_authority_last, control.levels)
    laws = {
        f"{level:g}": emulate(design_lqg(plant, weights, 10.0**level), 1.0 / study.rig.sample_hz)
        for level in levels
    }
    return {name: law for name, law in laws.items() if np.abs(np.linalg.eigvals(law.sampled.A)).max() < 1.0}
