"""Ctrl-C and SIGTERM end a run alike, also where Python would swallow them."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from typing import Any

AGAIN_S = 0.05


def catch_interrupts() -> Callable[[], bool]:
    """Raise KeyboardInterrupt on SIGINT and SIGTERM; the answer tells whether that has happened.

    An exception that reaches Python inside a weak-reference callback or a destructor is dropped (imports are
    full of those); the interruption is then raised again a moment later.
    """
    seen: list[int] = []

    def interrupt(number: int, frame: Any) -> None:
        seen.append(number)
        raise KeyboardInterrupt

    def dropped(lost: Any) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            sys.__unraisablehook__(lost)
            return
        import threading

        timer = threading.Timer(AGAIN_S, signal.raise_signal, [signal.SIGINT])
        timer.daemon = True
        timer.start()

    signal.signal(signal.SIGINT, interrupt)
    signal.signal(signal.SIGTERM, interrupt)
    sys.unraisablehook = dropped
    return lambda: bool(seen)
