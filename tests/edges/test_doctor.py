"""`middeck doctor --realtime` runs and says all that it promises; how late the machine is, is no test."""

from __future__ import annotations

import json
import time
import weakref

import numpy as np
import pytest

from cli_runner import middeck
from engine_cases import plain_settings
from middeck.cli.shown.screen import ScreenTable
from middeck.cli.verbs.doctor import _blocks
from middeck.errors import DataError
from middeck.realtime.engine.process.launch import run_bare_loop
from middeck.realtime.engine.process.supervisor import Supervisor
from middeck.realtime.engine.trials import timing
from middeck.realtime.engine.trials.durations import count_durations, no_durations, percentiles
from middeck.realtime.engine.trials.timing import TimingReport, name_machine, summarise

SMALL = ("--realtime", "--seconds", "1", "--states", "6", "--inputs", "2", "--outputs", "1")


@pytest.mark.usefixtures("compiler")
def test_the_report_is_whole(capfd):
    done = middeck(capfd, "doctor", *SMALL, "--json")
    assert done.code == 0, done.err
    report = json.loads(done.out)["realtime"]
    assert report["samples"] >= 500
    assert report["operations"] == 2 * (6 + 6 + 6 * 2 + 1 * 6 + 1 * 2)
    assert report["bytes"] == 4 * report["operations"]
    for key in ("late_s", "step_s", "floor_late_s", "floor_step_s"):
        assert len(report[key]) == 4
        assert sorted(report[key]) == report[key]
    assert set(report["machine"]) == {"processor", "cores", "kernel", "preemption"}
    assert set(report["granted"]) == {"FIFO priority", "locked memory", "own processor"}


@pytest.mark.usefixtures("compiler")
def test_the_floor_is_a_loop_that_keeps_the_ticks():
    """No pass through a hundred thousand numbers is quicker than at 100 GHz; a thousandth takes less."""
    period, numbers, began = 0.002, 100_000, time.monotonic()
    settings = plain_settings(period_s=period)
    late, step = run_bare_loop(settings, 50, numbers)
    assert time.monotonic() - began >= 49 * period
    assert late.shape == step.shape == (50,)
    assert late.min() >= 0
    few = run_bare_loop(settings, 50, 100)[1]
    assert step.min() >= numbers / 100
    assert np.median(step) > 10.0 * np.median(few)


def test_the_screen_tells_times_the_floor():
    report = TimingReport(
        machine=name_machine(), granted={}, trips=(),
        period_s=0.002, samples=10, overruns=0, operations=10, bytes=40,
        late_s=(6e-5, 7e-5, 8e-5, 9e-5), floor_late_s=(3e-5, 7e-5, 4e-5, 1e-5),
        step_s=(4e-6,) * 4, floor_step_s=(1e-6,) * 3 + (0.0,),
    )  # fmt: skip
    (table,) = (block for block in _blocks(report) if isinstance(block, ScreenTable))
    assert table.rows[2] == ["  times that", "2.00", "1.00", "2.00", "9.00"]
    assert table.rows[5][:4] == ["  times that", "4.00", "4.00", "4.00"]


def test_without_a_question_it_says_what_it_can_be_asked(capfd):
    done = middeck(capfd, "doctor")
    assert done.code == 2
    assert "--realtime" in done.err


def test_what_is_later_than_a_period_is_an_overrun():
    """Of a thousand samples in any order: seven beyond a period, three of exactly one, which are none."""
    period = 2_000_000
    late = np.concatenate([np.arange(990), np.full(3, period), period + 1 + np.arange(7)])
    late, step = np.random.default_rng(1).permutation(late), np.arange(1000)[::-1]
    found = summarise([(late[:300], step[:300]), (late[300:], step[300:])], 1e-9 * period)
    assert (found["samples"], found["overruns"]) == (1000, 7)
    assert found["step_s"] == pytest.approx([499.5e-9, 989.01e-9, 998.001e-9, 999e-9], rel=1e-12)
    assert found["late_s"][0] == pytest.approx(499.5e-9, rel=1e-12)
    assert found["late_s"][-1] == pytest.approx(1e-9 * (period + 7), rel=1e-12)


def test_durations_take_the_same_room_however_many_they_are():
    """Percentiles of a hundred thousand, from nanoseconds to hours in pieces, to half a bin of NumPy's."""
    rng, found = np.random.default_rng(2), no_durations()
    ns = np.exp(rng.normal(10.0, 4.0, 100_000)).astype(np.int64)
    for piece in np.array_split(ns, 7):
        found = count_durations(found, piece)
        assert found.counts.nbytes == no_durations().counts.nbytes < 500_000
    percent = (0.0, 1.0, 50.0, 99.0, 99.9, 99.99, 100.0)
    assert percentiles(found, percent) == pytest.approx(
        np.percentile(ns, percent), rel=1.0 / 2048.0, abs=1e-9
    )
    assert percentiles(found, percent)[-1] == ns.max()
    few = ns[ns < 2048]
    exact = percentiles(count_durations(no_durations(), few), percent)
    assert exact == pytest.approx(np.percentile(few, percent), rel=1e-12, abs=1e-9)
    alike = percentiles(count_durations(no_durations(), np.array([5000, 5000])), percent)
    assert alike.max() == 5000.0  # the longest, in the lower half of its bin
    for longest in ((1 << 53) - 1, 1 << 53, (1 << 62) + 1, (1 << 63) - 1):
        most = count_durations(found, np.array([longest]))
        assert (most.longest, int(most.counts.sum())) == (longest, len(ns) + 1)


@pytest.mark.usefixtures("compiler")
def test_a_run_of_any_length_keeps_one_piece_of_it(monkeypatch):
    """Of engine and bare loop alike: nothing of a piece is still there when the next but one begins."""
    kept, most = [], []

    def watched(give):
        def one(*args):
            most.append(sum(piece() is not None for piece in kept))
            given = give(*args)
            kept.append(weakref.ref(given))
            return given

        return one

    monkeypatch.setattr(timing, "PIECE", 40)
    monkeypatch.setattr(timing, "BARE_PIECE", 40)
    monkeypatch.setattr(Supervisor, "run", watched(Supervisor.run))
    monkeypatch.setattr(timing, "run_bare_loop", watched(timing.run_bare_loop))
    report = timing.measure_timing(rate_hz=1000.0, seconds=0.5, shape=(6, 2, 1), priority=None)
    assert len(kept) > report.samples // 40 >= 12
    assert max(most) <= 1


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("samples", [0, 1 << 44])
def test_a_floor_that_cannot_be_measured_is_told(samples):
    """A loop of no sample, and one for which no machine has memory: not in Python's words."""
    with pytest.raises(DataError, match="the bare loop has ended with code") as refused:
        run_bare_loop(plain_settings(), samples, 10)
    assert "memory" in refused.value.hint
