"""One row of the claims, and what several figures judge alike."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypedDict

from middeck.study.measured_loop import SEEN_DB, MeasuredLoop

RMS_DB, LINE_DB = 1.0, 3.0  # how closely a measured loop is to be predicted, in rms and line by line


class Claim(TypedDict):
    """One row: ``number`` and ``asked`` are in one ``unit`` and have one sign.

    A number of decibels is a change: negative is less.
    """

    claim: str
    holds: bool
    number: float | str | None
    asked: str
    unit: str


def row(claim: str, holds: bool, number: float | str | None, asked: str, unit: str = "") -> Claim:
    """A claim with its verdict, its number and what that is asked to be."""
    return {"claim": claim, "holds": bool(holds), "number": number, "asked": asked, "unit": unit}


def at_most(claim: str, number: float | None, most: float, unit: str = "dB") -> Claim:
    """It holds where there is a number that is no larger than ``most``."""
    return row(claim, number is not None and number <= most, number, f"\u2264 {most:g}", unit)


def largest(values: Iterable[float | None]) -> float | None:
    """The largest of some numbers; None where one is missing or there are none."""
    given = list(values)
    known = [value for value in given if value is not None]
    return max(known) if known and len(known) == len(given) else None


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
