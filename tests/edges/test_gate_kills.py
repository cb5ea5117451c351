"""A gate that is killed while an engine runs for it: its log can be read, and the rig is left at rest."""

from __future__ import annotations

import tempfile
import time

import numpy as np
import pytest

from engine_supervised import Forked, kill_at_line
from middeck.control.law.compensator import Compensator
from middeck.files.laws.gate_logs import GateLog, load_gate_log
from middeck.realtime.engine.interface.shared_file import open_shared_file
from middeck.realtime.engine.process.adopted_engine import AdoptedEngine
from middeck.realtime.engine.rigs.linear_article import linear_article
from middeck.realtime.engine.rigs.stepped_article import SteppedArticle
from middeck.realtime.gate.gate import examine_package
from middeck.realtime.gate.steps_on_rig import GateRig, GateTrials, package_settings
from middeck.realtime.gate.steps_without_rig import GateMargins
from middeck.realtime.package.package_law import package_law
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from repeats import repeats
from served_by_thread import served_by_thread

PERIOD_S, PATIENCE_S = 0.01, 20.0
ANY = GateMargins(gain_db=0.0, phase_deg=0.0)
TRIALS = GateTrials(dry_s=0.2, shadow_s=0.2, engage_s=0.2)
RUNS = ["dry run lag", "shadow run", "engagement"]


class Watched(SteppedArticle):
    """It keeps every command that arrives."""

    def __init__(self, article):
        super().__init__(article)
        self.commands = []

    def write(self, u):
        self.commands.append(float(u[0]))
        super().write(u)


def lag():
    """What it reads moves by itself, so that the law asks for something."""
    way, push = (Port("way", "m"),), (Port("push", "N"),)
    none = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))
    law = Compensator(SampledStateSpace(*none, [[-0.5]], period_s=PERIOD_S), way, push)
    plant = Plant(dynamics=StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]]), inputs=push, outputs=way)
    return package_law(law, "law", input_range=1.0, limit=1.0, ramp_s=0.1), plant


def gate(folder, rig, told, stage, line):
    """All steps, but for that it is killed at a line of the engine's Python after ``stage`` has begun."""
    package, plant = lag()
    tempfile.tempdir = str(folder)
    with GateLog(folder / "gate.jsonl", package, ["lag"]) as log:

        def logged(step):
            log(step)
            if step.name == (["recovery lag", *RUNS])[stage]:
                kill_at_line(told, line)

        case = GateRig(rig, package_settings(package))
        examine_package(package, {"lag": plant}, ANY, trials=TRIALS, rig=case, log=logged)


CASES = [(stage, 1 + 997 * k * k % 1201) for k in range(3, 23) for stage in (2, 0, 1)]


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize(("stage", "line"), repeats(CASES, 1))
def test_a_gate_killed_while_an_engine_runs_for_it_leaves_its_log_and_a_rig_at_rest(stage, line, tmp_path):
    """In a dry run, in shadow, or engaged; the engine, which has lost its supervisor, ends by itself."""
    noise = {"disturbed": ["push"], "disturbance_rms": 0.5, "sensor_noise": 1e-6}
    article = Watched(linear_article(lag()[1], PERIOD_S, ["push"], ["way"], **noise))
    with served_by_thread(article) as rig:
        with Forked(lambda told: gate(tmp_path, rig, told, stage, line)) as process:
            process.wait()
        began = time.monotonic()
        while any(engine.poll() is None for engine in engines_in(tmp_path)):
            assert time.monotonic() - began < PATIENCE_S
            time.sleep(0.005)
    (cut,) = load_gate_log(tmp_path / "gate.jsonl")
    assert (cut.passed, cut.tripped) == (None, "")
    assert [step.name for step in cut.steps][-1 - stage :] == ["recovery lag", *RUNS[:stage]]
    assert all(step.passed for step in cut.steps)
    assert not any(article.commands[-1:])


def engines_in(folder):
    """Those whose file is there, as one that takes over sees them."""
    return [AdoptedEngine(open_shared_file(path)) for path in folder.rglob("engine.shared")]
