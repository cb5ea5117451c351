"""Order of authority in the engine: what trips, what SAFE does, what a reset may undo."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg

from engine_cases import (
    OUTPUTS,
    SENSORS,
    kinds,
    plain_settings,
    random_article,
    random_package,
    static_package,
    still_article,
    verified,
)
from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.files.laws.blacklists import load_blacklist, write_blacklist
from middeck.realtime.engine.interface.adaptive_gain import AdaptiveGain
from middeck.realtime.engine.interface.monitors import Monitor
from middeck.realtime.engine.interface.settings import Drive, SensorTest, Spread
from middeck.realtime.engine.rigs.linear_article import Fault, encode_article, linear_article
from middeck.realtime.package.filter_sections import InputFilter, LoopPath, static_gain
from middeck.realtime.package.package_bytes import hash_law, hash_package
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.reference import ReferenceLaw
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace
from packaged_laws import PERIOD_S, ports, random_law
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
GAIN = -0.02
HOLD = (LoopPath(0, 0, static_gain(GAIN)), LoopPath(1, 1, static_gain(GAIN)))
RAMP, SAFE_RAMP = 250, 10


def held_settings(**changes):
    return plain_settings(**{"hold": HOLD, "verify_s": 0.1, **changes})


def test_safe_knows_no_strip():
    """Gain, offset and limiter of a strip would bend the hold, or leave a torque where none should be."""
    with Supervisor(held_settings(), still_article([0.5, -0.5, 0.0])) as engine:
        verified(engine)
        engine.set_strip("u0", "gain", -5.0)
        engine.set_strip("u1", "offset", 0.3)
        engine.run(2000, keep=False)
        engine.stop()
        records = engine.run(50)
        assert np.allclose(records["u"][SAFE_RAMP:], GAIN * records["y"][SAFE_RAMP:, :2], rtol=1e-12)
        engine.reset()
        again = engine.run(1000)
        assert np.allclose(again["u"], again["hold"])


def test_an_unverified_hold_is_none():
    with Supervisor(held_settings(), still_article([0.5, -0.5, 0.0])) as engine:
        engine.reset()
        engine.run(RAMP, keep=False)
        engine.stop()
        records = engine.run(50)
        assert np.all(records["u"][0] != 0.0)
        assert not np.any(records["u"][SAFE_RAMP:])


def test_after_a_reset_the_hold_rises():
    """From zero, and by at most the steepest step of its fade."""
    with Supervisor(held_settings(), still_article([0.5, -0.5, 0.0])) as engine:
        engine.reset()
        u = engine.run(RAMP + 20)["u"]
    steps = np.abs(np.diff(u, axis=0, prepend=0.0))
    assert steps.max() <= 1.5 / RAMP * 0.5 * abs(GAIN) * 1.0001
    assert np.allclose(u[-1], [0.5 * GAIN, -0.5 * GAIN])


@pytest.mark.parametrize("hold", [HOLD, ()], ids=["held", "not held"])
def test_a_reset_at_once_makes_no_jump(hold):
    """What SAFE has not yet taken away goes on falling at its pace."""
    settings = held_settings(hold=hold)
    with Supervisor(settings, still_article([0.5, 0.5, 0.5])) as engine:
        engine.load(static_package(np.full((OUTPUTS, SENSORS), 0.3)))
        engine.reset()
        engine.run(RAMP + 60, keep=False)
        engine.command("engage", values=[1.0])
        engine.run(RAMP + 50, keep=False)
        engine.stop()
        before = engine.run(3)
        engine.reset()
        after = engine.run(100)
    u = np.concatenate([before, after])["u"][:, 0]
    assert np.abs(np.diff(u)).max() <= 1.5 / SAFE_RAMP * 0.47
    assert np.all(np.diff(u[:SAFE_RAMP]) < 0.0)
    assert np.allclose(u[SAFE_RAMP:], 0.5 * GAIN if hold else 0.0)


@pytest.mark.parametrize(("length", "holds"), [(SAFE_RAMP, True), (SAFE_RAMP + 5, False)])
@pytest.mark.parametrize("fault", ["sensor nan", "rig silent"])
def test_the_hold_lives_through_a_short_silence_of_its_sensors(fault, length, holds):
    """On their last values; after a longer one nothing holds until a reset, though the sensor comes back."""
    start = RAMP + 100
    rig = still_article([0.5, -0.5, 0.0], faults=(Fault(kind=fault, start=start, end=start + length),))
    with Supervisor(held_settings(), rig) as engine:
        verified(engine)
        records = engine.run(start + 100 - engine.sample)
        assert engine.state == "safe"
        assert ("hold lost" not in kinds(engine)) == holds
        expected = GAIN * np.array([0.5, -0.5]) if holds else np.zeros(2)
        assert np.allclose(records["u"][-1], expected)
        assert engine.reset().done
        assert np.allclose(engine.run(RAMP + 50)["u"][-1], GAIN * np.array([0.5, -0.5]))


def test_a_stop_in_safe_is_a_new_trip():
    """A reset that names the trip before it does not undo it."""
    with Supervisor(plain_settings(), random_article()) as engine:
        engine.reset()
        engine.run(5, keep=False)
        engine.stop()
        engine.run(5, keep=False)
        old = engine.trip
        late = engine.send("reset", values=[old], at=engine.sample + 3)
        engine.stop()
        engine.run(5, keep=False)
        assert engine.answer(late).word == "wrong trip"
        assert engine.state == "safe"
        assert [event.kind for event in engine.events() if event.trips] == ["stop", "stop"]
        assert engine.reset().done


def test_a_compensator_that_overflows_trips_and_is_banned():
    """Its limits would make zero of what is no number, and nobody would know."""
    law = random_law(np.random.default_rng(3), 4, SENSORS, OUTPUTS)
    s = law.sampled
    wild = dataclasses.replace(
        law, dynamics=SampledStateSpace(1e3 * s.A, s.B, s.C, s.D, period_s=PERIOD_S), applied=None
    )
    package = package_law(wild, "law", limit=0.5, unstable=True, form="dense")
    settings = plain_settings(effort_s=0.0)
    with Supervisor(settings, random_article()) as engine:
        assert engine.load(package).done
        engine.reset()
        engine.command("engage", values=[1.0])
        records = engine.run(400)
        trip = next(event for event in engine.events() if event.trips)
        assert trip.kind == "command not finite"
        assert trip.side == "output"
        assert trip.sha256 == hash_package(package)
        assert engine.blacklist() == (hash_law(package),)
        assert np.isfinite(records["u"]).all()
        assert engine.load(package).word == "on blacklist"
    with Supervisor(settings, random_article()) as engine:  # in the shadow it only stops
        engine.load(package)
        engine.reset()
        engine.command("standby")
        engine.run(400, keep=False)
        assert engine.state == "ready"
        assert len(engine.blacklist()) == 1
        assert engine.command("engage", values=[1.0]).word == "on blacklist"


@pytest.mark.parametrize("trust", [True, False], ids=["verified", "unverified"])
def test_a_trip_within_a_sample_begins_the_ramp_in_it(trust):
    """From the last command to what SAFE has, though the hold was computed for another state."""
    law = random_law(np.random.default_rng(3), 4, SENSORS, OUTPUTS)
    s = law.sampled
    wild = SampledStateSpace(1e30 * s.A, s.B, s.C, s.D, period_s=PERIOD_S)
    package = package_law(
        dataclasses.replace(law, dynamics=wild, applied=None), "law", limit=0.5, unstable=True, form="dense"
    )
    with Supervisor(held_settings(verify_s=0.1 if trust else 0.0), still_article([0.5, -0.5, 0.1])) as engine:
        engine.load(package)
        engine.reset()
        engine.run(RAMP + 60, keep=False)
        engine.command("engage", values=[1.0])
        records = engine.run(60)
        trip = next(event for event in engine.events() if event.trips)
        assert trip.kind == "command not finite"
    at = trip.sample - RAMP - 60
    before, now = records["u"][at - 1], records["u"][at]
    first = 3.0 / SAFE_RAMP**2 - 2.0 / SAFE_RAMP**3
    aim = GAIN * records["y"][at, :2] if trust else np.zeros(OUTPUTS)
    assert np.allclose(now, (1.0 - first) * before + first * aim, rtol=1e-12)


@pytest.mark.parametrize("state", ["ready", "identify", "engaging", "control", "disengaging"])
@pytest.mark.parametrize("kind", ["sensor nan", "sensor add"])
def test_a_sample_that_cannot_be_moves_no_output(kind, state):
    """Its command is the first step from the last one to what SAFE has for the last good sample."""
    start = 1300
    rig = still_article([0.5, -0.5, 0.1], faults=(Fault(kind=kind, start=start, end=start + 1, value=1e3),))
    with Supervisor(held_settings(), rig, waveform=np.full((40, OUTPUTS), 0.1)) as engine:
        engine.load(static_package(np.full((OUTPUTS, SENSORS), 0.3)))
        verified(engine)
        if state == "identify":
            engine.run(start - 20 - engine.sample, keep=False)
            engine.command("excite", values=[0.0])
        elif state != "ready":
            wait = {"engaging": 100, "control": 400, "disengaging": 500}[state]
            engine.run(start - wait - engine.sample, keep=False)
            engine.command("engage", values=[1.0])
        if state == "disengaging":
            engine.run(start - 100 - engine.sample, keep=False)
            engine.command("disengage")
        (before,) = engine.run(start - engine.sample)[-1:]
        assert engine.state == state
        (now,) = engine.run(1)
        assert engine.state == "safe"
    first = 3.0 / SAFE_RAMP**2 - 2.0 / SAFE_RAMP**3
    aim = GAIN * np.array([0.5, -0.5])
    assert np.allclose(now["u"], (1.0 - first) * before["u"] + first * aim, rtol=1e-12)


def test_a_slew_limit_makes_no_jump_where_two_compensators_run():
    """Each goes on from what it has added itself, not from what both have."""
    first = static_package(np.full((OUTPUTS, SENSORS), 0.2))
    second = static_package(np.full((OUTPUTS, SENSORS), 0.21), slew_rate=0.5)
    with Supervisor(plain_settings(), still_article([0.5, 0.5, 0.5])) as engine:
        engine.load(first, slot=0)
        engine.load(second, slot=1)
        engine.reset()
        engine.command("engage", slot=0, values=[1.0])
        engine.run(600, keep=False)
        engine.command("standby", slot=1)
        shadow = engine.run(100)
        assert not np.any(shadow["added_1"])
        engine.command("engage", slot=1, values=[1.0])
        u = engine.run(600)["u"]
    assert np.abs(np.diff(u, axis=0)).max() <= 0.01 * 0.5
    assert np.allclose(u[-1], 0.315)


def test_less_authority_is_a_fade_and_no_jump():
    with Supervisor(plain_settings(), still_article([0.5, 0.5, 0.5])) as engine:
        engine.load(static_package(np.full((OUTPUTS, SENSORS), 0.3)))
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.run(600, keep=False)
        engine.command("engage", values=[0.25])
        u = engine.run(600)["u"]
        assert engine.state == "control"
    assert np.abs(np.diff(u, axis=0)).max() <= 0.01 * 0.5
    assert 0.0 < u[-1, 0] < 0.25 * 0.45


def test_momentum_outlives_a_reset_and_safe_adds_none():
    """A wheel does not stop because someone has pressed a key."""
    _, u = ports(0, SENSORS, OUTPUTS)
    drives = tuple(Drive(port=port, lower=-0.5, upper=0.5, momentum=0.05, stored=0.0) for port in u)
    settings = held_settings(drives=drives)
    with Supervisor(settings, still_article([-10.0, 0.0, 0.0])) as engine:  # 0.2 N m from the hold
        engine.reset()
        records = engine.run(1000)
        assert kinds(engine)[-1] == "momentum"
        for _ in range(3):
            engine.reset()
            records = np.concatenate([records, engine.run(1000)])
        assert engine.trip == 4
    turned = np.cumsum(records["u"][:, 0]) * PERIOD_S
    assert turned.max() <= 0.05 + (1 + SAFE_RAMP / 2) * 0.2 * PERIOD_S  # a sample, then the fall of the ramp
    steepest = 1.5 / SAFE_RAMP  # of 3 s^2 - 2 s^3
    assert np.abs(np.diff(records["u"][:, 0])).max() <= steepest * 0.2


@pytest.mark.parametrize(("share", "trips"), [(0.49, []), (0.51, ["effort"])])
def test_an_output_beyond_its_share_of_the_limit_is_an_effort(share, trips):
    settings = plain_settings(effort_s=0.1, effort_share=0.5)
    with Supervisor(settings, still_article([0.0, 0.0, 0.0])) as engine:
        engine.reset()
        engine.set_strip("u0", "offset", share * 0.5)
        engine.run(1000, keep=False)
        assert [event.kind for event in engine.events() if event.trips] == trips


def test_a_compensator_at_its_own_limit_is_an_effort():
    """Far below the engine's, as a limit cycle of a fast mode is; in slew as in size."""
    settings = plain_settings(effort_s=0.5)
    y = np.array([0.5, 0.5, 0.5])
    small = static_package(np.full((OUTPUTS, SENSORS), 0.3), limit=1e-3)
    with Supervisor(settings, still_article(y)) as engine:
        engine.load(small)
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.run(1000, keep=False)
        trip = next(event for event in engine.events() if event.trips)
        assert (trip.kind, trip.channel, trip.side) == ("effort", "u0", "output")
        assert len(engine.blacklist()) == 1
    slow = static_package(np.full((OUTPUTS, SENSORS), 0.3), slew_rate=1e-3)
    with Supervisor(settings, still_article(y)) as engine:
        engine.load(slow)
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.run(1000, keep=False)
        assert "effort" in kinds(engine)


