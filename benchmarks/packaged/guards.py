"""What the engine guards against: faults, packages that destabilise, hours without a false trip.

The cases and their judgement are those of the tests (`make test-all`); here they are counted,
which takes about two hours.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from engine_destabilising import SLOW_S, Outcome, draw, judge
from engine_faults import ARTICLE, KINDS, STATES, play
from engine_rigs import nominal_article, nominal_package, settings_of, wait_for_hold
from measured.rows import row
from middeck.realtime.engine.process.supervisor import Supervisor
from middeck.realtime.engine.rigs.article import with_faults

CASE, WHOLE, SEEDS, HOURS = "guards", 1000, 25, 24
RIGS = (("dm", "lab"), ("simple", "lab"), ("simple", "orbit"), ("dm", "orbit"))


def rows(options: Any) -> list[dict]:
    return [
        *fault_rows([(kind, state, play(kind, state, seed).why)
                     for kind in KINDS for state in STATES for seed in range(SEEDS)]),
        *destabilised_rows("random, past the gate", [_judged(seed, 4, False) for seed in range(WHOLE)]),
        *destabilised_rows("stable on the model", [_judged(WHOLE + seed, 2, True) for seed in range(WHOLE)]),
        normal_row(["dm", "simple"], HOURS),
        engaging_row(range(SEEDS)),
    ]  # fmt: skip


def _judged(seed: int, rigs: int, on_board_stable: bool) -> Outcome:
    rig = RIGS[seed % rigs]
    return judge(draw(seed, *rig, on_board_stable=on_board_stable), *rig)


def fault_rows(endings: Sequence[tuple[str, str, str]]) -> list[dict]:
    """From kind, state and complaint of each run."""
    wrong = [ending for ending in endings if ending[2]]
    runs = f"of {len(endings)} runs: {len(KINDS)} kinds, {len(STATES)} states, {SEEDS} seeds"
    return [
        row(CASE, "faults that end neither in SAFE nor in correct completion", "", len(wrong), 0.0, note=runs)
    ]


def destabilised_rows(what: str, outcomes: Sequence[Outcome]) -> list[dict]:
    fast = [o for o in outcomes if o.rate >= 1.0 / SLOW_S]
    slow = [o for o in outcomes if o.rate < 1.0 / SLOW_S]
    late = [o for o in fast if not (o.trip and o.after_s <= o.allowed_s)]
    return [
        row(CASE, f"packages that destabilise, {what}: late trips", "", len(late), 0.0,
            note=f"of {len(fast)} with a growth time below {SLOW_S:g} s: {_counted(fast)}"),
        row(CASE, f"packages that destabilise, {what}: slower, without a trip", "",
            sum(not o.trip for o in slow),
            note=f"of {len(slow)}, watched for 120 s at most: {_counted(slow)}"),
        row(CASE, f"packages that destabilise, {what}: largest angle over its envelope", "",
            max(o.peak for o in outcomes), 2.0, note=f"median {np.median([o.peak for o in outcomes]):.2f}"),
        row(CASE, f"packages that destabilise, {what}: largest torque over its limit", "",
            max(o.torque for o in outcomes), 1.0),
    ]  # fmt: skip


def _counted(outcomes: Sequence[Outcome]) -> str:
    return ", ".join(
        f"{kind or 'none'} {count}" for kind, count in Counter(o.trip for o in outcomes).most_common()
    )


def normal_row(articles: Sequence[str], hours: int) -> dict:
    """Trips in normal operation under control, each article for its share of the hours."""
    trips, each = 0, hours / len(articles)
    for article in articles:
        settings = settings_of(article)
        for piece in range(int(2 * each)):
            with Supervisor(settings, with_faults(nominal_article(article), seed=1000 + piece)) as engine:
                engine.load(nominal_package(article))
                engine.run(5000, keep=False)
                engine.reset()
                engine.run(5000, keep=False)
                wait_for_hold(engine)
                engine.command("engage", values=[1.0])
                for _ in range(60):
                    engine.run(settings.samples(30.0), keep=False)
                trips += engine.state != "control"
    return row(CASE, f"false trips in {hours} simulated hours", "", trips, 0.0, note=", ".join(articles))


def engaging_row(seeds: Sequence[int]) -> dict:
    settings, worst = settings_of(*ARTICLE), -np.inf
    limits = np.array([drive.upper for drive in settings.drives])
    ramp = settings.samples(settings.ramp_s)
    for seed in seeds:
        with Supervisor(settings, with_faults(nominal_article(*ARTICLE), seed=seed)) as engine:
            engine.load(nominal_package(*ARTICLE))
            engine.reset()
            engine.run(2 * ramp, keep=False)
            wait_for_hold(engine)
            engine.command("engage", values=[1.0])
            on = engine.run(ramp)["u"]
            normal = np.abs(np.diff(engine.run(4 * ramp)["u"], axis=0)).max(axis=0)
            engine.command("disengage")
            off = engine.run(ramp)["u"]
        for part in (on, off):
            worst = max(worst, float(((np.abs(np.diff(part, axis=0)).max(axis=0) - normal) / limits).max()))
    return row(
        CASE, "engaging and disengaging: largest step beyond a normal one, over the limit", "", worst, 0.01
    )
