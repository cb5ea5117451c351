"""The SISO experiment in the engine, its linear article included: speed, and a day without a false trip."""

from __future__ import annotations

import dataclasses
import resource
from typing import Any

import numpy as np

from engine_rigs import PERIOD_S, article_of, lqg, pack, siso_case
from measured.rows import row
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.engine.process.supervisor import Supervisor
from middeck.realtime.engine.trials.standard_trips import standard_monitors

CASE, SAMPLES, REPEATS, LEVEL = "lockstep, SISO experiment", 500_000, 3, 200.0
HOURS, MINUTE = 24, 30_000


def rows(options: Any) -> list[dict]:
    case = siso_case()
    article = article_of(case)
    package = pack(lqg(case, article, 100.0))
    bare = EngineSettings(
        period_s=PERIOD_S,
        sensors=(SensorTest(port=case.plant.outputs[0], range=1.5, envelope=0.3),),
        drives=(Drive(port=case.plant.inputs[0], lower=-5.0, upper=5.0),),
        heartbeat_s=0.0,
    )
    with Supervisor(bare, article, admitted="ungated") as engine:
        engine.load(package)
        engine.reset()
        before = engine.run(20_000)
        engine.command("engage", values=[1.0])
        record = np.concatenate([before, engine.run(20_000)])
    settings = EngineSettings(
        period_s=PERIOD_S, sensors=bare.sensors, drives=bare.drives, heartbeat_s=0.0,
        monitors=standard_monitors(bare, record["y"], record["u"]),
    )  # fmt: skip
    spent = float(np.median([_cpu_s(settings, article, package) for _ in range(REPEATS)]))
    n, law, pairs = len(article.A), package.core, article.pairs
    moves = n * n if pairs is None else n + 2 * pairs
    states = len(law.A) ** 2 if law.pairs is None else len(law.A) + 2 * law.pairs
    flops = 2 * (moves + 4 * n + states + 3 * len(law.A) + 10 * len(settings.monitors))
    step = 1e6 * spent / SAMPLES
    made = row(
        CASE, "simulated time over CPU time", "", SAMPLES * PERIOD_S / spent, LEVEL,
        note=f"{step:.2f} us a sample, {flops / step / 1e3:.1f} Gflop/s; {flops} operations: "
             f"article ({n} states), compensator ({len(law.A)}), {len(settings.monitors)} monitors",
    )  # fmt: skip
    trips = sum(_trips(settings, dataclasses.replace(article, seed=500 + k), package) for k in range(HOURS))
    day = row(
        CASE, f"false trips in {HOURS} simulated hours", "", trips, 0.0, note="a seed an hour, under control"
    )
    return [made | {"met": bool(made["value"] >= LEVEL)}, day]


def _trips(settings: EngineSettings, article: Any, package: Any) -> bool:
    with Supervisor(settings, article, admitted="ungated") as engine:
        engine.load(package)
        engine.reset()
        engine.run(5000, keep=False)
        engine.command("engage", values=[1.0])
        for _ in range(60):
            engine.run(MINUTE, keep=False)
        return engine.state != "control"


def _cpu_s(settings: EngineSettings, article: Any, package: Any) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with Supervisor(settings, article, admitted="ungated") as engine:
        engine.load(package)
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.run(SAMPLES, keep=False)
        if engine.state != "control":
            raise RuntimeError(f"the engine ended in {engine.state}: {engine.events()}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
