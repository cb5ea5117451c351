"""The supervisor's side of an engine: start it, command it, let it run, read what it has recorded."""

from __future__ import annotations

import contextlib
import math
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.article import LinearArticle, encode_article
from middeck.realtime.engine.build import build_engine
from middeck.realtime.engine.commands import (
    ANSWERS,
    COMMANDS,
    KINDS,
    QUEUE,
    STATES,
    STRIP_WORDS,
    Answer,
    Event,
)
from middeck.realtime.engine.header import constants, layout
from middeck.realtime.engine.settings import EngineSettings, encode_settings
from middeck.realtime.engine.shared_file import make_shared_file
from middeck.realtime.package.package import ControllerPackage
from middeck.values import record

POLL_S = 5e-5
BEAT_S = 0.05
PATIENCE_S = 60.0


@record
class UdpRig:
    """A rig that answers on this port of the loopback interface."""

    port: int


@record
class DriverRig:
    """Converters behind the driver that the engine was built with."""


RigChoice = LinearArticle | UdpRig | DriverRig


class Supervisor:
    """One engine and its shared file; a context manager, which ends both.

    Args:
        settings: Ports, hold, trips.
        rig: What it drives.
        waveform: Excitation of the outputs, one row a sample, which "excite" plays.
        real_time: By the clock, else in lockstep: as fast as it can, and only as far as `run` lets it.
        folder: Where the shared file lies; a temporary one if it is left out.
        ring: Records kept for reading.
        pretrip_s: Time before a trip that is kept until its reset.
        program: The compiled engine; that of `build_engine` if it is left out.
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
    ) -> None:
        self.settings, self.real_time = settings, real_time
        self._left = contextlib.ExitStack()
        where = folder or Path(
            self._left.enter_context(tempfile.TemporaryDirectory(prefix="middeck-engine-"))
        )
        article, numbers = encode_article(rig) if isinstance(rig, LinearArticle) else _no_article()
        played = np.zeros((0, len(settings.drives))) if waveform is None else _checked(waveform, settings)
        self.file = make_shared_file(
            where / "engine.shared",
            _started(settings, rig, real_time),
            article,
            numbers,
            played,
            ring=ring,
            pretrip=max(1, settings.samples(pretrip_s)),
        )
        self.seen_events = 0
        self.process = subprocess.Popen(
            [str(program or build_engine()), str(self.file.path)], stderr=subprocess.PIPE, text=True
        )
        try:
            self._wait(lambda: bool(self.file.status["running"]))
        except BaseException:
            self._left.close()
            raise

    def __enter__(self) -> Supervisor:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the engine, its outputs at zero, and remove a temporary shared file."""
        if self.process.poll() is None and kind_of_end(self):
            try:
                self.process.wait(5.0)
            except subprocess.TimeoutExpired:
                self.process.kill()
        self.process.wait()
        if self.process.stderr is not None:
            self.process.stderr.close()
        self._left.close()

    @property
    def state(self) -> str:
        """ "safe", "ready", "identify", "engaging", "control" or "disengaging"."""
        return STATES[int(self.file.status["state"])]

    @property
    def sample(self) -> int:
        """Samples that have been run."""
        return int(self.file.status["sample"])

    @property
    def trip(self) -> int:
        """Number of the trip that holds the loop in SAFE; 0 for none, and at power-up."""
        return int(self.file.status["trip"])

    def send(self, kind: str, *, slot: int = 0, values: Sequence[float] = (), at: int = 0) -> int:
        """Queue a command, not before sample ``at``; its number. Commands are taken in order.

        Raises `ConfigError` for a word that is no command and for more than four values; waits while the
        queue is full.
        """
        if kind not in COMMANDS or len(values) > 4:
            raise ConfigError(
                f"no command {kind!r} of {len(values)} values", hint=f"one of {', '.join(COMMANDS)}"
            )
        number = int(self.file.asks["written"]) + 1
        self._wait(lambda: number - int(self.file.status["acknowledged"]) < QUEUE)
        row = np.zeros((), layout("command"))
        row["number"], row["at"], row["kind"], row["slot"] = number, at, COMMANDS[kind], slot
        row["value"][: len(values)] = values
        self.file.commands[number % QUEUE] = row
        self.file.asks["written"] = number
        return number

    def answer(self, number: int) -> Answer:
        """Wait until a command is answered. In lockstep one that is not due yet needs `run` first."""
        self._wait(lambda: int(self.file.status["acknowledged"]) >= number)
        row = self.file.acknowledgements[number % QUEUE]
        return Answer(number, int(row["sample"]), ANSWERS[int(row["answer"])])

    def command(self, kind: str, *, slot: int = 0, values: Sequence[float] = ()) -> Answer:
        """Send a command and wait for its answer."""
        return self.answer(self.send(kind, slot=slot, values=values))

    def load(self, package: ControllerPackage | bytes, slot: int = 0) -> Answer:
        """Put a package into a slot that does not run: it is checked there, its test vectors replayed."""
        return self.command("load", slot=slot, values=[self.file.stage(package)])

    def set_strip(self, output: str, word: str, value: float) -> Answer:
        """Gain, offset, limit (a share) or hold (1 or 0) of an output's strip."""
        if word not in STRIP_WORDS:
            raise ConfigError(f"no word {word!r} of a strip", hint=f"one of {', '.join(STRIP_WORDS)}")
        return self.command("strip", slot=self.settings.drive(output), values=[STRIP_WORDS[word], value])

    def reset(self) -> Answer:
        """Leave SAFE, naming the trip that led there."""
        return self.command("reset", values=[self.trip])

    def stop(self) -> None:
        """STOP: safe at the next sample, whatever the queue holds."""
        self.file.asks["stop"] += 1

    def beat(self) -> None:
        """Show the engine that its supervisor lives."""
        self.file.asks["heartbeat"] += 1

    def run(self, samples: int, *, beats: bool = True, keep: bool = True) -> np.ndarray:
        """Let it run so many samples and return their records; none are kept where ``keep`` is false.

        In real time this takes that long. The supervisor's heart beats meanwhile, unless ``beats`` is false.
        Raises `DataError` where records were overwritten before they were read.
        """
        begin = self.sample
        if self.real_time:
            return self._follow(begin + samples, beats, keep)
        taken, slice_ = [], len(self.file.ring)
        for first in range(begin, begin + samples, slice_):
            if beats:
                self.beat()
            until = min(first + slice_, begin + samples)
            self.file.asks["until"] = until
            self._wait(lambda until=until: self.sample >= until)
            taken.append(self.read() if keep else self._skip())
        return np.concatenate(taken) if taken else self.file.ring[:0].copy()

    def read(self) -> np.ndarray:
        """Records that have not been read yet, in order."""
        ring, first = self.file.ring, int(self.file.asks["taken"])
        last = self.sample
        if last - first > len(ring):
            self.file.asks["taken"] = last
            raise DataError(
                f"{last - first - len(ring)} records were lost", where="engine", hint="read more often"
            )
        found = ring[np.arange(first, last) % len(ring)]
        self.file.asks["taken"] = last
        if np.any(found["sequence"] != np.arange(first + 1, last + 1)):
            raise DataError(
                "records were overwritten while they were read", where="engine", hint="a larger ring"
            )
        return found

    def events(self) -> list[Event]:
        """Events that have not been read yet, in order."""
        count, most = int(self.file.status["events"]), len(self.file.events)
        first = max(self.seen_events, count - most)
        self.seen_events = count
        return [self._event(self.file.events[k % most]) for k in range(first, count)]

    def pretrip(self) -> np.ndarray:
        """Records up to the trip that holds the loop in SAFE, oldest first; without one, those until now."""
        kept, end = self.file.pretrip, int(self.file.status["frozen_at"])
        return kept[np.arange(max(0, end - len(kept)), end) % len(kept)]

    def blacklist(self) -> tuple[str, ...]:
        """Hashes of packages that trips have refused."""
        count = int(self.file.status["blacklisted"])
        return tuple(bytes(row).hex() for row in self.file.status["blacklist"][:count])

    def _event(self, row: np.ndarray) -> Event:
        ports = [port.name for port in (*self.settings.inputs, *self.settings.outputs)]
        channel, digest = int(row["channel"]), bytes(row["hash"])
        return Event(
            number=int(row["sequence"]),
            sample=int(row["sample"]),
            kind=KINDS[int(row["kind"])],
            channel=ports[channel] if 0 <= channel < len(ports) else "",
            side="" if channel < 0 else "sensor" if channel < len(self.settings.sensors) else "output",
            value=float(row["value"]),
            limit=float(row["limit"]),
            sha256=digest.hex() if any(digest) else "",
        )

    def _skip(self) -> np.ndarray:
        self.file.asks["taken"] = self.sample
        return self.file.ring[:0].copy()

    def _follow(self, until: int, beats: bool, keep: bool) -> np.ndarray:
        taken = []
        while self.sample < until:
            if beats:
                self.beat()
            time.sleep(min(BEAT_S, (until - self.sample) * self.settings.period_s))
            self._require_alive()
            taken.append(self.read() if keep else self._skip())
        return np.concatenate(taken) if taken else self.file.ring[:0].copy()

    def _wait(self, reached: object) -> None:
        began = time.monotonic()
        while not reached():  # type: ignore[operator]
            self._require_alive()
            if time.monotonic() - began > PATIENCE_S:
                raise DataError(
                    f"the engine does not answer for {PATIENCE_S:g} s",
                    where="engine",
                    hint="is its rig alive?",
                )
            time.sleep(POLL_S)

    def _require_alive(self) -> None:
        if self.process.poll() is not None:
            said = self.process.stderr.read() if self.process.stderr else ""
            raise DataError(
                f"the engine has ended with code {self.process.returncode}: {said.strip()}",
                where="engine",
                hint="what it said; its records are still in the shared file",
            )


