"""A rig behind UDP as Python drives it, where no compiler is at hand: ``source/rig_udp.c`` once more."""

from __future__ import annotations

import secrets
import socket

import numpy as np
from jaxtyping import Float

from middeck.errors import DataError
from middeck.realtime.engine.interface.checksum import start_of
from middeck.realtime.engine.interface.header import constants
from middeck.realtime.engine.process.launch import UdpRig
from middeck.realtime.engine.rigs.engine_rig import EngineRig
from middeck.realtime.engine.rigs.rig_server import LARGEST, LOOPBACK
from middeck.realtime.engine.rigs.udp_replies import END, REPLY, REQUEST, refusal, seal, unseal

TRIES, OTHERS = 20, 64
"""How often it asks, and datagrams that are no answer after which a try is over."""
SILENT = "the rig does not answer"
FOREIGN = "the rig speaks another format of datagrams"
UPDATE_IT = "the same release of middeck, or its rig_udp.c, on both sides"
START_IT = "start it first; its port, and how many sensors and outputs it has, must be the engine's"


class RigClient(EngineRig):
    """``rig`` in lockstep, sample by sample; `read` raises `DataError` where it does not answer."""

    def __init__(self, rig: UdpRig, outputs: int, *, answer_s: float = 10.0) -> None:
        self.sample, self.outputs, self.session = 0, outputs, secrets.randbits(62) + 1
        self.heard: int | None = None  # the rig that answered first
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect((LOOPBACK, rig.port))
        self.socket.settimeout(answer_s / TRIES)
        self.request = self._request(np.zeros(outputs))
        self.now: np.ndarray | None = None

    def read(self) -> Float[np.ndarray, " sensor"]:
        """The sensors at this sample."""
        for _ in range(TRIES if self.now is None else 0):
            try:
                self.socket.send(self.request)
                data = next(filter(self._answers, (self.socket.recv(LARGEST) for _ in range(OTHERS))), None)
            except (TimeoutError, ConnectionError):
                continue
            if data is not None:
                self.now = np.frombuffer(unseal(data, "ANSWERED"), "<f8", offset=REPLY.size)
                break
        if self.now is None:
            raise DataError(SILENT, where="UDP", hint=START_IT)
        return self.now

    def write(self, u: Float[np.ndarray, " output"]) -> None:
        """Outputs to the next sample."""
        self.sample += 1
        self.now, self.request = None, self._request(u)

    def close(self) -> None:
        """Tell the rig that this is the end."""
        self.sample = END
        self.socket.send(self._request(np.zeros(self.outputs)))
        self.socket.close()

    def _request(self, u: np.ndarray) -> bytes:
        head = REQUEST.pack(self.sample, self.sample, self.session)
        return seal(head + np.ascontiguousarray(u, "<f8").tobytes(), "ASKED")

    def _answers(self, data: bytes) -> bool:
        if self._is_foreign(data):
            raise DataError(FOREIGN, where="UDP", hint=UPDATE_IT)
        body = unseal(data, "ANSWERED")
        if len(body) <= REPLY.size:
            return False
        sample, session, rig, _ = REPLY.unpack_from(body)
        if self.heard is None and session == self.session:
            self.heard = rig
        return (sample, session, rig) == (self.sample, self.session, self.heard)

    def _is_foreign(self, data: bytes) -> bool:
        """A refusal of another format; or the first word of the request, from before there were checks."""
        if len(data) == len(refusal()) and start_of(data) == constants()["REFUSED_FORMAT"]:
            return data != refusal()
        return len(data) > 8 and data[:8] == self.request[:8] and data != self.request  # an echo is lost
