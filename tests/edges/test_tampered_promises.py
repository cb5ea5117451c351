"""Sealed documents that were tampered with in ways that a parser forgives, and outcomes that are none."""

from __future__ import annotations

import json

import pytest

from middeck.errors import ConfigError, DataError
from middeck.files.promises import load_outcomes
from middeck.files.sealed import read_sealed, seal
from middeck.updating.score import Outcome, Statement, judge

SCHEMA = "middeck.promise/1"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"date":', '"date": "1999-01-01", "date":', "'date' stands twice"),
        ("1.5", "NaN", "not what was sealed"),
        ("1.5", "1e999", "not what was sealed"),
    ],
)
def test_tampering_that_a_parser_forgives_is_refused(tmp_path, old, new, said):
    path = tmp_path / "promise.json"
    text = json.dumps(seal({"schema": SCHEMA, "date": "2026-11-23", "value": 1.5}))
    path.write_text(text)
    assert read_sealed(path, SCHEMA)["value"] == 1.5
    path.write_text(text.replace(old, new))
    with pytest.raises(DataError, match=said):
        read_sealed(path, SCHEMA)


def test_an_infinite_frequency_is_no_outcome(tmp_path):
    path = tmp_path / "outcome.toml"
    path.write_text(
        'schema = "middeck.outcome/1"\n[[mode]]\nenvironment = "e"\nnumber = 1\nfrequency_hz = inf\n'
    )
    with pytest.raises(ConfigError, match="frequency_hz"):
        load_outcomes(path)


def test_two_statements_of_one_name_are_not_judged():
    mode = Statement(name="orbit: mode 1", low=1.0, high=2.0)
    loop = Statement(name="orbit: mode 1", low=-30.0, high=-20.0, probability=1.0, cautious=-20.0)
    with pytest.raises(DataError, match="two statements of 'orbit: mode 1'"):
        judge([loop, mode], [Outcome(name="orbit: mode 1", value=-25.0)])
