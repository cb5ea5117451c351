"""Figure 6: one torque to payload and bus rates, as modelled in 0-g and 1-g and as measured on the rig."""

from __future__ import annotations

import numpy as np

from middeck.files.studies import Study
from middeck.study.chapter import Chapter, Section
from middeck.study.chapters.gravity_responses import numbers, sentences, tables
from middeck.study.chapters.gravity_responses.computation import GravityResponses, study_gravity_responses
from middeck.study.chapters.gravity_responses.figure_6 import figure_6a, figure_6b
from middeck.study.claim import claims_of
from middeck.study.shared import find_modes


def compute(study: Study, rng: np.random.Generator) -> GravityResponses:
    """Of the article that Figure 6 names."""
    figure = study.figure_6
    orbit, lab = (find_modes(*study.case(figure.article, environment)) for environment in ("orbit", "lab"))
    return study_gravity_responses(orbit, lab, figure, study.rig, study.loop_test, rng)


GRAVITY_RESPONSES = Chapter(
    name="figure 6",
    share=0.01,
    stream=1,
    compute=compute,
    numbers={"figure_6": numbers.figure_6},
    sections=(
        Section(
            key="figure-6a",
            title=sentences.title_6a,
            draw=figure_6a,
            sentence=sentences.figure_6a,
            claims=claims_of("figure_6"),
        ),
        Section(
            key="figure-6b",
            title=sentences.title_6b,
            draw=figure_6b,
            sentence=sentences.figure_6b,
            tables=tables.response_tables,
            warnings_of="figure_6",
        ),
    ),
)
