"""Comparison of sampled designs as a table of text."""

from __future__ import annotations

import numpy as np

from middeck.control.analysis.margins_table import align_columns
from middeck.control.sampled.comparison import SamplingComparison, SamplingRow

HEAD = ("rate Hz", "method", "dB", "control rms", "gain dB", "phase deg", "disk")


def sampling_table(comparison: SamplingComparison) -> str:
    """One row for each law and rate: metric relative to no control, control rms, smallest margins.

    Decibels are negative for an improvement. ``-``: the plant alone has no metric, or no gain or
    phase breaks the loop.
    """
    return align_columns([HEAD, *(_cells(row, comparison.open_metric) for row in comparison.rows)])


def _cells(row: SamplingRow, open_metric: float) -> tuple[str, ...]:
    if row.margins is None:
        return (f"{row.rate_hz:g}", row.method, "unstable", *("",) * 4)
    loops = row.margins.loops
    return (
        f"{row.rate_hz:g}",
        row.method,
        _finite(20.0 * float(np.log10(row.outcome.metric) - np.log10(open_metric))),
        f"{np.linalg.norm(row.outcome.control_rms):.3g}",
        _finite(min(loop.gain_db for loop in loops)),
        _finite(np.degrees(min(loop.phase_limit_rad for loop in loops))),
        f"{min(loop.disk.alpha for loop in loops):.3f}",
    )


def _finite(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "-"
