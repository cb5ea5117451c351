"""What upsets an engine from outside: its supervisor, its clock, its process, the disk of its records."""

from __future__ import annotations

import contextlib
import errno
import os
import resource
import signal
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest import mock

import numpy as np

from faked_clock import SupervisorByFakedClock
from middeck.errors import DataError
from middeck.realtime.engine.interface.commands import COMMANDS, QUEUE, check_of
from middeck.realtime.engine.process.adopted_engine import AdoptedEngine
from middeck.realtime.engine.recording.recorder import BLOCK, Recorder
from middeck.realtime.engine.recording.run_file import read_run
from middeck.values import record
from ungated import Supervisor

AFTER = 900
"""Samples that run after an upset begins."""


@record(kw_only=True)
class Upset:
    """What came of it: records of the samples since, words of answers, and what is wrong already."""

    records: np.ndarray
    answers: tuple[str, ...] = ()
    why: str = ""


Act = Callable[[Supervisor, np.random.Generator], Upset]


def wait(engine: Supervisor, rng: np.random.Generator) -> Upset:
    """Nothing from outside."""
    return Upset(records=engine.run(AFTER))


def _stop(engine: Supervisor, rng: np.random.Generator) -> Upset:
    engine.stop()
    return wait(engine, rng)


def _silent(engine: Supervisor, rng: np.random.Generator) -> Upset:
    return Upset(
        records=np.concatenate([*(engine.run(10, beats=False) for _ in range(20)), engine.run(AFTER)])
    )


def _not_read(engine: Supervisor, rng: np.random.Generator) -> Upset:
    """More than the ring holds."""
    engine.run(AFTER, keep=False)
    return Upset(records=engine.run(1))


def _out_of_place(engine: Supervisor, rng: np.random.Generator) -> Upset:
    words = [("reset", 0, [1e9]), ("standby", 7, []), ("engage", -1, [1.0]), ("engage", 2, [1.0]),
             ("engage", 0, [np.nan]), ("excite", 0, [-1.0]), ("excite", 0, [0.5]), ("strip", 99, [0, 1]),
             ("strip", 0, [np.nan, 1]), ("strip", 0, [0, 1e9]), ("adapt", 0, [1.0]), ("load", 2, [0.0]),
             ("load", 9, [8.0]), ("load", 1, [1e12])]  # fmt: skip
    order = rng.permutation(len(words))
    answers = tuple(engine.command(words[i][0], slot=words[i][1], values=words[i][2]).word for i in order)
    why = "a command carried out that must be refused" if "done" in answers else ""
    return Upset(records=wait(engine, rng).records, answers=answers, why=why)


def _repeated(engine: Supervisor, rng: np.random.Generator) -> Upset:
    """All commands so far once more, the count of them set back and forth: each was for one time."""
    file, count = engine.file, int(engine.file.asks["written"])
    seen = int(file.status["events"])
    answers = tuple(engine.answer(number) for number in range(1, count + 1))
    for number in rng.permutation(np.arange(1, count + 1)):
        file.commands[number % QUEUE] = file.commands[number % QUEUE].copy()
        file.asks["written"] = number
        file.commands[(count + 1) % QUEUE] = file.commands[number % QUEUE]
        file.asks["written"] = count + 1  # an old one in the place of the next
        time.sleep(3e-4)  # the engine looks more often
    file.asks["written"] = count
    again = tuple(engine.answer(number) for number in range(1, count + 1))
    done = (int(file.status["acknowledged"]), int(file.status["events"])) != (count, seen) or again != answers
    return Upset(records=wait(engine, rng).records, why="a command carried out again" if done else "")


def _of_another_session(engine: Supervisor, rng: np.random.Generator) -> Upset:
    """Whole commands that were recorded under another supervisor, numbered as if they were the next."""
    answers = []
    for kind in rng.permutation(
        ["reset", "engage", "disengage", "excite", "silence", "strip", "load", "end"]
    ):
        number = int(engine.file.asks["written"]) + 1
        row = np.zeros((), engine.file.commands.dtype)
        row["number"], row["session"] = number, int(engine.file.asks["session"]) - 1
        row["kind"], row["value"] = COMMANDS[str(kind)], [1.0, 1.0, 0.0, 0.0]
        row["check"] = check_of(row)
        engine.file.commands[number % QUEUE] = row
        engine.file.asks["written"] = number
        answers.append(engine.answer(number).word)
    why = "" if set(answers) == {"other session"} else "a command of another session carried out"
    return Upset(records=wait(engine, rng).records, answers=tuple(answers), why=why)


