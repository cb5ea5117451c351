"""Every number behind every figure, in the form of ``numbers.schema.json`` beside this file."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy

from middeck import __version__
from middeck.files.studies import Study
from middeck.study.mission import CHAPTERS
from middeck.study.words import Numbers

SCHEMA = "1"


def study_numbers(study: Study, outcomes: Mapping[str, Any]) -> Numbers:
    """The document ``numbers.json`` of a study whose chapters gave ``outcomes``; no clock, no path."""
    figures: Numbers = {}
    for chapter in CHAPTERS:
        if chapter.name in outcomes:
            figures |= chapter.tabulate(outcomes[chapter.name])
    return {
        "schema": SCHEMA,
        "versions": {
            "middeck": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        },
        "inputs": {**dict(study.inputs), "overrides": list(study.overrides), "seed": study.seed},
        "figures": figures,
    }
