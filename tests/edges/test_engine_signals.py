"""Signals to the engine's process: it goes to SAFE and out, or leaves a record that can be read."""

from __future__ import annotations

import dataclasses
import os
import re
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from engine_cases import plain_settings, random_article
from middeck.errors import DataError
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
PATIENT = {"late_s": 0.2, "heartbeat_s": 0.0}  # other programs may hold this machine up for so long


def _settings():
    return dataclasses.replace(plain_settings(), period_s=0.01, **PATIENT)


@pytest.mark.parametrize("asked", [{"priority": 3, "processor": 0}, {"processor": 1000}])
def test_what_is_said_to_be_granted_is(asked):
    """The system says the same of the process; a processor that is not there is none that was granted."""
    settings = dataclasses.replace(_settings(), **asked)
    with Supervisor(settings, random_article(), real_time=True) as engine:
        engine.run(2)
        said, pid = int(engine.file.status["real_time"]), engine.process.pid
        fifo = os.sched_getscheduler(pid) == os.SCHED_FIFO and os.sched_getparam(pid).sched_priority == 3
        locked = re.search(r"VmLck:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
        alone = os.sched_getaffinity(pid) == {asked["processor"]}
    assert locked is not None
    assert [bool(said & bit) for bit in (1, 2, 4)] == [fifo, int(locked[1]) > 0, alone]
    assert alone == (asked["processor"] == 0)


def test_a_stopped_process_trips_by_its_lateness():
    """SIGSTOP for half a second: the first sample after it goes to SAFE."""
    with Supervisor(_settings(), random_article(), real_time=True) as engine:
        assert engine.reset().done
        engine.run(5)
        engine.process.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        engine.process.send_signal(signal.SIGCONT)
        records = engine.run(20)
        (trip,) = [event for event in engine.events() if event.trips]
        assert trip.kind == "lateness"
        assert trip.value > 1e9 * PATIENT["late_s"]
    late = np.flatnonzero(records["late_ns"] > 1e9 * PATIENT["late_s"])
    assert records["state"][late[0]] == 0


def test_sigterm_goes_to_safe_first():
    with Supervisor(_settings(), random_article(), real_time=True) as engine:
        assert engine.reset().done
        engine.run(5)
        engine.process.send_signal(signal.SIGTERM)
        assert engine.process.wait(10.0) == 0
        assert [event.kind for event in engine.events()][-2:] == ["stop", "ended"]
        assert engine.state == "safe"
        assert engine.file.status["running"] == 0


@pytest.mark.parametrize("real_time", [False, True])
def test_sigkill_leaves_what_was_recorded(real_time):
    with Supervisor(_settings(), random_article(), real_time=real_time) as engine:
        assert engine.reset().done
        engine.run(20, keep=False)
        engine.process.kill()
        engine.process.wait(10.0)
        with pytest.raises(DataError, match="-9"):
            engine.run(5)
        ring = engine.file.ring
        whole = ring[ring["sequence"] > 0]
        assert len(whole) >= 20
        assert np.array_equal(whole["sequence"], np.arange(1, len(whole) + 1))
        assert np.isfinite(whole["u"]).all()


@pytest.mark.parametrize("mode", [0o644, 0o755], ids=["may not run", "is no program"])
def test_a_program_that_cannot_be_started_is_told_with_what_to_try(tmp_path: Path, mode: int):
    program = tmp_path / "engine"
    program.write_bytes(b"\0no program")
    program.chmod(mode)
    with pytest.raises(DataError, match="does not start") as told:
        Supervisor(plain_settings(), random_article(), program=program)
    assert "delete the file" in str(told.value.hint)