ASKED: dict[str, Act] = {
    "crew STOP": _stop,
    "supervisor silent": _silent,
    "records not read": _not_read,
    "commands out of place": _out_of_place,
    "commands repeated": _repeated,
    "commands of another session": _of_another_session,
}


def _late(periods: Callable[[np.random.Generator], float], word: str = "late", times: int = 1) -> Act:
    """A sleep, or a sample, that takes so many periods longer, by a faked clock; ``times`` in a row."""

    def act(engine: Supervisor, rng: np.random.Generator) -> Upset:
        assert isinstance(engine, SupervisorByFakedClock)
        records = []
        for _ in range(times):
            engine.clock[word] = round(1e9 * periods(rng) * engine.settings.period_s)
            records.append(engine.run(1))
        return Upset(records=np.concatenate([*records, engine.run(AFTER)]))

    return act


def _stopped(engine: Supervisor, rng: np.random.Generator) -> Upset:
    """SIGSTOP while it sleeps; time goes on, and SIGCONT."""
    assert isinstance(engine, SupervisorByFakedClock)
    engine.process.send_signal(signal.SIGSTOP)
    _until(lambda: Path(f"/proc/{engine.process.pid}/stat").read_text().rpartition(")")[2].split()[0] == "T")
    engine.clock["now"] += int(1e9 * rng.uniform(0.02, 10.0))
    engine.process.send_signal(signal.SIGCONT)
    return wait(engine, rng)


def _calendar(engine: Supervisor, rng: np.random.Generator) -> Upset:
    assert isinstance(engine, SupervisorByFakedClock)
    engine.clock["day"] = int(1e9 * rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(0.0, 8.0))
    return wait(engine, rng)


CLOCKS: dict[str, Act] = {
    "engine late once": _late(lambda rng: rng.uniform(0.3, 1.9)),
    "engine overruns once": _late(lambda rng: rng.uniform(1.3, 2.4), "slow"),
    "engine overruns for long": _late(lambda rng: rng.uniform(1.3, 3.0), "slow", 8),
    "engine stalls": _late(lambda rng: rng.uniform(4.0, 100.0), "slow"),
    "engine stopped and continued": _stopped,
    "clock jumps": _late(lambda rng: 10.0 ** rng.uniform(0.7, 9.0)),
    "calendar set": _calendar,
}
"""By a faked clock in real time, in which lateness is a number and not a matter of the machine."""


def _until(reached: Callable[[], bool]) -> None:
    began = time.monotonic()
    while not reached():
        assert time.monotonic() - began < 20.0
        time.sleep(1e-4)


def _killed(engine: Supervisor, rng: np.random.Generator) -> Upset:
    """SIGKILL at any instant of a run: what it ran can be read, in the ring and in the file."""
    with tempfile.TemporaryDirectory() as folder:
        recorder, first = engine.record(Path(folder) / "run.mdr"), engine.sample
        engine.file.asks["until"] = first + AFTER
        time.sleep(rng.uniform(0.0, 0.004))
        engine.process.send_signal(signal.SIGKILL)
        engine.process.wait()
        try:
            engine.run(1)
            why = "a killed engine runs on"
        except DataError as error:
            why = "" if "-9" in error.what else f"told as {error.what}"
        engine.end_recording()
        run = read_run(recorder.path)
    found = run.records["sequence"]
    if run.faults or not np.array_equal(
        found[-(engine.sample - first) :], np.arange(first, engine.sample) + 1
    ):
        why = why or f"a record of {len(found)} samples of {engine.sample - first}: {run.faults}"
    kept = engine.pretrip()["sequence"]
    if not np.all(np.diff(kept) == 1):
        why = why or "the ring before the trip has a gap"
    return Upset(records=run.records, why=why)


def _told_to_end(engine: Supervisor, rng: np.random.Generator) -> Upset:
    """SIGTERM: through SAFE to outputs of zero."""
    engine.file.asks["until"] = engine.sample + int(rng.integers(AFTER))
    engine.process.send_signal(signal.SIGTERM)
    code = AdoptedEngine(engine.file).wait(20.0) and engine.process.wait(20.0)
    records = engine.read()
    events = [event.kind for event in engine.events()][-1:]
    zero = not len(records) or not np.any(records["u"][-1])
    whole = (code, events, engine.state, zero) == (0, ["ended"], "safe", True)
    return Upset(
        records=records,
        why="" if whole else f"ended with {code} in {engine.state}, {events}, zero: {zero}",
    )