def kind_of_end(supervisor: Supervisor) -> bool:
    """Ask an engine to end; False where it has no ear for it any more."""
    try:
        supervisor.send("end")
    except DataError:
        return False
    return True


def _no_article() -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((), layout("article")), np.zeros(0)


def _started(settings: EngineSettings, rig: RigChoice, real_time: bool) -> np.ndarray:
    words, kinds = encode_settings(settings), constants()
    words["clock"] = kinds["REAL_TIME" if real_time else "LOCKSTEP"]
    if isinstance(rig, LinearArticle):
        shape = rig.C.shape[0], rig.B.shape[1]
        if shape != (len(settings.sensors), len(settings.drives)):
            raise ConfigError(
                f"an article of {shape[0]} sensors and {shape[1]} outputs for an engine of "
                f"{len(settings.sensors)} and {len(settings.drives)}",
                hint="the same ports in the same order",
            )
        words["rig"] = kinds["LINEAR_RIG"]
    elif isinstance(rig, UdpRig):
        words["rig"], words["port"] = kinds["UDP_RIG"], rig.port
    else:
        words["rig"] = kinds["DRIVER_RIG"]
    return words


def _checked(waveform: np.ndarray, settings: EngineSettings) -> np.ndarray:
    w = np.ascontiguousarray(waveform, dtype=float)
    if w.ndim != 2 or w.shape[1] != len(settings.drives) or not np.isfinite(w).all():
        raise ConfigError(
            f"an excitation of shape {w.shape}",
            hint=f"finite, one column for each of {len(settings.drives)} outputs",
        )
    if not math.prod(w.shape):
        raise ConfigError("an excitation without a sample", hint="at least one")
    return w
