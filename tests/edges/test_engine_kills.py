"""Whichever process is killed, and when: the loop goes to its safe state and the records stay readable."""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from engine_campaigns import seeds_of
from engine_cases import plain_settings, random_article, random_package
from engine_supervised import settings
from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.interface.shared_file import open_shared_file
from middeck.realtime.engine.process.adopted_engine import AdoptedEngine, when_born
from middeck.realtime.engine.recording.run_file import read_run
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
SCRIPT = Path(__file__).parents[1] / "engine_supervised.py"
PATIENCE_S = 20.0


@contextlib.contextmanager
def supervised(clock):
    """A supervisor in another process, its engine's number, and its folder; nothing of it is left behind."""
    folder, pid = Path(tempfile.mkdtemp(prefix="middeck-kill-")), 0
    process = subprocess.Popen(
        [sys.executable, str(SCRIPT), str(folder), clock], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        pid = int(process.stdout.readline())
        yield process, pid, folder
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()
        if pid:
            AdoptedEngine(open_shared_file(folder / "engine.shared")).kill()
        shutil.rmtree(folder)


def until(reached):
    began = time.monotonic()
    while not reached():
        assert time.monotonic() - began < PATIENCE_S
        time.sleep(0.005)


def killed(process, seed):
    """Kill it at some instant; the last that it said was on the disk."""
    time.sleep(random.Random(seed).uniform(0.0, 1.6))
    process.kill()
    said = process.communicate()[0].splitlines()
    whole = [line.split() for line in said if len(line.split()) == 2]
    return max((int(synced) for synced, _ in whole), default=0)


def check_file(path, synced):
    """Readable, without a gap, and with all that was said to be on the disk."""
    run = read_run(path)
    assert {fault.kind for fault in run.faults} <= {"no end", "torn"}
    assert len(run.records) >= synced
    return run


@pytest.fixture
def seeds():
    return seeds_of("kills of a supervisor, of its engine")


def test_a_killed_supervisor_leaves_a_real_time_loop_safe(seeds):
    """Another one takes over: it reads on, resets and engages again, and goes on with the same file."""
    for seed in seeds:
        with supervised("real") as (process, pid, folder):
            synced = killed(process, seed)
            shared = open_shared_file(folder / "engine.shared")
            until(lambda shared=shared: int(shared.status["state"]) == 0 and int(shared.status["trip"]) > 0)
            before = check_file(folder / "loop.mdr", synced)
            with Supervisor.attach(folder / "engine.shared", settings(True)) as engine:
                assert engine.process.pid == pid
                assert engine.events()[-1].kind == "heartbeat"
                engine.record(folder / "loop.mdr", resume=True)
                engine.run(5)
                assert engine.reset().done
                assert engine.command("engage", values=[1.0]).done
                engine.run(20)
                assert engine.state in ("engaging", "control")
            run = read_run(folder / "loop.mdr")
            assert not run.faults
            assert np.array_equal(run.records["sequence"], 1 + np.arange(len(run.records)))
            assert run.records[: len(before.records)].tobytes() == before.records.tobytes()
            kinds = [event.kind for event in run.events]
            assert kinds[-1] == "ended"
            assert kinds.count("heartbeat") == 1
            assert engine.process.poll() is not None


def test_a_killed_supervisor_ends_a_lockstep_engine(seeds):
    """By itself, through its safe state; all that it ran can still be read."""
    for seed in seeds:
        with supervised("lockstep") as (process, _, folder):
            synced = killed(process, seed)
            orphan = AdoptedEngine(open_shared_file(folder / "engine.shared"))
            orphan.wait(PATIENCE_S)
            check_file(folder / "loop.mdr", synced)
            with Supervisor.attach(folder / "engine.shared", settings(False)) as engine:
                assert engine.state == "safe"
                events = engine.events()
                assert [event.kind for event in events[-2:]] == ["stop", "ended"]
                engine.record(folder / "loop.mdr", resume=True)
                with pytest.raises(DataError, match="has ended"):
                    engine.run(1)
            run = read_run(folder / "loop.mdr")
            assert not run.faults
            assert len(run.records) == engine.sample
            assert np.all(run.records["u"][-1] == 0.0)


@pytest.mark.parametrize("clock", ["real", "lockstep"])
def test_a_killed_engine_leaves_its_records(clock):
    with Supervisor(settings(clock == "real"), random_article(), real_time=clock == "real") as engine:
        engine.reset()
        engine.run(40)
        engine.stop()
        engine.run(10)
        os.kill(engine.process.pid, signal.SIGKILL)
        engine.process.wait()
        with pytest.raises(DataError, match="has ended with code -9"):
            engine.run(40)
        frozen = engine.pretrip()
        assert frozen["sequence"][-1] == frozen["sequence"][0] + len(frozen) - 1
        assert frozen["trip"][-1] == 1
        assert "stop" in [event.kind for event in engine.events()]
        assert engine.state == "safe"
        assert int(engine.file.ring["sequence"].max()) >= 50


@pytest.mark.parametrize("clock", ["real", "lockstep"])
def test_an_engine_that_is_told_to_go_goes_through_safe(clock):
    with Supervisor(settings(clock == "real"), random_article(), real_time=clock == "real") as engine:
        engine.load(random_package())
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.run(40)
        engine.process.send_signal(signal.SIGTERM)
        assert engine.process.wait(PATIENCE_S) == 0
        assert [event.kind for event in engine.events()[-2:]] == ["stop", "ended"]
        records = engine.read()
        assert engine.state == "safe"
        assert np.all(records["u"][-1] == 0.0)


def test_who_may_take_over(tmp_path):
    with Supervisor(plain_settings(), random_article(), folder=tmp_path) as engine:
        path = engine.file.path
        with pytest.raises(ConfigError, match="other settings"):
            Supervisor.attach(path, plain_settings(ramp_s=3.0))
        engine.file.asks["supervisor"], engine.file.asks["supervisor_born"] = 1, when_born(1)
        with pytest.raises(ConfigError, match="supervisor that lives, process 1"):
            Supervisor.attach(path, plain_settings())
        engine.file.asks["supervisor_born"] = when_born(1) + 1  # another that had its number
        again = Supervisor.attach(path, plain_settings())
        (tmp_path / "text").write_text("x" * 1000)
        for other, reason in (("text", "no shared file"), ("none", "cannot be read")):
            with pytest.raises(DataError, match=reason):
                Supervisor.attach(tmp_path / other, plain_settings())
        file = open_shared_file(path)
        assert AdoptedEngine(file).poll() is None
        for number, born in ((os.getpid(), when_born(os.getpid())), (engine.process.pid, 1), (0, 0)):
            file.status["pid"], file.status["born"] = number, born
            assert AdoptedEngine(file).poll() == -1  # another program of that number, or of an earlier one
        again.close()
