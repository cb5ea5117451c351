"""The study's chain from a ground test to orbit: what was promised on records from 1-g comes in 0-g."""

import dataclasses
import json
from importlib.resources import files
from typing import Any

import jsonschema
import numpy as np
import pytest

from middeck.files.json.output import json_text
from middeck.study.chapters.promise.computation import PromiseKept
from middeck.study.chapters.promise.numbers_and_claims import promise, promise_claims, routes
from middeck.study.chapters.promise.text import promise_tables, route_tables


@pytest.fixture(scope="module")
def kept(paper_outcomes: dict[str, Any]) -> PromiseKept:
    return paper_outcomes["promise"]


def test_its_numbers_follow_the_schema(kept: PromiseKept) -> None:
    schema = json.loads(files("middeck.study").joinpath("numbers.schema.json").read_text())
    entry = schema["properties"]["figures"]["properties"]["promise"] | {"additionalProperties": False}
    jsonschema.validate(json.loads(json_text(promise(kept))), entry)


# Some words of each claim, and the bounds of its number, near what was found: 0.015 %, 130 times, all,
# 0.08 dB, 0.07 dB (0.04 with few draws), 0 Hz.
CLAIMED = {
    "rms error of the first flexible frequencies in 0-g": (0.0, 0.03),
    "the nominal model has over 8 times that error": (50.0, 1000.0),
    "outcomes within their promised 95 % intervals": (90.0, 100.0),
    "difference of the promised median rms from the rms on the rig": (0.0, 0.2),
    "at most 3 dB worse than one on a 0-g record": (-0.3, 0.3),
    "a design for all motors on a 1-g record is stable in 1-g, and unstable near 0": (0.0, 0.1),
}


def test_every_claim_of_the_chain_has_its_number_and_holds(kept: PromiseKept) -> None:
    rows = promise_claims(promise(kept))
    assert len(rows) == len(CLAIMED)
    for words, (least, most) in CLAIMED.items():
        (row,) = (row for row in rows if words in row["claim"])
        assert least <= row["number"] <= most, row
        assert row["holds"], row


def test_refining_in_1_g_finds_the_0_g_frequencies_of_another_article(kept: PromiseKept) -> None:
    f = kept.frequencies
    assert len(f.true_hz) == 10
    refined, sheet = (np.abs(np.log(hz / f.true_hz)) for hz in (f.refined_hz, f.sheet_hz))
    assert np.all(refined < sheet)
    assert np.median(refined) < 2e-4


def test_the_friction_found_is_that_of_the_rig(kept: PromiseKept) -> None:
    (one,) = kept.ground.tests
    np.testing.assert_allclose(one.friction.slip_torque, 0.002, rtol=0.01)
    np.testing.assert_allclose(np.degrees(one.friction.slip_angle), 0.05, rtol=0.1)


def test_friction_is_what_parts_the_rig_from_a_linear_article(kept: PromiseKept) -> None:
    """Promised with it the medians are nearer to the rig than those promised without."""
    at = {o.name: o.friction for o in kept.promise.outlooks}
    for one in kept.flown:
        friction = at.get(one.name)
        if friction is not None:
            assert one.rig_db is not None
            with_it = next(o.level_db(0.5) for o in kept.promise.outlooks if o.name == one.name)
            assert abs(with_it - one.rig_db) < abs(np.median(friction.without_db) - one.rig_db)


def test_a_loop_that_grows_within_the_limits_of_the_rig_is_not_stable(kept: PromiseKept) -> None:
    bounded, *rest = kept.flown
    grown = dataclasses.replace(bounded, db=None)
    assert bounded.stable
    assert grown.rig_db is not None
    assert not grown.stable
    numbers = promise(dataclasses.replace(kept, flown=(grown, *rest)))
    assert numbers["came"][0]["rig_db"] == grown.rig_db
    assert routes(numbers)["sheet"][0] is None
    table = promise_tables({"promise": numbers})[1]
    assert table.rows[0][-2].startswith("unstable; ")


def test_without_a_design_on_the_record_the_study_goes_on(kept: PromiseKept) -> None:
    lost = [
        dataclasses.replace(one, db=None, rig_db=None, cause="no design") if "measured" in one.name else one
        for one in kept.flown
    ]
    numbers = promise(dataclasses.replace(kept, flown=tuple(lost)))
    assert set(routes(numbers)["measured"]) == {None}
    assert "unstable" in [cell for row in route_tables({"promise": numbers})[0].rows for cell in row]


def test_gravity_cannot_be_taken_out_of_a_measurement(kept: PromiseKept) -> None:
    assert kept.ground_law.lab.stable
    assert not kept.ground_law.orbit.stable
    assert kept.ground_law.orbit.frequency_hz < 0.1


def test_modes_that_no_test_saw_are_distinguished_and_are_uncertain(kept: PromiseKept) -> None:
    seen = np.array([mode["seen"] for mode in kept.there["modes"]])
    width = np.array([np.diff(np.log(mode["interval_95_hz"]))[0] for mode in kept.there["modes"]])
    assert np.count_nonzero(seen < 0.5) >= 4
    assert np.median(width[seen < 0.5]) > 5.0 * np.median(width[seen >= 0.5])