def test_a_trip_of_the_hold_alone_unlearns_it():
    """What trips in READY is what holds, and SAFE must not go on with it."""
    wild = (LoopPath(0, 0, static_gain(0.5)),)
    A = np.diag([0.999, 0.9, 0.9])
    rig = random_article(states=3, A=A, B=np.array([[0.01, 0.0]] * 3), C=np.eye(3), G=1e-6 * np.eye(3))
    monitor = Monitor(channel="y0", band_hz=(0.0, np.inf), window_s=0.1, factor=1.2, floor=1e-4)
    settings = plain_settings(hold=wild, verify_s=0.002, ramp_s=0.3, monitors=(monitor,))
    with Supervisor(settings, rig) as engine:
        engine.reset()
        records = engine.run(3000)
        found = kinds(engine)
        assert found.index("hold verified") < found.index("growth") < found.index("hold lost")
    assert not np.any(records["u"][-1])


def test_a_hold_that_drives_the_article_out_is_let_go():
    """An eighth beyond where it took over; a hold that only keeps it there goes on."""
    plain = plain_settings()
    sensors = tuple(dataclasses.replace(sensor, envelope=1.0) for sensor in plain.sensors)
    for gain, lost in ((0.05, True), (-0.05, False)):
        rig = still_article([0.3, 0.0, 0.0], A=np.diag([1.0, 0.5, 0.5]), B=np.array([[0.1, 0.0]] * 3))
        hold = (LoopPath(0, 0, static_gain(gain)),)
        with Supervisor(held_settings(hold=hold, sensors=sensors), rig) as engine:
            verified(engine)
            engine.stop()
            engine.run(1, keep=False)
            records = engine.run(1500)
            found = [event for event in engine.events() if event.kind == "hold lost"]
        assert bool(found) == lost
        if lost:
            assert found[0].value == pytest.approx(1.125, rel=0.006)  # a step of half a per cent
            assert not np.any(records["u"][-1])


