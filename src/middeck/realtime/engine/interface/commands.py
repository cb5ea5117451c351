"""Commands of a supervisor to an engine, and the engine's answers."""

from collections.abc import Mapping, Sequence

import numpy as np

from middeck.realtime.engine.interface.checksum import checksum
from middeck.realtime.engine.interface.header import constants, names_of
from middeck.signals.ports import Port
from middeck.values import record

REASONS = {
    "done": "",
    "unknown command": "no such command",
    "wrong slot": "no such slot",
    "not loaded": "the slot holds no checked package",
    "not ready": "not in this state: SAFE needs a reset first, a compensator a hold that has risen and been "
    "verified",
    "wrong trip": "the reset names another trip than the one that holds the loop",
    "still unhealthy": "a sensor is still out of order",
    "busy": "the slot runs, or the excitation plays",
    "out of range": "a value outside its range",
    "not admitted": "no gate has passed this package beside this hold: give its verdict to the supervisor, "
    'admitted=load_verdicts(["verdict.json"]), or on a bench admitted="ungated"',
    "on blacklist": "a trip has put the law of this package on the blacklist",
    "no waveform": "the engine was started without an excitation",
    "not adaptive": "the settings have no adaptive gain",
    "withdrawn": "a disengage, a silence or the end that came after it went first",
    "not proved": "no proof of this package, beside this hold, covers the adaptive gain of the settings, at "
    "this share and behind this strip; or another law still acts",
    "other session": "a command of another supervisor, or from before the engine was taken over",
    "bad proof": "a proof that was changed, or is of another package or another hold",
    "bad hash": "the package was changed: its hash does not fit",
    "cut short": "the package was cut short: it ends before what its sizes need",
    "too long": "wrong size: the package has more bytes than its sizes need",
    "bad magic": "no controller package: it begins otherwise",
    "bad format": "a package of another format or byte order",
    "bad size": "a size that no package has",
    "bad length": "wrong size: its sizes and its length do not fit",
    "bad number": "a number that is not finite",
    "bad limit": "limits or ranges that no output or input can have",
    "bad place": "a filter at an input that is not there",
    "bad text": "a name or unit that does not fit",
    "bad padding": "bytes that must be zero are not",
    "single precision": "a law in single precision, for small processors: load the one in double precision",
    "inner loop": "a package with an inner loop: the hold belongs to the engine's settings",
    "other rate": "a package of another sampling rate",
    "unknown port": "a port that the engine lacks, or has in another unit",
    "no bytes": "the package is empty",
    "other byte order": "the bytes of each number stand in the other order (big-endian)",
    "name twice": "two inputs or two outputs of one name",
    "undeclared pole": "a pole outside the unit circle that the package does not declare",
    "bad vectors": "the engine does not give the package's test vectors",
}


@record
class Answer:
    """Whether a command was carried out, after which sample, and the engine's word for it."""

    number: int
    sample: int
    word: str

    @property
    def done(self) -> bool:
        """Whether it was carried out."""
        return self.word == "done"

    @property
    def reason(self) -> str:
        """Why it was not; empty where it was."""
        return REASONS[self.word]


@record(kw_only=True)
class Event:
    """Something that happened in the engine.

    Attributes:
        number: From 1, without gaps.
        sample: In which.
        kind: A trip ("envelope", "stop" ...) or another happening ("engaged", "loaded" ...).
        channel, side: Name of the sensor or output, where there is one, and which of both it is.
        value, limit: What was seen, and what it is compared with.
        sha256: Of the package in control, where there is one; of the law that goes on the blacklist
            (`hash_law`).
    """

    number: int
    sample: int
    kind: str
    channel: str
    side: str
    value: float
    limit: float
    sha256: str

    @property
    def trips(self) -> bool:
        """Whether it took the loop to SAFE."""
        return self.kind in TRIPS


def check_of(command: np.ndarray) -> int:
    """Of the words of a command but the last: without it half a command could be taken for one."""
    found = checksum(command.tobytes()[:-8])
    return found - ((found >> 63) << 64)


def read_event(
    row: np.ndarray, sensors: Sequence[Port], outputs: Sequence[Port], kinds: Mapping[int, str]
) -> Event:
    """The shared record of an event; a kind that is not among ``kinds`` keeps its number."""
    ports = [port.name for port in (*sensors, *outputs)]
    channel, digest = int(row["channel"]), bytes(row["hash"])
    known = 0 <= channel < len(ports)
    return Event(
        number=int(row["sequence"]),
        sample=int(row["sample"]),
        kind=kinds.get(int(row["kind"]), f"kind {int(row['kind'])}"),
        channel=ports[channel] if known else "",
        side="" if not known else "sensor" if channel < len(sensors) else "output",
        value=float(row["value"]),
        limit=float(row["limit"]),
        sha256=digest.hex() if any(digest) else "",
    )


TRIPS = frozenset(names_of("trip").values()) - {"no trip", "power up"}
KINDS = {**names_of("trip"), **names_of("happening")}
COMMANDS = {word: code for code, word in names_of("command_kind").items()}
STRIP_WORDS = {word.removeprefix("strip "): code for code, word in names_of("strip_word").items()}
ANSWERS = names_of("answer")
STATES = names_of("state")
QUEUE = constants()["COMMANDS"]
