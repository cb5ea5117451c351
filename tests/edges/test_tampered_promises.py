"""Sealed documents that were tampered with in ways that a parser forgives, and outcomes that are none."""

from __future__ import annotations

import json

import pytest

from middeck.errors import ConfigError, DataError
from middeck.files.json.hash_seal import read_sealed, seal
from middeck.files.promises.outcomes import load_outcomes
from middeck.updating.promise.score import Scored, Statement, judge

SCHEMA = "middeck.promise/1"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"date":', '"date": "1999-01-01", "date":', "'date' stands twice"),
        ("1.5", "NaN", "not what was sealed"),
        ("1.5", "1e999", "not what was sealed"),
    ],
)
def test_tampering_that_a_parser_forgives_is_refused(tmp_path, old, new, message):
    path = tmp_path / "promise.json"
    text = json.dumps(seal({"schema": SCHEMA, "date": "2026-11-23", "value": 1.5}))
    path.write_text(text)
    assert read_sealed(path, SCHEMA)["value"] == 1.5
    path.write_text(text.replace(old, new))
    with pytest.raises(DataError, match=message):
        read_sealed(path, SCHEMA)


def test_an_infinite_frequency_is_no_outcome(tmp_path):
    path = tmp_path / "outcome.toml"
    path.write_text(
        'schema = "middeck.outcome/1"\n[[mode]]\nenvironment = "e"\nnumber = 1\nfrequency_hz = inf\n'
    )
    with pytest.raises(ConfigError, match="frequency_hz"):
        load_outcomes(path)


def test_two_statements_of_one_kind_and_name_are_not_judged():
    mode = Statement(kind="mode", name="orbit: mode 1", low=1.0, high=2.0)
    with pytest.raises(DataError, match="two statements of mode 'orbit: mode 1'"):
        judge([mode, mode], [])


def test_a_compensator_may_be_called_as_a_mode_is():
    """Each outcome is judged by the statement of its kind."""
    mode = Statement(kind="mode", name="orbit: mode 1", low=1.0, high=2.0)
    loop = Statement(
        kind="compensator", name="orbit: mode 1", low=-30.0, high=-20.0, probability=1.0, cautious=-20.0
    )
    came = [
        Scored(kind="compensator", name="orbit: mode 1", value=-25.0),
        Scored(kind="mode", name="orbit: mode 1", value=1.5),
    ]
    found = judge([loop, mode], came)
    assert [(v.kind, v.inside, v.brier) for v in found] == [("compensator", True, 0.0), ("mode", True, None)]
    with pytest.raises(DataError, match="the promise has no reading"):
        judge([loop, mode], [Scored(kind="reading", name="orbit: mode 1", value=1.5)])
