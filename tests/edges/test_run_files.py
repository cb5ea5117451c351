"""A run file: what was recorded comes back to the bit, and whatever is missing is said, block by block."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import struct
import time
import warnings
import zlib

import numpy as np
import pytest

from cli_runner import middeck
from engine_campaigns import cases_of
from engine_cases import plain_settings, random_article, random_package
from middeck.errors import ConfigError, DataError
from middeck.files.records import load_record, read_record
from middeck.realtime.engine.recording.recorder import BLOCK, Recorder
from middeck.realtime.engine.recording.run_file import decode_run, read_run
from middeck.realtime.engine.recording.run_frames import (
    Frame,
    decode_head,
    encode_frame,
    encode_head,
    frames_in,
)
from middeck.realtime.engine.recording.run_head import run_head
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
SAMPLES, STOPPED = 1500, 1200


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A run with a trip, its records as they were read, and its file."""
    file = tmp_path_factory.mktemp("run") / "loop.mdr"
    with Supervisor(plain_settings(), random_article()) as engine:
        engine.load(random_package())
        engine.reset()
        engine.record(file, start="2026-01-31T12:00:00Z")
        engine.command("engage", values=[1.0])
        records = [engine.run(STOPPED)]
        engine.stop()
        records.append(engine.run(SAMPLES - STOPPED))
        events = engine.events()
    return file, np.concatenate(records), events


def test_what_was_recorded_comes_back(recorded):
    file, records, events = recorded
    run = read_run(file)
    assert not run.faults
    assert run.records.tobytes() == records.tobytes()
    assert [event.kind for event in run.events] == [*(event.kind for event in events), "ended"]
    assert run.events[: len(events)] == tuple(events)
    assert run.packages == (events[0].sha256,)
    before, told = run.before(1)
    assert len(before) == STOPPED + 1
    assert told[-1].kind == "stop"
    with pytest.raises(DataError, match="no trip 2"):
        run.before(2)


def test_a_run_is_a_record(recorded, capfd, tmp_path):
    file, records, _ = recorded
    record = load_record(file)
    assert record.held
    assert record.sample_hz == 500.0
    assert np.array_equal(record.u[0, 0], records["u"])
    assert np.array_equal(record.y[0, 0], records["y"])
    assert [port.name for port in record.inputs] == ["u0", "u1"]
    done = middeck(capfd, "record", file, "-o", tmp_path / "loop.npz", "--json")
    assert done.code == 0, done.err
    (run,) = json.loads(done.out)["runs"]
    assert "stop" in [event["kind"] for event in run["events"]]
    assert np.array_equal(load_record(tmp_path / "loop.npz").u, record.u)
    assert "TRIP  stop" in middeck(capfd, "record", file).out


def frames_of(data):
    head = decode_head(data, "")
    return [frame for frame in frames_in(data, head.begin, head.mark) if isinstance(frame, Frame)]


