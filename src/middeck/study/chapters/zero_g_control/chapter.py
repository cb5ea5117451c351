"""Figure 7: controllers designed on the 0-g model, impinged on the 0-g and the 1-g model."""

from __future__ import annotations

import numpy as np

from middeck.files.studies import Study
from middeck.structure.comparison import ModeComparison
from middeck.study.chapter import Chapter, Section
from middeck.study.chapters.zero_g_control import numbers, sentences, tables
from middeck.study.chapters.zero_g_control.computation import ZeroGControl, study_zero_g_control
from middeck.study.chapters.zero_g_control.figure_7 import figure_7a, figure_7b
from middeck.study.claim import claims_of
from middeck.study.shared import compare_environments


def compute(study: Study, rng: np.random.Generator, comparison: ModeComparison) -> ZeroGControl:
    """On the modes that Figures 4 and 5 compare."""
    return study_zero_g_control({"orbit": comparison.orbit, "lab": comparison.lab}, study.control)


ZERO_G_CONTROL = Chapter(
    name="figure 7",
    share=0.08,
    stream=2,
    needs=(compare_environments,),
    compute=compute,
    numbers={"figure_7": numbers.figure_7},
    sections=(
        Section(
            key="figure-7a",
            title="Figure 7a: performance against authority",
            draw=figure_7a,
            sentence=sentences.figure_7a,
            claims=claims_of("figure_7"),
        ),
        Section(
            key="figure-7b",
            title="Figure 7b: the flexible modes alone",
            draw=figure_7b,
            sentence=sentences.figure_7b,
            tables=tables.authority_tables,
            warnings_of="figure_7",
        ),
    ),
    result=sentences.result,
)
