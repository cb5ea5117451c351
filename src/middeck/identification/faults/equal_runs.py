"""Runs of equal samples, and the levels of a converter."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float

from middeck.signals.fault import MOST_RUNS, RecordFault, Severity, Side
from middeck.signals.ports import Port
from middeck.values import record

Signal = Float[np.ndarray, " sample"]
Runs = list[tuple[int, int]]
Spans = Iterable[tuple[int, int]]
# A channel whose swing is within this share of its level is constant up to rounding.
ROUNDING = 1e-13
# The levels themselves are rounded, to 1e-7 of their size in single precision: finer steps are not reported.
FINEST = 1e-6


def runs_of(where: Bool[np.ndarray, " sample"]) -> Runs:
    """First and last + 1 of each run of true samples.

    >>> runs_of(np.array([True, False, True, True]))
    [(0, 1), (2, 4)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def equal_runs(x: Signal, least: int) -> Runs:
    """Runs of at least ``least`` samples of exactly one value.

    >>> equal_runs(np.array([1.0, 2.0, 2.0, 2.0, 1.0]), 3)
    [(1, 4)]
    """
    return [(a, b + 1) for a, b in runs_of(np.diff(x) == 0.0) if b + 1 - a >= least]


@record
class Levels:
    """Number of values of a signal, and the step of which they are whole multiples (0 if there is none)."""

    count: int
    step: float


def levels_of(x: Signal) -> Levels:
    """The levels of ``x``; a converter's are multiples of its step.

    >>> levels_of(np.round(np.sin(np.arange(500.0)), 2)).step
    0.01
    """
    levels = np.unique(x)
    if len(levels) < 4:
        return Levels(len(levels), 0.0)
    gaps = np.sort(np.diff(levels))
    finest = FINEST * np.abs(levels).max()
    gaps = gaps[gaps > finest][:200]
    # A level that is none, such as a limit, must not hide the step: the first few gaps may be it.
    for step in gaps[:5]:
        multiple = gaps / step
        # Values without a step agree so well in one of five hundred.
        if np.mean(np.abs(multiple - np.rint(multiple)) < 1e-3 + finest / step) > 0.9:
            return Levels(len(levels), float(f"{step:.6g}"))
    return Levels(len(levels), 0.0)


@record(kw_only=True)
class FaultDraft:
    """Kind, what, hint, severity and runs of samples of a `RecordFault`."""

    kind: str
    what: str
    hint: str
    severity: Severity = "serious"
    samples: tuple[tuple[int, int], ...] = ()

    def at(self, side: Side, port: Port, experiment: int | None = None) -> RecordFault:
        """The finding as a fault of a channel."""
        runs = self.samples[:MOST_RUNS]
        return RecordFault(
            kind=self.kind,
            severity=self.severity,
            side=side,
            channel=port.name,
            experiment=experiment,
            samples=runs,
            what=self.what,
            hint=self.hint,
        )


def fault(
    kind: str, what: str, hint: str, *, severity: Severity = "serious", samples: Spans = ()
) -> FaultDraft:
    """A finding of a channel, with the runs of samples where it shows."""
    return FaultDraft(kind=kind, what=what, hint=hint, severity=severity, samples=tuple(samples))
