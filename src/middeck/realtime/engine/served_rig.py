"""A rig in a process of its own, behind UDP on the loopback interface: hardware in the loop."""

from __future__ import annotations

import os
import pickle
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from types import TracebackType
from typing import NoReturn

from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.rig import EngineRig
from middeck.realtime.engine.rig_session import HOLD, RigSession
from middeck.realtime.engine.supervisor import UdpRig

LOOPBACK = socket.inet_ntoa(socket.INADDR_LOOPBACK.to_bytes(4, "big"))
LARGEST = 1 << 16
LOOK_S = 0.5
"""How often a rig without a clock looks whether the process that started it still lives."""


class ServedRig:
    """``rig`` in a process of its own; a context manager that gives the `UdpRig` for an engine.

    Its time is the engine's sample number: in lockstep a run is reproducible to the bit for a seed, whatever
    is lost or doubled on the way. With ``period_s`` its time goes on by itself where no request comes for two
    periods, with outputs of zero. The process ends with this context, and with the process that started it;
    engines may follow each other.

    Raises `ConfigError` for a rig that does not go through pickle.
    """

    def __init__(self, rig: EngineRig, *, period_s: float | None = None) -> None:
        try:
            self.given = pickle.dumps(rig), period_s
        except (pickle.PicklingError, TypeError, AttributeError) as error:
            raise ConfigError(
                f"the rig cannot go to another process: {error}",
                where="ServedRig",
                hint="a class of a module, given before its first read",
            ) from None
        self.process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> UdpRig:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
            opened.bind((LOOPBACK, 0))
            port, handle = opened.getsockname()[1], opened.fileno()
            self.process = subprocess.Popen(
                [sys.executable, "-c", f"from {__name__} import run_child; run_child({handle})"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                pass_fds=[handle],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(pickle.dumps(self.given))
        self.process.stdin.close()
        if self.process.stdout.read(1) != b"r":
            self.__exit__(None, None, None)
            raise DataError(
                "the rig's process has ended before it served", where="ServedRig", hint="what it said"
            )
        return UdpRig(port)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.process is not None:
            self.process.terminate()
            self.process.wait()
            assert self.process.stdout is not None
            self.process.stdout.close()

    def kill(self) -> None:
        """End its process at once, as a failure would."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()


def run_child(handle: int) -> None:
    """What the process of a `ServedRig` does with the socket that it inherits."""
    parent = os.getppid()
    signal.signal(signal.SIGTERM, _leave)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal: the process that started it decides
    given, period_s = pickle.load(sys.stdin.buffer)
    rig = pickle.loads(given)
    with socket.socket(fileno=handle) as opened:
        sys.stdout.write("r")
        sys.stdout.flush()
        serve_rig(rig, opened, period_s=period_s, lives=lambda: os.getppid() == parent)


def serve_rig(
    rig: EngineRig,
    opened: socket.socket,
    *,
    period_s: float | None = None,
    lives: Callable[[], bool] = lambda: True,
) -> None:
    """Answer engines on the socket ``opened`` while ``lives()``; at the end outputs go to zero."""
    session, waits = RigSession(rig), True
    try:
        while lives():
            opened.settimeout(LOOK_S if period_s is None else HOLD * period_s if waits else period_s)
            waits = _serve_one(session, opened)
            if not waits and period_s is not None:
                session.alone()
    finally:
        session.end()


def _serve_one(session: RigSession, opened: socket.socket) -> bool:
    """Whether a request came before the time was out."""
    try:
        data, sender = opened.recvfrom(LARGEST)
    except TimeoutError:
        return False
    except ConnectionError:  # an engine has gone: its port tells
        return True
    reply = session.answer(data, sender)
    if reply is not None:
        opened.sendto(reply, sender)
    return True


def _leave(*_: object) -> NoReturn:
    raise SystemExit(0)
