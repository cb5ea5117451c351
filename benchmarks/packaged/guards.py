"""What the engine guards against: faults, packages that destabilise, hours without a false trip.

The cases and their judgement are those of the tests (`make test-all`); here they are counted,
which takes about two hours.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from engine_destabilising import SLOW_S, Outcome, draw, judge
from engine_faults import ARTICLE, KINDS, STATES, play
from engine_rigs import end_of_normal_operation, engaging_step
from measured.kept import kept
from measured.rows import row
from middeck.campaign.cases import Case

CASE, WHOLE, SEEDS, HOURS = "guards", 1000, 25, 24
HALF_AN_HOUR_S = 1800.0
RIGS = (("dm", "lab"), ("simple", "lab"), ("simple", "orbit"), ("dm", "orbit"))


def rows(options: Any) -> list[dict]:
    halves = 2 * HOURS
    return [
        *fault_rows(kept(fault_ending, len(KINDS) * len(STATES) * SEEDS, options)),
        *destabilised_rows([Outcome(**one) for one in kept(random_outcome, WHOLE, options)]),
        *(normal_row(article, kept(trips, halves, options)) for article, trips in NORMAL.items()),
        engaging_row(kept(step_of, SEEDS, options)),
    ]


def fault_ending(case: Case, _: Any) -> tuple[str, str, str]:
    """Kind, state and complaint of one run."""
    seed, rest = divmod(case.index, len(KINDS) * len(STATES))
    kind, state = KINDS[rest // len(STATES)], STATES[rest % len(STATES)]
    return kind, state, play(kind, state, seed).why


def random_outcome(case: Case, _: Any) -> dict[str, Any]:
    rig = RIGS[case.index % 4]
    return dataclasses.asdict(judge(draw(case.index, *rig), *rig))


def fault_rows(endings: Sequence[tuple[str, str, str]]) -> list[dict]:
    """From kind, state and complaint of each run."""
    wrong = [ending for ending in endings if ending[2]]
    runs = f"of {len(endings)} runs: {len(KINDS)} kinds, {len(STATES)} states, {SEEDS} seeds"
    return [
        row(CASE, "faults that end neither in SAFE nor in correct completion", "", len(wrong), 0.0, note=runs)
    ]


def destabilised_rows(outcomes: Sequence[Outcome]) -> list[dict]:
    fast = [o for o in outcomes if o.rate >= 1.0 / SLOW_S]
    slow = [o for o in outcomes if o.rate < 1.0 / SLOW_S]
    late = [o for o in fast if not (o.trip and o.after_s <= o.allowed_s)]
    return [
        row(CASE, "packages that destabilise, random, past the gate: late trips", "", len(late), 0.0,
            note=f"of {len(fast)} with a growth time below {SLOW_S:g} s: {_counted(fast)}"),
        row(CASE, "packages that destabilise, random, past the gate: slower, without a trip", "",
            sum(not o.trip for o in slow),
            note=f"of {len(slow)}, watched for 120 s at most: {_counted(slow)}"),
        row(CASE, "packages that destabilise, random, past the gate: largest angle over its envelope", "",
            max(o.peak for o in outcomes), 2.0, note=f"median {np.median([o.peak for o in outcomes]):.2f}"),
        row(CASE, "packages that destabilise, random, past the gate: largest torque over its limit", "",
            max(o.torque for o in outcomes), 1.0),
    ]  # fmt: skip


def _counted(outcomes: Sequence[Outcome]) -> str:
    return ", ".join(
        f"{kind or 'none'} {count}" for kind, count in Counter(o.trip for o in outcomes).most_common()
    )


def one_axis_trips(case: Case, _: Any) -> bool:
    return end_of_normal_operation(case.index, "dm", HALF_AN_HOUR_S)[0] != "control"


def five_motor_trips(case: Case, _: Any) -> bool:
    return end_of_normal_operation(case.index, "simple", HALF_AN_HOUR_S)[0] != "control"


NORMAL = {"one axis": one_axis_trips, "five motors": five_motor_trips}


def normal_row(article: str, trips: Sequence[bool]) -> dict:
    return row(
        CASE, f"{article}: false trips in {len(trips) / 2:g} simulated hours", "", sum(trips), 0.0,
        note="a seed for each half hour, under control",
    )  # fmt: skip


def step_of(case: Case, _: Any) -> float:
    return engaging_step(case.index, *ARTICLE)


def engaging_row(steps: Sequence[float]) -> dict:
    return row(
        CASE,
        "engaging and disengaging: the most that the fade adds to a step, over the limit",
        "",
        max(steps),
        0.01,
    )