def test_a_sensor_that_stands_off_at_power_up_is_no_step():
    """Filters begin as if its value had always been there."""
    band = Monitor(channel="y0", band_hz=(2.0, 12.0), limit=1e-9)
    with Supervisor(plain_settings(monitors=(band,)), still_article([5.0, 0.0, 0.0])) as engine:
        engine.reset()
        engine.run(100, keep=False)
        assert engine.state == "ready"


@pytest.mark.parametrize(("share", "trips"), [(0.99, True), (1.01, False)])
def test_growth_needs_windows_to_grow_from(share, trips):
    """The first window after a reset has none before it; a slower growth is none."""
    rate, window = 0.02, 50
    rig = still_article([1e-3, 0.0, 0.0], A=np.diag([1.0 + rate, 1.0, 1.0]))
    factor = (1.0 + rate) ** window
    monitor = Monitor(
        channel="y0", band_hz=(0.0, np.inf), window_s=window * PERIOD_S, factor=share * factor, times=3
    )
    with Supervisor(plain_settings(monitors=(monitor,)), rig) as engine:
        engine.reset()
        engine.run(5 * window, keep=False)
        found = [(event.kind, event.sample) for event in engine.events() if event.trips]
        assert found == [("growth", 4 * window - 1)] * trips


def test_an_envelope_looks_ahead_by_the_rate():
    """The amplitude that a pendulum will reach is seen before it is there."""
    omega = 2.0 * np.pi * 1.3
    c, s = np.cos(omega * PERIOD_S), np.sin(omega * PERIOD_S)
    A = np.array([[c, s / omega, 0.0], [-omega * s, c, 0.0], [0.0, 0.0, 1.0]])
    plain = plain_settings()
    sensors = (
        dataclasses.replace(plain.sensors[0], envelope=1.0, rate="y1", coast_s=1.0 / omega),
        *plain.sensors[1:],
    )
    for amplitude, trips in ((0.999, False), (1.001, True)):
        rig = still_article([0.0, amplitude * omega, 0.0], A=A)
        with Supervisor(plain_settings(sensors=sensors), rig) as engine:
            engine.reset()
            engine.run(1, keep=False)
            assert (engine.state == "safe") == trips
            engine.run(2000, keep=False)
            assert (engine.state == "safe") == trips


