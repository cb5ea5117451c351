"""What the gate stops of random packages on the model that they destabilise, step by step.

The cases are those of "guards".
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from engine_destabilising import draw, refused_on_paper
from measured.kept import kept
from measured.rows import row
from middeck.campaign.cases import Case
from packaged.guards import RIGS, WHOLE

CASE = "gated"


def rows(options: Any) -> list[dict]:
    return [random_row(kept(random_step, WHOLE, options))]


def random_step(case: Case, _: Any) -> str:
    """The step that refuses a package on the model that it destabilises."""
    rig = RIGS[case.index % 4]
    return refused_on_paper(draw(case.index, *rig).law, *rig)


def random_row(steps: Sequence[str]) -> dict:
    stopped = Counter(steps)
    return row(
        CASE, "random packages that pass on the model that they destabilise", "", stopped[""], 0.0,
        note=f"of {stopped.total()}; stopped by {_listed(stopped)}",
    )  # fmt: skip


def _listed(counted: Counter[str]) -> str:
    return ", ".join(f"{step} {count}" for step, count in counted.most_common() if step)
