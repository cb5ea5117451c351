"""Figures 9a and 9b: a fit to a measured response, and loops designed on it."""

from __future__ import annotations

import numpy as np

from middeck.files.studies import Study
from middeck.laboratory.article import RigArticle
from middeck.study.chapter import Chapter, Section
from middeck.study.chapters.measured_control import numbers, sentences, tables
from middeck.study.chapters.measured_control.computation import MeasuredControl, study_measured_control
from middeck.study.chapters.measured_control.figure_9a import figure_9a
from middeck.study.chapters.measured_control.figure_9b import figure_9b
from middeck.study.claim import claims_of
from middeck.study.shared import rig_article


def compute(study: Study, rng: np.random.Generator, article: RigArticle) -> MeasuredControl:
    """With the one motor and the one sensor of the study's ``siso``."""
    return study_measured_control(article, study.rig, study.loop_test, study.siso, rng)


MEASURED_CONTROL = Chapter(
    name="figure 9",
    share=0.39,
    stream=3,
    needs=(rig_article,),
    compute=compute,
    numbers={"figure_9a": numbers.figure_9a, "figure_9b": numbers.figure_9b},
    sections=(
        Section(
            key="figure-9a",
            title="Figure 9a: measured response and fit",
            draw=figure_9a,
            sentence=sentences.figure_9a,
            tables=tables.fit_tables,
            warnings_of="figure_9a",
        ),
        Section(
            key="figure-9b",
            title="Figure 9b: open and closed loops",
            draw=figure_9b,
            sentence=sentences.figure_9b,
            tables=tables.loop_tables,
            claims=claims_of("figure_9b"),
            warnings_of="figure_9b",
        ),
    ),
    result=sentences.result,
    shortfalls=sentences.shortfalls,
)