def test_a_disengaged_slot_takes_another_package():
    with Supervisor(plain_settings(), random_article()) as engine:
        engine.load(random_package())
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.run(600, keep=False)
        assert engine.load(random_package(2)).word == "busy"
        engine.command("disengage")
        engine.run(600, keep=False)
        assert engine.state == "ready"
        assert engine.load(random_package(2)).done


def test_the_law_beside_a_hold_has_the_bits_of_the_reference():
    """Where no limit acts it learns exactly what it asked for, though a hold is added and taken away."""
    package = random_package(limit=5.0, input_range=1e-2)
    wide = tuple(Drive(port=port, lower=-50.0, upper=50.0) for port in ports(0, SENSORS, OUTPUTS)[1])
    with Supervisor(held_settings(drives=wide, verify_s=0.0), random_article()) as engine:
        engine.load(package)
        engine.reset()
        engine.run(RAMP + 10, keep=False)
        engine.command("engage", values=[1.0])
        records = engine.run(2000)
    reference = ReferenceLaw(package)
    expected = np.array([reference.step(row) for row in records["y"]])
    assert np.array_equal(records["added_0"].view(np.int64), expected.view(np.int64))
    assert np.any(records["hold"])


def test_a_full_blacklist_refuses_what_it_does_not_know():
    """Nothing drops out of it to make room."""
    settings, known = plain_settings(effort_s=0.5), [f"{k:064x}" for k in range(1022)]
    with Supervisor(settings, still_article([0.5, 0.5, 0.5]), blacklist=known) as engine:
        package = static_package(np.full((OUTPUTS, SENSORS), 0.3), limit=1e-3)
        assert engine.load(package).done
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.run(600, keep=False)
        assert engine.state == "safe"
        assert engine.blacklist() == (*known, hash_law(package))
        assert engine.load(random_package()).word == "on blacklist"
    with pytest.raises(ConfigError, match="1022 at most"):
        Supervisor(settings, random_article(), blacklist=[*known, "f" * 64])
    with pytest.raises(ConfigError, match="no SHA-256"):
        Supervisor(settings, random_article(), blacklist=["nobody"])


