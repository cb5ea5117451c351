"""An engine that another process has started."""

import contextlib
import os
import select
import signal
from pathlib import Path

from middeck.realtime.engine.interface.shared_file import SharedFile

START_TIME = 18
"""Its place among the fields of /proc/PID/stat after name and state."""


class AdoptedEngine:
    """Looks after the engine of a shared file; like `subprocess.Popen` as far as a supervisor needs it.

    Its number alone may have been given to another program since: what runs must also have begun when the
    engine did, and must have the shared file among its words.
    """

    stderr = None

    def __init__(self, file: SharedFile) -> None:
        self.pid, self.returncode = int(file.status["pid"]), None
        self._handle: int | None = None
        if self.pid <= 0:
            return
        with contextlib.suppress(OSError):
            self._handle = os.pidfd_open(self.pid)
        if self._handle is not None and not runs_engine(self.pid, int(file.status["born"]), file.path):
            os.close(self._handle)
            self._handle = None

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


def runs_engine(pid: int, born: int, path: Path) -> bool:
    """Whether the process of this number, that began when it says, runs the engine of the shared file."""
    return pid > 0 and when_born(pid) == born > 0 and str(path.resolve()) in _words_of(pid)


def when_born(pid: int) -> int:
    """When the process of this number began, in ticks of the system; 0 where none runs.

    One that has ended and only waits to be buried does not run.
    """
    try:
        state, *fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (OSError, ValueError):
        return 0
    return 0 if state in "ZX" else int(fields[START_TIME])


def _words_of(pid: int) -> list[str]:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return []
