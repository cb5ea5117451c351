"""The engine beside the reference, to the last bit, over the study's compensators; time of a sample."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from measured.rows import row
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.engine.process.supervisor import Supervisor
from middeck.realtime.engine.rigs.linear_article import LinearArticle
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.reference import ReferenceLaw
from packaged.study_laws import study_laws

CASE, SAMPLES, TIMED, REPEATS = "engine in lockstep", 2000, 50_000, 5
LIMITS = {"input_range": 0.1, "limit": 0.3, "slew_rate": 50.0, "ramp_s": 0.5}


def rows(options: Any) -> list[dict]:
    laws, different, compared, spent = study_laws(), 0, 0, []
    for law in laws.values():
        for form in ("dense", "auto"):
            package = package_law(law, "law", form=form, **LIMITS)
            records = _run(package, SAMPLES)
            reference = ReferenceLaw(package)
            expected = np.array([reference.step(y) for y in records["y"]])
            different += int(np.count_nonzero(records["u"].view(np.int64) != expected.view(np.int64)))
            compared += expected.size
    for _ in range(REPEATS):
        spent.append(_time(package))
    note = f"of {compared}: {len(laws)} compensators, dense and modal, noise as readings"
    size = f"{len(package.core.A)} states, {len(package.inputs)} in, {len(package.outputs)} out"
    return [
        row(CASE, "outputs that differ from the reference in a bit", "", different, 0.0, note=note),
        row(CASE, "a sample: read, test, compute, write, record", "us", float(np.median(spent)), note=size),
    ]


def _engine(package: ControllerPackage) -> Supervisor:
    settings = EngineSettings(
        period_s=package.period_s,
        sensors=tuple(SensorTest(port=port, range=10.0) for port in package.inputs),
        drives=tuple(Drive(port=port, lower=-1.0, upper=1.0) for port in package.outputs),
        effort_s=0.0,
        heartbeat_s=0.0,
    )
    m, p = len(package.inputs), len(package.outputs)
    article = LinearArticle(
        A=np.zeros((1, 1)), B=np.zeros((1, p)), C=np.zeros((m, 1)), G=np.zeros((1, 0)), x=np.zeros(1),
        sensor_noise=np.full(m, 0.01), seed=5,
    )  # fmt: skip
    engine = Supervisor(settings, article, admitted="ungated")
    for answer in (engine.load(package), engine.reset(), engine.command("engage", values=[1.0])):
        if not answer.done:
            raise RuntimeError(answer.reason)
    return engine


def _run(package: ControllerPackage, samples: int) -> np.ndarray:
    with _engine(package) as engine:
        return engine.run(samples)


def _time(package: ControllerPackage) -> float:
    with _engine(package) as engine:
        begin = time.perf_counter()
        engine.run(TIMED, keep=False)
        return 1e6 * (time.perf_counter() - begin) / TIMED
