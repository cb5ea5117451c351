"""A real fine steering mirror through the same data arm."""

from __future__ import annotations

import numpy as np

from middeck.files.records import load_record
from middeck.files.studies import Study
from middeck.study.chapter import Chapter, Section
from middeck.study.chapters.mirror import drawing, numbers, sentences, tables
from middeck.study.chapters.mirror.claims import mirror_claims
from middeck.study.chapters.mirror.computation import MirrorFit, study_mirror


def compute(study: Study, rng: np.random.Generator) -> MirrorFit:
    """On the two records that the study names."""
    return study_mirror(load_record(study.train_file), load_record(study.test_file), study.mirror.states)


MIRROR = Chapter(
    name="mirror",
    share=0.04,
    stream=5,
    compute=compute,
    numbers={"mirror": numbers.mirror},
    sections=(
        Section(
            key="mirror",
            title="A real steering mirror, measured and fitted",
            draw=drawing.mirror,
            sentence=sentences.mirror,
            tables=tables.mirror_tables,
            claims=mirror_claims,
            warnings_of="mirror",
            note="study/chapters/mirror/source.html",
        ),
    ),
    result=sentences.result,
)
