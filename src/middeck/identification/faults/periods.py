"""Faults of periodic records: periods that are not steady, an input that does not repeat."""

from __future__ import annotations

import numpy as np

from middeck.identification.faults.found import Found
from middeck.identification.faults.runs import Signal

# First period less last one, over the rms of the signal, from which a transient is told; and how much of it
# must die out from the first to the last quarter of a period, or from the first two to the last two periods.
TRANSIENT, SERIOUS, DIES = 0.01, 0.1, 4.0
# Scatter of the input over its periods, as a share of their mean.
REPEATS = 0.5


def find_transient(x: Signal, period: int) -> list[Found]:
    """A first period that differs from the last by what decays."""
    rows = x.reshape(-1, period)
    if len(rows) < 2:
        return []
    rest = rows[0] - rows[-1]
    rest = rest - rest.mean()
    size = float(np.sqrt(np.mean(rest**2)) / x.std())
    if size <= TRANSIENT or not (_dies(rest) or _dies_over_periods(rows)):
        return []
    what = f"not steady: the first period differs from the last by {size:.1%} of the rms"
    hint = "leave the first period out, or wait longer before recording"
    return [
        Found(
            "transient", what, hint, severity="serious" if size > SERIOUS else "note", samples=((0, period),)
        )
    ]


def _dies(rest: Signal) -> bool:
    quarter = len(rest) // 4
    first, last = (float(np.sum(part**2)) for part in (rest[:quarter], rest[-quarter:]))
    return first > DIES * last


def _dies_over_periods(rows: np.ndarray) -> bool:
    if len(rows) < 4:
        return False
    change = np.sum((np.diff(rows, axis=0) - np.diff(rows, axis=0).mean(axis=1, keepdims=True)) ** 2, axis=1)
    return bool(change[0] > DIES * change[-1])


def find_unsteady_input(u: Signal, period: int) -> list[Found]:
    """An input that is said to repeat and does not."""
    rows = u.reshape(-1, period)
    if len(rows) < 2:
        return []
    mean = rows.mean(axis=0)
    scatter, size = float(np.sqrt(np.mean((rows - mean) ** 2))), float(mean.std())
    if scatter <= REPEATS * size:
        return []
    what = f"does not repeat: it scatters by {scatter / max(size, 1e-300):.0%} of its mean period"
    return [Found("repeat", what, "count the periods; record only steady ones", severity="unusable")]
