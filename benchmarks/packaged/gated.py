"""What the gate stops of packages that destabilise, step by step, and what trips of the rest.

The cases are those of "guards"; margins at eleven fades take seconds each, and all of it about two hours.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from engine_destabilising import Destabiliser, draw, judge, own_limits, refused_on_paper
from engine_rigs import pack, rig_case, settings_of
from measured.kept import kept
from measured.rows import row
from middeck.campaign.cases import Case
from middeck.realtime.gate.steps_on_rig import (
    GateRig,
    GateTrials,
    check_dry_run,
    check_engagement,
    check_shadow_run,
)
from packaged.guards import RIGS, WHOLE

CASE = "gated"


def rows(options: Any) -> list[dict]:
    return [
        random_row(kept(random_step, WHOLE, options)),
        *shifted_rows(kept(shifted_step, WHOLE, options)),
    ]


def random_step(case: Case, _: Any) -> str:
    """The step that refuses a package on the model that it destabilises."""
    rig = RIGS[case.index % 4]
    return _stopped_by(draw(case.index, *rig), *rig)


def shifted_step(case: Case, _: Any) -> tuple[str, str]:
    """The step that refuses one that only the truth destabilises; else the trip that stops it there."""
    rig = RIGS[case.index % 2]
    found = draw(WHOLE + case.index, *rig, on_board_stable=True)
    step = _stopped_by(found, *rig)
    return step, "" if step else judge(found, *rig).trip


def _stopped_by(found: Destabiliser, article: str, environment: str) -> str:
    """On the model, in a dry run there, on the truth as its rig; "" where it passes."""
    step = refused_on_paper(found.law, article, environment)
    if step:
        return step
    settings, trials = settings_of(article, environment), GateTrials(dry_s=5.0, shadow_s=2.0)
    reach = [sensor.range for sensor in settings.sensors[: len(found.law.inputs)]]
    package = pack(found.law, input_range=reach, limit=own_limits(found, settings))
    bench, plant = GateRig(found.article, settings), rig_case(article, environment).plant
    if not check_dry_run(package, "on board", plant, trials, settings).passed:
        return "dry run"
    if not check_shadow_run(package, bench, trials).passed:
        return "shadow run"
    return "" if check_engagement(package, bench, trials)[0].passed else "engagement"


def random_row(steps: Sequence[str]) -> dict:
    stopped = Counter(steps)
    return row(
        CASE, "random packages that pass on the model that they destabilise", "", stopped[""], 0.0,
        note=f"of {stopped.total()}; stopped by {_listed(stopped)}",
    )  # fmt: skip


def shifted_rows(ends: Sequence[tuple[str, str]]) -> list[dict]:
    stopped = Counter(step for step, _ in ends)
    trips = Counter(trip for step, trip in ends if not step)
    return [
        row(CASE, "packages stable on the model that pass it and the truth as its rig", "", stopped[""],
            note=f"of {stopped.total()}; stopped by {_listed(stopped)}"),
        row(CASE, "packages that pass both and do not trip either", "", trips[""],
            note=f"{_listed(trips)}; watched for two minutes: "
            "slow_packages.csv says what stops the slower ones"),
    ]  # fmt: skip


def _listed(counted: Counter[str]) -> str:
    return ", ".join(f"{step} {count}" for step, count in counted.most_common() if step)
