"""`numbers.json` keeps the contract for automation, and the shipped schema describes all of it."""

import json
from importlib.resources import files
from pathlib import Path

import jsonschema
import pytest

from middeck.files.json_output import json_text
from middeck.files.studies import load_study
from middeck.study.numbers import study_numbers
from middeck.study.stages import STAGES, run_stages

REFERENCE = Path(__file__).parents[1] / "reference" / "numbers.schema.json"
SHIPPED = json.loads(files("middeck.study").joinpath("numbers.schema.json").read_text())


@pytest.fixture(scope="module")
def numbers():
    """All stages but the mirror, which has its own test and takes longest."""
    study = load_study("studies/mace-1993.toml")
    outcomes = {name: run() for name, run in run_stages(study) if name != "mirror"}
    assert list(outcomes) == [name for name in STAGES if name != "mirror"]
    return json.loads(json_text(study_numbers(study, outcomes)))


def test_the_contract_holds(numbers):
    jsonschema.validate(numbers, json.loads(REFERENCE.read_text()))


def test_the_shipped_schema_only_adds_to_the_contract(numbers):
    def contained(small, large):
        if isinstance(small, dict):
            return all(k in large and contained(v, large[k]) for k, v in small.items() if k != "description")
        if isinstance(small, list):
            return all(any(contained(s, x) for x in large) for s in small)
        return small == large

    assert contained(json.loads(REFERENCE.read_text()), SHIPPED)


def test_the_shipped_schema_knows_every_key(numbers):
    """Closing every table of the schema would leave no key of the document out."""

    def closed(node):
        if isinstance(node, list):
            return [closed(v) for v in node]
        if not isinstance(node, dict):
            return node
        out = {k: closed(v) for k, v in node.items()}
        if isinstance(node.get("properties"), dict) and "additionalProperties" not in node:
            out["additionalProperties"] = False
        return out

    schema = closed(SHIPPED)
    schema["properties"]["figures"]["required"].remove("mirror")
    jsonschema.validate(numbers, schema)


def test_unstable_points_have_no_decibels(numbers):
    for which in ("all", "rigid", "flexible"):
        for side in ("orbit", "lab"):
            row = numbers["figures"]["figure_7"][which][side]
            assert [v is None for v in row["db"]] == [not s for s in row["stable"]]


def test_inputs_are_named_by_hash(numbers):
    hashes = [v for k, v in numbers["inputs"].items() if k not in ("overrides", "seed")]
    assert len(hashes) == 7
    assert all(len(h) == 64 for h in hashes)
    assert not any(name.startswith("/") for name in numbers["inputs"])
