"""The study's compensators: LQG of Figure 7 under the sheet's loops, five motors and fourteen sensors."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.control.law.pd_loops import PDLoops, close_inner_loop
from middeck.control.lqg.design import design_lqg
from middeck.control.sampled.emulation import emulate
from middeck.files.studies.documents import Study, load_study
from middeck.study.chapters.zero_g_control.computation import control_plant, design_weights
from middeck.study.shared import find_modes
from middeck.systems.plants.plant import Plant

INTENSITY = 4.1e-6
"""Of each disturbance [(N m)^2/Hz], to the digits in which the study's is known without running it."""


def study_law(log10_authority: float, intensity: float = INTENSITY) -> Compensator:
    """At the rig's rate; 46 states."""
    study, plant = _held()
    law = design_lqg(plant, design_weights(study, intensity), 10.0**log10_authority)
    return emulate(law, 1.0 / study.rig.sample_hz)


@cache
def _held() -> tuple[Study, Plant]:
    study = load_study(Path(__file__).parents[1] / "studies" / "mace-1993.toml")
    control = study.control
    pd = PDLoops(control.pd_loops, np.array(control.pd_kp_nm_per_rad), np.array(control.pd_kd_nms_per_rad))
    plant = control_plant(find_modes(*study.case("simple", "orbit")), study)
    return study, close_inner_loop(plant, pd)
