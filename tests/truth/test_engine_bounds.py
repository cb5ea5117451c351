"""What the engine bounds of its own accord: how long a law takes to leave, and what a wheel has stored."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from engine_cases import (
    OUTPUTS,
    SENSORS,
    kinds,
    plain_settings,
    random_package,
    static_package,
    still_article,
)
from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.interface.monitors import Monitor
from middeck.realtime.engine.interface.settings import LEAST_RAMP, Drive, SensorTest, Spread
from middeck.realtime.engine.process.launch import started_settings
from middeck.realtime.engine.rigs.linear_article import Fault
from middeck.realtime.package.filter_sections import SMALLEST, LoopPath, static_gain
from middeck.realtime.package.reference import ReferenceLaw
from middeck.signals.ports import Port
from packaged_laws import PERIOD_S, ports
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
STILL = still_article(np.full(SENSORS, 0.5))
RAMP_S, LEAVE_S = 7.0, 0.61
"""3500 samples are no multiple of 305: some samples fall by eleven levels, some by twelve."""


def long_package(gain=0.2, **changes):
    return static_package(np.full((OUTPUTS, SENSORS), gain), limit=0.5, **{"ramp_s": RAMP_S, **changes})


def fallen(ramp, within):
    """3 s^2 - 2 s^3 of the level after each sample, which falls by ramp / within on the average."""
    k = np.arange(within + 2)
    s = np.maximum(ramp - k * ramp // within, 0) / ramp
    return s * s * (3.0 - 2.0 * s)


def test_a_law_leaves_within_what_the_settings_allow():
    """Hours of its own ramp are how it may rise, not how it may leave."""
    settings = plain_settings(ramp_s=0.3, leave_s=LEAVE_S)
    ramp, within = settings.samples(RAMP_S), settings.samples(LEAVE_S)
    with Supervisor(settings, STILL) as engine:
        assert engine.load(long_package()).done
        engine.reset()
        engine.command("engage", values=[1.0])
        risen = engine.run(ramp)["u"][:, 0]
        assert engine.state == "control"
        engine.command("disengage")
        u = engine.run(within + 2)["u"][:, 0]
        assert engine.state == "ready"
        engine.command("engage", values=[1.0])
        again = engine.run(ramp)["u"][:, 0]
    assert np.allclose(u, 0.3 * fallen(ramp, within), atol=1e-12)
    assert np.abs(np.diff(u)).max() <= 0.01 * 0.5
    assert np.array_equal(again, risen)


def test_a_law_that_is_relieved_leaves_as_fast():
    """Beside the other slot, which rises along its own ramp; at the shortest time that settings can name."""
    settings = plain_settings(ramp_s=0.0, leave_s=0.0)
    with Supervisor(settings, STILL) as engine:
        assert engine.load(long_package()).done
        assert engine.load(long_package(-0.1, name="other", ramp_s=0.0), slot=1).done
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.run(settings.samples(RAMP_S), keep=False)
        engine.command("engage", slot=1, values=[1.0])
        records = engine.run(2 * LEAST_RAMP + 2)
        engine.load(long_package(0.1))
        assert engine.state == "control"
    assert np.allclose(records["added_0"][:, 0], 0.3 * fallen(3500, 2 * LEAST_RAMP), atol=1e-12)
    assert np.abs(np.diff(records["u"][:, 0])).max() <= 0.01 * 0.5
    assert np.allclose(records["u"][-1], -0.15)


def test_a_wheel_counts_from_what_it_has_stored():
    """The engine after this one is told where this one has stopped."""
    _, u = ports(0, SENSORS, OUTPUTS)

    def settings(stored):
        first, second = (
            Drive(port=port, lower=-0.5, upper=0.5, momentum=0.5, stored=s)
            for port, s in zip(u, stored, strict=True)
        )
        return plain_settings(drives=(first, second))

    with Supervisor(settings((0.3, -0.7)), STILL) as engine:
        assert engine.momentum.tolist() == [0.3, -0.7]
        engine.reset()
        engine.set_strip("u0", "offset", 0.1)
        engine.set_strip("u1", "offset", 0.1)  # a wheel beyond its limit may come back
        records = engine.run(800)
        assert not any(event.trips for event in engine.events())
    stored = engine.momentum
    pushed = PERIOD_S * np.cumsum(engine.file.ring["u"][: engine.sample], axis=0)[-1]
    assert np.allclose(stored - pushed, (0.3, -0.7), atol=1e-12)
    assert records["u"][-1].tolist() == [0.1, 0.1]
    with Supervisor(settings(stored), STILL) as engine:
        engine.reset()
        engine.set_strip("u0", "offset", 0.1)
        engine.run(600, keep=False)
        assert kinds(engine)[-1] == "momentum"


@pytest.mark.parametrize("stored", [None, np.nan, np.inf])
def test_a_wheel_without_what_it_has_stored_is_refused(stored):
    _, (u, _) = ports(0, SENSORS, OUTPUTS)
    with pytest.raises(ConfigError, match=r"momentum 0\.5 counted from"):
        Drive(port=u, lower=-0.5, upper=0.5, momentum=0.5, stored=stored)


WATCHED = plain_settings(
    monitors=(Monitor(channel="y0", band_hz=(2.0, 12.0), limit=1.0, factor=1.2),),
    spreads=(Spread("y0", "y1", 0.1, 0.5),),
)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda w: w["monitor"]["limit"].__setitem__(0, np.nan), "nothing exceeds"),
        (lambda w: w["monitor"]["floor"].__setitem__(0, np.nan), "nothing exceeds"),
        (lambda w: w["monitor"]["times"].__setitem__(0, 0), "nothing exceeds"),
        (lambda w: w["monitor"]["forget"].__setitem__(0, 0.0), "nothing exceeds"),
        (lambda w: w["monitor"]["band"]["g"].__setitem__((0, 0, 4), 1.0), "finite and stable"),
        (lambda w: w["spread"]["limit"].__setitem__(0, np.nan), "without a limit"),
        (lambda w: w["spread"]["samples"].__setitem__(0, 0), "without a limit"),
        (lambda w: w["spread"]["limit"].__setitem__(0, np.inf), "without a limit"),
        (lambda w: w["spread"]["second"].__setitem__(0, 0), "without a limit"),
        (lambda w: w["monitor"]["floor"].__setitem__(0, np.inf), "nothing exceeds"),
        (lambda w: w["monitor"]["factor"].__setitem__(0, np.inf), "nothing exceeds"),
        (lambda w: w.__setitem__("effort_share", np.inf), "an effort"),
        (lambda w: w.__setitem__("effort_share", np.nan), "an effort"),
        (lambda w: w.__setitem__("effort_share", 1.0), "an effort"),
        (lambda w: w.__setitem__("ramp", 0), "a time"),
        (lambda w: w.__setitem__("leave", 0), "a time"),
        (lambda w: w["stored"].__setitem__(1, np.nan), "limits that no engine keeps"),
        (lambda w: w["coast"].__setitem__(0, 1e100), "a test that no engine runs"),
    ],
)
def test_the_engine_itself_refuses_a_test_that_would_never_trip(monkeypatch, spoil, reason):
    """A comparison with what is no number is never true: that watch would be off, and nobody would know."""

    def spoilt(*given):
        words = started_settings(*given)
        spoil(words)
        return words

    monkeypatch.setattr("middeck.realtime.engine.process.supervisor.started_settings", spoilt)
    with pytest.raises(DataError, match=reason):
        Supervisor(WATCHED, STILL)


def test_settings_refuse_it_first():
    band = {"channel": "y0", "band_hz": (2.0, 12.0)}
    for wrong in (
        {"floor": np.nan}, {"limit": np.nan}, {"seconds": np.inf}, {"window_s": np.inf}, {"window_s": 1e300},
        {"floor": np.inf}, {"factor": np.inf}, {"times": 2.5}, {"side": "motor"},
    ):  # fmt: skip
        with pytest.raises(ConfigError, match="monitor of y0: band"):
            Monitor(**band, **wrong)
    for edges in ((1.0,), (1.0, 2.0, 3.0), 2.0):
        with pytest.raises(ConfigError, match="monitor of y0: a band of"):
            Monitor(channel="y0", band_hz=edges)  # ty: ignore[invalid-argument-type]
    low = Monitor(channel="y0", band_hz=(1e-9, 1.0), limit=1.0)
    with pytest.raises(ConfigError, match="round to the unit circle"):
        Supervisor(plain_settings(monitors=(low,)), STILL)


def named(*names):
    return {"sensors": tuple(SensorTest(port=Port(name, "rad"), range=10.0) for name in names)}


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (named("y0", "y0\0", "y2"), "the name"),
        (named("\ud800", "y1", "y2"), "the name"),
        (named("", "y1", "y2"), "the name"),
        (named("y0", "a\n", "y2"), "the name"),
        ({"period_s": 1e-300}, "a period"),
        ({"period_s": 1e300}, "a period"),
        ({"late_most": 10**30}, "late_most"),
        ({"late_most": 2.5}, "late_most"),
        ({"processor": -1}, "processor"),
        ({"effort_share": np.inf}, "effort_share"),
        ({"effort_share": 1.0}, "effort_share of 1.0, which nothing exceeds"),
        ({"hold": (LoopPath(0.5, 0, static_gain(-1.0)),)}, "a hold from sensor"),
        ({"spreads": (Spread("y0", "y0", 1.0, 1.0),)}, "sensors y0 and y0"),
        ({"spreads": (Spread("y0", "y1", np.inf, 1.0),)}, "apart by inf"),
    ],
)
def test_what_no_engine_can_keep_is_refused_by_its_settings(wrong, reason):
    """Names that differ for one side only, times that are no count of samples, tests that nothing fails."""
    with pytest.raises(ConfigError, match=reason):
        plain_settings(**wrong)


@pytest.mark.parametrize(
    ("article", "given", "reason"),
    [
        ({"A": np.full((SENSORS, SENSORS), np.nan)}, {}, "not finite"),
        ({"sensor_noise": np.full(SENSORS, np.inf)}, {}, "not finite"),
        ({"seed": 1 << 64}, {}, "the seed"),
        ({"faults": (Fault(kind="sensor swap", value=1.5),)}, {}, "sensor swap at channel"),
        ({"faults": (Fault(kind="sensor nan", channel=0.5),)}, {}, "sensor nan at channel"),
        ({}, {"ring": -5}, "a ring"),
        ({}, {"pretrip_s": -1.0}, "before a trip"),
        ({}, {"pretrip_s": np.nan}, "before a trip"),
        ({}, {"pretrip_s": np.inf}, "before a trip"),
    ],
)
def test_an_engine_is_not_started_on_what_it_cannot_run(article, given, reason):
    with pytest.raises(ConfigError, match=reason):
        Supervisor(plain_settings(), still_article(np.zeros(SENSORS), **article), **given)


def test_a_fault_has_a_time():
    for wrong in ({"start": 50, "end": 1}, {"start": 2**70, "end": 2**71}, {"start": -1}):
        with pytest.raises(ConfigError, match="from sample"):
            Fault(kind="sensor nan", **wrong)


def test_what_is_no_number_is_no_command():
    with Supervisor(plain_settings(), STILL) as engine:
        for wrong in ({"slot": 2**70}, {"slot": 0.5}, {"values": ["a"]}, {"at": 2**70}, {"at": 2.5}):
            with pytest.raises(ConfigError, match="engage: "):
                engine.send("engage", **wrong)
        engine.reset()
        assert engine.set_strip("u0", "hold", 0.5).word == "out of range"
        assert engine.set_strip("u0", "hold", 1.0).done


def test_what_decays_becomes_zero_before_it_leaves_the_normal_numbers():
    """There a processor takes a hundred times as long: a quiet article would make the loop late."""
    package = random_package(states=20)
    article = still_article(np.zeros(SENSORS), x=np.full(SENSORS, 1e-260), A=0.9 * np.eye(SENSORS))
    with Supervisor(plain_settings(), article, ring=6000) as engine:
        engine.load(package)
        engine.reset()
        engine.command("engage", values=[1.0])
        records = engine.run(5000)
    law = ReferenceLaw(dataclasses.replace(package, ramp=max(package.ramp, 250)))
    found, sizes = [], []
    for y, u in zip(records["y"], records["u"], strict=True):
        found.append(law.compute(y))
        law.commit(u)
        sizes.append(np.abs(law.x))
    assert np.array(found).tobytes() == records["added_0"].tobytes()
    assert 0.0 < np.max(sizes) < 1e-255
    assert np.all((np.array(sizes) == 0.0) | (np.array(sizes) >= SMALLEST[np.float64]))
    assert not np.any(sizes[-1])


def test_no_law_engages_before_safe_has_something_to_fall_back_on():
    """What destabilises may take the article far beyond its envelope while SAFE can only let it go."""
    hold = (LoopPath(0, 0, static_gain(-0.1)),)
    settings = plain_settings(hold=hold, ramp_s=0.3, verify_s=1.0)
    with Supervisor(settings, STILL) as engine:
        engine.load(long_package(ramp_s=0.3))
        engine.reset()
        engine.run(settings.samples(settings.rise_s) + 100)
        assert engine.command("standby").done
        assert engine.command("engage", values=[1.0]).word == "not ready"
        engine.run(settings.samples(settings.verify_s))
        assert engine.file.status["hold_verified"]
        assert engine.command("engage", values=[1.0]).done
        engine.run(200)
        engine.stop()
        engine.run(10)
        engine.reset()  # a verified hold has held on: nothing is to be waited for
        assert engine.command("engage", values=[1.0]).done