def test_a_flipped_bit_takes_its_block_and_says_which(recorded):
    """Wherever it is: all else comes back to the bit, or nothing does and the reason is said."""
    data, records = recorded[0].read_bytes(), recorded[1]
    rng = np.random.default_rng(1993)
    for _ in range(cases_of("run files with a flipped bit")):
        place = int(rng.integers(8 * len(data)))
        changed = bytearray(data)
        changed[place // 8] ^= 1 << place % 8
        run = decode_run(bytes(changed))
        assert run.faults
        assert len(run.records) >= len(records) - BLOCK
        assert (
            run.records.tobytes() == records[np.isin(records["sequence"], run.records["sequence"])].tobytes()
        )
        missing = sorted(set(records["sequence"]) - set(run.records["sequence"]))
        if missing:
            said = {n for fault in run.faults if fault.samples for n in range(*fault.samples)}
            named = any(f.kind in ("flipped", "lost bytes") and "block" in f.what for f in run.faults)
            assert named
            assert said >= set(missing) or missing[0] == 1 or missing[-1] == len(records)


def test_a_file_cut_anywhere_gives_every_whole_block(recorded):
    data, records = recorded[0].read_bytes(), recorded[1]
    ends = {frame.end for frame in frames_of(data)}
    begin = decode_head(data, "").begin
    rng = np.random.default_rng(7)
    for size in (*ends, *rng.integers(0, len(data), cases_of("run files cut anywhere"))):
        if size < begin // 2:
            with pytest.raises(DataError):
                decode_run(data[:size])
            continue
        run = decode_run(data[:size])
        whole = sum(f.count for f in frames_of(data[:size]) if f.kind == 1)
        assert run.records.tobytes() == records[:whole].tobytes()
        kinds = {fault.kind for fault in run.faults}
        assert ("no end" in kinds) == (size < len(data))
        assert ("torn" in kinds) == (size not in ends and size > begin)


def test_no_bytes_make_the_reader_stumble(recorded):
    """Bytes changed, cut, doubled and moved, some sealed again."""
    data = recorded[0].read_bytes()
    document, begin = decode_head(data, "").document, decode_head(data, "").begin
    small = data[:begin] + b"".join(data[f.start : f.end] for f in frames_of(data) if f.kind != 1)
    rng = np.random.default_rng(3)
    for _ in range(cases_of("run files of changed bytes")):
        changed = bytearray(small)
        for _ in range(rng.integers(1, 6)):
            at = int(rng.integers(len(changed)))
            changed[at : at + int(rng.integers(0, 40))] = rng.bytes(int(rng.integers(0, 40)))
            changed = changed or bytearray(b"\0")
        with contextlib.suppress(DataError):
            decode_run(bytes(changed))
    for key in document:
        for other in (None, 3, "x", [], {}, [["y", "O", []]], [["sequence", "<i8", [1 << 40]]], 1e400):
            told = {**document, key: other}
            if other == 1e400:
                text = json.dumps(told).encode()
                head = struct.pack("<8sIII", b"MIDDECKR", 1, len(text), zlib.crc32(text)) + text
            else:
                head = encode_head(told)
            with contextlib.suppress(DataError):
                decode_run(head)


def test_frames_that_lie_are_left_out(recorded):
    data = recorded[0].read_bytes()
    head, first = decode_head(data, ""), frames_of(data)[1]
    begin, mark = head.begin, head.mark
    content = first.content
    row = len(content) // first.count
    for number, start, count, body in (
        (1, 5, first.count, content), (1, 1, first.count + 1, content), (1, 1, 1, content[: row - 8]),
        (1, 1, 2, content[:row] + content[2 * row : 3 * row]), (1, 1, 0, b""),
    ):  # fmt: skip
        run = decode_run(data[:begin] + encode_frame(mark, first.kind, number, start, count, body))
        assert not len(run.records)
        assert run.faults[0].kind == "flipped"
    twice = data[:begin] + 2 * data[first.start : first.end]
    assert "repeated" in [fault.kind for fault in decode_run(twice).faults]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "is empty"),
        (b"MIDDECKP" + bytes(100), "begins otherwise"),
        (struct.pack("<8sIII", b"MIDDECKR", 2, 2, zlib.crc32(b"{}")) + b"{}", "format 2"),
        (encode_head({"schema": "middeck.run/1"})[:30], "damaged or cut short"),
        (encode_head({"schema": "middeck.run/2"}), "schema"),
        (encode_head({"schema": "middeck.run/1"}), "does not say"),
    ],
)
def test_what_is_no_run_is_refused(data, reason, tmp_path):
    (tmp_path / "a.mdr").write_bytes(data)
    with pytest.raises(DataError, match=reason) as refused:
        read_run(tmp_path / "a.mdr")
    assert "a.mdr" in str(refused.value)
    with pytest.raises(DataError):
        read_record(tmp_path / "a.mdr")


def test_records_that_were_overwritten_are_a_gap(tmp_path):
    """What a trip froze fills the gap, as far as it reaches; so does the end, which goes through SAFE."""
    file = tmp_path / "loop.mdr"
    with Supervisor(plain_settings(), random_article(), ring=100, pretrip_s=0.5) as engine:
        engine.reset()
        engine.record(file)
        engine.run(50)
        engine.file.asks["until"] = 1000  # without reading
        while engine.sample < 1000:
            pass
        engine.run(50, keep=False)
        assert int(engine.file.status["lost"]) > 0
    run = read_run(file)
    (gap,) = [fault for fault in run.faults if fault.kind == "gap"]
    assert gap.samples == (51, 801)  # the ring before a trip has 250
    assert np.isnan(load_partial(file)[50:800]).all()

    file = tmp_path / "tripped.mdr"
    with Supervisor(plain_settings(), random_article(), ring=100, pretrip_s=0.5) as engine:
        engine.reset()
        engine.record(file)
        engine.run(50)
        engine.file.asks["until"] = 1000
        while engine.sample < 1000:
            pass
        engine.stop()
        engine.run(50, keep=False)
    (gap,) = [fault for fault in read_run(file).faults if fault.kind == "gap"]
    assert gap.samples == (51, 1001 - 249)


def load_partial(file):
    found = read_record(file)
    assert "gap" in {fault.kind for fault in found.faults}
    return found.record.y[0, 0, :, 0]


