"""Every requirement of the real-time computer has one number and tests that exist."""

from __future__ import annotations

import re
from pathlib import Path

from engine_campaigns import CAMPAIGNS, TWENTIETH, table
from engine_faults import EITHER, ENDS, HARMLESS, KINDS, TRIPS, endings
from engine_faults import table as fault_table

ROOT = Path(__file__).parents[2]
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (ROOT / "docs/reference/requirements.md").read_text().splitlines()
    if re.match(r"\| [A-Z]\d+ \|", line)
]

REAL_TIME = r"^from (middeck\.realtime|engine_)"
"""What a test of packages, gate or engine imports."""


def test_each_requirement_is_whole_and_has_a_number_of_its_own():
    assert len(ROWS) >= 40
    assert all(len(row) == 4 and all(row) for row in ROWS)
    numbers = [row[0] for row in ROWS]
    assert len(set(numbers)) == len(numbers)


def test_each_test_of_the_real_time_computer_shows_a_requirement():
    named = {name for row in ROWS for name in re.findall(r"`([^`]+)`", row[3])}
    missing = {
        f"{file.name}::{name}"
        for file in (ROOT / "tests").rglob("test_*.py")
        if file.parent.name != "docs"
        for text in (file.read_text(),)
        for name in re.findall(r"^def (test_\w+)", text, re.MULTILINE)
        if re.search(REAL_TIME, text, re.MULTILINE) or "_a_package_" in name
    } - named
    assert not missing


def test_each_test_that_is_named_exists():
    functions = {
        f"{file.name}::{name}"
        for file in (ROOT / "tests").rglob("test_*.py")
        for name in re.findall(r"^def (test_\w+)", file.read_text(), re.MULTILINE)
    }
    for number, *_, tests in ROWS:
        named = re.findall(r"`([^`]+)`", tests)
        assert named, number
        assert set(named) <= functions, number


def test_the_table_of_faults_is_what_the_campaign_plays():
    assert "\n".join(fault_table()) in (ROOT / "docs/reference/requirements.md").read_text()


def test_the_table_of_endings_is_what_the_campaign_asserts():
    """Of each kind one: a trip by these causes, none, or either with the reason why."""
    assert sorted([*TRIPS, *HARMLESS, *EITHER, *ENDS]) == sorted(KINDS)
    assert "\n".join(endings()) in (ROOT / "docs/reference/requirements.md").read_text()


def test_the_table_of_campaigns_is_what_the_tests_run():
    """None less than a twentieth; each is asked for by a test."""
    assert "\n".join(table()) in (ROOT / "docs/reference/requirements.md").read_text()
    text = "".join(file.read_text() for file in (ROOT / "tests").rglob("test_*.py"))
    for name, (whole, quick) in CAMPAIGNS.items():
        assert f'_of("{name}")' in text, name
        assert TWENTIETH * quick >= whole, name
