"""A hold that drives the article out, however slowly, is none; one that only has much to do is."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from engine_campaigns import seeds_of
from engine_cases import kinds, plain_settings, static_package, still_article, verified
from middeck.errors import DataError
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.engine.process.launch import started_settings
from middeck.realtime.engine.rigs.linear_article import LinearArticle
from middeck.realtime.package.filter_sections import LoopPath, static_gain
from packaged_laws import PERIOD_S
from repeats import repeats
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
INERTIA, STEP = 1.0, PERIOD_S


def pendulum(
    hz: float, push: float, noise: float = 1e-4, start: float = 1e-3, step: float = STEP
) -> LinearArticle:
    """Angle and rate of a pendulum without damping, exactly sampled; ``push`` is the rms of white torque."""
    w = 2.0 * np.pi * hz
    c, s = np.cos(w * step), np.sin(w * step)
    A = np.array([[c, s / w], [-w * s, c]])
    B = np.array([[(1.0 - c) / w**2], [s / w]]) / INERTIA
    return LinearArticle(
        A=A, B=B, C=np.eye(2), G=push * B, x=np.array([start, 0.0]), sensor_noise=np.full(2, noise), seed=4
    )


def held(rate_gain: float, **changes) -> EngineSettings:
    """Rate feedback alone: a negative gain damps, with a decay of half the gain over the inertia."""
    plain = plain_settings()
    given = {
        "sensors": plain.sensors[:2],
        "drives": (Drive(port=plain.outputs[0], lower=-5.0, upper=5.0),),
        "hold": (LoopPath(1, 0, static_gain(rate_gain)),),
        "verify_s": 2.0,
    }
    return plain_settings(**{**given, **changes})


@pytest.mark.parametrize("efold_s", repeats([8.0, 1.0, 3.0, 30.0], 2))
def test_a_hold_that_drives_the_article_out_slowly_is_not_verified_for_long(efold_s):
    """e-folds from a second to half a minute, on a quiet article: SAFE is zero long before it is far out."""
    rig = pendulum(0.3, push=0.0)
    with Supervisor(held(2.0 * INERTIA / efold_s), rig, ring=1 << 16) as engine:
        engine.reset()
        most = 1e-3 * np.exp(7.0) if efold_s < 8.0 else 1e-3 * np.exp(4.0)
        while np.abs(engine.run(100)["y"][:, 0]).max() < most:
            pass
        found = kinds(engine)
        assert engine.file.status["hold_verified"] == 0
        assert found.count("hold verified") <= 1
        assert engine.state == "ready"
        engine.stop()
        assert not engine.run(50)["u"][15:].any()


@pytest.mark.parametrize("hz", repeats([0.3, 0.05, 2.0]))
def test_a_hold_that_is_pushed_about_stays_verified(hz):
    """An hour of a light pendulum in noise: its motion comes and goes, but does not grow."""
    rig = pendulum(hz, push=0.02)
    with Supervisor(held(-0.05), rig) as engine:
        engine.reset()
        engine.run(1_800_000, keep=False)
        found = kinds(engine)
        assert engine.file.status["hold_verified"] == 1
    assert "hold lost" not in found
    assert found.count("hold verified") == 1


@pytest.mark.parametrize("damping", repeats([0.0, 0.01, 0.3]))
def test_an_article_that_noise_sets_in_motion_loses_no_hold(damping):
    """Without damping a third of the waits see three windows of some length in a row grow by a fifth."""
    rig = pendulum(2.0, push=0.02, noise=1e-6, start=0.0, step=0.02)
    hold = held(-2.0 * damping * INERTIA, verify_s=0.4, period_s=0.02)
    for seed in seeds_of("waits in READY from rest: ten minutes of 24 h"):
        with Supervisor(hold, dataclasses.replace(rig, seed=seed)) as engine:
            engine.reset()
            engine.run(30_000, keep=False)
            found = kinds(engine)
        assert (found.count("hold verified"), found.count("hold lost")) == (1, 0)


def test_safe_does_not_begin_with_a_hold_that_may_drive_out():
    """By e in 30 s: after 66 s it has grown for three windows, which is not yet told, but is for SAFE."""
    with Supervisor(held(2.0 * INERTIA / 30.0), pendulum(0.3, push=0.0)) as engine:
        engine.reset()
        engine.run(33_000, keep=False)
        assert engine.file.status["hold_verified"] == 1
        assert "hold lost" not in kinds(engine)
        engine.stop()
        assert not engine.run(50)["u"][15:].any()
        assert "hold lost" in kinds(engine)


@pytest.mark.parametrize("start", [1.0, 6.0])
def test_without_an_envelope_half_the_range_is_one(start):
    """In SAFE the hold pushes away, by e in 4 s, from a sensor whose envelope is infinite: it is let go."""
    rig = still_article([start, 0.0, 0.0], A=np.diag([1.0, 0.5, 0.5]), B=np.array([[0.01, 0.0]] * 3))
    settings = plain_settings(hold=(LoopPath(0, 0, static_gain(0.05)),), verify_s=0.1)
    with Supervisor(settings, rig) as engine:
        verified(engine)
        engine.stop()
        records = engine.run(6000)
        (lost,) = [event for event in engine.events() if event.kind == "hold lost"]
    y = records["y"][:, 0]
    taken_over = max(5.0, y[50])  # five ramps after the trip
    assert abs(y[lost.sample - records["sequence"][0] + 1]) == pytest.approx(1.125 * taken_over, rel=1e-3)
    assert y.max() < 1.13 * taken_over
    assert not records["u"][-1].any()


def test_a_hold_that_overflows_blames_no_package():
    """Its own numbers are none any more: it trips, adds nothing, and whoever was in control stays welcome."""
    huge = LoopPath(0, 0, static_gain(1e308))
    plain = plain_settings()
    sensors = tuple(dataclasses.replace(sensor, range=1e3) for sensor in plain.sensors)
    rig = still_article([0.0, 0.0, 0.0], A=np.diag([1.0, 1.0, 1.0]), x=np.zeros(3))
    rig = dataclasses.replace(rig, A=np.array([[1, 1, 0], [0, 1, 0], [0, 0, 1.0]]), x=np.array([0, 1e-2, 0]))
    package = static_package(np.zeros((2, 3)))
    with Supervisor(plain_settings(hold=(huge,), sensors=sensors, verify_s=0.0), rig) as engine:
        engine.load(package)
        engine.reset()
        engine.command("engage", values=[1.0])
        records = engine.run(2000)
        trips = [event for event in engine.events() if event.trips]
        assert [trip.kind for trip in trips] == ["command not finite"]
        assert engine.blacklist() == ()
        assert np.isfinite(records["u"]).all()
        assert not records["u"][-1].any()
        assert engine.load(package).done


def test_the_hold_of_a_verified_engine_is_verified():
    """The sensors of a test stand still: nothing grows."""
    sensors = (SensorTest(port=plain_settings().inputs[0], range=10.0), *plain_settings().sensors[1:])
    with Supervisor(
        plain_settings(hold=(LoopPath(0, 0, static_gain(-0.02)),), verify_s=0.1, sensors=sensors),
        still_article([0.5, -0.5, 0.0]),
    ) as engine:
        verified(engine)
        engine.run(5000, keep=False)
        assert engine.file.status["hold_verified"] == 1


def test_the_engine_itself_refuses_an_unstable_section(monkeypatch):
    """Whoever writes the shared file: its own numbers would grow whatever the article does."""

    def spoilt(*given):
        words = started_settings(*given)
        words["path"]["s"]["g"][0, 4] = 1.0
        return words

    monkeypatch.setattr("middeck.realtime.engine.process.supervisor.started_settings", spoilt)
    with pytest.raises(DataError, match="a section that is not finite or not stable"):
        Supervisor(held(-0.05), pendulum(0.3, push=0.0))