def test_a_full_disk_is_said_and_the_loop_goes_on(tmp_path):
    """The system takes a part of a block and refuses the rest; later there is room again."""
    file = tmp_path / "loop.mdr"
    most = resource.getrlimit(resource.RLIMIT_FSIZE)
    with (
        Supervisor(plain_settings(), random_article()) as engine,
        warnings.catch_warnings(record=True) as said,
    ):
        warnings.simplefilter("always")
        engine.reset()
        recorder = engine.record(file)
        engine.run(500)
        resource.setrlimit(resource.RLIMIT_FSIZE, (os.stat(file).st_size + 200_000, most[1]))
        try:
            engine.run(2000)
            while not recorder.faults:
                engine.run(100)
            engine.run(1)
            synced, full = recorder.synced, read_run(file)
            assert engine.state == "ready"
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, most)
        count = engine.sample
    assert {fault.kind for fault in full.faults} == {"no end"}
    assert synced <= len(full.records) < count
    assert any("cannot be written: File too large" in str(warning.message) for warning in said)
    run = read_run(file)
    assert len(run.records) == count
    assert {fault.kind for fault in run.faults} == {"note"}


def test_what_never_fits_is_counted(tmp_path):
    settings = plain_settings()
    with Supervisor(settings, random_article()) as engine:
        engine.run(2000)
        head = run_head(settings, engine.file, "")
        records = engine.file.ring[:2000].copy()
    recorder = Recorder(tmp_path / "loop.mdr", head, clock=lambda: 0.0, held=100_000)
    for k in range(0, 2000, 200):
        recorder.add_records(records[k : k + 200])
    recorder.close()
    run = read_run(tmp_path / "loop.mdr")
    assert len(run.records) + recorder.lost == 2000
    if recorder.lost:
        assert "more waits for the disk" in run.faults[0].what


def test_a_folder_that_takes_nothing_and_a_name_that_is_taken(tmp_path):
    with Supervisor(plain_settings(), random_article()) as engine:
        engine.reset()
        with pytest.raises(DataError, match="cannot be written: No such file"):
            engine.record(tmp_path / "none" / "loop.mdr")
        (tmp_path / "file").write_text("")
        with pytest.raises(DataError, match="cannot be written: Not a directory"):
            engine.record(tmp_path / "file" / "loop.mdr")
        with pytest.raises(ConfigError, match="is there already"):
            engine.record(tmp_path / "file")
        if os.path.isdir("/proc/self"):
            with pytest.raises(DataError, match="cannot be written"):
                engine.record(type(tmp_path)("/proc/self/loop.mdr"))  # a folder that nobody writes into
        assert len(engine.run(20)) == 20
        assert engine.state == "ready"


def test_a_refused_name_does_not_end_the_recording_before_it(tmp_path):
    first, second = tmp_path / "first.mdr", tmp_path / "second.mdr"
    with Supervisor(plain_settings(), random_article()) as engine:
        engine.record(str(first))
        engine.reset()
        engine.run(20)
        engine.record(second)
        with pytest.raises(ConfigError, match="is there already"):
            engine.record(first)
        with pytest.raises(ConfigError, match="is being recorded"):
            engine.record(second, resume=True)
        with pytest.raises(ConfigError, match="is a run that has ended"):
            engine.record(first, resume=True)
        engine.run(20)
    runs = read_run(first), read_run(second)
    assert not runs[0].faults + runs[1].faults
    assert runs[0].records["sequence"].tolist() == list(range(1, 21))
    assert set(range(21, 41)) <= set(runs[1].records["sequence"].tolist())


def test_each_recording_says_its_own_faults(tmp_path, monkeypatch):
    """And one whose file was removed is no reason to stumble."""
    first, second, third = (tmp_path / f"{name}.mdr" for name in ("first", "second", "third"))
    with Supervisor(plain_settings(), random_article()) as engine:
        engine.record(first)
        for path in (second, third):
            engine.recorder._blame("no room")
            with pytest.warns(UserWarning, match="no room"):
                engine.run(1)
            engine.record(path)
        third.unlink()
        with pytest.raises(ConfigError, match="is a run that has ended"):
            engine.record(first, resume=True)
        with monkeypatch.context() as refused:
            refused.setattr(engine, "_say_faults", lambda: pytest.fail("a warning as an error"))
            with pytest.raises(pytest.fail.Exception):
                engine.record(third)
    assert {fault.kind for fault in read_run(third).faults} <= {"note"}


def test_a_lockstep_engine_does_not_run_away_from_a_slow_disk(tmp_path, monkeypatch):
    """What a kill of the supervisor would lose is still in the ring, with half of it left for the way out."""
    append = Recorder._append

    def slowly(self, file, data):
        time.sleep(0.02)
        append(self, file, data)

    monkeypatch.setattr(Recorder, "_append", slowly)
    with Supervisor(plain_settings(), random_article(), ring=200) as engine:
        recorder = engine.record(tmp_path / "loop.mdr")
        behind = []
        for _ in range(12):
            engine.run(50)
            behind.append(recorder.behind)
    assert 0 < max(behind) <= 100
    assert not read_run(tmp_path / "loop.mdr").faults
