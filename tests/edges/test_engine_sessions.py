"""Commands of another session move nothing; a file of another build is read by nobody; a run is a count."""

from __future__ import annotations

import contextlib
import os
import subprocess

import numpy as np
import pytest

from engine_cases import kinds, plain_settings, random_article, random_package
from engine_faults import ARTICLE, HOLDING, engine_in, fault_settings
from engine_rigs import nominal_article
from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.interface import header
from middeck.realtime.engine.interface.commands import COMMANDS, check_of
from middeck.realtime.engine.interface.shared_file import open_shared_file
from middeck.realtime.engine.process.compile import build_engine
from middeck.realtime.engine.recording.run_file import read_run
from repeats import repeats
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")


def into_control(engine):
    """The commands by which a session went there, as they stood in the file, and one of each other kind."""
    others = [("excite", [0.0]), ("strip", [1.0, 0.3]), ("silence", []), ("disengage", []), ("end", [])]
    assert engine.load(random_package()).done
    assert engine.reset().done
    for kind, values in [("engage", [1.0]), *others]:
        engine.send(kind, values=values)
    return engine.file.commands.copy(), int(engine.file.asks["written"])


def replayed(engine, rows, written):
    """Put the rows of another session where this engine looks for its next commands; its answers."""
    engine.file.commands[:] = rows
    first = int(engine.file.status["acknowledged"]) + 1
    engine.file.asks["written"] = written
    return [engine.answer(number).word for number in range(first, written + 1)]


WAVE = np.full((500, 2), 0.1)


def test_commands_that_an_earlier_session_gave_are_refused():
    """Word by word as they were, checks and all, in the same file of an engine started anew."""
    with Supervisor(plain_settings(), random_article(), waveform=WAVE) as engine:
        rows, written = into_control(engine)
    with Supervisor(plain_settings(), random_article(), waveform=WAVE) as engine:
        assert set(replayed(engine, rows, written)) == {"other session"}
        assert not engine.run(100)["u"].any()
        assert engine.state == "safe"
        assert engine.reset().done  # its own are still heard
        assert [kind for kind in kinds(engine) if kind != "power up"] == ["reset done"]


@pytest.mark.parametrize("state", repeats(["control", "identify", "engaging", "ready", "disengaging"], 2))
def test_in_no_state_does_an_earlier_session_move_anything(state):
    """Each row whose number comes next: the loop gives the bits that it gives without them."""
    rig, settings, start = nominal_article(*ARTICLE), fault_settings(), HOLDING + 200
    wave = 0.02 * np.random.default_rng(3).standard_normal((200, len(settings.drives)))
    seen = []
    for foreign in (False, True):
        with engine_in(state, start, rig, settings, waveform=wave) as engine:
            assert engine.state == state
            taken = int(engine.file.asks["written"])
            if foreign:
                rows = engine.file.commands.copy()
                for number in range(taken + 1, taken + 41):
                    row = rows[number % len(rows)]
                    kind = ("disengage", "engage", "silence", "excite", "strip", "end")[number % 6]
                    row["number"], row["session"], row["kind"], row["at"] = number, 7, COMMANDS[kind], 0
                    row["slot"], row["value"] = 0, [1.0, 0.3, 0.0, 0.0]
                    row["check"] = check_of(row)
                found = replayed(engine, rows, taken + 40)
                assert set(found) == {"other session"}
            seen.append(engine.run(100)[["y", "u", "state"]].tobytes())
    assert seen[0] == seen[1]


@pytest.mark.parametrize("real_time", [False, True])
def test_who_was_relieved_commands_no_more(tmp_path, real_time):
    """What it left in the queue is refused at once, due or not, and blocks nobody; STOP is anybody's."""
    settings = plain_settings(late_s=1e3)
    with (
        Supervisor(settings, random_article(), folder=tmp_path, real_time=real_time, waveform=WAVE) as old,
        contextlib.ExitStack() as ending,
    ):
        assert old.load(random_package()).done
        assert old.reset().done
        left = [
            old.send("standby", at=1 << 40),
            old.send("excite", values=[0.0]),
            old.send("end", at=1 << 40),
        ]
        again = ending.enter_context(Supervisor.attach(tmp_path / "engine.shared", settings))
        again.run(5)
        assert [again.answer(number).word for number in left] == ["other session"] * 3
        for speak in (old.reset, lambda: old.send("engage", values=[1.0]), lambda: old.run(5)):
            with pytest.raises(DataError, match="another supervisor has taken"):
                speak()
        beats = int(old.file.asks["heartbeat"])
        old.beat()
        assert int(old.file.asks["heartbeat"]) == beats
        assert again.command("engage", values=[1.0]).done
        again.run(20)
        old.stop()
        again.run(5)
        assert again.state == "safe"


def test_who_is_relieved_while_the_queue_is_full_overwrites_no_command(tmp_path, monkeypatch):
    settings = plain_settings()
    with (
        Supervisor(settings, random_article(), folder=tmp_path) as old,
        contextlib.ExitStack() as ending,
    ):
        sent = []

        def relieve(reached):
            monkeypatch.undo()
            sent.append(ending.enter_context(Supervisor.attach(tmp_path / "engine.shared", settings)))
            sent.append(sent[0].send("reset", values=[sent[0].trip]))

        monkeypatch.setattr(old, "_wait", relieve)
        with pytest.raises(DataError, match="another supervisor has taken"):
            old.send("engage", values=[1.0])
        assert sent[0].answer(sent[1]).done


