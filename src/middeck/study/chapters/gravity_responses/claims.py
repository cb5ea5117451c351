"""Figure 6: what the phase and the magnitude of a measured response say of the models."""

from __future__ import annotations

import numpy as np

from middeck.study.chapters.gravity_responses.computation import GravityResponses
from middeck.study.claim import Claim, below


def figure_6_claims(responses: GravityResponses) -> list[Claim]:
    """Delay explains the phase; gravity and suspension bring the model to the data."""
    gap = responses.phase_gap_s
    largest = None if gap is None else 1e3 * float(np.max(np.abs(gap - responses.delay_s)))
    error = responses.magnitude_error
    names = [port.name for port in responses.rig.outputs]
    rows = [
        below("phase gap above 5 Hz equals the delay within 0.2 ms; largest gap [ms]", largest, 0.2, "ms")
    ]
    for k, name in enumerate(names):
        where = "where both are measured" if error is None else "in {:g}-{:g} Hz".format(*error.band_hz)
        ratio = None if error is None else float(error.lab_db[k] / error.orbit_db[k])
        text = f"{name}: the 1-g model's log-magnitude error {where} is below the 0-g one's; ratio"
        rows.append(below(text, ratio, 1.0, ""))
    return rows
