"""Whichever process is killed, and when: the loop goes to its safe state and the records stay readable."""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import signal
import socket
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from engine_campaigns import cases_of, seeds_of
from engine_cases import plain_settings, random_article, random_package
from engine_supervised import (
    HELD,
    Forked,
    constant_law,
    held_settings,
    kill_at_line,
    settings,
    supervise,
    supervise_held,
)
from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.interface.commands import KINDS, TRIPS
from middeck.realtime.engine.interface.shared_file import event_rows, open_shared_file
from middeck.realtime.engine.process.adopted_engine import AdoptedEngine, when_born
from middeck.realtime.engine.process.launch import UdpRig
from middeck.realtime.engine.recording.run_file import read_run
from middeck.realtime.engine.rigs.rig_server import LOOPBACK, serve_rig
from middeck.realtime.engine.rigs.stepped_article import SteppedArticle
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
PATIENCE_S = 20.0
STOPS_AT = {"lockstep": 30_000, "real": 12_000}
"""Lines of its own that a supervisor has executed after seconds."""


@contextlib.contextmanager
def supervised(act):
    """A process that does ``act``, and its folder; neither it nor its engine is left behind."""
    folder = Path(tempfile.mkdtemp(prefix="middeck-kill-"))
    try:
        with Forked(lambda told: act(folder, told)) as process:
            yield process, folder
    finally:
        for pid in engines_of(folder):
            os.kill(pid, signal.SIGKILL)
        shutil.rmtree(folder)


def engines_of(folder):
    """Numbers of the processes that run the engine of a folder, found by their words."""
    name = str(folder / "engine.shared").encode()
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            words = (place / "cmdline").read_bytes().split(b"\0")
            if name in words and when_born(int(place.name)):
                found.append(int(place.name))
    return found


def until(reached):
    began = time.monotonic()
    while not reached():
        assert time.monotonic() - began < PATIENCE_S
        time.sleep(0.005)


def killed(process, seed):
    """Kill it at some instant of its rounds; the last that it said was on the disk."""
    until(lambda: process.told["round"] > 0)
    time.sleep(random.Random(seed).uniform(0.0, 1.6))
    process.kill()
    return int(process.told["synced"])


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
        with supervised(lambda folder, told: supervise(folder, True, told)) as (process, folder):
            synced = killed(process, seed)
            shared = open_shared_file(folder / "engine.shared")
            (pid,) = engines_of(folder)
            until(lambda shared=shared: int(shared.status["state"]) == 0 and int(shared.status["trip"]) > 0)
            before = check_file(folder / "loop.mdr", synced)
            with Supervisor.attach(folder / "engine.shared", settings(True)) as engine:
                assert engine.process.pid == pid
                assert engine.events()[-1].kind == "heartbeat"
                engine.record(folder / "loop.mdr", resume=True)
                engine.run(25)
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
            reset = [event.sample for event in run.events if event.kind == "reset done"][-1]
            (trip,) = [event.sample for event in run.events if event.kind == "heartbeat"]
            # On a busy machine the supervisor may be missed before it has engaged anything.
            engaged = "engaged" in kinds[: kinds.index("heartbeat")]
            assert engaged == bool(np.any(run.records["u"][trip - 1]))
            assert_falls_to_zero(run.records["u"], trip, reset, settings(True))


def assert_falls_to_zero(u, trip, end, settings):
    """From the sample of a trip on: torques on one ramp to zero, where they stay until ``end``."""
    ramp = settings.samples(settings.safe_ramp_s)
    sizes = np.abs(u[trip - 1 : trip + ramp])
    assert np.all(np.diff(sizes, axis=0) <= 0.0)
    assert np.all(u[trip : trip + ramp] * u[trip - 1] >= 0.0)
    steepest = 1.5 / ramp * (1.0 + 1e-9)
    assert np.all(-np.diff(sizes, axis=0) <= steepest * sizes[0])
    assert end > trip + ramp
    assert not np.any(u[trip + ramp : end])


RIG_STATES = ("control", "ready", "engaging", "identify", "disengaging")


