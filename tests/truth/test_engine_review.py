"""States of the engine from which a fault must still end in SAFE, and a torque must not jump."""

from __future__ import annotations

import dataclasses
import errno
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from engine_cases import (
    OUTPUTS,
    SENSORS,
    kinds,
    plain_settings,
    random_article,
    static_package,
    still_article,
    verified,
)
from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.interface.monitors import Monitor
from middeck.realtime.engine.interface.shared_file import open_shared_file
from middeck.realtime.engine.process.compile import build_engine, engine_sources
from middeck.realtime.engine.process.launch import DriverRig
from middeck.realtime.engine.rigs.linear_article import Fault, LinearArticle
from middeck.realtime.package.filter_sections import LoopPath, static_gain
from packaged_laws import PERIOD_S
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
RAMP = 250


@pytest.mark.parametrize("watched", [False, True])
def test_a_loud_band_does_not_hide_that_the_hold_takes_all_effort(watched):
    """A drive that turns its sign makes the verified hold a limit cycle: in SAFE it must be let go."""
    omega = 2 * np.pi * 20
    turn = np.array([[0, 1, 0], [-(omega**2), -0.04 * omega, omega**2], [0, 0, 0]])
    stepped = scipy.linalg.expm(turn * PERIOD_S)
    article = LinearArticle(
        A=stepped[:2, :2], B=np.hstack([0.01 * stepped[:2, 2:], np.zeros((2, 1))]),
        C=np.array([[1, 0], [0, 1 / omega], [0, 0]]), G=np.zeros((2, 1)), x=np.zeros(2),
        sensor_noise=np.full(SENSORS, 1e-4), seed=3,
    )  # fmt: skip
    loud = Monitor(channel="u0", side="output", band_hz=(0.0, np.inf), limit=0.2, seconds=0.1)
    settings = plain_settings(
        hold=(LoopPath(1, 0, static_gain(-40.0)),), verify_s=0.1, effort_s=0.5,
        monitors=(loud,) if watched else (),
    )  # fmt: skip
    turned = dataclasses.replace(article, faults=(Fault(kind="output gain", start=1500, value=-1.0),))
    with Supervisor(settings, turned) as engine:
        verified(engine)
        engine.run(4000, keep=False)
        assert engine.state == "safe"
        assert engine.file.status["hold_verified"] == 0
        assert "hold lost" in kinds(engine)
        assert not engine.run(10)["u"].any()


def test_no_strip_moves_an_output_in_safe():
    """Nothing moves before a reset, nor by a strip while a trip holds the loop."""
    with Supervisor(plain_settings(), still_article([0.5, -0.5, 0.0])) as engine:
        assert engine.set_strip("u0", "offset", 0.5).word == "not ready"
        assert not engine.run(300)["u"].any()
        engine.reset()
        engine.stop()
        engine.run(1)
        assert engine.set_strip("u0", "offset", 0.5).word == "not ready"
        assert not engine.run(300)["u"].any()


def test_a_strip_that_is_held_again_while_it_lets_go_does_not_jump():
    with Supervisor(plain_settings(), still_article([0.0, 0.0, 0.0])) as engine:
        engine.reset()
        engine.set_strip("u0", "offset", 0.5)
        engine.run(400, keep=False)
        engine.set_strip("u0", "hold", 1)
        engine.run(300, keep=False)
        engine.set_strip("u0", "offset", -0.5)
        engine.run(500, keep=False)
        engine.set_strip("u0", "hold", 0)
        records = [engine.run(75)]
        engine.set_strip("u0", "hold", 1)
        records.append(engine.run(300))
    u = np.concatenate(records)["u"][:, 0]
    assert np.abs(np.diff(u)).max() <= 1.0 / RAMP + 1e-15
    assert u[-1] == pytest.approx(0.5)


def test_who_stands_by_adds_nothing_whatever_limits_did():
    """Its own slew must not go on from an output that a held strip stood at."""
    idle = static_package(np.zeros((OUTPUTS, SENSORS)), slew_rate=0.05)
    with Supervisor(plain_settings(), still_article([0.0, 0.0, 0.0])) as engine:
        assert engine.load(idle).done
        engine.reset()
        assert engine.command("standby").done
        engine.set_strip("u0", "offset", 0.4)
        records = [engine.run(300)]
        engine.set_strip("u0", "hold", 1)
        records.append(engine.run(300))
        engine.set_strip("u0", "offset", 0.0)
        records.append(engine.run(300))
        engine.set_strip("u0", "hold", 0)
        records.append(engine.run(300))
    seen = np.concatenate(records)
    assert not seen["added_0"].any()
    assert seen["u"][-1].tolist() == [0.0, 0.0]


