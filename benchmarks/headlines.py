"""The twelve comparisons that open docs/benchmarks.md: ours beside the best peer of the same run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

RESULTS = Path(__file__).parent / "results"
# (result file, case, measure): what it is, in a newcomer's words. Each is better where it is smaller.
CHOSEN = {
    ("structure", "suspended bus, 102 degrees of freedom",
     "largest error of 15 frequencies, to the limit of the mesh"):
        "frequencies of a hung flexible bus, 17 nodes: largest relative error",
    ("structure", "suspended bus, 102 degrees of freedom", "rest state and 40 modes"):
        "the same bus: rest state and 40 modes, time",
    ("structure", "suspended boom, 104886 degrees of freedom", "rest state and 40 modes"):
        "hung lattice boom, 104,886 degrees of freedom: rest state and 40 modes, time",
    ("identification", "gimbal multisine", "relative complex error, median of 50"):
        "response fitted to noisy data of a simulated gimbal: relative error",
    ("identification", "mirror 300 mV beside nfoursid", "NRMSE of output 1"):
        "measured mirror, held-out record: simulation error (peer: one experiment of six)",
    ("identification", "mirror 300 mV beside vector fitting", "time of the fit, median of 3"):
        "the same mirror: time of the fit",
    ("identification", "arms robot", "NRMSE"):
        "measured robot arm, held-out half: simulation error",
    ("identification", "arms CD player", "NRMSE of output 2"):
        "measured arm of a CD player, held-out half: simulation error",
    ("control", "response", "10,000 lines, full matrices"):
        "frequency response, 270 states, 10,000 frequencies: time",
    ("control", "riccati modal", "500 states"):
        "Riccati equation of 500 states: time",
    ("control", "riccati modal", "residual"):
        "the same equation: relative residual",
    ("control", "simulation", "million closed-loop samples"):
        "a million samples of a closed loop: time",
}  # fmt: skip


class Headline(NamedTuple):
    """One comparison; ``unit`` is empty for a relative error."""

    what: str
    ours: float
    unit: str
    peer: str
    theirs: float

    @property
    def ratio(self) -> float:
        """Ours over theirs: below one, middeck is better."""
        return self.ours / self.theirs


def headlines() -> list[Headline]:
    """The comparisons of `CHOSEN`, in its order; KeyError for one that the results lack."""
    rows = {
        (path.stem, row["case"], row["measure"]): row
        for path in RESULTS.glob("*.json")
        for row in json.loads(path.read_text())["rows"]
    }
    found = []
    for key, what in CHOSEN.items():
        row = rows[key]
        peer, theirs = min(((n, p["value"]) for n, p in row["peers"].items()), key=lambda p: p[1])
        found.append(
            Headline(
                what, row["value"], row["unit"].replace("CPU ", "").replace("relative", ""), peer, theirs
            )
        )
    return found
