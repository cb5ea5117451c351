"""The supervisor's side of an engine: start it, command it, let it run, read what it has recorded."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import signal
import subprocess
import tempfile
import time
import warnings
from collections.abc import Collection
from pathlib import Path
from types import TracebackType

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.interface.commands import (
    KINDS,
    TRIPS,
    Event,
    read_event,
)
from middeck.realtime.engine.interface.monitors import LONGEST_S
from middeck.realtime.engine.interface.settings import EngineSettings, time_to_rest
from middeck.realtime.engine.interface.shared_file import (
    event_rows,
    make_shared_file,
    open_shared_file,
    pretrip_records,
    take_records,
)
from middeck.realtime.engine.process.admitted import NONE_ADMITTED, Admitted, checked_admitted
from middeck.realtime.engine.process.adopted_engine import AdoptedEngine, when_born
from middeck.realtime.engine.process.commanded_engine import PATIENCE_S, POLL_S, CommandedEngine
from middeck.realtime.engine.process.compile import build_engine
from middeck.realtime.engine.process.folder_lock import locked
from middeck.realtime.engine.process.launch import (
    LEFT,
    RigChoice,
    banned_hashes,
    checked_waveform,
    is_run_by,
    launch,
    no_article,
    require_no_engine,
    started_settings,
)
from middeck.realtime.engine.recording.recorder import Recorder
from middeck.realtime.engine.recording.run_head import run_head
from middeck.realtime.engine.rigs.linear_article import LinearArticle, encode_article

BEAT_S = 0.05
PATIENCE_AT_END_S = 5.0
LOOK_S = 0.01
TEMPORARY = ".middeck-temporary"
"""A file that marks a folder which goes with its engine; no name that a user's own folder may hold."""


