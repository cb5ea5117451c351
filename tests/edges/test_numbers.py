"""`numbers.json` keeps the contract for automation, and the shipped schema describes all of it."""

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from middeck.files.json.output import json_text
from middeck.study.mission import CHAPTERS, study_numbers
from repeats import LONG

REFERENCE = Path(__file__).parents[1] / "reference" / "numbers.schema.json"
SHIPPED = json.loads(files("middeck.study").joinpath("numbers.schema.json").read_text())
ENDS = 30


def ends(value: Any) -> Any:
    """The document with both ends of its long lists: one rule holds for all items of a curve."""
    if isinstance(value, dict):
        return {key: ends(inner) for key, inner in value.items()}
    if not isinstance(value, list):
        return value
    return [
        ends(inner) for inner in (value if LONG or len(value) < 2 * ENDS else value[:ENDS] + value[-ENDS:])
    ]


@pytest.fixture(scope="module")
def numbers(paper_study, paper_outcomes):
    assert list(paper_outcomes) == [c.name for c in CHAPTERS if c.name != "mirror"]
    return json.loads(json_text(study_numbers(paper_study, paper_outcomes)))


def test_the_contract_holds(numbers):
    jsonschema.validate(ends(numbers), json.loads(REFERENCE.read_text()))


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
    jsonschema.validate(ends(numbers), schema)


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


def test_figures_follow_the_papers_order(numbers):
    keys = ["4", "5", "6", "7", "9a", "9b", "10a", "10b", "11", "12"]
    assert list(numbers["figures"]) == [*(f"figure_{key}" for key in keys), "promise"]


def test_a_margin_stands_only_beside_a_stable_loop(numbers):
    figures = numbers["figures"]
    loops = [figures["figure_9b"][name] for name in ("low", "high", "robust")]
    loops += [figures["figure_11"]["payload"], figures["figure_12"]["both"]]
    judged = [on for loop in loops for on in loop["rig"]]
    assert {on["stable"] for on in judged} == {True, False}
    for on in judged:
        assert (on["gain_margin_db"] is not None) == (on["improvement_db"] is not None) == on["stable"]
        assert (on["growth_rad_s"] > 1e-8) == (not on["stable"])  # `GROWTH_LIMIT`