READ, MISSED, LOST, FOREIGN = range(4)  # of rig.h
LOSING = """#include "rig.h"

#include <stdlib.h>

#include "queue.h"

static whole written;

void __real_publish_record(shared *f, const engine *e, const real *y, whole late_ns, whole step_ns);
void __wrap_publish_record(shared *f, const engine *e, const real *y, whole late_ns, whole step_ns);

void __wrap_publish_record(shared *f, const engine *e, const real *y, whole late_ns, whole step_ns)
{
    if (e->happenings > 0)
        abort();
    __real_publish_record(f, e, y, late_ns, step_ns);
}

static enum rig_answer read_sensors(rig *r, real *y)
{
    whole i;

    for (i = 0; i < r->set->inputs; ++i)
        y[i] = 0.001 * (real)i;
    return written == 20 ? (enum rig_answer)atoi(getenv("READS")) : RIG_READ;
}

static enum rig_answer write_outputs(rig *r, const real *u, whole alive)
{
    (void)r;
    (void)u;
    (void)alive;
    return ++written == 20 ? (enum rig_answer)atoi(getenv("WRITES")) : RIG_READ;
}

static void close_driver(rig *r)
{
    (void)r;
}

rig *open_driver(const settings *set)
{
    static rig driver = {read_sensors, write_outputs, close_driver, 0};

    driver.set = set;
    return &driver;
}
"""


@pytest.mark.parametrize(
    ("reads", "writes", "trip"),
    [
        (READ, LOST, "rig dead"),
        (READ, MISSED, "no answer"),
        (READ, FOREIGN, "other format"),
        (READ, 7, "rig dead"),
        (LOST, READ, "rig dead"),
        (-1, READ, "rig dead"),
    ],
)
def test_outputs_that_do_not_arrive_trip(tmp_path, monkeypatch, reads, writes, trip):
    """Whatever a driver answers; the event stands in the file before its record, else this engine aborts."""
    driver = tmp_path / "losing.c"
    driver.write_text(LOSING)
    program = build_engine(driver=driver, flags=("-O0", "-Wl,--wrap=publish_record"))
    for name, answer in (("READS", reads), ("WRITES", writes)):
        monkeypatch.setenv(name, str(answer))
    with Supervisor(plain_settings(), DriverRig(), program=program) as engine:
        engine.reset()
        engine.run(20, keep=False)
        assert engine.state == "ready"
        engine.run(1, keep=False)
        assert engine.state == "safe"
        assert kinds(engine) == ["reset done", trip]


def test_commands_and_waiting_for_their_answers_are_beats():
    """A reset after a pause, or a package that takes long to check, must not trip by the heartbeat."""
    settings = plain_settings(heartbeat_s=0.2, late_s=1e3)
    with Supervisor(settings, random_article(), real_time=True) as engine:
        engine.run(20, keep=False)
        time.sleep(0.5)
        assert engine.reset().done
        engine.run(50, keep=False)
        assert engine.state == "ready"
        assert kinds(engine) == ["reset done"]


def test_records_before_a_trip_are_whole_and_in_order():
    """While an earlier trip held the loop none were kept: what stands in their places is older."""
    with Supervisor(plain_settings(), random_article(), pretrip_s=150 * PERIOD_S) as engine:
        engine.reset()
        engine.run(100, keep=False)
        engine.stop()
        engine.run(100, keep=False)
        engine.reset()
        engine.run(10, keep=False)
        engine.stop()
        engine.run(50, keep=False)
        assert engine.pretrip()["sequence"].tolist() == [*range(62, 102), *range(201, 212)]


def test_an_answer_that_a_later_one_has_replaced_is_not_given():
    with Supervisor(plain_settings(), random_article()) as engine:
        refused = engine.send("engage", values=[1.0])
        for _ in range(256):
            last = engine.send("silence")
        assert engine.answer(last).done
        with pytest.raises(DataError, match="answer to command 1 is gone"):
            engine.answer(refused)


def test_who_cannot_be_ended_by_a_command_goes_through_safe():
    """A command that is not due yet stands before the end: the engine is told by a signal."""
    with Supervisor(plain_settings(), random_article()) as engine:
        engine.reset()
        engine.run(10, keep=False)
        engine.send("silence", at=1 << 40)
        status = engine.file.status
    assert engine.process.returncode == 0
    assert status["state"] == 0
    assert status["trips"] == 1


def test_who_is_told_to_go_takes_no_command_any_more():
    """A reset on the way out would end in a step from what moves the article then."""
    settings = plain_settings(safe_ramp_s=0.5, late_s=1e3)
    with Supervisor(settings, random_article(), real_time=True) as engine:
        engine.reset()
        engine.set_strip("u0", "offset", 0.4)
        engine.run(200, keep=False)
        engine.process.send_signal(signal.SIGTERM)
        while engine.state != "safe":
            time.sleep(0.01)
        engine.send("reset", values=[engine.trip])
        engine.process.wait(5.0)
        assert engine.state == "safe"


def test_the_shared_file_has_its_room_on_the_disk():
    """A full disk must be refused at the start, not end the loop by a page that cannot be written."""
    with Supervisor(plain_settings(), random_article()) as engine:
        found = engine.file.path.stat()
        assert found.st_blocks * 512 >= found.st_size