@pytest.mark.parametrize("state", RIG_STATES)
def test_a_rig_killed_at_any_instant_leads_to_safe(state, tmp_path):
    """A real process behind UDP: torques that were there fall to zero, all is recorded, nothing resets."""
    count = cases_of("kills of a rig in a process of its own, in every state")
    for seed in range(count // len(RIG_STATES)):
        path, rng = tmp_path / f"{seed}.mdr", np.random.default_rng([seed, RIG_STATES.index(state)])
        given = plain_settings()
        wave = 0.1 * rng.standard_normal((200, len(given.drives)))
        with rig_in_a_process() as (process, rig), Supervisor(given, rig, waveform=wave) as engine:
            engine.record(path)
            assert engine.load(random_package()).done
            assert engine.reset().done
            engine.run(300, keep=False)
            if state == "identify":
                assert engine.command("excite", values=[0.0]).done
            elif state != "ready":
                assert engine.command("engage", values=[1.0]).done
            engine.run(40 if state in ("identify", "engaging") else 400, keep=False)
            if state == "disengaging":
                assert engine.command("disengage").done
                engine.run(10, keep=False)
            assert engine.state == state
            timer = threading.Timer(rng.uniform(0.0, 0.005), process.kill)
            timer.start()
            while engine.state != "safe":
                engine.run(50, keep=False)
            timer.join()
            ramp = given.samples(given.safe_ramp_s)
            engine.run(2 * ramp, keep=False)
            assert engine.reset().word == "still unhealthy"
            (trip,) = [event for event in engine.events() if event.trips]
        assert trip.kind == "rig dead"
        run = read_run(path)
        assert not run.faults
        assert np.array_equal(run.records["sequence"], 1 + np.arange(len(run.records)))
        if np.any(run.records["u"][trip.sample - 1]):
            assert_falls_to_zero(run.records["u"], trip.sample, len(run.records), given)
        else:
            assert state == "ready"
            assert not np.any(run.records["u"])


@contextlib.contextmanager
def rig_in_a_process():
    """It, and how an engine finds it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind((LOOPBACK, 0))
        rig = SteppedArticle(random_article())
        with Forked(lambda told: serve_rig(rig, opened)) as process:
            port = opened.getsockname()[1]
            opened.close()  # else what is sent to a dead one waits here
            yield process, UdpRig(port)


def test_a_killed_supervisor_ends_a_lockstep_engine(seeds):
    """By itself, through its safe state; all that it ran can still be read."""
    for seed in seeds:
        with supervised(lambda folder, told: supervise(folder, False, told)) as (process, folder):
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


def killed_at_line(clock, seed):
    """At a line of its own: from its first one to many rounds with a hold and a law; process and folder.

    Every other seed looks at the start closely, as evenly as multiples of the golden ratio lie.
    """
    share, most = 0.6180339887 * seed % 1.0, STOPS_AT[clock]
    line = round(share * most if seed % 2 else 10.0 * (0.1 * most) ** share)

    def act(folder, told):
        kill_at_line(told, line)
        supervise_held(folder, clock == "real", told)

    return supervised(act)


def outputs_of(file):
    """Records of the ring in order; no output beyond hold and law, and no step beyond that of two ramps."""
    ring = file.ring[file.ring["sequence"] > 0]
    records = ring[np.argsort(ring["sequence"])]
    assert np.all(np.diff(records["sequence"]) == 1)
    u = records["u"]
    assert np.all((u >= HELD - 1e-12) & (u <= 1e-12))
    settings = held_settings(False)
    steepest = sum(1.5 / settings.samples(ramp_s) for ramp_s in (settings.ramp_s, settings.safe_ramp_s))
    assert np.abs(np.diff(u, axis=0)).max(initial=0.0) <= -HELD * steepest
    return records


def check_record(process, folder):
    """What was said to be recorded can be read, whenever it was killed."""
    told = process.told
    if told["recorded"]:
        check_file(folder / "loop.mdr", int(told["synced"]))
    elif (folder / "loop.mdr").exists() and (folder / "loop.mdr").stat().st_size:
        check_file(folder / "loop.mdr", 0)


def test_a_supervisor_killed_at_any_line_leaves_a_lockstep_engine_at_zero():
    """It ends, from the law or the hold along ramps, and none is left that waits for a supervisor."""
    constant_law()
    for seed in seeds_of("kills of a supervisor at any of its lines, in lockstep"):
        with killed_at_line("lockstep", seed) as (process, folder):
            process.wait()
            until(lambda folder=folder: not engines_of(folder))
            check_record(process, folder)
            if process.told["round"]:
                file = open_shared_file(folder / "engine.shared")
                records = outputs_of(file)
                assert not np.any(records["u"][-1])
                assert records["state"][-1] == 0
                assert int(file.status["running"]) == 0
                assert int(file.status["sample"]) == records["sequence"][-1]


def test_a_supervisor_killed_at_any_line_leaves_a_real_time_loop_in_its_safe_state():
    """The verified hold, else zero; within the time that its heart may not beat."""
    silent = held_settings(True).samples(held_settings(True).heartbeat_s)
    ramp = held_settings(True).samples(held_settings(True).safe_ramp_s)
    constant_law()
    seeds, acted = seeds_of("kills of a supervisor at any of its lines, in real time"), 0
    for seed in seeds:
        with killed_at_line("real", seed) as (process, folder):
            process.wait()
            check_record(process, folder)
            if not engines_of(folder):
                assert process.told["round"] == 0  # killed before it started one
                continue
            file = open_shared_file(folder / "engine.shared")
            last = int(file.status["sample"])
            until(lambda file=file, last=last: int(file.status["sample"]) > last + silent + 2 * ramp)
            os.kill(engines_of(folder)[0], signal.SIGSTOP)
            records = outputs_of(file)
            trips = [row for row in event_rows(file, 0) if KINDS[int(row["kind"])] in TRIPS]
            if process.told["round"]:
                assert {KINDS[int(row["kind"])] for row in trips} == {"heartbeat"}
                assert trips[-1]["sample"] <= last + silent + 1
            held = HELD if file.status["hold_verified"] else 0.0
            acted += bool(held) and bool(np.any(records["slots"][: -silent - 2 * ramp]))
            assert np.all(records["state"][-ramp:] == 0)
            assert records["u"][-1] == pytest.approx(held, abs=1e-12)
    assert acted > len(seeds) // 10, "hardly any was killed beside a law and a verified hold"


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
