"""Figures 3, 4 and 5: what gravity and suspension do to shape and modes."""

from __future__ import annotations

import numpy as np

from middeck.files.studies import Study
from middeck.structure.comparison import ModeComparison
from middeck.study.chapter import Chapter, Section
from middeck.study.chapters.gravity_modes import numbers, sentences, tables
from middeck.study.chapters.gravity_modes.figure_3 import figure_3
from middeck.study.chapters.gravity_modes.figure_4 import figure_4
from middeck.study.chapters.gravity_modes.figure_5 import figure_5
from middeck.study.shared import compare_environments


def compute(study: Study, rng: np.random.Generator, comparison: ModeComparison) -> ModeComparison:
    """The comparison itself, which Figure 7 needs too."""
    return comparison


GRAVITY_MODES = Chapter(
    name="figures 4 and 5",
    share=0.02,
    stream=0,
    needs=(compare_environments,),
    compute=compute,
    numbers={"figure_4": numbers.figure_4, "figure_5": numbers.figure_5},
    sections=(
        Section(
            key="figure-3",
            title="Figure 3: the article in 0-g and hung in 1-g",
            draw=figure_3,
            sentence=sentences.figure_3,
            tables=tables.rest_tables,
        ),
        Section(
            key="figure-4",
            title="Figure 4: eigenfrequencies and eigenratios",
            draw=figure_4,
            sentence=sentences.figure_4,
            tables=tables.mode_tables,
            warnings_of="figure_4",
        ),
        Section(
            key="figure-5",
            title="Figure 5: cross-orthogonality of 0-g and 1-g modes",
            draw=figure_5,
            sentence=sentences.figure_5,
            tables=tables.orthogonality_tables,
            warnings_of="figure_5",
        ),
    ),
    result=sentences.result,
)
