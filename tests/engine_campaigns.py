"""Seeded campaigns of the real-time computer: how much of each `make test` runs, a twentieth at least."""

from __future__ import annotations

from typing import NamedTuple

from repeats import LONG

TWENTIETH = 20
SEED = 1993


class Campaign(NamedTuple):
    """Cases of the whole, and those that `make test` runs."""

    whole: int
    quick: int


CAMPAIGNS = {
    "samples of a law beside its compensator": Campaign(100_000, 5000),
    "single precision within its bound: laws": Campaign(40, 2),
    "changed packages under their own hash, the engine's reader": Campaign(1_000_000, 50_000),
    "changed packages under their own hash, the reader in Python": Campaign(1_000_000, 50_000),
    "changed packages sealed again, the engine's reader": Campaign(1_000_000, 50_000),
    "changed packages sealed again, the reader in Python": Campaign(400_000, 20_000),
    "changed JSON twins under their own hash": Campaign(20_000, 1000),
    "changed JSON twins sealed again": Campaign(8000, 400),
    "changed shared files, an engine started on each": Campaign(3000, 150),
    "random packages at the gate, models of two modes": Campaign(1000, 50),
    "random packages at the gate, the study's articles": Campaign(1000, 50),
    "cross-fades that grow": Campaign(200, 10),
    "adaptive gains of random loops": Campaign(600, 30),
    "kinds of fault in every state": Campaign(62 * 7 * 25, 62 * 9),
    "kinds of fault, the engine built with sanitizers": Campaign(62 * 2, 7),
    "samples that cannot be, in every state": Campaign(3 * 6 * 25, 3 * 6 * 2),
    "STOP in every state": Campaign(7 * 25, 7 * 2),
    "engaging and disengaging": Campaign(2 * 25, 3),
    "normal operation: half minutes of 24 h": Campaign(2 * 24 * 60, 144),
    "waits in READY from rest: ten minutes of 24 h": Campaign(144, 8),
    "random packages past the gate": Campaign(1000, 50),
    "packages that only the truth destabilises, past the gate": Campaign(1000, 50),
    "kills of a supervisor, of its engine": Campaign(40, 2),
    "kills of a supervisor at any of its lines, in lockstep": Campaign(400, 20),
    "kills of a supervisor at any of its lines, in real time": Campaign(80, 4),
    "kills of a rig in a process of its own, in every state": Campaign(100, 5),
    "run files with a flipped bit": Campaign(2000, 100),
    "run files cut anywhere": Campaign(1000, 100),
    "run files of changed bytes": Campaign(100_000, 5000),
}


def cases_of(name: str) -> int:
    """How many cases of a campaign this run takes."""
    return CAMPAIGNS[name].whole if LONG else CAMPAIGNS[name].quick


def seeds_of(name: str) -> range:
    """As many seeds."""
    return range(SEED, SEED + cases_of(name))


def table() -> list[str]:
    """The rows of the requirements' page."""
    rows = ["| campaign | cases | in `make test` | share |", "| --- | --- | --- | --- |"]
    rows += [
        f"| {name} | {all_} | {quick} | 1/{all_ / quick:.3g} |" for name, (all_, quick) in CAMPAIGNS.items()
    ]
    return rows
