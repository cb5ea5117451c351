"""Random packages past the gate that destabilise slowly, one by one, with what stopped each.

The cases are those of "guards"; only those with a growth time of 10 s and more run. The list is a table of
its own, `results/slow_packages.csv`: a row of the benchmark says how many it has.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from engine_destabilising import SLOW_S, draw, judge
from measured.kept import kept
from measured.rows import row
from middeck.campaign.cases import Case
from packaged.guards import RIGS, WHOLE

CASE = "slow"
LISTED = Path(__file__).resolve().parents[1] / "results" / "slow_packages.csv"
LONGEST = 1 << 20
"""Samples for which one is watched, if twenty growth times are no fewer: 35 minutes."""
FIELDS = (
    "number", "article", "environment", "kind", "growth_time_s", "stopped_by",
    "after_full_authority_s", "angle_over_envelope", "torque_over_limit",
)  # fmt: skip


def rows(options: Any) -> list[dict]:
    every = [one for one in kept(slow_random, WHOLE, options) if one]
    with LISTED.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, FIELDS, lineterminator="\n")
        table.writeheader()
        table.writerows(every)
    return [_counted(every)]


def slow_random(case: Case, _: Any) -> dict[str, Any]:
    return slow_one(case.index)


def slow_one(number: int) -> dict[str, Any]:
    """What came of package ``number``; empty where it grows faster."""
    rig = RIGS[number % len(RIGS)]
    found = draw(number, *rig)
    if found.rate >= 1.0 / SLOW_S:
        return {}
    came = judge(found, *rig, longest=LONGEST)
    return {
        "number": number, "article": rig[0], "environment": rig[1], "kind": came.kind,
        "growth_time_s": f"{1.0 / came.rate:.3g}", "stopped_by": came.trip or "nothing",
        "after_full_authority_s": f"{came.after_s:.3f}" if came.trip else "",
        "angle_over_envelope": f"{came.peak:.3f}", "torque_over_limit": f"{came.torque:.3f}",
    }  # fmt: skip


def _counted(found: list[dict[str, Any]]) -> dict:
    through = [one for one in found if not one["after_full_authority_s"]]
    angle = max(float(one["angle_over_envelope"]) for one in through) if through else 0.0
    measure = f"random packages with a growth time of {SLOW_S:g} s and more, without a trip in twenty of them"
    note = f"of {len(found)}, each with what stopped it: benchmarks/results/slow_packages.csv"
    if through:
        note += f"; without a trip angles stay below {angle:.2f} of their envelope"
    return row(CASE, measure, "", len(through), note=note)
