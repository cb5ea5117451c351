"""A process that supervises an engine until it is killed, at some instant or at one of its lines."""

from __future__ import annotations

import functools
import mmap
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from engine_cases import (
    OUTPUTS,
    SENSORS,
    plain_settings,
    random_article,
    random_package,
    static_package,
    still_article,
)
from middeck.realtime.package.filter_sections import LoopPath, static_gain
from middeck.realtime.package.package import ControllerPackage
from ungated import Supervisor

TOLD = np.dtype([("recorded", "<i8"), ("synced", "<i8"), ("round", "<i8"), ("lines", "<i8")])
"""What the process has told: whether it records, the last sample on the disk, its rounds, its lines."""
OWN = f"{os.sep}realtime{os.sep}engine{os.sep}"
STANDS, HELD, MOVED = 0.5, -0.2, 0.15
"""Where the sensors of the held article stand, what the hold makes of it, and what the law adds."""


def settings(real_time: bool):
    """With a heartbeat; in real time without a test of lateness, which belongs to the machine."""
    late = {"late_s": 1e3, "heartbeat_s": 0.4} if real_time else {"heartbeat_s": 0.2}
    return plain_settings(**late)


@functools.cache
def held_settings(real_time: bool):
    """And with a hold at each output, verified within half a second."""
    hold = tuple(LoopPath(k, k, static_gain(HELD / STANDS)) for k in range(OUTPUTS))
    late = {"late_s": 1e3, "heartbeat_s": 0.3} if real_time else {"heartbeat_s": 0.2}
    return plain_settings(hold=hold, verify_s=0.1, ramp_s=0.2, safe_ramp_s=0.1, **late)


def supervise(folder: Path, real_time: bool, told: np.ndarray) -> None:
    """Until it is killed; a law of chance on a moving article."""
    with Supervisor(settings(real_time), random_article(), real_time=real_time, folder=folder) as engine:
        engine.load(random_package())
        engine.reset()
        recorder = engine.record(folder / "loop.mdr")
        engine.command("engage", values=[1.0])
        while True:
            told["round"] += 1
            engine.run(25 if real_time else 200)
            told["synced"] = recorder.synced


@functools.cache
def constant_law() -> ControllerPackage:
    """What it gives where the held article stands is MOVED."""
    return static_package(np.full((OUTPUTS, SENSORS), MOVED / (SENSORS * STANDS)))


def supervise_held(folder: Path, real_time: bool, told: np.ndarray) -> None:
    """Until it is killed: a hold is verified, a law engages, disengages, engages ... beside it."""
    article = still_article(np.full(SENSORS, STANDS))
    with Supervisor(held_settings(real_time), article, real_time=real_time, folder=folder) as engine:
        recorder = engine.record(folder / "loop.mdr")
        told["recorded"] = 1
        engine.load(constant_law())
        engine.reset()
        while True:
            engine.run(25)
            told["round"] += 1
            told["synced"] = recorder.synced
            if told["round"] % 20 == 10:
                engine.command("engage", values=[1.0])
            elif told["round"] % 20 == 0:
                engine.command("disengage")


class Forked:
    """A process that does ``act`` until it is killed, and what it has told; a context manager."""

    def __init__(self, act: Callable[[np.ndarray], Any]) -> None:
        self.told = np.frombuffer(mmap.mmap(-1, TOLD.itemsize), TOLD)[0]
        self.waited = False
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # threads of this process do nothing that the other one needs
            self.pid = os.fork()
        if self.pid == 0:
            try:
                act(self.told)
            finally:
                os._exit(3)

    def wait(self) -> None:
        """Until it has been killed."""
        assert os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1]) == -signal.SIGKILL
        self.waited = True

    def kill(self) -> None:
        """Now."""
        os.kill(self.pid, signal.SIGKILL)
        self.wait()

    def __enter__(self) -> Forked:
        return self

    def __exit__(self, *_: object) -> None:
        if not self.waited:
            self.kill()


def kill_at_line(told: np.ndarray, line: int) -> None:
    """From now on this process executes so many lines of the engine's modules, all threads together."""

    def count(frame: FrameType, event: str, given: object) -> Any:
        if OWN not in frame.f_code.co_filename:
            return None
        if event == "line":
            told["lines"] += 1
            if told["lines"] >= line:
                os.kill(os.getpid(), signal.SIGKILL)
        return count

    threading.settrace(count)
    sys.settrace(count)
