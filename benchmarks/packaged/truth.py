"""Packages that are stable on every model on board and destabilise the truth: what stops each.

A thousand laws of six kinds on two articles, each with weights, intensities, authority and limits of its own,
each on a truth whose frequencies are off by 2 to 5 %, mode by mode. Every one is taken through the gate and,
whatever it said, past it. The list is a table of its own, `results/truth_packages.csv`.
"""

from __future__ import annotations

import csv
import datetime
from collections import Counter
from pathlib import Path
from typing import Any

from engine_destabilising import SLOW_S, judge
from engine_truths import first_attempt, packed, refusal_on_paper, refusals, refusals_in_runs
from measured.kept import kept
from measured.rows import row
from middeck.campaign.cases import Case
from middeck.realtime.gate.steps_on_rig import GateTrials
from middeck.realtime.package.package_bytes import hash_law

CASE, WHOLE = "truth", 1000
LISTED = Path(__file__).resolve().parents[1] / "results" / "truth_packages.csv"
LONGEST = 1 << 20
"""Samples for which one is watched, if twenty growth times are no fewer: 35 minutes."""
ON_PAPER = ("model at all fades", "recovery")
AT_LENGTH = "for the gate's own time"
"""Of runs: `refusals` takes shorter ones first."""
ORDER = (
    "poles, model (6 dB at a motor), dry run of 5 s, shadow run of 2 s, engagement, model at all fades, "
    f"recovery, dry run and shadow run {AT_LENGTH}, 10 s each"
)
FIELDS = (
    "number", "attempt", "article", "environment", "motors", "sensors", "decades_of_authority",
    "share_of_limits", "growth_time_s", "refused_by", "stopped_by", "after_full_authority_s", "allowed_s",
    "angle_over_envelope", "torque_over_limit", "on_blacklist", "judged_on",
)  # fmt: skip


def rows(options: Any) -> list[dict]:
    found = kept(truth_package, WHOLE, options)
    through = [one["number"] for _, one in found if not one["refused_by"]]
    for number, step in zip(through, kept(truth_on_paper, through, options), strict=True):
        found[number][1]["refused_by"] = ON_PAPER[0] if step == "model" else step
    through = [number for number in through if not found[number][1]["refused_by"]]
    for number, step in zip(through, kept(truth_at_length, through, options), strict=True):
        found[number][1]["refused_by"] = step
    with LISTED.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, FIELDS, lineterminator="\n")
        table.writeheader()
        table.writerows(one for _, one in found)
    return table_rows([one for _, one in found], len({law for law, _ in found}))


def truth_package(case: Case, _: Any) -> tuple[str, dict[str, Any]]:
    """SHA-256 of the law of one package, and its line of the list."""
    number = case.index
    trial, draw = first_attempt(number)
    came = judge(draw.found, *draw.family.rig, longest=LONGEST)
    law = draw.found.law
    return hash_law(packed(draw)), {
        "number": number, "attempt": trial, "article": draw.family.article,
        "environment": draw.family.environment, "motors": len(law.outputs), "sensors": len(law.inputs),
        "decades_of_authority": f"{draw.decades:.3f}", "share_of_limits": f"{draw.found.share:.3f}",
        "growth_time_s": f"{1.0 / came.rate:.4g}", "refused_by": ", ".join(refusals(draw)),
        "stopped_by": came.trip or "nothing",
        "after_full_authority_s": f"{came.after_s:.3f}" if came.trip else "",
        "allowed_s": f"{came.allowed_s:.3f}", "angle_over_envelope": f"{came.peak:.3f}",
        "torque_over_limit": f"{came.torque:.4f}", "on_blacklist": "yes" if came.blacklisted else "no",
        "judged_on": datetime.date.today().isoformat(),
    }  # fmt: skip


def truth_on_paper(case: Case, _: Any) -> str:
    return refusal_on_paper(first_attempt(case.index)[1])


def truth_at_length(case: Case, _: Any) -> str:
    """What refuses it of the runs as the gate has them."""
    steps = refusals_in_runs(first_attempt(case.index)[1], GateTrials())
    return f"{steps[0]} {AT_LENGTH}" if steps else ""


def is_last(step: str) -> bool:
    """Whether this step is asked only of what passes all cheap ones."""
    return step in ON_PAPER or step.endswith(AT_LENGTH)


def table_rows(listed: list[dict[str, Any]], laws: int) -> list[dict]:
    """From the lines of the list."""
    slow = [one for one in listed if is_slow(one)]
    fast = [one for one in listed if not is_slow(one)]
    through = [one for one in listed if not one["refused_by"]]
    first = Counter(one["refused_by"].split(", ")[0] for one in listed)
    steps = (step for one in listed for step in one["refused_by"].split(", "))
    alone = Counter(step for step in steps if step and not is_last(step))
    judged = Counter(one["judged_on"] for one in listed)
    return [
        row(CASE, "packages stable on both models on board that the truth destabilises", "", len(listed),
            note=f"frequencies off by 2 to 5 %; {laws} different laws; {_families(listed)}"),
        row(CASE, "of these, packages that pass the gate with the truth as its rig", "", len(through),
            note=f"stopped by {_said(first)}, asked in the order of {ORDER}; for itself each of the cheap "
            f"steps refuses {_said(alone)}; judged on {_said(judged)}"),
        row(CASE, "of these, packages that pass the gate and do not trip", "",
            sum(one["stopped_by"] == "nothing" for one in through), 0.0, note=_trips(through)),
        row(CASE, "past the gate: late trips of packages with a growth time below 10 s", "",
            sum(is_late(one) for one in fast), 0.0, note=f"of {len(fast)}: {_trips(fast)}"),
        row(CASE, "past the gate: slower packages without a trip in twenty growth times", "",
            sum(one["stopped_by"] == "nothing" for one in slow),
            note=f"of {len(slow)}, listed in {LISTED.name}: {_trips(slow)}"),
        row(CASE, "past the gate: largest angle over its envelope", "",
            max(float(one["angle_over_envelope"]) for one in listed), 2.0),
        row(CASE, "past the gate: largest torque over its limit", "",
            max(float(one["torque_over_limit"]) for one in listed), 1.0),
    ]  # fmt: skip


def is_slow(one: dict[str, Any]) -> bool:
    return float(one["growth_time_s"]) >= SLOW_S


def is_late(one: dict[str, Any]) -> bool:
    """Without a trip, or with one after ten growth times and two seconds of saturation."""
    trips = one["stopped_by"] != "nothing"
    return not (trips and float(one["after_full_authority_s"]) <= float(one["allowed_s"]))


def _families(listed: list[dict[str, Any]]) -> str:
    kinds = Counter((one["article"], one["environment"], int(one["motors"])) for one in listed)
    return ", ".join(
        f"{article} in {place}, motors {n}: {count}" for (article, place, n), count in kinds.items()
    )


def _trips(listed: list[dict[str, Any]]) -> str:
    return _said(Counter(one["stopped_by"] for one in listed))


def _said(counted: Counter[str]) -> str:
    return ", ".join(f"{step} {count}" for step, count in counted.most_common() if step) or "none"