def test_another_name_and_other_limits_are_the_same_law(tmp_path):
    """What tripped is what computes; and the next engine knows it from the gate's file."""
    settings, gain = plain_settings(effort_s=0.5), np.full((OUTPUTS, SENSORS), 0.3)
    guilty = static_package(gain, limit=1e-3)
    others = [
        static_package(gain, limit=1e-3, name="innocent"),
        static_package(gain, limit=0.4, slew_rate=9.0, input_range=7.0, ramp_s=0.7),
        guilty,
    ]
    assert len({hash_package(package) for package in others}) == 3
    assert {hash_law(package) for package in others} == {hash_law(guilty)}
    assert hash_law(static_package(1.0001 * gain)) != hash_law(guilty)
    with Supervisor(settings, still_article([0.5, 0.5, 0.5])) as engine:
        engine.load(guilty)
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.run(600, keep=False)
        assert [engine.load(package).word for package in others] == 3 * ["on blacklist"]
        write_blacklist(tmp_path / "black.json", dict.fromkeys(engine.blacklist(), "effort u0"))
    listed = load_blacklist(tmp_path / "black.json")
    with Supervisor(settings, still_article([0.5, 0.5, 0.5]), blacklist=listed) as engine:
        assert [engine.load(package).word for package in others] == 3 * ["on blacklist"]
        assert engine.command("forgive", slot=0).done
        assert engine.load(others[0]).done
        assert engine.blacklist() == ()


