"""Who takes an engine over, or starts one in a folder, does so alone; a way out is recorded to its end."""

from __future__ import annotations

import multiprocessing
import os
import time
import warnings

import numpy as np
import pytest

from engine_cases import OUTPUTS, SENSORS, plain_settings, random_article, static_package, still_article
from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.interface.shared_file import open_shared_file
from middeck.realtime.engine.process import supervisor
from middeck.realtime.engine.process.adopted_engine import AdoptedEngine
from middeck.realtime.engine.recording.run_file import read_run
from middeck.realtime.package.filter_sections import LoopPath, static_gain
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
FORK = multiprocessing.get_context("fork")  # so that no interpreter starts


def contend(look, act, said, start):
    """Act, slow between a look and what follows from it, say how it went, and live on."""
    looked = getattr(supervisor, look)

    def look_long(*asked):
        found = looked(*asked)
        time.sleep(0.1)
        return found

    setattr(supervisor, look, look_long)
    start.wait()
    try:
        engine = act()
        said.send("alone")
    except ConfigError as error:
        engine = None
        said.send(error.what)
    time.sleep(60.0)
    del engine


def race(look, act, count=2):
    """What each process says that acts at the same time; all of them live until all have said it."""
    start, pipes = FORK.Barrier(count), [FORK.Pipe(duplex=False) for _ in range(count)]
    started = [FORK.Process(target=contend, args=(look, act, said, start)) for _, said in pipes]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # threads of this process do nothing that the others need
            for process in started:
                process.start()
        return [heard.recv() for heard, _ in pipes]
    finally:
        for process in started:
            process.kill()
            process.join()


def test_of_several_that_start_or_take_over_one_does(tmp_path):
    """Each is slow between its look and what follows from it."""
    try:
        given = plain_settings(late_s=1e3), random_article()
        said = race(
            "require_no_engine",
            lambda: supervisor.Supervisor(*given, folder=tmp_path, real_time=True),
        )
        assert said.count("alone") == 1
        assert sum(what.startswith("an engine runs there") for what in said) == 1
        # Who started it has been killed.
        said = race("when_born", lambda: supervisor.Supervisor.attach(tmp_path / "engine.shared", given[0]))
        assert said.count("alone") == 1
        assert sum(what.startswith("has a supervisor that lives") for what in said) == 1
    finally:
        AdoptedEngine(open_shared_file(tmp_path / "engine.shared")).kill()


@pytest.mark.parametrize(("real_time", "ring", "ramp_s"), [(False, 300, 8.0), (True, 64, 0.6)])
def test_all_of_a_way_out_that_is_longer_than_the_ring_is_recorded(tmp_path, real_time, ring, ramp_s):
    hold = (LoopPath(0, 0, static_gain(-0.4)), LoopPath(1, 1, static_gain(-0.4)))
    settings = plain_settings(hold=hold, verify_s=0.1, late_s=1e3, ramp_s=ramp_s)
    article = still_article(np.full(SENSORS, 0.5))
    with Supervisor(settings, article, real_time=real_time, ring=ring) as engine:
        engine.reset()
        engine.record(tmp_path / "run.mdr")
        for _ in range(2):
            engine.run(settings.samples(0.6 * ramp_s), keep=False)
        assert engine.file.status["hold_verified"]
    run = read_run(tmp_path / "run.mdr")
    assert not run.faults
    assert np.array_equal(run.records["sequence"], 1 + np.arange(engine.sample))
    u = run.records["u"]
    assert len(u) >= settings.samples(2.2 * ramp_s)
    assert np.abs(np.diff(u, axis=0)).max() <= 1.5 / settings.samples(ramp_s) * 0.2 + 1e-15
    assert u[-1].tolist() == [0.0] * OUTPUTS


def test_who_reads_no_record_is_not_waited_for(tmp_path):
    """Without a recorder the end overwrites what nobody has read; its last records can be read."""
    settings = plain_settings(ramp_s=8.0, safe_ramp_s=8.0)
    with Supervisor(settings, still_article(np.full(SENSORS, 0.5)), ring=300) as engine:
        assert engine.load(static_package(np.full((OUTPUTS, SENSORS), 0.2))).done
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.run(400, keep=False)
    assert engine.sample > 4000
    assert int(engine.file.ring["sequence"].max()) == engine.sample


def write_at(file, at, data):
    with file.open("r+b") as opened:
        opened.seek(at)
        opened.write(data)


def test_a_shared_file_whose_head_was_changed_is_refused(tmp_path):
    """Each of its places, beyond the file's end or without an end: in words, and not by a fault of memory."""
    with Supervisor(
        plain_settings(), still_article(np.zeros(SENSORS)), folder=tmp_path, pretrip_s=0.1
    ) as engine:
        fields = engine.file.places.dtype.fields
    file = tmp_path / "engine.shared"
    whole = file.read_bytes()
    regions = ("settings", "asks", "status", "commands", "acknowledgements", "events", "ring", "pretrip")
    for field in (*regions, "ring_count", "pretrip_count"):
        at = fields[field][1]
        for word in (1 << 40, (1 << 63) - 1, (1 << 64) - 8):
            write_at(file, at, word.to_bytes(8, "little"))
            with pytest.raises(DataError, match="or changed"):
                Supervisor.attach(file, plain_settings())
        write_at(file, at, whole[at : at + 8])
    for size in (len(whole) - 1, len(whole) // 2, 4096, 64, 8, 0):
        os.truncate(file, size)
        with pytest.raises(DataError, match="or changed"):
            Supervisor.attach(file, plain_settings())
