"""A package on a rig in stages: the engine and the reference law find the same."""

from __future__ import annotations

import dataclasses
import shutil

import numpy as np
import pytest
import scipy.linalg as sla

from engine_cases import SENSORS, plain_settings, random_article, random_package
from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.interface.adaptive_gain import AdaptiveGain
from middeck.realtime.engine.interface.monitors import Monitor
from middeck.realtime.engine.process.launch import DriverRig
from middeck.realtime.engine.rigs.linear_article import Fault, linear_article
from middeck.realtime.engine.rigs.stepped_article import SteppedArticle
from middeck.realtime.engine.trials.trial import ENGINE, REFERENCE, Stage, run_trial
from middeck.realtime.gate.steps_on_rig import GateRig, GateTrials, check_shadow_run
from middeck.realtime.package.filter_sections import LoopPath, static_gain
from middeck.realtime.package.single_precision import to_single
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace
from packaged_laws import PERIOD_S
from served_by_thread import served_by_thread

STAGES = (Stage("standby", 0.2), Stage("engage", 0.4, 0.25), Stage("engage", 0.8))
HOLD = (LoopPath(0, 1, static_gain(-0.02)),)


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("changes", [{}, {"hold": HOLD, "verify_s": 0.0}], ids=["alone", "held"])
def test_both_computers_find_the_same(changes):
    """In standby, at a share and at full authority, within limits and at them; the noise is the same too."""
    settings, package = plain_settings(**changes), random_package()
    risen = Stage("standby", settings.rise_s)
    by_engine, by_reference = (
        run_trial(package, settings, random_article(), (risen, *STAGES), computer=computer)
        for computer in ("engine", "reference")
    )
    assert (by_engine.computer, by_reference.computer) == (ENGINE, REFERENCE)
    for name in ("y", "u", "wanted"):
        one, other = getattr(by_engine, name), getattr(by_reference, name)
        assert one.shape == other.shape
        # Sums run in another order; 1e-12 a sample, and the loop's growth of it.
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9 * np.abs(one).max(), err_msg=name)
    assert np.abs(by_engine.u[:100]).max() < (0.5 if changes else 1e-300)
    assert np.abs(by_engine.wanted[:100]).max() > 0.0
    assert by_engine.u.max() == 0.5


