"""What makes safe waits for nothing, and whatever leaves the article leaves it along a ramp."""

from __future__ import annotations

import dataclasses
import signal
import time

import numpy as np
import pytest

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
from middeck.errors import DataError
from middeck.realtime.engine.interface.commands import check_of
from middeck.realtime.engine.interface.settings import Drive, time_to_rest
from middeck.realtime.engine.process import commanded_engine
from middeck.realtime.package.filter_sections import LoopPath, static_gain
from middeck.realtime.package.package_law import package_law
from middeck.systems.state_space.statespace import SampledStateSpace
from packaged_laws import PERIOD_S, ports
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
RAMP, SAFE_RAMP = 250, 10
HOLD = (LoopPath(0, 0, static_gain(-0.4)), LoopPath(1, 1, static_gain(-0.4)))
STEEPEST = 1.5
"""Of 3 s^2 - 2 s^3: its largest step is this over the number of its steps."""
OFF = np.array([0.5, -0.5, 0.0])


def last_of(engine, count):
    """The last ``count`` records of an engine that has ended, from its shared file."""
    ring = engine.file.ring
    rows = np.sort(ring[ring["sequence"] > 0], order="sequence")
    assert np.all(np.diff(rows["sequence"]) == 1)
    return rows[-count:]


def told_by_a_signal(engine):
    engine.process.send_signal(signal.SIGTERM)
    engine.process.wait(10.0)


def told_again_and_again(engine):
    """A second SIGTERM is no other than the first."""
    for _ in range(3):
        engine.process.send_signal(signal.SIGTERM)
        time.sleep(0.01)
    engine.process.wait(10.0)


WAYS = [Supervisor.close, told_by_a_signal, told_again_and_again]


@pytest.mark.parametrize("way", WAYS, ids=["end", "signal", "signals"])
@pytest.mark.parametrize("real_time", [False, True], ids=["lockstep", "clock"])
def test_the_end_is_a_ramp_from_the_law_to_the_hold_and_then_to_zero(tmp_path, way, real_time):
    """0.3 of a law beside the hold's -0.2: SAFE takes the law away, and then the hold falls as it rose."""
    settings = plain_settings(hold=HOLD, verify_s=0.1, late_s=1e3, period_s=PERIOD_S)
    with Supervisor(settings, still_article(OFF), folder=tmp_path, real_time=real_time) as engine:
        verified(engine)
        assert engine.load(static_package(np.array([[0.6, 0, 0], [0, 0.6, 0]]))).done
        engine.command("engage", values=[1.0])
        engine.run(RAMP + 10, keep=False)
        assert engine.state == "control"
        way(engine)
        assert engine.process.returncode == 0
        assert engine.state == "safe"
        assert [event.kind for event in engine.events()][-2:] == ["stop", "ended"]
        rows = last_of(engine, SAFE_RAMP + RAMP + 20)
        u = rows["u"][np.argmax(rows["state"] == 0) - 1 :]
    assert np.allclose(u[0], (0.1, -0.1))
    assert np.abs(np.diff(u[:, 0])).max() <= STEEPEST / SAFE_RAMP * 0.3
    assert np.abs(np.diff(u[SAFE_RAMP + 1 :, 0])).max() <= STEEPEST / RAMP * 0.2
    assert u[:, 0].min() == pytest.approx(-0.2, rel=0.02)
    assert u[-1].tolist() == [0.0, 0.0]


def test_a_trip_and_the_end_keep_the_slew_limits():
    """What a motor cannot do at once takes as long as it takes."""
    _, u = ports(0, SENSORS, OUTPUTS)
    slow = tuple(Drive(port=port, lower=-0.5, upper=0.5, slew_rate=0.5) for port in u)
    with Supervisor(plain_settings(drives=slow), still_article(OFF)) as engine:
        for _ in range(2):
            engine.reset()
            engine.set_strip("u0", "offset", 0.4)
            pushed = engine.run(1000)["u"][:, 0]
            assert pushed[-1] == 0.4
            if engine.trip == 0:
                engine.stop()
                pushed = engine.run(500)["u"][:, 0]
                assert pushed[0] > 0.39
                assert pushed[-1] == 0.0
        file = engine.file
    rows = np.sort(file.ring[file.ring["sequence"] > 0], order="sequence")
    assert np.abs(np.diff(rows["u"][:, 0])).max() <= 0.5 * PERIOD_S + 1e-15
    assert rows["u"][-1, 0] == 0.0


