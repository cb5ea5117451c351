"""An engine in real time whose clock goes as a test lets it: deadlines are known, nothing is waited for."""

from __future__ import annotations

import contextlib
import functools
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from middeck.realtime.generate.compiler import compile_once
from ungated import Supervisor

DEADLINES = 4096
COUNTS = ("granted", "sleeps", "now", "day", "late", "slow")
WORDS = np.dtype([*((name, "<i8") for name in COUNTS), ("deadline", "<i8", DEADLINES)])
EVER = 1 << 62
AT_ONCE = 500
"""Samples between two looks and beats of the supervisor."""


@functools.cache
def library() -> Path:
    """The preloaded clock, compiled once for each state of its source."""
    source = Path(__file__).with_name("faked_clock.c")
    return compile_once("faked_clock", {source.name: source.read_text()}, flags=("-shared", "-fPIC"))


class FakedClock:
    """What the engine's clock shows and has been asked for: the words of faked_clock.c."""

    def __init__(self, path: Path) -> None:
        self.words = np.memmap(path, WORDS, "r+", shape=())

    def __getitem__(self, name: str) -> int:
        return int(self.words[name])

    def __setitem__(self, name: str, value: int) -> None:
        self.words[name] = value

    def waits(self) -> bool:
        """Whether the engine sleeps to a deadline that is not granted: its last sample is whole."""
        return self["sleeps"] > self["granted"]

    def deadlines(self, first: int, last: int) -> np.ndarray:
        """Of the sleeps from number ``first`` to ``last`` [ns]."""
        return self.words["deadline"][np.arange(first, last + 1) % DEADLINES].copy()


@contextlib.contextmanager
def faked_clock() -> Iterator[FakedClock]:
    """Engines that are started within have this clock."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clock"
        words = np.zeros((), WORDS)
        words["now"] = 1_000_000_000_000
        path.write_bytes(words.tobytes())
        with mock.patch.dict(os.environ, {"LD_PRELOAD": str(library()), "FAKED_CLOCK": str(path)}):
            yield FakedClock(path)


class SupervisorByFakedClock(Supervisor):
    """It lets the engine's clock go on where others wait: as far as it runs, else sample by sample."""

    def __init__(self, *args: Any, clock: FakedClock, **options: Any) -> None:
        self.clock = clock
        super().__init__(*args, real_time=True, **options)

    def _beat_by_the_clock(self) -> None:
        super()._beat_by_the_clock()
        if self.clock.waits():
            self.clock["granted"] = self.clock["sleeps"]

    def _wait(self, reached: Callable[[], object]) -> None:
        super()._wait(reached)
        self._until_it_waits()  # else a sample that is under way would be one more than is counted

    def _follow(self, until: int, beats: bool, keep: bool) -> np.ndarray:
        taken = [self.file.ring[:0].copy()]
        while self.sample < until:
            if beats:
                self.beat()
            self._until_it_waits()
            self.clock["granted"] += min(AT_ONCE, until - self.sample)
            self._until_it_waits()
            taken.append(self.read() if keep else self._skip())
        return np.concatenate(taken)

    def _until_it_waits(self) -> None:
        while not self.clock.waits():
            self._require_alive()
            time.sleep(5e-5)

    def _wait_for_end(self, patience_s: float) -> None:
        self.clock["granted"] = EVER
        super()._wait_for_end(patience_s)
