"""Runs before a package may run: on every model, in shadow, and engaged at a share; and the blacklist."""

from __future__ import annotations

import dataclasses
import shutil

import numpy as np
import pytest

from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.engine.process.launch import DriverRig
from middeck.realtime.engine.rigs.engine_rig import EngineRig
from middeck.realtime.engine.rigs.linear_article import linear_article
from middeck.realtime.engine.trials.trial import ENGINE, REFERENCE, Stage, run_trial
from middeck.realtime.gate.gate import examine_package
from middeck.realtime.gate.steps_on_rig import (
    GateRig,
    GateTrials,
    check_dry_run,
    check_engagement,
    check_shadow_run,
    package_settings,
)
from middeck.realtime.gate.steps_without_rig import GateMargins
from middeck.realtime.package.filter_sections import LoopPath, static_gain
from middeck.realtime.package.package_bytes import hash_law
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.vectors import add_test_vectors
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from served_by_thread import served_by_thread

PERIOD_S = 0.002
WAY, PUSH = Port("way", "m"), Port("push", "N")
TRIALS = GateTrials(dry_s=2.0, shadow_s=1.0, engage_s=2.0)
MARGINS = GateMargins(gain_db=3.0, phase_deg=10.0)


def swing(hz: float = 1.0, sign: float = 1.0) -> Plant:
    """One light mode."""
    w = 2.0 * np.pi * hz
    system = StateSpace([[0.0, w], [-w, -0.02 * w]], [[0.0], [sign]], [[1.0, 0.0]], [[0.0]])
    return Plant(dynamics=system, inputs=(PUSH,), outputs=(WAY,))


def damper(gain: float = 5.0):
    """The rate of the mode, by a filtered difference."""
    lag = SampledStateSpace([[0.9]], [[1.0]], [[gain]], [[-10.0 * gain]], period_s=PERIOD_S)
    law = Compensator(lag, (WAY,), (PUSH,))
    return package_law(law, "damper", input_range=1.0, limit=1.0, ramp_s=0.3)


def bench(plant: Plant, *, envelope: float = 0.5, noise: float = 1e-5, disturbance: float = 0.05) -> GateRig:
    """A rig: ``plant`` with noise, and the envelope of an experiment."""
    settings = EngineSettings(
        period_s=PERIOD_S,
        sensors=(SensorTest(port=WAY, range=1.0, envelope=envelope),),
        drives=(Drive(port=PUSH, lower=-1.0, upper=1.0),),
    )
    given = {"disturbed": ["push"], "disturbance_rms": disturbance, "sensor_noise": noise}
    return GateRig(linear_article(plant, PERIOD_S, ["push"], ["way"], **given), settings)


@pytest.fixture(params=["engine", "reference"])
def computer(request, monkeypatch):
    """With a compiler, and with none to be found."""
    if request.param == "engine":
        request.getfixturevalue("compiler")
    else:
        monkeypatch.setattr(shutil, "which", lambda *_: None)
    return ENGINE if request.param == "engine" else REFERENCE


def test_a_sound_package_passes_every_step(computer):
    verdict = examine_package(
        damper(), {"swing": swing()}, MARGINS, trials=TRIALS, rig=bench(swing(1.02), disturbance=0.01)
    )
    assert verdict.passed, verdict.steps
    assert [step.name for step in verdict.steps] == [
        *("blacklist", "interface", "poles", "vectors", "error bound"),
        *("model swing", "recovery swing", "dry run swing", "shadow run", "engagement"),
    ]
    assert all(step.said.endswith(f"({computer})") for step in verdict.steps[7:])
    assert (verdict.left_out, verdict.tripped) == ((), "")


