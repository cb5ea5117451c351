"""An engine that another process has started."""

from __future__ import annotations

import contextlib
import os
import select
import signal
from pathlib import Path


class AdoptedEngine:
    """Looks after an engine by its number; like `subprocess.Popen` as far as a supervisor needs it.

    The number alone may have been given to another program since: what runs must have the shared file among
    its words.
    """

    stderr = None

    def __init__(self, pid: int, file: Path) -> None:
        self.pid, self.returncode = pid, None
        self._handle: int | None = None
        if pid > 0 and str(file.resolve()) in _words_of(pid):
            with contextlib.suppress(ProcessLookupError):
                self._handle = os.pidfd_open(pid)

    def poll(self) -> int | None:
        """None while it runs; then -1, as nobody but its parent is told its code."""
        if self._handle is not None and self._ended(0.0):
            os.close(self._handle)
            self._handle = None
        self.returncode = None if self._handle is not None else -1
        return self.returncode

    def wait(self, timeout: float | None = None) -> int | None:
        """Wait until it has ended; raises `TimeoutError`."""
        if self._handle is not None and not self._ended(timeout):
            raise TimeoutError(f"process {self.pid} still runs")
        return self.poll()

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)

    def send_signal(self, number: int) -> None:
        """Send a signal to it, and to no other program."""
        if self._handle is not None:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._handle, number)

    def _ended(self, timeout: float | None) -> bool:
        assert self._handle is not None
        poll = select.poll()
        poll.register(self._handle, select.POLLIN)
        return bool(poll.poll(None if timeout is None else 1e3 * timeout))


def is_alive(pid: int) -> bool:
    """Whether a process of this number runs, and is not only waiting to be buried."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (OSError, IndexError):
        return False
    return state not in "ZX"


def _words_of(pid: int) -> list[str]:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return []
