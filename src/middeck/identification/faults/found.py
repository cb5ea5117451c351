"""A fault without its channel, as the detectors return it."""

from __future__ import annotations

from dataclasses import KW_ONLY

from middeck.signals.fault import MOST_RUNS, Fault, Severity, Side
from middeck.signals.ports import Port
from middeck.values import record


@record
class Found:
    """Kind, what, hint, severity and runs of samples of a `Fault`."""

    kind: str
    what: str
    hint: str
    _: KW_ONLY
    severity: Severity = "serious"
    samples: tuple[tuple[int, int], ...] = ()

    def at(self, side: Side, port: Port, experiment: int | None = None) -> Fault:
        """As a fault of a channel."""
        runs = self.samples[:MOST_RUNS]
        return Fault(self.kind, self.severity, side, port.name, experiment, runs, self.what, self.hint)
