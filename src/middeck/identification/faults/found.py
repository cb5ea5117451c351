"""A fault before it is known in which channel it was found."""

from __future__ import annotations

from collections.abc import Sequence

from middeck.signals.fault import MOST_RUNS, Fault, Severity, Side
from middeck.values import record


@record
class Found:
    """Kind, severity, runs of samples, what and hint of a `Fault`."""

    kind: str
    severity: Severity
    samples: tuple[tuple[int, int], ...]
    what: str
    hint: str


def placed(found: Sequence[Found], side: Side, channel: str, experiment: int | None) -> list[Fault]:
    """As faults of a channel."""
    return [
        Fault(f.kind, f.severity, side, channel, experiment, f.samples[:MOST_RUNS], f.what, f.hint)
        for f in found
    ]
