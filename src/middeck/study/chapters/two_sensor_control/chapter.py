"""Figures 10, 11 and 12: three paths fitted together, and loops closed on two of them."""

from __future__ import annotations

import numpy as np

from middeck.files.studies import Study
from middeck.laboratory.article import RigArticle
from middeck.study.chapter import Chapter, Section
from middeck.study.chapters.two_sensor_control import numbers, sentences, tables
from middeck.study.chapters.two_sensor_control.computation import TwoSensorControl, study_two_sensor_control
from middeck.study.chapters.two_sensor_control.figure_10 import figure_10a, figure_10b
from middeck.study.chapters.two_sensor_control.figures_11_12 import figure_11, figure_12a, figure_12b
from middeck.study.claim import claims_of
from middeck.study.shared import rig_article


def compute(study: Study, rng: np.random.Generator, article: RigArticle) -> TwoSensorControl:
    """With the motor and excitation of ``siso``, and the sensors and designs of ``sito``."""
    return study_two_sensor_control(article, study.rig, study.loop_test, study.siso, study.sito, rng)


TWO_SENSOR_CONTROL = Chapter(
    name="figures 10 to 12",
    share=0.46,
    stream=4,
    needs=(rig_article,),
    compute=compute,
    numbers={
        "figure_10a": numbers.figure_10a,
        "figure_10b": numbers.figure_10b,
        "figure_11": numbers.figure_11,
        "figure_12": numbers.figure_12,
    },
    sections=(
        Section(
            key="figure-10a",
            title=sentences.title_10a,
            draw=figure_10a,
            sentence=sentences.figure_10a,
            tables=tables.encoder_tables,
            warnings_of="figure_10a",
        ),
        Section(
            key="figure-10b",
            title=sentences.title_10b,
            draw=figure_10b,
            sentence=sentences.figure_10b,
            tables=tables.bus_tables,
            claims=claims_of("figure_10b"),
            warnings_of="figure_10b",
        ),
        Section(
            key="figure-11",
            title="Figure 11: payload held by encoder and bus",
            draw=figure_11,
            sentence=sentences.figure_11,
            tables=tables.reach_tables,
            claims=claims_of("figure_11"),
            warnings_of="figure_11",
        ),
        Section(
            key="figure-12a",
            title="Figure 12a: payload under both penalties",
            draw=figure_12a,
            sentence=sentences.figure_12a,
            claims=claims_of("figure_12"),
        ),
        Section(
            key="figure-12b",
            title="Figure 12b: bus under both penalties",
            draw=figure_12b,
            sentence=sentences.figure_12b,
            tables=tables.both_tables,
            warnings_of="figure_12",
        ),
    ),
    result=sentences.result,
    shortfalls=sentences.shortfalls,
)