def test_a_law_that_overflows_standing_by_does_not_stay_in_control_from_the_other_slot():
    y, u = ports(0, SENSORS, OUTPUTS)
    system = SampledStateSpace(
        [[1.5]], [[1.0, 0.0, 0.0]], [[1e-300], [0.0]], np.zeros((OUTPUTS, SENSORS)), period_s=PERIOD_S
    )
    law = package_law(Compensator(system, y, u), "law", limit=0.5, unstable=True)
    with Supervisor(plain_settings(), still_article([1.0, 0.0, 0.0])) as engine:
        engine.load(law, slot=0)
        engine.load(law, slot=1)
        engine.reset()
        engine.command("standby", slot=1)
        engine.run(1000, keep=False)
        engine.command("engage", slot=0, values=[1.0])
        engine.run(3000, keep=False)
        banned, trip = (e for e in engine.events() if e.kind in ("blacklisted", "command not finite"))
        assert (banned.kind, trip.sample) == ("blacklisted", banned.sample)
        assert engine.state == "safe"
        assert engine.blacklist() == (hash_law(law),)


@pytest.mark.parametrize("form", ["modal", "dense"])
def test_both_sides_know_a_law_by_the_same_hash(form):
    """Filters, a path of applied commands and blocks of states included."""
    package = random_package(form=form, filters=(InputFilter(1, static_gain(0.5)),))
    with Supervisor(plain_settings(), random_article(), blacklist=[hash_law(package)]) as engine:
        assert engine.load(package).word == "on blacklist"
        assert engine.load(random_package(form=form)).done


def test_sensors_that_read_one_thing_must_agree():
    rig = still_article([0.1, 0.1, 0.0])
    spread = Spread("y0", "y1", 0.01, 0.02)
    for value, trips in ((0.009, False), (0.011, True)):
        faulty = dataclasses.replace(
            rig, faults=(Fault(kind="sensor add", channel=1, start=50, value=value),)
        )
        with Supervisor(plain_settings(spreads=(spread,)), faulty) as engine:
            engine.reset()
            last = engine.run(100)[-1]
            assert (engine.state == "safe") == trips
            assert [e.sample for e in engine.events() if e.kind == "spread"] == ([59] if trips else [])
            assert last["unhealthy"] == (0b11 if trips else 0)  # nobody knows which of them it is


@pytest.mark.parametrize(("length", "trips"), [(10, []), (11, [61])])
def test_a_sensor_that_gives_one_value_for_too_long_is_stuck(length, trips):
    """Ten times in a row the same as before, in noise; one that is not asked may stand for ever."""
    plain = plain_settings()
    sensors = (plain.sensors[0], dataclasses.replace(plain.sensors[1], stuck_s=10 * PERIOD_S))
    rig = still_article([0.1, 0.1], C=np.eye(2), sensor_noise=np.array([0.0, 1e-3]))
    stuck = Fault(kind="sensor stuck", channel=1, start=51, end=51 + length)
    with Supervisor(plain_settings(sensors=sensors), dataclasses.replace(rig, faults=(stuck,))) as engine:
        engine.reset()
        engine.run(100, keep=False)
        assert [(e.kind, e.sample) for e in engine.events() if e.trips] == [("stuck", k) for k in trips]


@pytest.mark.parametrize("hz", [20.0, 45.0])
def test_a_limit_cycle_of_hundredths_of_a_degree_trips_by_its_band(hz):
    """Where its rms exceeds the limit of its band; an envelope of 2 degrees sees nothing of it."""
    angle, limit = 2.0 * np.pi * hz * PERIOD_S, np.radians(0.03)
    A = np.eye(3)
    A[:2, :2] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    monitor = Monitor(channel="y0", band_hz=(12.0, np.inf), limit=limit, seconds=0.1)
    passed = 1.0 / np.sqrt(
        1.0 + (np.tan(0.024 * np.pi) / np.tan(angle / 2.0)) ** 4
    )  # of the band's high pass
    plain = plain_settings(monitors=(monitor,))
    sensors = tuple(dataclasses.replace(sensor, envelope=np.radians(2.0)) for sensor in plain.sensors)
    for rms, trips in ((0.9, []), (1.2, ["band power"])):  # a mean of 0.1 s has a ripple of 4 % at 20 Hz
        rig = still_article([rms * limit / passed * np.sqrt(2.0), 0.0, 0.0], A=A)
        with Supervisor(dataclasses.replace(plain, sensors=sensors), rig) as engine:
            engine.reset()
            engine.run(1000, keep=False)
            assert [event.kind for event in engine.events() if event.trips] == trips