@pytest.mark.usefixtures("compiler")
def test_a_rig_in_python_and_one_behind_udp_are_the_same_rig():
    """Served to the engine, stepped by the reference law, and reached by it over UDP."""
    package, settings, stages = random_package(), plain_settings(), STAGES[:2]
    found = [
        run_trial(package, settings, SteppedArticle(random_article()), stages, computer=computer)
        for computer in ("engine", "reference")
    ]
    with served_by_thread(SteppedArticle(random_article())) as served:
        found.append(run_trial(package, settings, served, stages, computer="reference"))
    for other in found[1:]:
        np.testing.assert_allclose(found[0].y, other.y, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize(
    ("changes", "trip", "blamed"),
    [
        ({"sensors": "range"}, "range y", True),  # driven there: half of it was seen before
        ({"sensors": "envelope"}, "envelope y", True),
        ({"effort_s": 0.1, "effort_share": 0.2}, "effort u", True),
        ({"hold": HOLD, "verify_s": 0.0, "effort_s": 0.2, "effort_share": 0.1}, "effort u", True),
    ],
)
@pytest.mark.usefixtures("compiler")
def test_both_computers_trip_alike(changes, trip, blamed):
    """In the same sample, of the same channel, and the same package is to blame."""
    settings = plain_settings()
    if "sensors" in changes:
        tight = tuple(dataclasses.replace(s, **{changes["sensors"]: 0.03}) for s in settings.sensors)
        changes = {"sensors": tight}
    settings = plain_settings(**changes)
    stages = Stage("standby", settings.rise_s), Stage("engage", 4.0)
    found = [
        run_trial(random_package(), settings, random_article(), stages, computer=computer)
        for computer in ("engine", "reference")
    ]
    for trial in found:
        assert trial.trip.startswith(trip)
        assert trial.blamed == blamed
    assert found[0].trip == found[1].trip
    if not trip.startswith("effort"):  # which is found in what was written
        assert found[1].u[-1].tolist() == [0.0, 0.0]


@pytest.mark.usefixtures("compiler")
def test_neither_computer_engages_while_the_hold_rises():
    settings, stages = plain_settings(hold=HOLD, verify_s=0.0), (Stage("standby", 0.2), Stage("engage", 0.5))
    for computer in ("engine", "reference"):
        trial = run_trial(random_package(), settings, random_article(), stages, computer=computer)
        assert trial.refused.startswith("not in this state")
        assert np.abs(trial.u).max() < 0.5


def test_without_a_compiler_the_reference_law_runs(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda *_: None)
    trial = run_trial(random_package(), plain_settings(), random_article(), STAGES[:1])
    assert trial.computer == REFERENCE
    assert trial.y.shape == (100, SENSORS)
    with pytest.raises(ConfigError, match="driver in C"):
        run_trial(random_package(), plain_settings(), DriverRig(), STAGES[:1])
    with pytest.raises(ConfigError, match="no clock"):
        run_trial(random_package(), plain_settings(), random_article(), STAGES[:1], real_time=True)
    faulty = random_article(faults=(Fault(kind="sensor nan"),))
    with pytest.raises(ConfigError, match="with faults"):
        run_trial(random_package(), plain_settings(), faulty, STAGES[:1])
    other = plain_settings(drives=plain_settings().drives[:1])
    with pytest.raises(ConfigError, match="lacks, or has in another unit: u1"):
        run_trial(random_package(), other, random_article(), STAGES[:1])
    with pytest.raises(ConfigError, match="another sampling rate"):
        run_trial(
            random_package(),
            dataclasses.replace(plain_settings(), period_s=0.01),
            random_article(),
            STAGES[:1],
        )


def test_without_a_compiler_nothing_that_is_to_be_guarded_goes_unguarded(monkeypatch):
    """A rig does not run without the trips that its settings ask for: nothing would stop it."""
    monkeypatch.setattr(shutil, "which", lambda *_: None)
    plain = plain_settings()
    sensor, drive = plain.sensors[0], plain.drives[0]
    quiet = {"sensor": sensor.port.name, "band_hz": (1.0, 2.0), "quiet_rms": 0.1, "loud_rms": 0.2}
    for changed, lacking in (
        ({"monitors": (Monitor(channel=sensor.port.name, band_hz=(1.0, 2.0), limit=1.0),)}, "monitors"),
        ({"sensors": (dataclasses.replace(sensor, stuck_s=1.0), *plain.sensors[1:])}, "test of stuck"),
        ({"drives": (dataclasses.replace(drive, momentum=1.0, stored=0.0), *plain.drives[1:])}, "momentum"),
        ({"adaptive": AdaptiveGain(maximum=1.0, rate=0.1, **quiet)}, "adaptive gain"),
    ):
        settings = dataclasses.replace(plain, **changed)
        with pytest.raises(ConfigError, match=f"{lacking}.*which the settings ask for"):
            run_trial(random_package(), settings, random_article(), STAGES[:1])
        step = check_shadow_run(random_package(), GateRig(random_article(), settings), GateTrials())
        assert not step.passed
        assert "which the settings ask for" in step.said


def test_what_is_for_small_processors_runs_by_the_reference():
    """In single precision, and with an inner loop of its own."""
    single = to_single(random_package())
    assert run_trial(single, plain_settings(), random_article(), STAGES[:1]).computer == REFERENCE


@pytest.mark.usefixtures("compiler")
def test_what_the_engine_does_not_take_is_refused_in_its_words():
    trial = run_trial(
        to_single(random_package()), plain_settings(), random_article(), STAGES, computer="engine"
    )
    assert "single precision" in trial.refused
    assert len(trial.u) == 0


def test_a_plant_becomes_an_article_whatever_its_noises_and_sensors_count():
    """In modal form, from its own matrices: more sensors than noises, and fewer."""
    rng = np.random.default_rng(4)
    turns = ([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]] for a in (0.1, 0.7))
    modes = 0.95 * sla.block_diag(*turns)
    B, C = rng.standard_normal((4, 3)), rng.standard_normal((3, 4))
    system = SampledStateSpace(modes, B, C, np.zeros((3, 3)), period_s=PERIOD_S)
    u, y = (tuple(Port(f"{side}{i}", "m") for i in range(3)) for side in "uy")
    plant = Plant(dynamics=system, inputs=u, outputs=y)
    for noises, sensors in ((1, 3), (3, 1), (0, 2)):
        disturbed, reads = [f"u{i}" for i in range(noises)], [f"y{i}" for i in range(sensors)]
        article = linear_article(plant, PERIOD_S, ["u2"], reads, disturbed=disturbed, disturbance_rms=0.5)
        assert article.pairs == 2
        for gain, given in ((article.B, B[:, 2:]), (article.G, 0.5 * B[:, :noises])):
            power, own = np.eye(4), np.eye(4)
            for _ in range(5):
                np.testing.assert_allclose(article.C @ own @ gain, C[:sensors] @ power @ given, atol=1e-12)
                power, own = modes @ power, article.A @ own


@pytest.mark.usefixtures("compiler")
def test_an_engine_without_a_driver_says_so():
    """The template compiles with every engine, and drives nothing."""
    with pytest.raises(DataError, match="built without a driver"):
        run_trial(random_package(), plain_settings(), DriverRig(), STAGES[:1])
