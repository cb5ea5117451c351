"""End what runs in circles, so that a test fails in place of waiting for ever."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def cpu_limit(seconds: float) -> Iterator[None]:
    """Fail after ``seconds`` of the process' own time: that a machine is busy does not count.

    What is raised is no `Exception`: no code under test takes it for an error of its own.
    """

    def stop(*_: object) -> None:
        pytest.fail(f"still running after {seconds:g} s of its own time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
