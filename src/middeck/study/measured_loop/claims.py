"""Whether loops are measured as they were predicted."""

from __future__ import annotations

from collections.abc import Iterable

from middeck.study.claim import Claim, at_most, largest
from middeck.study.measured_loop.computation import SEEN_DB, MeasuredLoop

RMS_DB, LINE_DB = 1.0, 3.0  # how closely a measured loop is to be predicted, in rms and line by line


def prediction_claims(loops: Iterable[MeasuredLoop], which: str) -> list[Claim]:
    """Whether each loop is measured as it was predicted."""
    loops = tuple(loops)
    rms = largest(None if loop.rms_error_db is None else abs(loop.rms_error_db) for loop in loops)
    line = largest(loop.worst_error_db for loop in loops)
    seen = f"within {LINE_DB:g} dB wherever the open loop is within {SEEN_DB:g} dB of its peak"
    return [
        at_most(
            f"{which}: predicted and measured rms agree within {RMS_DB:g} dB; difference [dB]", rms, RMS_DB
        ),
        at_most(f"{which}: and line by line {seen}; largest [dB]", line, LINE_DB),
    ]
