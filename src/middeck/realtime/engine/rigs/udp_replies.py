"""What a rig answers to an engine's datagrams: ``source/rig_udp.c`` from the other side."""

import math
import secrets
import struct

import numpy as np

from middeck.realtime.engine.interface.checksum import checksum, start_of
from middeck.realtime.engine.interface.header import constants
from middeck.realtime.engine.rigs.engine_rig import EngineRig

REQUEST, REPLY = struct.Struct("<qqq"), struct.Struct("<qqqq")
"""Behind the check: sample, alive, session, then outputs; sample, session, rig, stale, then sensors."""
HEAD = struct.Struct("<qq")
"""Check and sample of every format; sample and alive of requests from before there were checks."""
NOBODY = 0
"""No engine has this session."""
END = -1
"""The sample of an engine's last request."""
HOLD = 2
"""Periods for which outputs hold while the alive number stands still; then they are zero."""
LONGEST = 1 << 16
"""Most samples that one request may move on; what asks for more is no request of an engine."""

EARLY, SMALL, FORMATS = 1 << 40, 1e-200, 1 << 8
"""Requests from before there were checks begin with two counts below the first, and outputs between the
second and its inverse follow. There will be fewer formats than the third: a flipped bit is none of them, nor
a sample beyond 2^32, whose upper half stands where the number does."""
SILENT = 20
"""Samples that another engine asks for before a followed one, silent meanwhile, is taken for gone."""


class RigSession:
    """A rig, where it stands, and its last reply; `answer` takes one datagram.

    Time of the rig is the engine's sample number. A request that was answered before gets the same reply; one
    whose number has grown by n moves the rig by n samples. It follows one engine, known by its session: one
    of another session relieves it at its sample 0, or joins after a last request or `SILENT` samples of
    its own without one of the followed engine, and the rig goes on from where it is. Whatever else is of
    another session, above all what an earlier engine has asked before, moves nothing and counts as ``stale``.
    Replies carry a number of chance of the session, by which an engine tells this rig from another one.
    """

    def __init__(self, rig: EngineRig) -> None:
        self.rig, self.number = rig, secrets.randbits(62) + 1
        self.sensors: np.ndarray | None = None
        self.engine = self.other = NOBODY
        self.asked: dict[int, float] = {}  # last samples of engines before; no more of one that has ended
        self.sample = self.alive = self.other_sample = -1
        self.unheard = self.stale = 0
        self.still = self.ahead = self.outputs = 0
        self.reply = b""

    def answer(self, data: bytes) -> bytes | None:
        """The reply; a refusal to an engine of another format; None for an end, what is old or changed."""
        if speaks_other(data):
            return refusal()
        body = unseal(data, "ASKED")
        outputs = (len(body) - REQUEST.size) // 8
        if outputs < 1:
            return None
        sample, alive, session = REQUEST.unpack_from(body)
        if sample < END or session == NOBODY:
            return None
        if sample == END:
            self.asked[session] = math.inf
            self.engine = NOBODY if session == self.engine else self.engine
            return None
        if session != self.engine:
            if not self._may_join(session, sample):
                self.stale += 1
                return None
            if self.engine != NOBODY:
                self.asked[self.engine] = self.sample
            self.engine, self.sample, self.alive, self.still = session, sample, -1, 0
            self.outputs, self.ahead, self.reply = outputs, 0, self._reply(sample)
        self.other, self.unheard = NOBODY, 0
        if not self.sample <= sample <= self.sample + LONGEST or outputs != self.outputs:
            return None
        if sample > self.sample:
            u = np.frombuffer(body, "<f8", outputs, REQUEST.size)
            self._follow(sample - self.sample, u if np.isfinite(u).all() else np.zeros(outputs), alive)
            self.sample, self.reply = sample, self._reply(sample)
        return self.reply

    def alone(self) -> None:
        """One sample without an engine, at outputs of zero, for a rig whose time goes on by itself."""
        if self.outputs:
            self._move(np.zeros(self.outputs))
            self.ahead += 1

    def end(self) -> None:
        """Outputs to zero, then let go."""
        if self.outputs:
            self._move(np.zeros(self.outputs))
        self.rig.close()

    def _may_join(self, session: int, sample: int) -> bool:
        """Whether this is no late copy, and nobody is followed or is relieved."""
        if sample <= self.asked.get(session, END):
            return False
        return self.engine == NOBODY or sample == 0 or self._silent(session, sample)

    def _silent(self, session: int, sample: int) -> bool:
        """Whether the followed engine is, while this other one asks for its samples; copies do not count."""
        if session != self.other:
            self.other, self.other_sample, self.unheard = session, -1, 0
        if sample > self.other_sample:
            self.other_sample, self.unheard = sample, self.unheard + 1
        return self.unheard >= SILENT

    def _follow(self, samples: int, u: np.ndarray, alive: int) -> None:
        if alive != self.alive:
            self.alive, self.still = alive, 0
        for _ in range(max(0, samples - self.ahead)):
            self._move(u if self.still < HOLD else np.zeros(self.outputs))
            self.still += 1
        self.ahead = 0

    def _move(self, u: np.ndarray) -> None:
        self.rig.write(u)
        self.sensors = self.rig.readings()

    def _reply(self, sample: int) -> bytes:
        if self.sensors is None:
            self.sensors = self.rig.readings()
        head = REPLY.pack(sample, self.engine, self.number, self.stale)
        return seal(head + np.ascontiguousarray(self.sensors, "<f8").tobytes(), "ANSWERED")


def seal(body: bytes, start: str) -> bytes:
    """The datagram: a check, begun with FORMAT and ``start`` ("ASKED" or "ANSWERED"), and ``body``."""
    return struct.pack("<Q", checksum(body, constants()["FORMAT"] << 32 | constants()[start])) + body


def refusal() -> bytes:
    """What a rig answers to an engine of another format, in every format: its own number."""
    body = struct.pack("<q", constants()["FORMAT"])
    return struct.pack("<Q", checksum(body, constants()["REFUSED_FORMAT"])) + body


def speaks_other(data: bytes) -> bool:
    """Whether ``data`` is the request of an engine of another format: by its check, or from before checks."""
    if len(data) % 8 or len(data) < HEAD.size + 8:
        return False
    first, second = HEAD.unpack_from(data)
    size = np.abs(np.frombuffer(data, "<f8", offset=HEAD.size))
    if END <= first < EARLY and 0 <= second < EARLY:
        return bool(np.all((size == 0.0) | ((size > SMALL) & (size < 1.0 / SMALL))))
    number, kind = divmod(start_of(data), 1 << 32)
    own = constants()
    return kind == own["ASKED"] and number != own["FORMAT"] and number < FORMATS and second < 1 << 32


def unseal(data: bytes, start: str) -> bytes:
    """What stands behind the check; nothing where it does not fit."""
    return data[8:] if len(data) % 8 == 0 and seal(data[8:], start) == data else b""