def test_outputs_may_have_the_names_of_sensors():
    """As a loop's torque and its angle have: strips and monitors know which is meant."""
    plain = plain_settings()
    named = tuple(
        dataclasses.replace(drive, port=dataclasses.replace(drive.port, name=sensor.port.name))
        for drive, sensor in zip(plain.drives, plain.sensors, strict=False)
    )
    monitor = Monitor(channel="y1", side="output", band_hz=(0.0, np.inf), limit=0.05, seconds=0.01)
    with Supervisor(
        dataclasses.replace(plain, drives=named, monitors=(monitor,)), still_article([1.0, 1.0, 1.0])
    ) as engine:
        engine.reset()
        assert engine.set_strip("y1", "offset", 0.2).done
        engine.run(500, keep=False)
        trip = next(event for event in engine.events() if event.trips)
        assert (trip.kind, trip.channel, trip.side) == ("band power", "y1", "output")


def test_a_linear_article_has_as_many_disturbances_as_it_likes():
    """With more, and fewer, of them than outputs: variance by Lyapunov's equation."""
    rng = np.random.default_rng(4)
    y, u = ports(0, SENSORS, OUTPUTS)
    A = 0.9 * np.linalg.qr(rng.standard_normal((4, 4)))[0]
    system = SampledStateSpace(
        A,
        rng.standard_normal((4, OUTPUTS)),
        rng.standard_normal((SENSORS, 4)),
        np.zeros((SENSORS, OUTPUTS)),
        period_s=PERIOD_S,
    )
    plant = Plant(dynamics=system, inputs=u, outputs=y)
    for disturbed in (("u0",), ("u0", "u1", "u0")):
        rig = linear_article(
            plant, PERIOD_S, ("u0", "u1"), ("y0", "y1", "y2"), disturbed=disturbed, disturbance_rms=0.3
        )
        assert rig.G.shape == (4, len(disturbed))
        X = scipy.linalg.solve_discrete_lyapunov(rig.A, rig.G @ rig.G.T)
        G = 0.3 * system.B[:, [int(name[1]) for name in disturbed]]
        truth = scipy.linalg.solve_discrete_lyapunov(A, G @ G.T)
        assert np.allclose(rig.C @ X @ rig.C.T, system.C @ truth @ system.C.T, rtol=1e-9)


@pytest.mark.parametrize(
    "fault",
    [
        {"kind": "sensor nan", "channel": SENSORS},
        {"kind": "output dead", "channel": OUTPUTS},
        {"kind": "sensor swap", "value": SENSORS},
        {"kind": "sensor stuck", "channel": -1},
    ],
)
def test_faults_of_channels_that_are_not_there_are_refused(fault):
    with pytest.raises(ConfigError, match="channel"):
        encode_article(dataclasses.replace(random_article(), faults=(Fault(**fault),)))


@pytest.mark.parametrize(
    "wrong",
    [{"kind": "sensor late", "value": 64.0}, {"kind": "encoder wrap", "value": 0.0}, {"kind": "none"}],
)
def test_faults_that_cannot_be_are_refused(wrong):
    with pytest.raises(ConfigError):
        Fault(**wrong)


@pytest.mark.parametrize(
    "wrong",
    [
        {
            "adaptive": AdaptiveGain(
                maximum=1.0, rate=1.0, sensor="y9", band_hz=(1.0, 9.0), quiet_rms=0.1, loud_rms=0.2
            )
        },
        {"spreads": (Spread("y0", "y1", -1.0, 0.1),)},
        {"verify_s": -1.0},
        {"heartbeat_s": np.nan},
        {"late_most": -1},
        {"effort_share": 0.0},
        {"drives": (Drive(port=Port("u" * 65, "N m"), lower=-1.0, upper=1.0),)},
        {"sensors": (SensorTest(port=Port("y0", "rad"), range=1.0, rate="y9", coast_s=1.0),)},
    ],
)
def test_settings_that_cannot_be_are_refused(wrong):
    with pytest.raises(ConfigError):
        plain_settings(**wrong)
