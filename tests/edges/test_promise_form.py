"""Documents that were sealed without being promises: each key left out, each value of a wrong type."""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from middeck.cli.main import execute
from middeck.errors import DataError
from middeck.files.json.hash_seal import SEAL, seal
from middeck.files.promises.form import SealedForm
from middeck.files.promises.promise_file import read_promise
from repeats import LONG

ROOT = Path(__file__).parents[2]
LOOPS = ROOT / "data/virtual-survey/promise.json"
READINGS = ROOT / "promises/pazy-behind.json"
OF_READINGS = """schema = "middeck.outcome/1"
[[mode]]
environment = "hangs"
number = 1
frequency_hz = 4.2
[[reading]]
environment = "hangs"
load_case = "behind_500g"
gauge = "height"
value = -0.06
"""
LEFT_OUT = object()
WRONG: tuple[Any, ...] = (LEFT_OUT, None, -1, 10**400, "\ud800", [[]], {})
Keys = tuple[str | int, ...]


def places(value: Any, at: Keys = ()) -> Iterator[Keys]:
    """Of every key, and of the first item of every list."""
    if at:
        yield at
    items = (
        value.items() if isinstance(value, dict) else enumerate(value[:1] if isinstance(value, list) else ())
    )
    for key, inner in items:
        yield from places(inner, (*at, key))


def changed(document: dict[str, Any], at: Keys, value: Any) -> dict[str, Any]:
    """Sealed anew."""
    found = {key: inner for key, inner in copy.deepcopy(document).items() if key != SEAL}
    place: Any = found
    for key in at[:-1]:
        place = place[key]
    if value is LEFT_OUT:
        del place[at[-1]]
    else:
        place[at[-1]] = value
    return seal(found)


@pytest.mark.parametrize("source", [LOOPS, READINGS], ids=["compensators", "readings"])
def test_what_was_sealed_without_being_a_promise_is_bad_data(
    source: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    """Exit 4 with file and advice; 0 where what is missing is not read or was never promised."""
    outcome = ROOT / "data/virtual-survey/outcome.toml"
    if source == READINGS:
        outcome = tmp_path / "outcome.toml"
        outcome.write_text(OF_READINGS, encoding="utf-8")
    whole = json.loads(source.read_text(encoding="utf-8"))
    path, refused, rng = tmp_path / "promise.json", 0, random.Random(1993)
    tried = len(WRONG) if LONG else 2  # of each place
    for at in places({key: value for key, value in whole.items() if key != SEAL}):
        for value in rng.sample(WRONG, tried):
            path.write_text(json.dumps(changed(whole, at, value)), encoding="utf-8")
            code = execute(["outcome", str(path), str(outcome)], lambda: False)
            message = capfd.readouterr().err
            assert code in (0, 4), (at, value, message)
            assert "Traceback" not in message
            if code:
                refused += 1
                assert str(path) in message or str(outcome) in message, (at, value, message)
                assert "\n  try: " in message, (at, value, message)
    assert refused > 60 * tried / len(WRONG)


@pytest.mark.parametrize("value", ["[" * 100_000 + "]" * 100_000, "[" * 800 + "]" * 800, "9" * 5000])
def test_what_no_parser_reads_is_bad_data(tmp_path: Path, value: str):
    path = tmp_path / "promise.json"
    path.write_text(f'{{"schema": "middeck.promise/1", "environments": {value}}}', encoding="utf-8")
    with pytest.raises(DataError) as found:
        read_promise(path)
    assert found.value.hint


@pytest.mark.parametrize(
    ("at", "value", "what"),
    [
        (("environments",), LEFT_OUT, "environments: missing"),
        (("environments",), [], r"environments = \[\]: has 0 items"),
        (("environments", 0, "modes"), LEFT_OUT, r"environments\.0\.modes: missing"),
        (("environments", 0, "modes", 0, "interval_95_hz"), [2.0, 1.0], "interval_95_hz.*: must rise"),
        (("environments", 0, "compensators", 0, "db"), [1.0], "db: has 1 levels for 7 shares"),
        (("environments", 0, "compensators", 0, "db", 3), None, "db.*: must rise, null last"),
        (
            ("environments", 0, "compensators", 0, "name"),
            "LQG 3",
            "'LQG 3' stands there 2 times",
        ),
        (("shares",), [0.5] * 7, "shares.*: must hold 0.025, 0.5, 0.975, 0.99"),
        (("environments", 0, "shapes", "node"), [], "shapes: 0 nodes, 34 directions and 34 rows"),
        (("environments", 0, "shapes", "shape", 2), [], "shape.2: has 0 numbers for 10 modes"),
        (("environments", 0, "shapes", "direction", 0), "y", "node: 'n1 y' stands there 2 times"),
    ],
)
def test_what_is_missing_is_named_by_its_key(tmp_path: Path, at: Keys, value: Any, what: str):
    whole = json.loads(LOOPS.read_text(encoding="utf-8"))
    path = tmp_path / "promise.json"
    path.write_text(json.dumps(changed(whole, at, value)), encoding="utf-8")
    with pytest.raises(DataError, match=what) as found:
        read_promise(path)
    assert found.value.where == str(path)
    assert found.value.hint


def test_half_a_character_is_no_name(tmp_path: Path):
    """It could be read and sealed, but neither drawn nor written again."""
    whole = json.loads(LOOPS.read_text(encoding="utf-8"))
    path = tmp_path / "promise.json"
    changed_name = changed(whole, ("environments", 0, "modes", 0, "name"), "first \ud800")
    path.write_text(json.dumps(changed_name), encoding="utf-8")
    with pytest.raises(DataError, match="lone surrogate"):
        read_promise(path)


def test_what_a_later_version_adds_is_not_in_the_way(tmp_path: Path):
    whole = json.loads(LOOPS.read_text(encoding="utf-8"))
    path = tmp_path / "promise.json"
    path.write_text(json.dumps(changed(whole, ("environments", 0, "moons"), 3)), encoding="utf-8")
    assert read_promise(path)["environments"][0]["moons"] == 3
    assert SealedForm.model_validate(whole).environments[0].name == "orbit"