@pytest.mark.usefixtures("compiler")
def test_a_trip_when_engaged_goes_on_the_blacklist_for_good():
    """Stable on its models; the truth has the sign of its motor the other way round."""
    package, models, rig = damper(), {"swing": swing()}, bench(swing(sign=-1.0), envelope=0.02)
    verdict = examine_package(package, models, MARGINS, trials=TRIALS, rig=rig)
    assert [step.name for step in verdict.steps if not step.passed] == ["engagement"]
    assert verdict.tripped.startswith("envelope way at")
    blacklist = {verdict.law: verdict.tripped}
    again = examine_package(package, models, MARGINS, trials=TRIALS, rig=rig, blacklist=blacklist)
    assert [step.name for step in again.steps] == ["blacklist"]
    assert "it has tripped: envelope way" in again.steps[0].said
    assert again.left_out == ()
    other = examine_package(damper(4.9), models, MARGINS, blacklist=blacklist)
    assert other.passed
    assert other.left_out == ("dry run", "shadow run", "engagement")


@pytest.mark.usefixtures("compiler")
def test_a_law_that_trips_is_blamed_before_its_step_is_logged():
    """A log that is full, or a gate that is killed there, would leave it off the blacklist."""
    rig, blamed = bench(swing(sign=-1.0), envelope=0.02), {}

    def full(step):
        if step.name == "engagement":
            raise DataError("no space left")

    with pytest.raises(DataError, match="no space left"):
        examine_package(
            damper(), {"swing": swing()}, MARGINS, trials=TRIALS, rig=rig, log=full,
            on_trip=blamed.__setitem__,
        )  # fmt: skip
    assert list(blamed) == [hash_law(damper())]
    assert blamed[hash_law(damper())].startswith("envelope way at")


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("step", ["dry run swing", "shadow run"])
def test_a_trip_of_what_moved_no_article_puts_nothing_on_the_blacklist(step):
    """A dry run blames model and noise, and moves nothing; in a shadow run the package has no outputs."""
    if step == "shadow run":
        given = {"trials": TRIALS, "rig": bench(swing(), disturbance=60.0)}
    else:
        given = {"trials": GateTrials(dry_s=1.0, noise=0.3)}
    verdict = examine_package(damper(), {"swing": swing()}, MARGINS, **given)
    assert (verdict.steps[-1].name, verdict.steps[-1].passed) == (step, False)
    assert verdict.steps[-1].said.startswith("trip: ")
    assert verdict.tripped == ""


def test_a_dry_run_refuses_what_saturates_or_moves_too_far(computer):
    """Both are stable with margin on paper."""
    loud = check_dry_run(damper(), "swing", swing(), GateTrials(dry_s=2.0, noise=0.05))
    assert not loud.passed
    assert "push peaks at 1 N, allowed are 0.9 of 1 N" in loud.said or "trip: effort push" in loud.said
    shaken = check_dry_run(damper(), "swing", swing(), GateTrials(dry_s=2.0, rms=1e-4, disturbance=0.02))
    assert "way has an rms of" in shaken.said
    assert shaken.said.endswith(f"({computer})")
    quiet = check_dry_run(damper(), "swing", swing(), GateTrials(dry_s=2.0))
    assert quiet.passed
    assert quiet.name == "dry run swing"


def test_a_shadow_run_refuses_on_live_sensors_and_moves_nothing(computer):
    """The rig's sensor is noisier than it may be."""
    step = check_shadow_run(damper(), bench(swing(), noise=0.05), TRIALS)
    assert not step.passed
    assert "push would get" in step.said
    assert check_shadow_run(damper(), bench(swing()), TRIALS).passed
    tight = bench(swing(), disturbance=60.0)
    moved = check_shadow_run(damper(), tight, TRIALS)
    assert "trip: envelope way" in moved.said
    trial = run_trial(damper(), tight.settings, tight.rig, (Stage("standby", 1.0),))
    assert trial.computer == computer
    assert not trial.u.any()
    assert trial.wanted.any()
    assert not trial.blamed  # it moved nothing


