"""The recorder: a run of an engine into one file to which it only ever appends.

A thread writes, so that neither the engine nor its supervisor's heartbeat waits for a disk. What
`Recorder.synced` names has been handed to the disk (fdatasync) and outlives a kill of any process. What
cannot be written now is kept and tried again, up to a size; beyond that it is counted as lost and shows as a
gap. Nothing of this stops the loop.
"""

import contextlib
import hashlib
import json
import os
import queue
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.recording.run_frames import (
    Frame,
    Kind,
    decode_head,
    encode_frame,
    encode_head,
    frames_in,
    head_mark,
)

BLOCK = 250
"""Records of a frame: what a flipped bit takes with it."""
HELD = 1 << 26
"""Bytes that wait for a slow or full disk."""
OF_A_START = ("start", "packages")
"""What differs in the head where another supervisor goes on with a file."""


class _Part(NamedTuple):
    kind: Kind
    first: int
    rows: int
    content: bytes


class Recorder:
    """Writes one run file; `Supervisor.record` makes it.

    Args:
        path: The file; it must not be there yet, unless ``resume`` is true: then its head must be this one,
            what was torn at its end is cut off, and it goes on.
        head: What `encode_head` takes.
        clock: Seconds that never go back.
        sync_s: Time after which what has been written goes to the disk; events go there at once.
        held: Bytes that may wait for the disk.

    Raises `ConfigError` where the file is there already, or is of another run; `DataError` where it cannot be
    written.
    """

    def __init__(
        self,
        path: Path,
        head: dict[str, Any],
        *,
        clock: Callable[[], float],
        sync_s: float = 1.0,
        held: int = HELD,
        resume: bool = False,
    ) -> None:
        self.path, self.synced, self.synced_event, self.lost = path, 0, 0, 0
        self.faults: tuple[str, ...] = ()
        self.last = self.last_event = 0
        self._mark, self._clock, self._sync_s, self._most = head_mark(head), clock, sync_s, held
        self._number = self._size = 0
        self._digest = hashlib.sha256()
        self._counts = {"records": 0, "events": 0}
        self._file = self._opened(head, resume)
        self._written = (self.last, self.last_event)
        self.synced, self.synced_event = self._written
        self._gaps: list[tuple[int, int]] = []
        self._waiting: queue.SimpleQueue[_Part | None] = queue.SimpleQueue()
        self._parts: list[_Part] = []
        self._held, self._lock = 0, threading.Lock()
        self._thread = threading.Thread(target=self._work, name="middeck-recorder", daemon=True)
        self._thread.start()

    def add_records(self, records: np.ndarray) -> None:
        """Take records whose sequence numbers follow each other; at once."""
        if not len(records):
            return
        first = int(records["sequence"][0])
        if first > self.last + 1:
            self._gaps.append((self.last + 1, first - 1))
        self.last = int(records["sequence"][-1])
        for k in range(0, len(records), BLOCK):
            self._hand(Kind.RECORDS, int(records["sequence"][k]), records[k : k + BLOCK])

    def add_events(self, events: np.ndarray) -> None:
        """Take events in their order; at once."""
        if len(events):
            self.last_event = int(events["sequence"][-1])
            self._hand(Kind.EVENTS, int(events["sequence"][0]), events)

    def add_pretrip(self, records: np.ndarray) -> None:
        """Add those of the records before a trip that the file lacks."""
        for first, last in self._gaps:
            inside = (records["sequence"] >= first) & (records["sequence"] <= last)
            missing = records[inside]
            for k in range(0, len(missing), BLOCK):
                self._hand(Kind.PRETRIP, int(missing["sequence"][k]), missing[k : k + BLOCK])
        self._gaps.clear()

    def note(self, what: str) -> None:
        """Write a sentence for who reads the file."""
        content = json.dumps({"what": what}).encode()
        self._put(_Part(Kind.NOTE, self.last, 1, content))

    @property
    def behind(self) -> int:
        """How many records a kill of this process would lose: taken, and not yet given to the system."""
        return self.last - self._written[0]

    def is_writing(self, path: Path) -> bool:
        """Whether ``path`` is the file that is open here, under whatever name."""
        try:
            return os.path.samestat(path.stat(), os.fstat(self._file))
        except OSError:
            return False

    def close(self, patience_s: float = 30.0) -> None:
        """Write what waits and the end of the file, and let it go to the disk."""
        self._waiting.put(None)
        self._thread.join(patience_s)
        if self._thread.is_alive():
            self._blame("the disk does not answer: the file has no end")

    def _hand(self, kind: Kind, first: int, rows: np.ndarray) -> None:
        if self._held + rows.nbytes > self._most:
            self.lost += len(rows)
            self._blame("more waits for the disk than may be held: what is left out is a gap in the file")
            return
        self._put(_Part(kind, first, len(rows), rows.tobytes()))

    def _put(self, part: _Part) -> None:
        with self._lock:
            self._held += len(part.content)
        self._waiting.put(part)

    def _blame(self, what: str) -> None:
        if what not in self.faults:
            self.faults = (*self.faults, what)

    def _opened(self, head: dict[str, Any], resume: bool) -> int:
        flags = os.O_RDWR | os.O_APPEND | (0 if resume else os.O_CREAT | os.O_EXCL)
        try:
            with contextlib.ExitStack() as left:
                file = os.open(self.path, flags, 0o666)
                left.callback(os.close, file)
                if resume:
                    self._take_up(file, head)
                else:
                    self._append(file, encode_head(head))
                    os.fsync(file)
                    self._sync_folder()
                left.pop_all()
        except FileExistsError:
            raise ConfigError(
                "is there already: a run is never written over", where=str(self.path), hint="another name"
            ) from None
        except OSError as error:
            raise DataError(
                f"cannot be written: {error.strerror}", where=str(self.path),
                hint="another folder; the loop runs on",
            ) from None  # fmt: skip
        return file

    def _take_up(self, file: int, head: dict[str, Any]) -> None:
        data = self.path.read_bytes()
        found = decode_head(data, str(self.path))
        if any(found.document.get(key) != value for key, value in head.items() if key not in OF_A_START):
            raise ConfigError("is the file of another run", where=str(self.path), hint="another name")
        self._mark = found.mark
        frames = [f for f in frames_in(data, found.begin, self._mark) if isinstance(f, Frame)]
        if any(f.kind == Kind.END for f in frames):
            raise ConfigError("is a run that has ended", where=str(self.path), hint="another name")
        self._size = frames[-1].end if frames else found.begin
        os.ftruncate(file, self._size)
        self._digest = hashlib.sha256(data[: self._size])
        self._number = max((f.number for f in frames), default=0)
        whole = [f for f in frames if f.content is not None]
        self.last = max((f.first + f.count - 1 for f in whole if f.kind == Kind.RECORDS), default=0)
        self.last_event = max((f.first + f.count - 1 for f in whole if f.kind == Kind.EVENTS), default=0)
        for kind, name in ((Kind.RECORDS, "records"), (Kind.PRETRIP, "records"), (Kind.EVENTS, "events")):
            self._counts[name] += sum(f.count for f in whole if f.kind == kind)

    def _sync_folder(self) -> None:
        with contextlib.suppress(OSError):  # some file systems have no such thing
            folder = os.open(self.path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)

    def _append(self, file: int, data: bytes) -> None:
        """All of ``data`` or nothing: what a full disk has taken of it is cut off again."""
        try:
            done = 0
            while done < len(data):
                done += os.write(file, data[done:])
        except OSError:
            os.ftruncate(file, self._size)
            raise
        self._size += len(data)
        self._digest.update(data)

    def _work(self) -> None:
        due, ended = self._clock() + self._sync_s, False
        while not ended:
            try:
                part = self._waiting.get(timeout=max(0.0, min(due - self._clock(), self._sync_s)))
                ended = part is None
                if part is not None:
                    self._parts.append(part)
                urgent = part is not None and part.kind == Kind.EVENTS
            except queue.Empty:
                urgent = False
            late = self._clock() >= due
            if not self.faults or late or ended:
                self._drain()
            if late or urgent or ended:
                self._sync()
                due = self._clock() + self._sync_s
        self._end()

    def _drain(self) -> None:
        while self._parts:
            part = self._parts[0]
            frame = encode_frame(self._mark, part.kind, self._number + 1, part.first, part.rows, part.content)
            try:
                self._append(self._file, frame)
            except OSError as error:
                self._blame(f"cannot be written: {error.strerror}")
                return
            self._number += 1
            del self._parts[0]
            with self._lock:
                self._held -= len(part.content)
            self._count(part)

    def _count(self, part: _Part) -> None:
        last, last_event = self._written
        end = part.first + part.rows - 1
        if part.kind == Kind.RECORDS:
            last = end
        elif part.kind == Kind.EVENTS:
            last_event = end
        self._written = (last, last_event)
        if part.kind in (Kind.RECORDS, Kind.PRETRIP):
            self._counts["records"] += part.rows
        elif part.kind == Kind.EVENTS:
            self._counts["events"] += part.rows

    def _sync(self) -> None:
        reached = self._written
        try:
            os.fdatasync(self._file)
        except OSError as error:
            self._blame(f"does not reach the disk: {error.strerror}")
            return
        self.synced, self.synced_event = reached

    def _end(self) -> None:
        """The end mark, where all before it has been written."""
        if not self._parts:
            told = {**self._counts, "lost": self.lost, "faults": self.faults}
            content = json.dumps({**told, "sha256": self._digest.hexdigest()}).encode()
            self._parts.append(_Part(Kind.END, self.last, 1, content))
            self._drain()
            self._sync()
        if self._parts:
            self._blame(f"{sum(part.rows for part in self._parts)} records or events were never written")
        os.close(self._file)
