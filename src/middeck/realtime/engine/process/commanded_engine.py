"""A running engine as its supervisor commands it: state, queue of commands, answers, heartbeat."""

from __future__ import annotations

import operator
import subprocess
import time
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.interface.adaptive_gain import ProvedGain, encode_proof
from middeck.realtime.engine.interface.commands import (
    ANSWERS,
    COMMANDS,
    QUEUE,
    STATES,
    STRIP_WORDS,
    Answer,
    check_of,
)
from middeck.realtime.engine.interface.header import layout
from middeck.realtime.engine.interface.settings import EngineSettings, hash_hold
from middeck.realtime.engine.interface.shared_file import SharedFile
from middeck.realtime.engine.process.admitted import Admitted, is_admitted
from middeck.realtime.engine.process.adopted_engine import AdoptedEngine
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_bytes import encode_package

POLL_S, LATER, MOST_POLL_S = 5e-5, 0.1, 2e-3
"""Between two looks: an answer is seen later by no more than a share of the time that it took."""
PATIENCE_S = 60.0
KEPT, KEPT_FREE = 16, {"disengage": 1, "silence": 1, "end": 0}
"""Places of the queue that a command leaves free: those that make safe find one where the rest wait."""


class CommandedEngine:
    """A started engine under command of its supervisor."""

    settings: EngineSettings
    real_time: bool
    file: SharedFile
    process: subprocess.Popen[str] | AdoptedEngine
    _admitted: Admitted
    _session: int

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

    @property
    def momentum(self) -> Float[np.ndarray, " output"]:
        """The momentum stored by each output: `Drive.stored` of an engine that follows this one."""
        return self.file.status["momentum"][: len(self.settings.drives)].copy()

    def send(self, kind: str, *, slot: int = 0, values: Sequence[float] = (), at: int = 0) -> int:
        """Queue a command, not before sample ``at``; its number. Commands are taken in order, but for
        "disengage", "silence" and "end": what makes safe waits for none, and an "engage" or "excite" before
        it that has not been carried out is withdrawn.

        Raises `ConfigError` for a word that is no command, more than four values, and what is no number,
        `DataError` once another supervisor has taken the engine over; waits while the queue is full.
        """
        if kind not in COMMANDS or len(values) > 4:
            raise ConfigError(
                f"no command {kind!r} of {len(values)} values", hint=f"one of {', '.join(COMMANDS)}"
            )
        self._require_own()
        self._beat_by_the_clock()
        number = int(self.file.asks["written"]) + 1
        room = QUEUE - KEPT_FREE.get(kind, KEPT)
        self._wait(lambda: number - int(self.file.status["acknowledged"]) < room)
        self._require_own()  # that may have taken long
        row = np.zeros((), layout("command"))
        try:
            row["number"], row["session"], row["kind"] = number, self._session, COMMANDS[kind]
            row["at"], row["slot"] = operator.index(at), operator.index(slot)
            row["value"][: len(values)] = values
        except (TypeError, ValueError, OverflowError) as error:
            raise ConfigError(f"{kind}: {error}", hint="a sample, a slot, numbers") from None
        row["check"] = check_of(row)
        self.file.commands[number % QUEUE] = row
        self.file.asks["written"] = number
        return number

    def answer(self, number: int) -> Answer:
        """Wait until a command is answered. In lockstep one that is not due yet needs `run` first.

        Raises `DataError` for one whose place a later answer has taken.
        """
        place = self.file.acknowledgements[number % QUEUE]
        self._wait(lambda: int(self.file.status["acknowledged"]) >= number or int(place["number"]) == number)
        row = place.copy()
        if int(row["number"]) != number:
            raise DataError(
                f"the answer to command {number} is gone", where="engine", hint=f"the last {QUEUE} are kept"
            )
        return Answer(number, int(row["sample"]), ANSWERS[int(row["answer"])])

    def command(self, kind: str, *, slot: int = 0, values: Sequence[float] = ()) -> Answer:
        """Send a command and wait for its answer."""
        return self.answer(self.send(kind, slot=slot, values=values))

    def load(
        self, package: ControllerPackage | bytes, slot: int = 0, *, proof: ProvedGain | None = None
    ) -> Answer:
        """Put a package into a slot that does not run: it is checked there, its test vectors replayed.

        ``proof`` is what the gate has proved of the adaptive gain: without it "adapt" is refused. A package
        that is not ``admitted`` does not reach the engine: its answer has the number 0.
        """
        if not is_admitted(self._admitted, _seal(package), hash_hold(self.settings)):
            return Answer(0, self.sample, "not admitted")
        self._require_own()  # before its package lies where that of a successor may wait
        sealed = b"" if proof is None else encode_proof(proof)
        return self.command("load", slot=slot, values=[self.file.stage(package, sealed), bool(sealed)])

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
        """Show the engine that its supervisor lives; nothing of one that is none any more."""
        if not self._is_relieved():
            self.file.asks["heartbeat"] += 1

    def blacklist(self) -> tuple[str, ...]:
        """Laws that are refused, by their `hash_law`: those of the start, then those that tripped."""
        count = int(self.file.status["blacklisted"])
        return tuple(bytes(row).hex() for row in self.file.status["blacklist"][:count])

    def _takes_end(self) -> bool:
        """Ask the engine to end; False where it has no ear for it any more."""
        try:
            self.send("end")
        except DataError:
            return False
        return True

    def _wait(self, reached: Callable[[], object]) -> None:
        """Patience begins anew with each sample in lockstep, which may take as long as a rig's answer."""
        first, last = time.monotonic(), self.sample
        began = now = first
        while not reached():
            self._require_alive()
            self._beat_by_the_clock()
            if not self.real_time and self.sample != last:
                began, last = now, self.sample
            patience = PATIENCE_S + (0.0 if self.real_time else self.settings.answer_s)
            if now - began > patience:
                raise DataError(
                    f"does not answer for {patience:g} s at sample {self.sample}",
                    where="engine, or its rig",
                    hint="a rig whose read hangs stops the engine: end both and start the rig first",
                )
            time.sleep(min(max(POLL_S, LATER * (now - first)), MOST_POLL_S))
            now = time.monotonic()

    def _beat_by_the_clock(self) -> None:
        """Who commands or waits for an answer lives; time goes on meanwhile."""
        if self.real_time:
            self.beat()

    def _is_relieved(self) -> bool:
        """Whether another supervisor has taken the engine over."""
        return int(self.file.asks["session"]) != self._session

    def _require_own(self) -> None:
        if self._is_relieved():
            raise DataError(
                "another supervisor has taken the engine over: commands of this one are refused",
                where="engine",
                hint="Supervisor.attach, once the other one is gone; stop() is left",
            )

    def _require_alive(self) -> None:
        if self.process.poll() is not None:
            said = self.process.stderr.read() if self.process.stderr else ""
            raise DataError(
                f"the engine has ended with code {self.process.returncode}: {said.strip()}",
                where="engine",
                hint="what it said; its records are still in the shared file",
            )


def _seal(package: ControllerPackage | bytes) -> str:
    """The SHA-256 that a package says it has; the engine computes it anew."""
    return (package if isinstance(package, bytes) else encode_package(package))[-32:].hex()
