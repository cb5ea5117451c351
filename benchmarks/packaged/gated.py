"""What the gate stops of packages that destabilise, step by step, and what trips of the rest.

The cases are those of "guards"; margins at eleven fades take seconds each, and all of it about two hours.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

from engine_destabilising import Destabiliser, draw, judge, stopped_by
from measured.rows import row
from packaged.guards import RIGS, WHOLE

CASE = "gated"


def rows(options: Any) -> list[dict]:
    random = ((draw(seed, *RIGS[seed % 4]), RIGS[seed % 4]) for seed in range(WHOLE))
    shifted = (
        (draw(WHOLE + seed, *RIGS[seed % 2], on_board_stable=True), RIGS[seed % 2]) for seed in range(WHOLE)
    )
    return [random_row(random), *shifted_rows(shifted)]


def random_row(drawn: Iterable[tuple[Destabiliser, tuple[str, str]]]) -> dict:
    stopped = Counter(stopped_by(found, *rig) for found, rig in drawn)
    return row(
        CASE, "random packages that pass on the model that they destabilise", "", stopped[""], 0.0,
        note=f"of {stopped.total()}; stopped by {_listed(stopped)}",
    )  # fmt: skip


def shifted_rows(drawn: Iterable[tuple[Destabiliser, tuple[str, str]]]) -> list[dict]:
    stopped: Counter[str] = Counter()
    trips: Counter[str] = Counter()
    for found, rig in drawn:
        step = stopped_by(found, *rig)
        stopped[step] += 1
        if not step:
            trips[judge(found, *rig).trip] += 1
    return [
        row(CASE, "packages stable on the model that pass it and the truth as its rig", "", stopped[""],
            note=f"of {stopped.total()}; stopped by {_listed(stopped)}"),
        row(CASE, "packages that pass both and do not trip either", "", trips[""], note=_listed(trips)),
    ]  # fmt: skip


def _listed(counted: Counter[str]) -> str:
    return ", ".join(f"{step} {count}" for step, count in counted.most_common() if step)
