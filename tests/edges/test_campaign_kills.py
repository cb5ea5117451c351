"""A campaign that is killed, refused or starved of room loses nothing and doubles nothing."""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest

from campaign_functions import leaving, never_begin, quantity, some_cases, troubled
from middeck.campaign import executors, run_campaign
from middeck.errors import ConfigError, DataError
from repeats import LONG, repeats

SCRIPT = Path(__file__).parents[1] / "campaign_functions.py"
QUICK = {"wait_s": 0.0}
COUNT, WAIT = 60, 0.004


def _started(ledger, workers=1, wait_s=WAIT, limit=""):
    run = [sys.executable, str(SCRIPT), str(ledger), str(COUNT), str(wait_s), str(workers), limit]
    found = subprocess.Popen(run, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert found.stdout is not None
    assert found.stdout.readline() == "begun\n"
    return found


def _rows(ledger):
    base = sqlite3.connect(ledger)
    try:
        if not base.execute("select count(*) from sqlite_master").fetchone()[0]:
            return []
        return base.execute(
            "select case_index, fault, body, digest from result order by case_index"
        ).fetchall()
    finally:
        base.close()


@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGINT])
@pytest.mark.parametrize("seed", repeats(range(40)))
def test_killed_and_resumed_equals_undisturbed(tmp_path, seed, sent):
    whole = tmp_path / "whole"
    undisturbed = run_campaign(quantity, some_cases(COUNT), whole, inputs={"wait_s": WAIT})
    ledger, chance, kept = tmp_path / "killed", random.Random(seed), []
    for workers in (1, 2) if LONG else (1,):
        process = _started(ledger, workers)
        time.sleep(chance.uniform(0.0, 0.3))
        process.send_signal(sent)
        process.communicate()  # its pipes close only with its last worker
        before, kept = kept, _rows(ledger)
        assert set(before) <= set(kept)
    resumed = run_campaign(quantity, some_cases(COUNT), ledger, inputs={"wait_s": WAIT})
    assert resumed.digest == undisturbed.digest
    assert _rows(ledger) == _rows(whole)
    assert set(kept) <= set(_rows(ledger))


def test_a_second_process_is_refused_and_a_killed_one_leaves_the_ledger_free(tmp_path):
    ledger = tmp_path / "ledger"
    process = _started(ledger, workers=2 if LONG else 1, wait_s=0.05)
    while not Path(f"{ledger}-wal").exists():
        time.sleep(0.01)
    with pytest.raises(DataError, match="another process"):
        run_campaign(quantity, some_cases(COUNT), ledger, inputs={"wait_s": 0.05})
    process.kill()
    process.communicate()
    assert len({row[0] for row in _rows(ledger)}) == len(_rows(ledger)) < COUNT


def test_faults_and_dead_workers_are_rows_and_run_again_on_request_alone(tmp_path):
    ledger, seen, ticks = tmp_path / "ledger", [], iter(range(100))
    found = run_campaign(troubled, some_cases(8), ledger, workers=2, progress=seen.append,
                         clock=lambda: float(next(ticks)))  # fmt: skip
    faults = {o.index: o.fault for o in found.outcomes if o.fault is not None}
    assert faults.keys() == {2, 3, 5}
    assert faults[2] == "ValueError: slack cable"
    assert "ledger cannot hold" in faults[3]
    assert "process died" in faults[5]
    assert [o.result for o in found.outcomes if o.fault is None] == [0, 1, 4, 6, 7]
    assert (seen[-1].done, seen[-1].faults, seen[-1].remaining_s) == (8, 3, 0.0)
    assert (seen[1].elapsed_s, seen[1].remaining_s) == (2.0, 6.0)
    assert run_campaign(troubled, some_cases(8), ledger).digest == found.digest
    with pytest.raises(ConfigError, match="no function"):
        run_campaign("campaign_functions:none", some_cases(8), ledger)


def test_a_case_that_leaves_its_process_ends_no_other(tmp_path):
    found = run_campaign(leaving, some_cases(3), tmp_path / "ledger")
    assert [(o.result, o.fault) for o in found.outcomes] == [
        (0, None),
        (None, "SystemExit: no rest state"),
        (2, None),
    ]


def test_processes_that_never_begin_are_no_fault_of_a_case(tmp_path, monkeypatch):
    ledger = tmp_path / "ledger"
    with monkeypatch.context() as patched:
        patched.setattr(executors, "_begin_worker", never_begin)
        with pytest.raises(ConfigError, match="before their first case") as caught:
            run_campaign(leaving, some_cases(1), ledger, workers=2)
    assert "__main__" in (caught.value.hint or "")
    assert _rows(ledger) == []
    assert run_campaign(leaving, some_cases(1), ledger).outcomes[0].result == 0


def test_two_campaigns_in_one_folder_know_nothing_of_each_other(tmp_path):
    """Each case of one runs a whole other one beside it, which the second time has nothing left to do."""
    alone = run_campaign(quantity, some_cases(3), tmp_path / "alone", inputs=QUICK)
    beside = []

    def other(_):
        beside.append(run_campaign(leaving, some_cases(3), tmp_path / "other").digest)

    both = run_campaign(quantity, some_cases(3), tmp_path / "one", inputs=QUICK, progress=other)
    assert both.digest == alone.digest
    assert len(set(beside)) == 1
    assert len(_rows(tmp_path / "one")) == len(_rows(tmp_path / "other")) == 3