class Jump(EngineRig):
    """A sensor that is good for a while, and then gives nonsense."""

    def __init__(self, nonsense: float) -> None:
        self.nonsense, self.samples = nonsense, 0

    def read(self) -> np.ndarray:
        return np.array([self.nonsense if self.samples > 300 else 0.01 * np.sin(self.samples)])

    def write(self, u: np.ndarray) -> None:
        self.samples += 1


def test_a_trip_that_is_not_the_packages_fault_blames_nobody(computer):
    """A sensor that jumps; where it was driven towards its end, or beyond its envelope, the package is."""
    for nonsense, said in ((5.0, "trip: range way"), (np.nan, "trip: not finite way")):
        with served_by_thread(Jump(nonsense)) as rig:
            step, tripped = check_engagement(damper(), GateRig(rig, bench(swing()).settings), TRIALS)
        assert step.said.startswith(said)
        assert not tripped
    for envelope, said in ((2.0, "trip: range way"), (0.3, "trip: envelope way")):
        step, tripped = check_engagement(
            damper(), bench(swing(), envelope=envelope, disturbance=60.0), TRIALS
        )
        assert step.said.startswith(said)
        assert tripped
        assert step.said == f"trip: {tripped} ({computer})"


def test_a_command_that_overflows_is_refused_in_shadow(computer):
    """Its limit would make it a number; what it asks for is none."""
    law = Compensator(
        SampledStateSpace([[0.5]], [[0.0]], [[0.0]], [[-1e308]], period_s=PERIOD_S), (WAY,), (PUSH,)
    )
    package = package_law(law, "endless", input_range=100.0, limit=1.0)
    rig = bench(swing())
    wide = dataclasses.replace(rig.settings.sensors[0], range=100.0, envelope=90.0)
    settings = dataclasses.replace(rig.settings, sensors=(wide,))
    with served_by_thread(Jump(50.0)) as served:
        step = check_shadow_run(package, GateRig(served, settings), TRIALS)
    assert not step.passed
    # The engine does not even take it: its test vectors overflow too.
    assert (
        "overflow" in step.said or "command not finite push" in step.said or step.said.startswith("refused: ")
    )


def test_what_cannot_be_tried_is_not_passed(computer):
    """A plant that answers at once, a rig without the ports."""
    w = 2.0 * np.pi
    direct = StateSpace([[0.0, w], [-w, -0.02 * w]], [[0.0], [1.0]], [[1.0, 0.0]], [[1e-3]])
    plant = Plant(dynamics=direct, inputs=(PUSH,), outputs=(WAY,))
    said = check_dry_run(damper(0.5), "direct", plant, TRIALS).said
    assert said == "not decided: an output responds at once to an input"
    pull = (Drive(port=Port("pull", "N"), lower=-1.0, upper=1.0),)
    settings = dataclasses.replace(bench(swing()).settings, drives=pull)
    step = check_shadow_run(damper(), GateRig(bench(swing()).rig, settings), TRIALS)
    assert not step.passed
    assert "lacks" in step.said
    if computer == REFERENCE:
        step = check_shadow_run(damper(), GateRig(DriverRig(), package_settings(damper())), TRIALS)
        assert step.said == "not decided: converters have a driver in C"


@pytest.mark.parametrize("given", [{"dry_s": 0.0}, {"share": 0.0}, {"noise": -1.0}, {"peak": 1.5}])
def test_trials_out_of_range_are_refused(given):
    with pytest.raises(ConfigError, match="trials of"):
        GateTrials(**given)


def test_a_package_with_an_inner_loop_is_tried_by_the_reference_law():
    """The engine has a hold of its own and takes no such package."""
    paths = (LoopPath(0, 0, static_gain(-0.1)),)
    package = add_test_vectors(dataclasses.replace(damper(), paths=paths, vectors=None))
    step = check_dry_run(package, "swing", swing(), TRIALS)
    assert step.passed
    assert step.said.endswith(f"({REFERENCE})")
