"""Lateness of this machine and cost of a step on it: a report, never a test."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from middeck.control.law.compensator import Compensator
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.engine.process.launch import run_bare_loop
from middeck.realtime.engine.process.supervisor import Supervisor
from middeck.realtime.engine.rigs.linear_article import LinearArticle
from middeck.realtime.engine.trials.durations import count_durations, no_durations, percentiles
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_law import package_law
from middeck.signals.ports import Port
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record

PERCENT = (50.0, 99.0, 99.9, 100.0)
PIECE, BARE_PIECE = 5000, 100_000
"""Samples of which all is known at a time; each piece of the bare loop is a process of its own."""
Timed = tuple[Int[np.ndarray, " sample"], Int[np.ndarray, " sample"]]


@record(kw_only=True)
class TimingReport:
    """Lateness and cost of a step, with the machine named.

    Attributes:
        machine: Processor, cores, kernel, and whether its kernel preempts for real time.
        granted: Whether the system gave FIFO priority, locked memory and a processor of its own; None for one
            that was not asked for.
        period_s, samples: Sampling period and number of samples of the run.
        late_s, step_s: At 50, 99, 99.9 and 100 percent of the samples, to 0.05 %; the last is exact.
        floor_late_s, floor_step_s: The same of ``bare_loop.c``, run after it: it sleeps to each tick, and its
            step only reads as many numbers as the law has, a multiplication and an addition for each.
        overruns: Samples later than a whole period.
        operations, bytes: Multiplications and additions of a step of the law, and the size of its numbers.
        trips: Kinds of trips during the run; none where all went well.
    """

    machine: dict[str, str]
    granted: dict[str, bool | None]
    period_s: float
    samples: int
    late_s: tuple[float, ...]
    step_s: tuple[float, ...]
    floor_late_s: tuple[float, ...]
    floor_step_s: tuple[float, ...]
    overruns: int
    operations: int
    bytes: int
    trips: tuple[str, ...]


def measure_timing(
    *,
    rate_hz: float = 500.0,
    seconds: float = 10.0,
    shape: tuple[int, int, int] = (60, 14, 5),
    priority: int | None = 80,
    processor: int | None = None,
) -> TimingReport:
    """Run a random stable law of ``shape`` (states, inputs, outputs) by the clock.

    Raises `ConfigError` for a shape that no package has, `NoCompilerError` without a compiler.
    """
    package = _random_package(np.random.default_rng(1), shape, 1.0 / rate_hz)
    settings = _settings(package, priority, processor)
    with Supervisor(settings, _still_article(package), real_time=True, admitted="ungated") as engine:
        engine.load(package)
        engine.reset()
        engine.command("engage", values=[1.0])
        found = summarise(_timed(engine, max(1, round(seconds * rate_hz))), 1.0 / rate_hz)
        granted = int(engine.file.status["real_time"])
        trips = tuple(event.kind for event in engine.events() if event.trips)
    count = _numbers(package)
    floor = summarise(_timed_bare(settings, found["samples"], count), 1.0 / rate_hz)
    return TimingReport(
        machine=name_machine(),
        granted={
            "FIFO priority": None if priority is None else bool(granted & 1),
            "locked memory": bool(granted & 2),
            "own processor": None if processor is None else bool(granted & 4),
        },
        **found,
        floor_late_s=floor["late_s"],
        floor_step_s=floor["step_s"],
        operations=2 * count,
        bytes=8 * count,
        trips=trips,
    )


def _timed(engine: Supervisor, samples: int) -> Iterator[Timed]:
    """Lateness and step of so many samples, a piece at a time."""
    while samples > 0:
        records = engine.run(min(PIECE, samples))
        samples -= len(records)
        yield records["late_ns"], records["step_ns"]


def _timed_bare(settings: EngineSettings, samples: int, numbers: int) -> Iterator[Timed]:
    for first in range(0, samples, BARE_PIECE):
        late, step = run_bare_loop(settings, min(BARE_PIECE, samples - first), numbers)
        yield late, step


def summarise(pieces: Iterable[Timed], period_s: float) -> dict[str, Any]:
    """The statistics of a `TimingReport`, of lateness and step [ns] piece by piece; none of them is kept.

    >>> found = summarise([(np.array([5, 2_000_000, 2_000_001]), np.array([7, 7, 7]))], 0.002)
    >>> found["overruns"], found["samples"]
    (1, 3)
    """
    late = step = no_durations()
    overruns = samples = 0
    for late_ns, step_ns in pieces:
        late, step = count_durations(late, late_ns), count_durations(step, step_ns)
        overruns += int(np.count_nonzero(late_ns > 1e9 * period_s))
        samples += len(late_ns)
    return {
        "period_s": period_s,
        "samples": samples,
        "late_s": tuple((1e-9 * percentiles(late, PERCENT)).tolist()),
        "step_s": tuple((1e-9 * percentiles(step, PERCENT)).tolist()),
        "overruns": overruns,
    }


def name_machine() -> dict[str, str]:
    """Processor, cores, kernel and its preemption."""
    found = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        found = next(
            (line.partition(":")[2].strip() for line in lines if line.startswith("model name")), found
        )
    except OSError:
        pass
    version = platform.version()
    return {
        "processor": found,
        "cores": str(os.cpu_count() or 1),
        "kernel": f"{platform.system()} {platform.release()}",
        "preemption": "PREEMPT_RT" if "PREEMPT_RT" in version else "not PREEMPT_RT",
    }


def _random_package(
    rng: np.random.Generator, shape: tuple[int, int, int], period_s: float
) -> ControllerPackage:
    states, inputs, outputs = shape
    A = np.zeros((states, states))
    for i in range(0, states - 1, 2):
        angle, radius = rng.uniform(0.02, 2.8), rng.uniform(0.9, 0.99)
        c, s = radius * np.cos(angle), radius * np.sin(angle)
        A[i : i + 2, i : i + 2] = [[c, s], [-s, c]]
    system = SampledStateSpace(
        A,
        rng.standard_normal((states, inputs)),
        1e-3 * rng.standard_normal((outputs, states)),
        np.zeros((outputs, inputs)),
        period_s=period_s,
    )
    y = tuple(Port(f"y{i}", "rad") for i in range(inputs))
    u = tuple(Port(f"u{i}", "N m") for i in range(outputs))
    return package_law(Compensator(system, y, u), "timing", input_range=1.0, limit=1.0)


def _settings(package: ControllerPackage, priority: int | None, processor: int | None) -> EngineSettings:
    """Settings without the tests that a stalled machine would trip: the run measures its lateness."""
    return EngineSettings(
        period_s=package.period_s,
        sensors=tuple(SensorTest(port=port, range=1e6) for port in package.inputs),
        drives=tuple(Drive(port=port, lower=-1.0, upper=1.0) for port in package.outputs),
        effort_s=0.0,
        heartbeat_s=0.0,
        late_s=3600.0,
        priority=priority,
        processor=processor,
    )


def _still_article(package: ControllerPackage) -> LinearArticle:
    inputs, outputs = len(package.inputs), len(package.outputs)
    return LinearArticle(
        A=np.zeros((1, 1)), B=np.zeros((1, outputs)), C=np.zeros((inputs, 1)), G=np.zeros((1, 0)),
        x=np.zeros(1), sensor_noise=np.full(inputs, 1e-3),
    )  # fmt: skip


def _numbers(package: ControllerPackage) -> int:
    """Coefficients that a step multiplies with."""
    core = package.core
    n = len(core.A)
    dynamics = n * n if core.pairs is None else n + 2 * core.pairs
    return dynamics + core.B.size + core.C.size + core.D.size
