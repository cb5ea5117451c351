"""A fault before it is known in which channel it was found."""

from __future__ import annotations

from middeck.signals.fault import MOST_RUNS, Fault, Severity, Side
from middeck.signals.ports import Port
from middeck.values import record


@record
class Found:
    """Kind, severity, runs of samples, what and hint of a `Fault`."""

    kind: str
    severity: Severity
    samples: tuple[tuple[int, int], ...]
    what: str
    hint: str

    def at(self, side: Side, port: Port, experiment: int | None = None) -> Fault:
        """As a fault of a channel."""
        runs = self.samples[:MOST_RUNS]
        return Fault(self.kind, self.severity, side, port.name, experiment, runs, self.what, self.hint)
