"""The process that serves a rig over UDP: it imports little, and ends with the process that started it."""

import os
import pickle
import signal
import socket
import sys
from collections.abc import Callable
from typing import NoReturn

from middeck.realtime.engine.rigs.engine_rig import EngineRig
from middeck.realtime.engine.rigs.udp_replies import HOLD, RigSession

LOOPBACK = socket.inet_ntoa(socket.INADDR_LOOPBACK.to_bytes(4, "big"))
LARGEST = 1 << 16
LOOK_S = 0.5
"""How often a rig without a clock looks whether the process that started it still lives."""


def run_child(handle: int) -> None:
    """Serve the inherited socket in the process of a `ServedRig`."""
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
    reply = session.answer(data)
    if reply is not None:
        opened.sendto(reply, sender)
    return True


def _leave(*_: object) -> NoReturn:
    raise SystemExit(0)
