"""``middeck doctor``: abilities of this machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from middeck.cli import options
from middeck.cli.shown.screen import ScreenTable, show
from middeck.errors import ConfigError

if TYPE_CHECKING:
    from middeck.realtime.engine.trials.timing import TimingReport

EXAMPLES = """\
  middeck doctor --realtime
  middeck doctor --realtime --rate 1000 --seconds 60 --states 120
"""


@click.command("doctor", cls=options.Verb, examples=EXAMPLES)
@click.option("--realtime", is_flag=True, help="Run the engine in real time and report its lateness.")
@options.defaulted("--rate", default=500.0, type=options.Real(1.0, 1e5), help="Samples a second.")
@options.defaulted("--seconds", default=10.0, type=options.Real(0.1, 86400.0), help="Time to run.")
@options.defaulted("--states", default=60, type=click.IntRange(0, 1024), help="States of a random law.")
@options.defaulted("--inputs", default=14, type=click.IntRange(1, 64), help="Inputs of that law.")
@options.defaulted("--outputs", default=5, type=click.IntRange(1, 64), help="Outputs of that law.")
@options.defaulted("--priority", default=80, type=click.IntRange(0, 99), help="FIFO priority; 0: none.")
@click.option("--processor", type=click.IntRange(min=0), default=None, help="Processor to stay on.")
@options.common
def verb(
    realtime: bool,
    rate: float,
    seconds: float,
    states: int,
    inputs: int,
    outputs: int,
    priority: int,
    processor: int | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Timing of the real-time engine on this machine.

    A random stable law runs in the engine in real time, then a bare loop as long: it only sleeps to each tick
    and reads as many numbers. The report gives lateness and the time of a step beside that loop's, samples
    delayed by more than a period, operations and bytes of a step, the granted priority, memory lock and
    processor, and the machine. It gives no verdict. --set takes no keys.
    """
    if not realtime:
        raise ConfigError("nothing to examine", hint="middeck doctor --realtime")
    if overrides:
        raise ConfigError(f"doctor takes no keys: {overrides[0]}", hint="its options")
    from middeck.realtime.engine.trials.timing import measure_timing

    report = measure_timing(
        rate_hz=rate,
        seconds=seconds,
        shape=(states, inputs, outputs),
        priority=priority or None,
        processor=processor,
    )
    document = {"schema": "middeck.doctor/1", "law": [states, inputs, outputs], "realtime": report}
    show(as_json, document, *_blocks(report))


def _blocks(report: TimingReport) -> list[str | ScreenTable]:
    late, step = (report.late_s, report.floor_late_s), (report.step_s, report.floor_step_s)
    rows = []
    for name, (found, floor) in (("late", late), ("step", step)):
        rows.append([name, *(f"{1e6 * value:.1f}" for value in found)])
        rows.append(["  bare loop", *(f"{1e6 * value:.1f}" for value in floor)])
        rows.append(["  times that", *(f"{a / max(b, 1e-9):.2f}" for a, b in zip(found, floor, strict=True))])
    granted = ", ".join(f"{name}: {_granted(given)}" for name, given in report.granted.items())
    rate = report.operations / max(report.step_s[0], 1e-9) / 1e9
    return [
        "machine      {processor}, {cores} cores, {kernel}, {preemption}".format(**report.machine),
        f"granted      {granted}",
        f"run          {report.samples} samples at {1.0 / report.period_s:g} Hz, "
        f"{report.overruns} later than a period"
        + (f"; tripped: {', '.join(report.trips)}" if report.trips else ""),
        f"law          {report.operations} operations, {report.bytes / 1000:.1f} kB of numbers; "
        f"{rate:.2f} Gflop/s with reading, writing and the engine's tests",
        ScreenTable("microseconds", ["", "50 %", "99 %", "99.9 %", "most"], rows),
    ]


def _granted(given: bool | None) -> str:
    return "not asked" if given is None else "yes" if given else "NO"
