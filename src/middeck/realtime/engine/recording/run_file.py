"""The reader of a run file: every whole block, and a description of what is missing."""

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from middeck.errors import DataError
from middeck.realtime.engine.interface.commands import Event, read_event
from middeck.realtime.engine.recording.run_frames import (
    SCHEMA,
    Frame,
    Kind,
    Unreadable,
    decode_head,
    frames_in,
)
from middeck.signals.ports import Port
from middeck.values import record

NEEDED = ("sequence", "state", "trip", "late_ns", "step_ns", "y", "u")
EVENT = ("sequence", "sample", "kind", "channel", "value", "limit", "hash")
AGAIN = "the file as it was recorded"


@record(kw_only=True)
class RunFault:
    """Something that a run file lacks.

    Attributes:
        kind: gap, flipped, torn, lost bytes, repeated, head, no end, another end, note.
        what: For people, with the block and the bytes.
        samples: Sequence numbers (first, last + 1) that are missing for it; empty where none are.
    """

    kind: str
    what: str
    samples: tuple[int, int] | tuple[()] = ()


@record(kw_only=True)
class Run:
    """A run of an engine as its file has it.

    Attributes:
        period_s, inputs, outputs: Of the loop: ``inputs`` are what it drives (``u``), ``outputs`` what it
            reads (``y``), as a plant has them.
        start, real_time, settings_sha256, packages: As the head says.
        records: One row a sample, in order; ``sequence`` counts samples from 1.
        events: In order.
        faults: What is missing; none for a whole file.
        states: Word of each number of ``records["state"]``.
    """

    period_s: float
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    start: str
    real_time: bool
    settings_sha256: str
    packages: tuple[str, ...]
    records: np.ndarray
    events: tuple[Event, ...]
    faults: tuple[RunFault, ...]
    states: tuple[str, ...]

    def before(self, trip: int) -> tuple[np.ndarray, tuple[Event, ...]]:
        """Records and events up to the trip of this number, from 1; raises `DataError` without it."""
        tripped = self.records["sequence"][self.records["trip"] == trip]
        if not len(tripped):
            count = int(self.records["trip"].max(initial=0))
            raise DataError(f"no trip {trip} in the records", where="run", hint=f"1 to {count}")
        sample = int(tripped[0])
        kept = self.records[self.records["sequence"] <= sample]
        return kept, tuple(event for event in self.events if event.sample < sample)