def test_a_package_under_check_while_the_engine_is_taken_over_ends_its_check(tmp_path):
    """Its answer is that of the check, and the next one is loaded as ever."""
    settings = plain_settings(late_s=1e3)
    with Supervisor(settings, random_article(), folder=tmp_path, real_time=True) as old:
        number = old.send("load", values=[old.file.stage(random_package()), 0])
        with Supervisor.attach(tmp_path / "engine.shared", settings) as again:
            assert again.answer(number).word in {"done", "other session"}
            assert again.load(random_package()).done


@pytest.mark.parametrize("real_time", [False, True])
@pytest.mark.parametrize("ending", ["closed", "an error"])
def test_who_was_relieved_leaves_engine_and_files_alone(tmp_path, real_time, ending):
    """Its end is not the engine's; nothing that it still does moves a word of the file; all is recorded."""
    settings = plain_settings(late_s=1e3)
    old = Supervisor(settings, random_article(), real_time=real_time)
    old.record(tmp_path / "old.mdr")
    assert old.load(random_package()).done
    assert old.reset().done
    assert old.command("engage", values=[1.0]).done
    old.run(20)
    with Supervisor.attach(old.file.path, settings) as again:
        again.record(tmp_path / "new.mdr")
        again.run(20)
        staged = bytes(old.file.map[int(old.file.places["staging"]) :])
        reads = [old.read, lambda: old.load(random_package(seed=9)), lambda: old.record(tmp_path / "x.mdr")]
        asks = again.file.asks.tobytes()
        for speak in reads:
            with pytest.raises(DataError, match="another supervisor has taken"):
                speak()
        if ending == "closed":
            old.close()
        else:
            with pytest.raises(KeyError), old:
                raise KeyError
        assert again.file.asks.tobytes() == asks
        assert bytes(old.file.map[int(old.file.places["staging"]) :]) == staged
        assert old.file.path.exists()
        again.run(20)
        assert again.process.poll() is None
        assert again.state in ("engaging", "control")
    assert old.process.wait() == 0
    assert not old.file.path.parent.exists()  # its last supervisor removes what is temporary
    seen = [read_run(tmp_path / name).records["sequence"] for name in ("old.mdr", "new.mdr")]
    assert np.union1d(*seen).tolist() == list(range(1, again.sample + 1))


def test_a_folder_of_the_user_stays(tmp_path):
    (tmp_path / "temporary").mkdir()
    old = Supervisor(plain_settings(), random_article(), folder=tmp_path)
    with Supervisor.attach(old.file.path, plain_settings()) as again:
        again.run(1)
    old.close()
    assert old.process.wait() == 0
    assert (tmp_path / "temporary").exists()


def test_a_number_that_moves_makes_another_layout(monkeypatch):
    """Of an event, an answer or a field; words about them make none."""
    own, text = header.layout_check(), header.source_text("shared.h")
    changes = {
        "events": text.replace("RESET_DONE = 100, LOADED", "RESET_DONE = 100, UNLOADED, LOADED"),
        "trips": text.replace("STOP, NOT_FINITE", "NOT_FINITE, STOP"),
        "answers": text.replace("WRONG_SLOT, ", ""),
        "fields": text.replace("whole late, worst_late_ns", "whole worst_late_ns, late"),
    }
    found = set()
    for changed in [*changes.values(), text.replace("/* Why the loop", "/* Wherefore it"), text]:
        monkeypatch.setattr(header, "source_text", lambda file, changed=changed: changed)
        header._header.cache_clear()
        header.layout_check.cache_clear()
        found.add(header.layout_check())
    monkeypatch.undo()
    header._header.cache_clear()
    header.layout_check.cache_clear()
    assert own in found
    assert len(found) == 1 + len(changes)


def test_nobody_reads_a_file_of_another_build(tmp_path):
    """Neither who would take over nor the engine; and an engine of another build still bars its folder."""
    with Supervisor(plain_settings(), random_article(), folder=tmp_path) as engine:
        path, own = engine.file.path, int(engine.file.places["layout"])
        at = 8 * engine.file.places.dtype.names.index("layout")
        engine.file.map[at : at + 8] = (own ^ 1).to_bytes(8, "little")
        with pytest.raises(DataError, match="another build"):
            open_shared_file(path)
        with pytest.raises(ConfigError, match=f"an engine runs there, process {engine.process.pid}"):
            Supervisor(plain_settings(), random_article(), folder=tmp_path)
        said = subprocess.run(
            [build_engine(), os.fspath(path)], capture_output=True, text=True, check=False, timeout=10
        )
        assert said.returncode == 2
        assert "not laid out for this engine" in said.stderr
        engine.file.map[at : at + 8] = own.to_bytes(8, "little")


@pytest.mark.parametrize("real_time", [False, True])
def test_a_run_is_a_count_of_samples(real_time):
    with Supervisor(plain_settings(late_s=1e3), random_article(), real_time=real_time) as engine:
        for samples in (-1, -(1 << 40), 2.5, np.nan, "9", None):
            with pytest.raises(ConfigError, match="a run of"):
                engine.run(samples)
        assert len(engine.run(0)) == 0 or real_time
        assert len(engine.run(np.int64(3))) >= 3
