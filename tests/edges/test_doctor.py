"""`middeck doctor --realtime` runs and says all that it promises; how late the machine is, is no test."""

from __future__ import annotations

import json

import pytest

from cli_runner import middeck

SMALL = ("--realtime", "--seconds", "1", "--states", "6", "--inputs", "2", "--outputs", "1")


@pytest.mark.usefixtures("compiler")
def test_the_report_is_whole(capfd):
    done = middeck(capfd, "doctor", *SMALL, "--json")
    assert done.code == 0, done.err
    report = json.loads(done.out)["realtime"]
    assert report["samples"] >= 500
    assert report["operations"] == 2 * (6 + 6 + 6 * 2 + 1 * 6 + 1 * 2)
    assert report["bytes"] == 4 * report["operations"]
    for key in ("late_s", "step_s"):
        assert len(report[key]) == 4
        assert sorted(report[key]) == report[key]
    assert set(report["machine"]) == {"processor", "cores", "kernel", "preemption"}
    assert set(report["granted"]) == {"FIFO priority", "locked memory", "own processor"}


def test_without_a_question_it_says_what_it_can_be_asked(capfd):
    done = middeck(capfd, "doctor")
    assert done.code == 2
    assert "--realtime" in done.err