def test_a_trip_seen_after_the_outputs_takes_every_step_of_the_ramp():
    """Effort is judged when outputs have been written: the next sample is the first step."""
    settings = plain_settings(effort_s=0.1, effort_share=0.5)
    with Supervisor(settings, still_article(OFF)) as engine:
        engine.load(static_package(np.full((OUTPUTS, SENSORS), 1.0), limit=0.4))
        engine.reset()
        engine.set_strip("u0", "offset", 0.3)
        records = engine.run(400)
        (trip,) = [event for event in engine.events() if event.trips]
        assert trip.kind == "effort"
    u = records["u"][trip.sample :, 0]
    s = np.arange(SAFE_RAMP + 1) / SAFE_RAMP
    assert np.allclose(u[: SAFE_RAMP + 1], u[0] * (1.0 - s * s * (3.0 - 2.0 * s)), atol=1e-15)
    assert u[0] > 0.2


def test_silence_is_a_ramp():
    """A steady push fades as a law does, and the loop identifies until it is gone."""
    wave = np.tile([0.4, -0.4], (7, 1))
    with Supervisor(plain_settings(), still_article(OFF), waveform=wave) as engine:
        engine.reset()
        assert engine.command("excite", values=[0.0]).done
        engine.run(20)
        assert engine.command("excite", values=[0.0]).word == "busy"
        assert engine.command("silence").done
        falling = engine.run(100)
        assert engine.state == "identify"
        assert engine.command("silence").done  # once more changes nothing
        assert engine.command("excite", values=[1.0]).word == "busy"
        falling = np.concatenate([falling, engine.run(200)])
        assert engine.state == "ready"
        assert kinds(engine) == ["reset done", "excited", "quiet"]
        assert engine.command("excite", values=[1.0]).done
        assert np.array_equal(engine.run(7)["u"], wave)
    level = np.maximum(RAMP - 1.0 - np.arange(300), 0.0) / RAMP
    assert np.allclose(falling["u"], (level**2 * (3.0 - 2.0 * level))[:, None] * wave[0], atol=1e-15)


def test_a_wheel_that_fills_in_safe_is_pushed_less_and_less():
    """x+ = x - (M - x) / n at the end: it never reaches what it may store, and nothing jumps."""
    _, u = ports(0, SENSORS, OUTPUTS)
    drives = tuple(Drive(port=port, lower=-0.5, upper=0.5, momentum=0.5, stored=0.0) for port in u)
    settings = plain_settings(hold=HOLD, verify_s=0.1, drives=drives)
    with Supervisor(settings, still_article(OFF)) as engine:
        verified(engine)
        engine.stop()
        records = engine.run(3000)
        assert engine.state == "safe"
    pushed = records["u"][:, 0]
    stored = np.cumsum(np.concatenate([[0.0], engine.file.ring["u"][:310, 0], pushed])) * PERIOD_S
    assert np.abs(stored).max() <= 0.5
    assert np.abs(stored).max() == pytest.approx(0.5, rel=1e-6)
    assert np.abs(np.diff(pushed)).max() <= 0.2 / SAFE_RAMP
    assert pushed[-1] == pytest.approx(0.0, abs=1e-9)


