"""A rig behind UDP on a thread of this process, where a process of its own is not the point."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator

from middeck.realtime.engine.process.launch import UdpRig
from middeck.realtime.engine.rigs.engine_rig import EngineRig
from middeck.realtime.engine.rigs.rig_server import LOOPBACK, serve_rig


@contextlib.contextmanager
def served_by_thread(rig: EngineRig, **more: float) -> Iterator[UdpRig]:
    done = threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind((LOOPBACK, 0))
        given = {"lives": lambda: not done.is_set(), **more}
        thread = threading.Thread(target=serve_rig, args=(rig, opened), kwargs=given)
        thread.start()
        try:
            yield UdpRig(opened.getsockname()[1])
        finally:
            done.set()
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as waker:
                waker.sendto(b"", opened.getsockname())
            thread.join()