ENDS: dict[str, Act] = {"engine killed": _killed, "engine told to end": _told_to_end}


@contextlib.contextmanager
def _full(recorder: Recorder, rng: np.random.Generator) -> Iterator[None]:
    """The system takes a part of what is written, and refuses the rest."""
    most = resource.getrlimit(resource.RLIMIT_FSIZE)
    size = recorder.path.stat().st_size + int(rng.integers(200_000))
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, most[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, most)


@contextlib.contextmanager
def _short(recorder: Recorder, rng: np.random.Generator) -> Iterator[None]:
    """It takes a part of what is written, and the rest when that is asked for."""
    write = os.write

    def some(file: int, data: bytes) -> int:
        count = len(data) if file != recorder._file else int(rng.integers(1, len(data) + 1))
        return write(file, data[:count])

    with mock.patch("os.write", some):
        yield


@contextlib.contextmanager
def _read_only(recorder: Recorder, rng: np.random.Generator) -> Iterator[None]:
    """After some blocks it takes no more, and cuts nothing off."""
    write, cut, left = os.write, os.ftruncate, [int(rng.integers(4))]

    def refused(act: Callable, used: int) -> Callable:
        def one(file: int, what: bytes | int) -> int | None:
            if file == recorder._file:
                left[0] -= used
                if left[0] < 0:
                    raise OSError(errno.EROFS, os.strerror(errno.EROFS))
            return act(file, what)

        return one

    with mock.patch("os.write", refused(write, 1)), mock.patch("os.ftruncate", refused(cut, 0)):
        yield


def _on_disk(spoilt: Callable, *, lasting: bool, told: bool) -> Act:
    """A run that is recorded while the disk does as it likes: ``lasting`` until the end of the record, and
    ``told`` as a fault if so."""

    def act(engine: Supervisor, rng: np.random.Generator) -> Upset:
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            recorder, first = engine.record(Path(folder) / "run.mdr"), engine.sample
            with spoilt(recorder, rng):
                records = engine.run(AFTER)
                if lasting:
                    engine.end_recording()
            engine.end_recording()
            run = read_run(recorder.path)
        found = run.records["sequence"]
        whole = bool(recorder.faults) if lasting and told else len(found) >= AFTER
        ordered = np.array_equal(found[-AFTER:], first + 1 + np.arange(len(found[-AFTER:])))
        silent = not told and (recorder.faults or run.faults)
        why = (
            "" if whole and ordered and not silent else f"a record of {len(found)} samples, {recorder.faults}"
        )
        return Upset(records=records, why=why)

    return act


def _folder_read_only(engine: Supervisor, rng: np.random.Generator) -> Upset:
    """No file can be made: it is said, and the loop goes on."""
    refuse = mock.patch("os.open", side_effect=OSError(errno.EROFS, os.strerror(errno.EROFS)))
    try:
        with refuse:
            engine.record(Path("run.mdr"))
        why = "a recorder without a file"
    except DataError as error:
        why = "" if "Read-only" in error.what else error.what
    return Upset(records=wait(engine, rng).records, why=why)


def _bit_flips(engine: Supervisor, rng: np.random.Generator) -> Upset:
    """Of a file that lies on the disk: it takes its block, and is told."""
    with tempfile.TemporaryDirectory() as folder:
        recorder = engine.record(Path(folder) / "run.mdr")
        upset = wait(engine, rng)
        engine.end_recording()
        whole, data = read_run(recorder.path).records, bytearray(recorder.path.read_bytes())
        data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
        recorder.path.write_bytes(data)
        run = read_run(recorder.path)
    kept = np.isin(whole["sequence"], run.records["sequence"])
    right = run.records.tobytes() == whole[kept].tobytes() and np.sum(~kept) <= BLOCK and run.faults
    return Upset(records=upset.records, why="" if right else f"{np.sum(~kept)} samples lost, {run.faults}")


DISKS: dict[str, Act] = {
    "disk full": _on_disk(_full, lasting=True, told=True),
    "disk full for a while": _on_disk(_full, lasting=False, told=True),
    "disk read-only": _on_disk(_read_only, lasting=True, told=True),
    "disk takes short writes": _on_disk(_short, lasting=True, told=False),
    "folder read-only": _folder_read_only,
    "bit flips in a stored block": _bit_flips,
}