def test_order_and_pool_change_no_outcome(tmp_path):
    one = run_campaign(quantity, some_cases(6), tmp_path / "one", inputs=QUICK)
    two = run_campaign(quantity, some_cases(6)[::-1], tmp_path / "two", inputs=QUICK)
    pooled = run_campaign(quantity, some_cases(6), tmp_path / "pool", inputs=QUICK, workers=2)
    assert pooled.digest == one.digest
    assert repr(one.outcomes) == repr(two.outcomes)
    assert _rows(tmp_path / "one") == _rows(tmp_path / "pool")


@pytest.mark.skipif(sys.platform == "win32", reason="limits of POSIX")
def test_a_full_disk_is_reported_and_loses_nothing(tmp_path):
    ledger = tmp_path / "ledger"
    process = _started(ledger, wait_s=0.0, limit="65536")
    message = process.communicate()[1]
    assert process.returncode
    assert "ledger cannot be written" in message
    kept = _rows(ledger)
    found = run_campaign(quantity, some_cases(COUNT), ledger, inputs=QUICK)
    assert 0 < len(kept) < COUNT == len(found.outcomes)
    assert set(kept) <= set(_rows(ledger))


@pytest.fixture
def finished(tmp_path):
    ledger = tmp_path / "ledger"
    run_campaign(quantity, some_cases(4), ledger, inputs=QUICK)
    return ledger


@pytest.mark.parametrize(
    ("function", "count", "inputs", "named"),
    [(quantity, 5, QUICK, "cases"), (quantity, 4, {"wait_s": 1}, "inputs"), (troubled, 4, QUICK, "function")],
)
def test_another_campaign_in_the_file_is_refused(finished, function, count, inputs, named):
    kept = _rows(finished)
    with pytest.raises(DataError, match=rf"another campaign's: {named}"):
        run_campaign(function, some_cases(count), finished, inputs=inputs)
    assert _rows(finished) == kept


def test_what_differs_is_named_and_not_cut_off(tmp_path):
    """As a promise has it: long names of files first, of which one was changed."""
    files = [["plan.toml", "a1" * 32], ["article.toml", "b2" * 32]]
    inputs = {"article": "/a/" + 90 * "long" + "/article.toml", "files": files, "wait_s": 0}
    run_campaign(quantity, some_cases(4), tmp_path / "ledger", inputs=inputs)
    changed = inputs | {"files": [files[0], ["article.toml", "c3" * 32]], "wait_s": 1}
    with pytest.raises(DataError) as caught:
        run_campaign(quantity, some_cases(4), tmp_path / "ledger", inputs=changed)
    assert caught.value.what == (
        "the ledger is another campaign's: inputs.files article.toml b2b2b2b2b2b2, now article.toml "
        "c3c3c3c3c3c3; inputs.wait_s 0, now 1"
    )


def test_a_text_that_begins_like_json_is_named_as_it_stands(tmp_path):
    ledger, inputs = tmp_path / "ledger", {"note": "[draft] wing", "wait_s": 0}
    run_campaign(quantity, some_cases(4), ledger, inputs=inputs)
    with pytest.raises(DataError, match=r"inputs.note \[draft\] wing, now \[final\] wing"):
        run_campaign(quantity, some_cases(4), ledger, inputs=inputs | {"note": "[final] wing"})


def _shorten(path):
    path.write_bytes(path.read_bytes()[:5000])


def _other_text(path):
    path.write_text("index,result\n0,1.0\n" * 100)


def _other_base(path):
    path.unlink()
    base = sqlite3.connect(path)
    base.execute("create table result (x)")
    base.close()


def _change_a_digit(path):
    kept = path.read_bytes()
    at = kept.index(b'"ratio":0.') + len(b'"ratio":0.')
    path.write_bytes(kept[:at] + (b"1" if kept[at : at + 1] != b"1" else b"2") + kept[at + 1 :])


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_shorten, "damaged"),
        (_other_text, "damaged"),
        (_other_base, "no ledger"),
        (_change_a_digit, "case [0-3]"),
    ],
)
def test_a_foreign_or_damaged_file_is_refused(finished, spoil, message):
    spoil(finished)
    kept = finished.read_bytes()
    with pytest.raises(DataError, match=message):
        run_campaign(quantity, some_cases(4), finished, inputs=QUICK)
    assert finished.read_bytes()[100:] == kept[100:]  # SQLite counts openings in its header


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(DataError, match="cannot be written"):
        run_campaign(quantity, some_cases(1), tmp_path / "no" / "ledger", inputs=QUICK)


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root writes everywhere")
def test_a_read_only_folder_is_named(finished):
    finished.parent.chmod(0o555)
    finished.chmod(0o444)
    with pytest.raises(DataError, match="cannot be written"):
        run_campaign(quantity, some_cases(4), finished, inputs=QUICK)
    finished.parent.chmod(0o755)
