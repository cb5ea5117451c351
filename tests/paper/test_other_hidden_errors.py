"""The study's chain on articles with other hidden errors: it reaches its report, and its intervals cover.

Gravity stays in a measurement on every one: a law of the 1-g record is unstable in orbit.
"""

import json
from importlib.resources import files
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from middeck.files.json.output import json_text
from middeck.files.studies.documents import load_study
from middeck.study.chapters.promise import drawing, text
from middeck.study.chapters.promise.chapter import PROMISE
from middeck.study.chapters.promise.computation import compute
from middeck.study.chapters.promise.numbers_and_claims import (
    frequency_error,
    promise,
    promise_claims,
    route_gap_db,
)
from repeats import LONG

STUDY = Path(__file__).parents[2] / "studies/mace-1993.toml"
SEEDS = range(20)
# Loops of the sheet's article are unstable on this one: the quick share is the hardest.
HARD = [11]
# Its fit is sure of itself from the second order on; the mesh, the rig's too, is no part of the law. The test
# keeps its length: of periods of 12 s, three of twenty intervals missed with OpenBLAS's kernel for AVX-512.
QUICK = [
    *("promise.draws=4", "promise.log10_authority=[3.0]", "promise.states=[36]"),
    "mesh.elements_per_strut=2",
]


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_chain_reaches_its_report_whatever_is_hidden() -> None:
    schema = json.loads(files("middeck.study").joinpath("numbers.schema.json").read_text())
    entry = schema["properties"]["figures"]["properties"]["promise"] | {"additionalProperties": False}
    inside: list[bool] = []
    for seed in SEEDS if LONG else HARD:
        study = load_study(STUDY, [f"promise.hidden_seed={seed}", *([] if LONG else QUICK)])
        kept = compute(study, PROMISE.rng(study.seed))
        numbers = promise(kept)
        jsonschema.validate(json.loads(json_text(numbers)), entry)
        for words in (text.promise_tables, text.route_tables, text.promise, text.routes, text.shortfalls):
            assert words({"promise": numbers}) is not None
        assert drawing.promised_and_came(kept)
        assert drawing.routes(kept)
        assert len(promise_claims(numbers)) == 6
        assert {f"record from orbit: {warning}" for warning in kept.measured.warnings} <= set(
            numbers["warnings"]
        )
        assert frequency_error(numbers, "refined_hz") < min(0.1, frequency_error(numbers, "sheet_hz") / 8.0)
        gap = route_gap_db(numbers)
        assert gap is not None
        assert gap < 3.0
        law = kept.ground_law
        assert law.lab.stable
        assert not law.orbit.stable
        assert law.orbit.frequency_hz < 0.1
        inside += [verdict.inside for verdict in kept.verdicts]
    assert np.mean(inside) >= 0.9
    assert not LONG or np.mean(inside) <= 0.99