def read_run(path: str | Path) -> Run:
    """The run in a file, whatever has happened to the file.

    Raises `DataError` where it cannot be opened, is no run file, or both copies of its head are gone.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", where=str(path), hint="another file") from None
    return decode_run(data, str(path))


def decode_run(data: bytes, where: str = "") -> Run:
    """`read_run` of the bytes of a file."""
    front = decode_head(data, where)
    found = _Blocks(_Head(front.document, where), data)
    if not front.both:
        found.fault("head", "one of the two copies of its head is damaged; the other one is whole")
    for piece in frames_in(data, front.begin, front.mark):
        found.take(piece)
    return found.run()


class _Head:
    """The document at the front of a file, checked."""

    def __init__(self, document: Mapping[str, Any], where: str) -> None:
        try:
            if document["schema"] != SCHEMA:
                raise ValueError(f"schema {document['schema']!r}")
            self.period_s = float(document["period_s"])
            self.inputs, self.outputs = (
                tuple(Port(str(name), str(unit)) for name, unit in document[side])
                for side in ("inputs", "outputs")
            )
            self.start, self.real_time = str(document["start"]), bool(document["real_time"])
            self.settings_sha256 = str(document["settings_sha256"])
            self.packages = tuple(str(one) for one in document["packages"])
            self.kinds = {int(key): str(word) for key, word in document["kinds"].items()}
            self.states = tuple(str(word) for word in document["states"])
            self.record, self.event = _kind(document["record"], NEEDED), _kind(document["event"], EVENT)
            shapes = (self.record["y"].shape, self.record["u"].shape)
            if shapes != ((len(self.outputs),), (len(self.inputs),)) or not 0.0 < self.period_s < np.inf:
                raise ValueError("ports, period and records do not fit")
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise DataError(
                f"its head does not say what a run needs: {error}", where=where, hint=AGAIN
            ) from None


def _kind(fields: Any, needed: tuple[str, ...]) -> np.dtype:
    """A record of numbers, from pairs of name and type with a size; no other type is believed."""
    made: list[tuple[str, str, tuple[int, ...]]] = []
    for name, kind, shape in fields:
        sizes = tuple(int(size) for size in shape)
        if not re.fullmatch(r"\w{1,40}", name) or kind not in ("<i8", "<f8", "|u1") or len(sizes) > 1:
            raise ValueError(f"field {name!r} of {kind!r}")
        if any(not 0 < size <= 4096 for size in sizes):
            raise ValueError(f"field {name!r} of {sizes}")
        made.append((name, kind, sizes))
    if len(made) > 100 or not set(needed) <= {name for name, _, _ in made}:
        raise ValueError(f"fields {', '.join(name for name, _, _ in made)}")
    return np.dtype(made)


class _Blocks:
    """Takes frames and gathers records, events and faults."""

    def __init__(self, head: _Head, data: bytes) -> None:
        self.head, self.data = head, data
        self.records: list[np.ndarray] = []
        self.events: list[np.ndarray] = []
        self.faults: list[RunFault] = []
        self.number, self.ended = 0, False

    def fault(self, kind: str, what: str, samples: tuple[int, int] | tuple[()] = ()) -> None:
        self.faults.append(RunFault(kind=kind, what=what, samples=samples))

    def take(self, piece: Frame | Unreadable) -> None:
        if isinstance(piece, Unreadable):
            size, after = piece.end - piece.start, f"after block {self.number}"
            if piece.torn:
                self.fault(
                    "torn", f"the file ends within a block: its last {size} bytes, {after}, are no whole one"
                )
            else:
                self.fault("lost bytes", f"bytes {piece.start} to {piece.end}, {after}, are no whole block")
            return
        if self.ended:
            self.fault("another end", f"block {piece.number} stands behind the end")
        if piece.number <= self.number:
            self.fault("repeated", f"block {piece.number} stands behind block {self.number}: left out")
            return
        if piece.number > self.number + 1:
            self.fault("lost bytes", f"blocks {self.number + 1} to {piece.number - 1} are not there")
        self.number = piece.number
        if piece.content is None:
            samples = (piece.first, piece.first + piece.count) if piece.kind == Kind.RECORDS else ()
            self.fault(
                "flipped",
                f"block {piece.number}, bytes {piece.start} to {piece.end}, was changed: left out",
                samples,
            )
            return
        self._open(piece, piece.content)

    def _open(self, frame: Frame, content: bytes) -> None:
        if frame.kind in (Kind.RECORDS, Kind.PRETRIP, Kind.EVENTS):
            kind = self.head.event if frame.kind == Kind.EVENTS else self.head.record
            rows = np.frombuffer(content, kind) if len(content) == frame.count * kind.itemsize else None
            if rows is None or not _in_order(rows, frame, gaps=frame.kind == Kind.PRETRIP):
                self.fault("flipped", f"block {frame.number} does not hold what it says: left out")
                return
            (self.events if frame.kind == Kind.EVENTS else self.records).append(rows)
        elif frame.kind == Kind.NOTE:
            self.fault("note", str(_document(content).get("what", "a note without a text")))
        elif frame.kind == Kind.END:
            self._close(frame, content)
        else:
            self.fault(
                "lost bytes",
                f"block {frame.number} is of kind {frame.kind}, which this program does not know",
            )

    def _close(self, frame: Frame, content: bytes) -> None:
        self.ended, told = True, _document(content)
        if told.get("sha256") != hashlib.sha256(self.data[: frame.start]).hexdigest():
            self.fault("another end", "its end mark has another SHA-256 than what stands before it")
        for what in told["faults"] if isinstance(told.get("faults"), list) else ():
            self.fault("note", f"the recorder: {what}")

    def run(self) -> Run:
        head = self.head
        records = _sorted(self.records, head.record)
        events = _sorted(self.events, head.event)
        if not self.ended:
            self.fault("no end", "it has no end mark: its recorder was stopped, or the file was cut short")
        self._look_for_gaps(records["sequence"], "samples")
        self._look_for_gaps(events["sequence"], "events")
        return Run(
            period_s=head.period_s,
            inputs=head.inputs,
            outputs=head.outputs,
            start=head.start,
            real_time=head.real_time,
            settings_sha256=head.settings_sha256,
            packages=head.packages,
            records=records,
            events=tuple(
                read_event(row, self.head.outputs, self.head.inputs, self.head.kinds) for row in events
            ),
            faults=tuple(self.faults),
            states=head.states,
        )

    def _look_for_gaps(self, sequence: np.ndarray, what: str) -> None:
        for k in np.flatnonzero(np.diff(sequence) > 1):
            first, last = int(sequence[k]) + 1, int(sequence[k + 1])
            samples = (first, last) if what == "samples" else ()
            self.fault("gap", f"{last - first} {what} are missing: {first} to {last - 1}", samples)


def _in_order(rows: np.ndarray, frame: Frame, *, gaps: bool) -> bool:
    sequence = rows["sequence"]
    if not len(rows) or sequence[0] != frame.first or frame.first < 1:
        return False
    steps = np.diff(sequence)
    return bool(np.all(steps > 0) if gaps else np.all(steps == 1))


def _sorted(parts: list[np.ndarray], kind: np.dtype) -> np.ndarray:
    together = np.concatenate(parts) if parts else np.zeros(0, kind)
    _, first = np.unique(together["sequence"], return_index=True)
    return together[first]


def _document(content: bytes) -> dict[str, Any]:
    try:
        found = json.loads(content)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
