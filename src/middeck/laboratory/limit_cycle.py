"""Runs that only the motor's limit keeps finite: unstable ones."""

from __future__ import annotations

import numpy as np

from middeck.laboratory.rig.runs import Run

# A motor that is at its limit for more than this share of a run holds a loop that is unstable without it.
SATURATED = 1e-3


def limit_cycle(run: Run) -> str:
    """Message of a run that only the motor's limit kept finite; empty for a good one."""
    share = 0.0 if run.events is None else float(np.max(run.events.saturated))
    return f"unstable: the motor is at its limit in {share:.0%} of the run" if share > SATURATED else ""
