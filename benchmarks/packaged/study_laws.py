"""The study's compensators at the intensity of disturbance that the study finds."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.files.studies.documents import load_study
from middeck.study.chapters.zero_g_control.computation import study_zero_g_control
from middeck.study.shared import compare_environments
from study_compensators import study_law

STUDY = Path(__file__).resolve().parents[2] / "studies" / "mace-1993.toml"


@cache
def study_laws() -> dict[str, Compensator]:
    """By "log10 authority", all that are stable by themselves."""
    study = load_study(STUDY)
    control, comparison = study.control, compare_environments(study)
    psd = study_zero_g_control({"orbit": comparison.orbit, "lab": comparison.lab}, study).disturbance_psd
    levels = np.linspace(control.log10_authority_first, control.log10_authority_last, control.levels)
    laws = {f"{level:g}": study_law(level, psd) for level in levels}
    return {name: law for name, law in laws.items() if np.abs(np.linalg.eigvals(law.sampled.A)).max() < 1.0}
