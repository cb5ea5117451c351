"""Progress of a run of stages: a bar with the remaining time on a terminal, plain lines elsewhere."""

import sys
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager

import click

from middeck.cli.shown.screen import is_terminal

Begin = Callable[[str], None]
End = Callable[[str, float], None]
FEW_S, LONG_S = 10.0, 120.0


@contextmanager
def follow(shares: Mapping[str, float]) -> Generator[tuple[Begin, End]]:
    """Two functions to call when a stage begins and when it has ended after so many seconds, on stderr."""
    if is_terminal(sys.stderr):
        with _bar(shares) as functions:
            yield functions
    else:
        yield lambda name: None, lambda name, seconds: click.echo(f"{name}  {seconds:.1f} s", err=True)


@contextmanager
def status(verb: str) -> Generator[Callable[[str], None]]:
    """A function to call with the next step: a line with the seconds so far on a terminal, else nothing.

    For work whose stages are not known beforehand.
    """
    if not is_terminal(sys.stderr):
        yield lambda what: None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as line:
        task = line.add_task(verb)
        yield lambda what: line.update(task, description=f"{verb}: {what}")


def remaining_s(shares: Mapping[str, float], times: Mapping[str, float], now_s: float) -> float | None:
    """Remaining time, ``now_s`` into the stage after those in ``times``, if all run at the pace so far.

    A stage that takes longer than its share leaves those after it their own.

    >>> remaining_s({"a": 0.25, "b": 0.75}, {"a": 2.0}, 1.0)
    5.0
    >>> remaining_s({"a": 0.25, "b": 0.25, "c": 0.5}, {"a": 2.0}, 60.0)
    4.0
    """
    done = sum(shares[name] for name in times)
    if not done:
        return None
    pace = sum(times.values()) / done
    current, *later = [share for name, share in shares.items() if name not in times] or [0.0]
    return max(0.0, pace * current - now_s) + pace * sum(later)


def left_words(left_s: float | None) -> str:
    """The estimate in words; empty where there is none, or where the last stage has used it up.

    >>> [left_words(s) for s in (None, 0.0, 3.0, 41.0, 190.0)]
    ['', '', 'a few seconds left', 'about 40 s left', 'about 3 min left']
    """
    if not left_s:
        return ""
    if left_s < FEW_S:
        return "a few seconds left"
    return (
        f"about {10 * round(left_s / 10)} s left" if left_s < LONG_S else f"about {left_s / 60:.0f} min left"
    )


@contextmanager
def _bar(shares: Mapping[str, float]) -> Generator[tuple[Begin, End]]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
    from rich.text import Text

    times: dict[str, float] = {}
    since = [time.monotonic()]

    class Remaining(ProgressColumn):
        """The estimate of `remaining_s`, counting down between stages."""

        def render(self, task: Task) -> Text:
            """The remaining time in words."""
            return Text(left_words(remaining_s(shares, times, time.monotonic() - since[0])))

    columns = (
        BarColumn(),
        TextColumn("{task.percentage:.0f} %"),
        Remaining(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=sum(shares.values()))

        def begin(name: str) -> None:
            since[0] = time.monotonic()
            bar.update(task, description=name)

        def end(name: str, seconds: float) -> None:
            times[name] = seconds
            bar.advance(task, shares[name])
            bar.console.print(f"{name}  {seconds:.1f} s", highlight=False)

        yield begin, end