def test_a_reset_beside_a_full_wheel_does_not_jump():
    """SAFE has let the hold go in part: it rises from there, and trips where the wheel takes no more."""
    _, u = ports(0, SENSORS, OUTPUTS)
    full = Drive(port=u[0], lower=-0.5, upper=0.5, momentum=0.5, stored=0.0)
    settings = plain_settings(hold=HOLD, verify_s=0.1, drives=(full, Drive(port=u[1], lower=-0.5, upper=0.5)))
    with Supervisor(settings, still_article(OFF)) as engine:
        verified(engine)
        engine.stop()
        before = engine.run(900)
        while before["u"][-1, 0] < -0.1:
            before = engine.run(1)
        engine.reset()
        records = np.concatenate([before[-1:], engine.run(300)])
        assert kinds(engine)[-2:] == ["reset done", "momentum"]
    assert np.abs(np.diff(records["u"][:, 1])).max() <= STEEPEST / SAFE_RAMP * 0.2
    assert np.abs(np.diff(records["u"][:, 0])).max() <= STEEPEST / SAFE_RAMP * 0.1


def slow_to_check(seed=5, states=400):
    """A dense law whose poles crowd the unit circle: its check squares the matrix until nothing is left."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.standard_normal((states, states)))[0]
    y, u = ports(0, SENSORS, OUTPUTS)
    system = SampledStateSpace(
        (1.0 - 1e-10) * turn, np.zeros((states, SENSORS)), np.zeros((OUTPUTS, states)),
        np.zeros((OUTPUTS, SENSORS)), period_s=PERIOD_S,
    )  # fmt: skip
    return package_law(Compensator(system, y, u), "slow", limit=0.5, form="dense")


@pytest.fixture(scope="module")
def slow_package():
    return slow_to_check()


def test_what_makes_safe_does_not_wait_for_a_package_that_is_checked(slow_package):
    """Disengage, silence and end go first; an engage that stands before them is withdrawn."""
    settings = plain_settings(late_s=1e3)
    wave = np.full((10, OUTPUTS), 0.1)
    with Supervisor(settings, still_article(OFF), waveform=wave, real_time=True) as engine:
        engine.load(static_package(np.full((OUTPUTS, SENSORS), 0.1)))
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.command("excite", values=[0.0])
        engine.run(RAMP, keep=False)
        loading = engine.send("load", slot=1, values=[engine.file.stage(slow_package)])
        engaging = engine.send("engage", slot=1, values=[1.0])
        exciting = engine.send("excite", values=[0.0])
        for kind, withdrawn in (("disengage", engaging), ("silence", exciting)):
            began = engine.sample
            assert engine.command(kind).done
            assert engine.sample - began < 50
            assert engine.answer(withdrawn).word == "withdrawn"
        assert int(engine.file.status["acknowledged"]) == loading - 1
        standing = engine.send("standby", slot=1)
        engine.run(RAMP + 10, keep=False)
        assert engine.state == "ready"
        assert engine.answer(loading).done  # nobody has disturbed its check
        assert engine.answer(standing).done
        assert engine.state == "ready"
        engine.send("load", slot=0, values=[engine.file.stage(slow_package)])
        began = time.monotonic()
        engine.close()
        assert engine.process.returncode == 0
        assert time.monotonic() - began < 3.0
        assert kinds(engine)[-1] == "ended"


def test_what_makes_safe_does_not_wait_for_a_command_of_later():
    with Supervisor(plain_settings(), random_article()) as engine:
        engine.load(random_package())
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.run(20)
        later = engine.send("engage", values=[0.5], at=10_000)
        assert engine.command("disengage").done
        assert engine.answer(later).word == "withdrawn"
        engine.run(100)
        assert engine.state == "ready"
        began = time.monotonic()
        engine.send("standby", at=1 << 40)
        never = [engine.send("engage", values=[1.0]), engine.send("excite", values=[0.0])]
        engine.close()
        assert time.monotonic() - began < 3.0
        assert [engine.answer(number).word for number in never] == ["withdrawn", "withdrawn"]


def send_many(engine, kind):
    for _ in range(300):
        engine.send(kind)


def test_what_makes_safe_finds_a_place_in_a_full_queue(monkeypatch):
    """Nobody else takes the last places, and an engine that hears no end is told by a signal."""
    with Supervisor(plain_settings(late_s=1e3), random_article(), real_time=True) as engine:
        engine.load(random_package())
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.send("standby", at=1 << 40)
        monkeypatch.setattr(commanded_engine, "PATIENCE_S", 1.0)
        with pytest.raises(DataError, match="does not answer"):
            send_many(engine, "standby")
        assert engine.command("disengage").done
        with pytest.raises(DataError, match="does not answer"):
            send_many(engine, "silence")
        monkeypatch.setattr(commanded_engine, "KEPT_FREE", {"end": 250})
        began = time.monotonic()
        engine.close()
        assert time.monotonic() - began < 3.0
        assert engine.process.returncode == 0


def test_half_a_command_is_none():
    """Its words may reach the engine in any order: it waits until its check comes out."""
    with Supervisor(plain_settings(late_s=1e3), random_article(), real_time=True) as engine:
        engine.reset()
        commands, written = engine.file.commands, int(engine.file.asks["written"])
        number = engine.send("strip", slot=0, values=[1.0, 0.3], at=1 << 40)
        row = commands[number % len(commands)].copy()
        spoilt = row.copy()
        spoilt["at"], spoilt["slot"] = 0, 1
        commands[number % len(commands)] = spoilt
        assert int(engine.file.asks["written"]) == written + 1
        engine.run(30)
        assert int(engine.file.status["acknowledged"]) == number - 1
        assert not engine.run(30)["u"].any()


def hide(engine, number):
    """Take the command of this number out of the shared file; what puts it back."""
    commands = engine.file.commands
    row = commands[number % len(commands)].copy()
    commands[number % len(commands)] = np.zeros((), row.dtype)

    def show():
        row["at"] = 0
        row["check"] = check_of(row)
        commands[number % len(commands)] = row

    return show


def test_a_command_that_arrives_after_what_withdraws_it_is_withdrawn():
    """Its words may become visible after the disengage that was sent later."""
    with Supervisor(plain_settings(), random_article()) as engine:
        engine.load(random_package())
        engine.reset()
        first = engine.send("engage", values=[1.0], at=1 << 40)
        show = hide(engine, first)
        assert engine.command("disengage").done
        show()
        engine.run(5)
        assert engine.answer(first).word == "withdrawn"
        assert engine.state == "ready"
        assert engine.command("engage", values=[1.0]).done  # a later one is not


@pytest.mark.parametrize(("starts", "stops"), [("engage", "disengage"), ("excite", "silence")])
def test_what_was_withdrawn_stays_so_when_an_earlier_command_is_due_later(starts, stops):
    """A second stop, sent before the first one but for a later sample, lets nothing through again."""
    settings, wave = plain_settings(), np.full((500, OUTPUTS), 0.1)
    with Supervisor(settings, random_article(), waveform=wave) as engine:
        engine.load(random_package())
        engine.reset()
        now = engine.sample
        engine.send("standby", at=now + 40)
        engine.send(stops, at=now + 20)
        late = engine.send(starts, values=[1.0 if starts == "engage" else 0.0], at=1 << 40)
        show = hide(engine, late)
        assert engine.command(stops).done
        engine.run(30)
        show()
        engine.run(30)
        assert engine.answer(late).word == "withdrawn"
        assert engine.state == "ready"
        assert not engine.run(5)["u"].any()


def test_an_article_at_rest_ends_at_once():
    """Nothing moves before a reset, and so there is nothing to bring down."""
    with Supervisor(plain_settings(), random_article()) as engine:
        engine.run(5)
    assert int(engine.file.status["sample"]) == 5
    assert int(engine.file.status["trips"]) == 0


def test_time_to_rest_is_what_the_end_takes():
    settings = plain_settings(hold=HOLD, verify_s=0.1)
    with Supervisor(settings, still_article(OFF)) as engine:
        verified(engine)
        before = engine.sample
    took = (int(engine.file.status["sample"]) - before) * PERIOD_S
    assert time_to_rest(settings) - 0.05 <= took <= time_to_rest(settings) + 0.05
    slow = dataclasses.replace(settings, ramp_s=2.0)
    assert time_to_rest(slow) == time_to_rest(settings) + 1.5