def test_a_disk_without_room_is_said(monkeypatch, tmp_path):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(DataError, match="No space left"):
        Supervisor(plain_settings(), random_article(), folder=tmp_path)


def test_a_folder_in_which_an_engine_runs_is_refused(tmp_path):
    """Its shared file would be cut to nothing under the loop."""
    with Supervisor(plain_settings(), random_article(), folder=tmp_path) as engine:
        engine.reset()
        engine.run(10, keep=False)
        with pytest.raises(ConfigError, match="an engine runs"):
            Supervisor(plain_settings(), random_article(), folder=tmp_path)
        assert len(engine.run(10)) == 20 - 10
        assert engine.state == "ready"
    with Supervisor(plain_settings(), random_article(), folder=tmp_path) as again:
        assert len(again.run(10)) == 10


def test_an_engine_in_a_relative_folder_is_found_again(tmp_path, monkeypatch):
    """Its words must name the file as whoever takes it over knows it."""
    monkeypatch.chdir(tmp_path)
    settings = plain_settings(late_s=1e3)
    with (
        Supervisor(settings, random_article(), folder=Path(), real_time=True) as engine,
        Supervisor.attach(Path("engine.shared"), settings) as again,
    ):
        assert again.process.poll() is None
        assert engine.process.pid == again.process.pid


def test_who_takes_an_engine_over_asks_for_verdicts_too(tmp_path):
    settings = plain_settings(late_s=1e3)
    with (
        Supervisor(settings, random_article(), folder=tmp_path, real_time=True) as engine,
        Supervisor.attach(tmp_path / "engine.shared", settings, admitted={}) as again,
    ):
        assert again.load(static_package(np.zeros((OUTPUTS, SENSORS)))).word == "not admitted"
        assert not engine.events()


def test_a_stop_before_the_loop_begins_counts(tmp_path):
    """A program that starts late: whoever says STOP meanwhile has said it, and a reset must name it."""
    late = tmp_path / "late"
    late.write_text(f'#!/bin/sh\nsleep 0.5\nexec {build_engine()} "$@"\n')
    late.chmod(0o755)

    def say_stop():
        time.sleep(0.3)
        open_shared_file(tmp_path / "engine.shared").asks["stop"] += 1

    crew = threading.Thread(target=say_stop)
    crew.start()
    with Supervisor(
        plain_settings(late_s=1e3), random_article(), folder=tmp_path, real_time=True, program=late
    ) as engine:
        crew.join()
        engine.run(10, keep=False)
        assert engine.trip == 1
        assert engine.command("reset", values=[0.0]).word == "wrong trip"


def test_events_that_were_overwritten_are_said():
    """The ring of events is shorter than what happened: how many are gone is a warning, not a silence."""
    with Supervisor(plain_settings(), still_article([0.0] * SENSORS), waveform=np.zeros((1, 2))) as engine:
        engine.reset()
        assert [event.number for event in engine.events()] == [1]
        for _ in range(600):
            engine.command("excite", values=[1.0])
            engine.run(1, keep=False)
        with pytest.warns(UserWarning, match="176 events were lost"):
            found = engine.events()
        assert [event.number for event in found] == list(range(178, 1202))
        assert engine.events() == []


def test_a_start_that_fails_leaves_no_folder(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    broken = tmp_path / "broken"
    broken.write_text("#!/bin/sh\nexit 3\n")
    broken.chmod(0o755)
    for wrong in ({"waveform": np.zeros((2, 9))}, {"program": broken}, {"program": tmp_path / "none"}):
        with pytest.raises((ConfigError, DataError, OSError)):
            Supervisor(plain_settings(), random_article(), **wrong)
        assert [path.name for path in tmp_path.iterdir()] == ["broken"]


def test_settings_are_read_without_a_library_of_filters():
    """Whoever only commands an engine does not wait a second for one."""
    said = "import sys, middeck.realtime.engine.process.supervisor; print('scipy.signal' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    assert found.stdout == "False\n"


def test_what_is_published_is_fenced_where_stores_are_reordered(small_processors, tmp_path):
    """On ARM a record is opened, a barrier stands, and a release closes it: nobody reads half of one."""
    for name, text in engine_sources().items():
        (tmp_path / name).write_text(text)
    (tmp_path / "string.h").write_text(
        "#include <stddef.h>\nvoid *memcpy(void *, const void *, size_t);\n"
        "void *memset(void *, int, size_t);\nint memcmp(const void *, const void *, size_t);\n"
    )
    flags = ["-ffreestanding", "-I.", "-march=armv8-a", "-O2", "-S"]
    subprocess.run([small_processors[0], *flags, "publish.c"], cwd=tmp_path, check=True)
    bodies = re.split(r"^(\w+):$", (tmp_path / "publish.s").read_text(), flags=re.MULTILINE)
    found = dict(zip(bodies[1::2], bodies[2::2], strict=True))
    for function in ("publish_events", "publish_record", "answer_command"):
        assert 0 < found[function].find("dmb") < found[function].rfind("stl"), function