class Supervisor(CommandedEngine):
    """One engine and its shared file; a context manager, which ends both.

    Args:
        settings: Ports, hold, trips.
        rig: What it drives.
        waveform: Excitation of the outputs, one row a sample, which "excite" plays.
        real_time: In real time, else in lockstep: as fast as it can, and only as far as `run` lets it.
        folder: Where the shared file lies; a temporary one if it is left out.
        ring: Records kept for reading.
        pretrip_s: Time before a trip that is kept until its reset.
        program: The compiled engine; that of `build_engine` if it is left out.
        blacklist: Laws that it refuses from the start, by their `hash_law`: what `load_blacklist` reads.
        admitted: What gates have passed: the ``hold`` of each verdict by its ``sha256`` (`load_verdicts`).
            Any other package, or one that was judged beside another hold, is refused: if it is left out, all
            are. ``"ungated"`` asks for no verdict, as on a bench.

    Raises `ConfigError` for settings and options that fit no engine.
    """

    def __init__(
        self,
        settings: EngineSettings,
        rig: RigChoice,
        *,
        waveform: Float[np.ndarray, "sample output"] | None = None,
        real_time: bool = False,
        folder: Path | None = None,
        ring: int = 8192,
        pretrip_s: float = 30.0,
        program: Path | None = None,
        blacklist: Collection[str] = (),
        admitted: Admitted = NONE_ADMITTED,
    ) -> None:
        self._begin(settings, real_time, admitted)
        banned = banned_hashes(blacklist)
        try:
            self._start(rig, waveform, folder, ring, pretrip_s, program, banned)
        except BaseException:
            self._left.close()
            raise

    def _start(
        self,
        rig: RigChoice,
        waveform: np.ndarray | None,
        folder: Path | None,
        ring: int,
        pretrip_s: float,
        program: Path | None,
        banned: bytes,
    ) -> None:
        settings = self.settings
        if ring < 1 or not 0.0 <= pretrip_s <= LONGEST_S:
            raise ConfigError(
                f"a ring of {ring} records, {pretrip_s} s before a trip", hint=f"from 1; 0 to {LONGEST_S:g} s"
            )
        program = program or build_engine()
        where = folder or Path(tempfile.mkdtemp(prefix="middeck-engine-"))
        if folder is None:
            (where / TEMPORARY).touch()
            self._removes(where)
        article, numbers = encode_article(rig) if isinstance(rig, LinearArticle) else no_article()
        played = (
            np.zeros((0, len(settings.drives))) if waveform is None else checked_waveform(waveform, settings)
        )
        with locked(where):
            require_no_engine(where / "engine.shared")
            self.file = make_shared_file(
                where / "engine.shared",
                started_settings(settings, rig, self.real_time),
                article,
                numbers,
                played,
                banned,
                ring=ring,
                pretrip=max(1, settings.samples(pretrip_s)),
            )
            self._sign()
            self.process = launch(program, self.file)
            try:
                self._wait(lambda: bool(self.file.status["running"]))
            except BaseException:
                self.close()
                raise

    def _removes(self, folder: Path) -> None:
        self._left.callback(shutil.rmtree, folder, ignore_errors=True)

    def _sign(self) -> None:
        """Say who supervises: a process, when it began, and its session; it keeps no records yet."""
        self.file.asks["keeps"] = 0
        self.file.asks["supervisor_born"] = when_born(os.getpid())
        self.file.asks["supervisor"] = os.getpid()
        self._session = secrets.randbits(62) + 1
        self.file.asks["session"] = self._session

    @classmethod
    def attach(
        cls, path: Path, settings: EngineSettings, *, admitted: Admitted = NONE_ADMITTED
    ) -> Supervisor:
        """Take over an engine whose supervisor is gone, by its shared file ("engine.shared" in its folder).

        Its heart beats again at once; records go on where they were last read. Of an engine that has ended as
        well, what the file holds can still be read. ``admitted`` is asked for what is loaded from now on, not
        for what its slots hold. Commands of the supervisor before it that still wait are refused ("other
        session"), a "disengage" too: look at `state`. Raises `DataError` for what is no shared file of this
        build of the engine, `ConfigError` for one of other settings and while another supervisor lives.
        """
        file = open_shared_file(path)
        if not is_run_by(settings, file.settings):
            raise ConfigError("is run with other settings", where=str(path), hint="those it was started with")
        made = cls.__new__(cls)
        made._begin(settings, bool(file.settings["clock"]), admitted)
        made.file = file
        made.process = AdoptedEngine(file)
        with locked(path.parent):
            other = int(file.asks["supervisor"])
            if other != os.getpid() and when_born(other) == int(file.asks["supervisor_born"]) > 0:
                raise ConfigError(
                    f"has a supervisor that lives, process {other}",
                    where=str(path),
                    hint="end that one first",
                )
            made._sign()
        if made.process.poll() is None and (path.parent / TEMPORARY).is_file():
            made._removes(path.parent.resolve())
        made.beat()
        return made

    def _begin(self, settings: EngineSettings, real_time: bool, admitted: Admitted) -> None:
        self._admitted = checked_admitted(admitted)
        self.settings, self.real_time = settings, real_time
        self.recorder: Recorder | None = None
        self.seen_events = self._said = 0
        self._runs_on = real_time
        self._left = contextlib.ExitStack()

    def __enter__(self) -> Supervisor:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the engine through SAFE, its outputs at zero, then the recording; remove a temporary file.

        Where another supervisor has taken the running engine over, only the own recording is ended: engine
        and temporary file are the other one's to end.
        """
        if self.process.poll() is None and self._is_relieved():
            LEFT.append(self.process)
            self._left.pop_all()
        else:
            self._end()
        if self.process.stderr is not None:
            self.process.stderr.close()
        self.end_recording()
        self._left.close()

    def _end(self) -> None:
        if self.process.poll() is None:
            try:
                self._wait_for_end(self._patience_at_end() if self._takes_end() else 0.0)
            except (subprocess.TimeoutExpired, TimeoutError):
                self._end_in_safe()
        self.process.wait()

    def _end_in_safe(self) -> None:
        """An engine that takes no command is told by a signal, else killed."""
        self.process.send_signal(signal.SIGTERM)
        try:
            self._wait_for_end(self._patience_at_end())
        except (subprocess.TimeoutExpired, TimeoutError):
            self.process.kill()

    def _wait_for_end(self, patience_s: float) -> None:
        """Meanwhile its records are kept: the ring may be shorter than the way out."""
        until, self._runs_on = time.monotonic() + patience_s, True
        while time.monotonic() < until:
            with contextlib.suppress(subprocess.TimeoutExpired, TimeoutError):
                self.process.wait(LOOK_S)
                return
            if self.recorder is not None:
                self._take()
        self.process.wait(0.0)

    def _patience_at_end(self) -> float:
        rest = time_to_rest(self.settings) if self.real_time else self.settings.answer_s
        return PATIENCE_AT_END_S + rest

    def record(self, path: str | Path, *, start: str | None = None, resume: bool = False) -> Recorder:
        """Write all that is read from now on into a file, with events and what precedes a trip.

        `read` and `run` hand it on, a thread writes it. ``start`` is a text for the time; now if it is left
        out. ``resume`` goes on with the file of a recorder that was killed. A recording before it ends once
        the new file is open. What goes wrong with the disk later is a warning and stands in
        `Recorder.faults`; the loop goes on.

        Raises `ConfigError` where the file is there already, of another run or the one being recorded,
        `DataError` where it cannot be written, and once another supervisor has taken the engine over; a
        recording before it goes on then.
        """
        self._require_own()
        file, before = Path(path), self.recorder
        if resume and before is not None and before.is_writing(file):
            raise ConfigError("is being recorded", where=str(file), hint="it goes on; nothing to resume")
        now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()) if start is None else start
        made = Recorder(file, run_head(self.settings, self.file, now), clock=time.monotonic, resume=resume)
        try:
            self.end_recording()
        except BaseException:
            made.close()
            raise
        self.recorder, self._said = made, 0
        if resume:
            self.file.asks["taken"] = self.recorder.last
        self.file.asks["keeps"] = 1
        self._take()
        if self.file.status["frozen"]:
            self.recorder.add_pretrip(self.pretrip())
        return self.recorder

    def end_recording(self) -> None:
        """Record what has not been read yet, and end the file; without a recorder nothing happens.

        What a relieved supervisor has not read is its successor's to record.
        """
        if self.recorder is not None:
            if not self._is_relieved():
                self._take()
                self.file.asks["keeps"] = 0
            self.recorder.close()
            self._say_faults()
            self.recorder = None

    def run(self, samples: int, *, beats: bool = True, keep: bool = True) -> np.ndarray:
        """Let it run so many samples and return their records; none are kept where ``keep`` is false.

        In real time this takes that long. The supervisor's heart beats meanwhile, unless ``beats`` is false.
        Raises `ConfigError` for what is no count of samples, `DataError` where records were overwritten
        before they were read, and once another supervisor has taken the engine over.
        """
        if not isinstance(samples, (int, np.integer)) or samples < 0:
            raise ConfigError(f"a run of {samples!r} samples", hint="a whole number from 0")
        self._require_own()
        begin = self.sample
        if self.real_time:
            return self._follow(begin + samples, beats, keep)
        # A quarter of the ring not yet read, one not yet written: half is left for the engine's way out.
        taken, slice_ = [], max(1, len(self.file.ring) // 4)
        for first in range(begin, begin + samples, slice_):
            if beats:
                self.beat()
            self._let_write(slice_)
            until = min(first + slice_, begin + samples)
            self.file.asks["until"] = until
            self._wait(lambda until=until: self.sample >= until)
            taken.append(self.read() if keep else self._skip())
        return np.concatenate(taken) if taken else self.file.ring[:0].copy()

    def read(self) -> np.ndarray:
        """Records that have not been read yet, in order."""
        found, lost = self._take()
        if lost:
            raise DataError(
                f"{lost} records were lost: overwritten before they were read", where="engine",
                hint="read more often, or a larger ring",
            )  # fmt: skip
        return found

    def _take(self) -> tuple[np.ndarray, int]:
        """`take_records`, recorded."""
        self._require_own()  # who reads says how far it has read
        last = self.sample
        found, lost = take_records(self.file, last, runs_on=self._runs_on)
        self._record(found)
        self.file.asks["taken"] = last
        return found, lost

    def _record(self, records: np.ndarray) -> None:
        if self.recorder is None:
            return
        events = event_rows(self.file, self.recorder.last_event)
        self.recorder.add_events(events)
        self.recorder.add_records(records)
        if any(KINDS.get(int(kind)) in TRIPS for kind in events["kind"]):
            self.recorder.add_pretrip(self.pretrip())
        self._say_faults()

    def _say_faults(self) -> None:
        assert self.recorder is not None
        new = self.recorder.faults[self._said :]
        self._said += len(new)
        for what in new:
            warnings.warn(f"{self.recorder.path}: {what}", UserWarning, stacklevel=5)

    def events(self) -> list[Event]:
        """Events that have not been read yet, in order."""
        rows = event_rows(self.file, self.seen_events)
        lost = int(rows["sequence"][0]) - self.seen_events - 1 if len(rows) else 0
        self.seen_events += lost + len(rows)
        if lost:
            warnings.warn(
                f"{lost} events were lost: overwritten before they were read; read them more often",
                UserWarning, stacklevel=2,
            )  # fmt: skip
        return [read_event(row, self.settings.inputs, self.settings.outputs, KINDS) for row in rows]

    def pretrip(self) -> np.ndarray:
        """Records up to the trip that holds the loop in SAFE, oldest first; without one, those until now."""
        return pretrip_records(self.file)

    def _skip(self) -> np.ndarray:
        if self.recorder is None:
            self._require_own()
            self.file.asks["taken"] = self.sample
        else:
            self._take()
        return self.file.ring[:0].copy()

    def _follow(self, until: int, beats: bool, keep: bool) -> np.ndarray:
        taken = []
        while self.sample < until:
            if beats:
                self.beat()
            time.sleep(min(BEAT_S, max(0, until - self.sample) * self.settings.period_s))
            self._require_alive()
            self._require_own()
            taken.append(self.read() if keep else self._skip())
        return np.concatenate(taken) if taken else self.file.ring[:0].copy()

    def _let_write(self, most: int) -> None:
        """Wait in lockstep until no more than ``most`` records wait for a disk that works."""
        recorder, began = self.recorder, time.monotonic()
        while recorder is not None and recorder.behind > most and not recorder.faults:
            if time.monotonic() - began > PATIENCE_S:
                return
            time.sleep(POLL_S)
