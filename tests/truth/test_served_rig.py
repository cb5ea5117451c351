"""The simulated rig in a process of its own is the rig of `simulate_rig`, whatever the wire does."""

from __future__ import annotations

import dataclasses
import os
import signal
import socket
import struct
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

from engine_cases import OUTPUTS, SENSORS, plain_settings, static_package
from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError, DataError
from middeck.joints.attachment import JointElements
from middeck.joints.friction import Friction
from middeck.laboratory.rig.parts.motors import Motor, Rotor
from middeck.laboratory.rig.parts.sensors import Encoder, Gyro
from middeck.laboratory.rig.plant.drifting_modes import Drift
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.ticks.simulate_rig import cut_blocks, simulate_rig, switch_on
from middeck.laboratory.rig.ticks.stepped import SteppedRig
from middeck.realtime.engine.interface.header import constants
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.engine.process.launch import UdpRig
from middeck.realtime.engine.rigs import udp_replies
from middeck.realtime.engine.rigs.engine_rig import EngineRig
from middeck.realtime.engine.rigs.rig_server import LOOPBACK, serve_rig
from middeck.realtime.engine.rigs.udp_replies import (
    HOLD,
    LONGEST,
    REPLY,
    REQUEST,
    SILENT,
    RigSession,
    seal,
    unseal,
)
from middeck.realtime.engine.trials.served_rig import ServedRig
from middeck.realtime.engine.trials.udp_client import RigClient
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.reference import ReferenceLaw
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace
from plant_builders import sum_of_modes
from repeats import repeats
from served_by_thread import served_by_thread
from ungated import Supervisor

PERIOD_S, SEED, RAMP = 0.002, 7, 150
FIRST, SECOND = 11, 12
"""Sessions of two engines."""
ANGLE, TORQUE = Port("angle", "rad"), Port("torque", "N m")
TURN = Port("turn", "rad")
FRICTION = Friction(slip_torque=0.002, stiffness=2.0, viscous=0.001)


def gimbal() -> Plant:
    """Two modes between a torque, the angle beside it and another."""
    omega = 2.0 * np.pi * np.array([1.5, 9.0])
    beside, other = np.array([1.0, 0.6]), np.array([0.7, -0.4])
    modes = sum_of_modes(
        omega, np.array([0.02, 0.01]), beside[:, None], np.stack([other, beside]), names=("slow", "fast")
    )
    return Plant(dynamics=modes, inputs=(TORQUE,), outputs=(ANGLE, TURN))


def whole_rig(**changes):
    """With a motor's limits and steps, a gyro's errors, an encoder and friction."""
    given = {
        "motors": {"torque": Motor(torque_limit=2.0, resolution=1e-4, rotor=Rotor(0.01, 100.0))},
        "sensors": {"angle": Gyro(bandwidth_hz=100.0, noise=1e-4, bias=1e-3, resolution=1e-5, range=5.0),
                    "turn": Encoder(1e-5)},
        "joints": [JointElements("torque", "turn", (FRICTION,))],
    }  # fmt: skip
    return build_rig(gimbal(), sample_hz=1.0 / PERIOD_S, delay_s=0.006, **{**given, **changes})


def commands(count: int, seed: int = 3) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 1)).repeat(3, axis=0)[:count]


RIGS = {
    "whole": whole_rig,
    "linear": lambda: build_rig(gimbal(), sample_hz=1.0 / PERIOD_S, delay_s=0.0063),
    # Without steps in which a rounding error may be a whole count.
    "fine": lambda: whole_rig(
        motors={"torque": Motor(torque_limit=2.0, rotor=Rotor(0.01, 100.0))},
        sensors={"angle": Gyro(bandwidth_hz=100.0, noise=1e-4, bias=1e-3), "turn": Encoder(1e-12)},
    ),
    "drifting": lambda: whole_rig(drifts=(Drift(("fast",), 2.0, 10.0),)),
}


@pytest.mark.parametrize("kind", ["whole", "linear", "drifting"])
def test_a_rig_stepped_is_the_rig_simulated(kind):
    """Sample by sample and in blocks: limits, steps, noise, friction, drift; beyond a block's end."""
    rig, u = RIGS[kind](), commands(4500)
    rng = np.random.default_rng(SEED)
    start = switch_on(rig, None, 0.5, rng)
    measured = np.concatenate([b.measured for b in simulate_rig(rig, None, cut_blocks(u, 777), rng, start)])
    stepped = SteppedRig(rig, np.random.default_rng(SEED), rest_s=0.5)
    found = np.empty_like(measured)
    for k, row in enumerate(u):
        found[k] = stepped.read()
        stepped.write(row)
    # The sums run in another order: a count of a converter may fall the other way.
    worst = np.abs(found - measured).max() / np.abs(measured).max()
    assert worst < (1e-12 if kind == "linear" else 1e-6)


def settings(**changes) -> EngineSettings:
    given = {
        "sensors": (SensorTest(port=ANGLE, range=10.0), SensorTest(port=TURN, range=10.0)),
        "drives": (Drive(port=TORQUE, lower=-2.0, upper=2.0),),
        "effort_s": 0.0,
        "ramp_s": RAMP * PERIOD_S,
    }
    return EngineSettings(period_s=PERIOD_S, **{**given, **changes})


def damping_package():
    """A lagged rate of the angle beside the motor."""
    lag = SampledStateSpace(
        [[0.8]], [[0.2, 0.1]], [[12.0]], [[-2.5, -1.0]], period_s=PERIOD_S
    )  # fmt: skip
    law = Compensator(lag, (TURN, ANGLE), (TORQUE,))
    return law, package_law(law, "damper", input_range=10.0, limit=2.0, form="dense")


def run_engine(rig: UdpRig, samples: int, waveform=None, **changes) -> np.ndarray:
    with Supervisor(settings(**changes), rig, waveform=waveform) as engine:
        assert engine.load(damping_package()[1]).done
        assert engine.reset().done
        assert engine.command("engage", values=[1.0]).done
        if waveform is not None:
            assert engine.command("excite", values=[0.0]).done
        records = engine.run(samples)
        assert engine.state == "control"
    return records


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("kind", repeats(["fine", "linear"]))
def test_a_package_through_the_engine_is_the_law_in_the_simulation(kind):
    """From the end of its fade on, of rig and law where they then are; nothing is limited."""
    rig, wave, samples = RIGS[kind](), commands(700), 700
    with ServedRig(SteppedRig(rig, np.random.default_rng(SEED), rest_s=0.1)) as served:
        records = run_engine(served, samples, wave)
    law, package = damping_package()
    reference = ReferenceLaw(dataclasses.replace(package, ramp=RAMP, vectors=None))
    rng = np.random.default_rng(SEED)
    start = switch_on(rig, None, 0.1, rng)
    for k in range(RAMP + 50):
        reference.compute(records["y"][k][[1, 0]])
        reference.commit(records["u"][k] - wave[k])
    (before,) = simulate_rig(rig, None, [records["u"][: RAMP + 50]], rng, start)
    there = dataclasses.replace(before.state, computer=np.concatenate([before.state.computer, reference.x]))
    (after,) = simulate_rig(rig, law, [wave[RAMP + 50 :]], rng, there)
    assert np.abs(records["u"]).max() < 2.0
    scale = np.abs(after.measured).max()
    assert np.abs(before.measured - records["y"][: RAMP + 50]).max() < 1e-10 * scale
    assert np.abs(after.measured - records["y"][RAMP + 50 :]).max() < 1e-8 * scale
    assert np.abs(after.torque - records["u"][RAMP + 50 :]).max() < 1e-8


class Wire:
    """Between engine and rig: loses, doubles, delays and changes datagrams of both by a seed."""

    def __init__(self, there: int, seed: int) -> None:
        self.rng, self.there, self.before = np.random.default_rng(seed), there, b""
        self.lost = self.doubled = self.changed = self.late = 0
        self.near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.far = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.near.bind((LOOPBACK, 0))
        self.far.connect((LOOPBACK, there))
        self.threads = [threading.Thread(target=run, daemon=True) for run in (self._out, self._back)]
        self.sender = None

    def __enter__(self) -> UdpRig:
        for thread in self.threads:
            thread.start()
        return UdpRig(self.near.getsockname()[1])

    def __exit__(self, *_):
        for half in (self.near, self.far):
            half.shutdown(socket.SHUT_RDWR) if half is self.far else half.sendto(b"", half.getsockname())
        for thread in self.threads:
            thread.join()
        self.near.close()
        self.far.close()

    def _passed(self, data: bytes) -> list[bytes]:
        draw, before = self.rng.uniform(), self.before
        self.lost, self.doubled = self.lost + (draw < 0.04), self.doubled + (draw > 0.9)
        self.changed, self.late = self.changed + (0.04 <= draw < 0.06), self.late + (0.06 <= draw < 0.16)
        if draw < 0.04:
            return []
        if draw < 0.06:
            spoilt = bytearray(data)
            spoilt[int(self.rng.integers(len(data)))] ^= 1 << int(self.rng.integers(8))
            return [bytes(spoilt)]
        if draw < 0.16:
            return [data, before]
        self.before = data
        return [data, data] if draw > 0.9 else [data]

    def _out(self) -> None:
        while True:
            data, self.sender = self.near.recvfrom(4096)
            if not data:
                return
            for one in self._passed(data):
                self.far.send(one)

    def _back(self) -> None:
        while data := self.far.recv(4096):
            for one in self._passed(data):
                self.near.sendto(one, self.sender)


@pytest.mark.usefixtures("compiler")
def test_a_bad_wire_changes_nothing_in_lockstep():
    """The same bytes for the same seed, whatever is lost, changed, late, doubled or echoed."""
    taken = []
    for bad in (False, True):
        with served_by_thread(SteppedRig(whole_rig(), np.random.default_rng(SEED))) as served:
            if bad:
                wire = Wire(served.port, 11)
                with wire as port:
                    taken.append(run_engine(port, 220, answer_s=2.0))
            else:
                taken.append(run_engine(served, 220))
    assert wire.lost > 10
    assert wire.doubled > 10
    assert wire.changed > 3
    assert wire.late > 10
    names = [name for name in taken[0].dtype.names if name not in ("late_ns", "step_ns")]
    assert all(taken[0][name].tobytes() == taken[1][name].tobytes() for name in names)


@pytest.mark.usefixtures("compiler")
def test_a_rig_that_dies_leads_to_safe():
    """The outputs go to zero, and the trip says why."""
    served = ServedRig(SteppedRig(whole_rig(), np.random.default_rng(SEED)))
    with served as rig, Supervisor(settings(answer_s=0.2), rig) as engine:
        assert engine.load(damping_package()[1]).done
        assert engine.reset().done
        assert engine.command("engage", values=[1.0]).done
        engine.run(100)
        served.kill()
        records = engine.run(60)
        assert engine.state == "safe"
        assert records["u"][-1] == 0.0
        assert [event.kind for event in engine.events() if event.trips] == ["rig dead"]


class Counter(EngineRig):
    """Says what it was told last, and how often."""

    def __init__(self) -> None:
        self.told: list[float] = []

    def read(self) -> np.ndarray:
        return np.array([len(self.told), self.told[-1] if self.told else 0.0])

    def write(self, u: np.ndarray) -> None:
        self.told.append(float(u[0]))


def asked(sample: int, u: float, alive: int, engine: int = 1) -> bytes:
    return seal(REQUEST.pack(sample, alive, engine) + np.array([u]).tobytes(), "ASKED")


def ask(session: RigSession, sample: int, u: float, alive: int, engine: int = 1) -> list[float]:
    reply = session.answer(asked(sample, u, alive, engine))
    if reply is None:
        return []
    body = unseal(reply, "ANSWERED")
    assert REPLY.unpack_from(body)[:2] == (sample, engine)
    return np.frombuffer(body, "<f8", offset=REPLY.size).tolist()


def test_a_session_counts_samples_and_watches_the_alive_number():
    rig = Counter()
    session = RigSession(rig)
    assert ask(session, 0, 9.0, 0) == [0.0, 0.0]
    assert ask(session, 1, 1.0, 1) == [1.0, 1.0]
    assert ask(session, 1, 5.0, 1) == [1.0, 1.0]  # sent again: answered as before
    assert ask(session, 0, 5.0, 1) == []  # delayed
    assert ask(session, 5, 2.0, 2) == [5.0, 0.0]  # a jump: held for two samples, then zero
    assert rig.told == [1.0, 2.0, 2.0, 0.0, 0.0]
    for k, expected in ((6, 3.0), (7, 4.0), (8, 0.0), (9, 0.0)):  # the number stands still
        ask(session, k, k - 3.0, 7)
        assert rig.told[-1] == expected
    assert ask(session, 10, 1.0, 8) == [10.0, 1.0]
    assert ask(session, 11, np.nan, 9) == [11.0, 0.0]
    assert ask(session, 11 + LONGEST + 1, 1.0, 10) == []
    assert ask(session, 0, 1.0, 0, 2) == [11.0, 0.0]  # the rig goes on from where it is
    assert ask(session, 1, 2.0, 1, 2) == [12.0, 2.0]
    session.alone()
    assert ask(session, 2, 4.0, 2, 2) == [13.0, 0.0]  # moved on by itself, at zero
    for junk in (b"", b"x" * 24, bytes(8) + REQUEST.pack(3, 3, 2) + bytes(8), bytes(33)):
        assert session.answer(junk) is None
    assert ask(session, -1, 0.0, 3, 3) == []
    assert ask(session, 2, 4.0, 2, 2) == [13.0, 0.0]  # none of its business
    assert ask(session, -1, 0.0, 3, 2) == []
    assert ask(session, 0, 4.0, 0, 4) == [13.0, 0.0]  # the next one
    session.end()
    assert rig.told[-1] == 0.0
    assert HOLD == 2


def test_a_datagram_that_was_changed_is_none():
    """No bit of a request moves the article otherwise, or takes the rig to another sample."""
    rig = Counter()
    session = RigSession(rig)
    assert ask(session, 0, 0.0, 0) == [0.0, 0.0]
    data = asked(1, 0.5, 1)
    for bit in range(8 * len(data)):
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        assert session.answer(bytes(changed)) is None
    assert rig.told == []
    assert ask(session, 1, 0.5, 1) == [1.0, 0.5]


def test_a_rig_of_another_format_only_says_which(monkeypatch):
    """What the words of the other meant would be a guess: of an older one, and of one from before checks."""
    session = RigSession(Counter())
    assert ask(session, 0, 0.0, 0) == [0.0, 0.0]
    now = constants()
    data = asked(1, 0.5, 1)
    monkeypatch.setattr(udp_replies, "constants", lambda: {**now, "FORMAT": now["FORMAT"] - 1})
    (said,) = struct.unpack("<q", session.answer(data)[8:])
    assert said == now["FORMAT"] - 1
    unchecked = struct.pack("<qq", 1, 1) + np.array([0.5]).tobytes()
    assert session.answer(unchecked) == udp_replies.refusal()
    assert session.answer(udp_replies.refusal()) is None
    assert session.sample == 0


def test_a_rig_follows_one_engine():
    """Requests of one that was relieved, or that come late, neither move the article nor are answered."""
    rig = Counter()
    session = RigSession(rig)
    for k in range(501):
        assert ask(session, k, 1.0, k, FIRST)[0] == k
    assert ask(session, 0, 0.0, 0, SECOND) == [500.0, 1.0]
    for k in range(1, 21):
        assert ask(session, 500 + k, 1.0, 500 + k, FIRST) == []
        assert ask(session, k, 2.0, k, SECOND) == [500.0 + k, 2.0]
    assert rig.told == [1.0] * 500 + [2.0] * 20
    ask(session, -1, 0.0, 21, SECOND)
    assert ask(session, 530, 3.0, 530, FIRST) == [520.0, 2.0]  # it joins again: the rig stands as it is
    assert ask(session, 531, 3.0, 531, FIRST) == [521.0, 3.0]


def test_what_an_engine_asked_before_relieves_nobody():
    """Its first request, delayed or recorded, had the rig follow it; the engine of now was not heard."""
    rig = Counter()
    session = RigSession(rig)
    for k in range(8):
        ask(session, k, 1.0, k, FIRST)
    for end in (False, True):  # the first was killed, or said so
        if end:
            ask(session, -1, 0.0, 8, FIRST)
        ask(session, 0, 0.0, 0, SECOND + end)
        before = rig.told.copy()
        for k in range(1, 8):
            for old in range(8):
                assert session.answer(asked(old, 9.0, old, FIRST)) is None
            assert ask(session, k, 2.0, k, SECOND + end)[1] == 2.0
        assert rig.told == before + [2.0] * 7
    assert session.stale == 2 * 7 * 8


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("computer", ["engine", "reference"])
def test_answers_of_another_session_are_counted_and_not_read(computer):
    """Sealed, of the sample that is asked for, and before the answer: as from a port that was given again."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind((LOOPBACK, 0))
        opened.settimeout(5.0)

        def serve():
            while True:
                data, sender = opened.recvfrom(1 << 16)
                sample, _, session = REQUEST.unpack_from(unseal(data, "ASKED"))
                if sample < 0:
                    return
                for whose, stale, y in ((session + 1, 500, 9.0), (session, 3, 0.25)):
                    body = REPLY.pack(sample, whose, 1, stale) + np.full(2, y).tobytes()
                    opened.sendto(seal(body, "ANSWERED"), sender)

        thread = threading.Thread(target=serve)
        thread.start()
        rig = UdpRig(opened.getsockname()[1])
        if computer == "engine":
            with Supervisor(settings(), rig) as engine:
                assert np.all(engine.run(20)["y"] == 0.25)
                assert int(engine.file.status["stale"]) == 20 + 3
        else:
            client = RigClient(rig, 1)
            assert client.read().tolist() == [0.25, 0.25]
            client.close()
        thread.join()


class Constant(EngineRig):
    """Both sensors at one value."""

    def __init__(self, value: float) -> None:
        self.value = value

    def read(self) -> np.ndarray:
        return np.full(2, self.value)

    def write(self, u: np.ndarray) -> None:
        pass


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("computer", ["engine", "reference"])
def test_of_two_rigs_that_answer_in_turn_the_first_is_heard(computer):
    """The other answers each request before it, and is not heard once the first is silent either."""
    first, other = RigSession(Constant(0.25)), RigSession(Constant(9.0))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind((LOOPBACK, 0))
        opened.settimeout(5.0)

        def serve():
            while True:
                data, sender = opened.recvfrom(1 << 16)
                sample = REQUEST.unpack_from(unseal(data, "ASKED"))[0]
                if sample < 0:
                    return
                for rig in [other] * (sample > 0) + [first] * (sample < 20):
                    opened.sendto(rig.answer(data), sender)

        thread = threading.Thread(target=serve)
        thread.start()
        there = UdpRig(opened.getsockname()[1])
        if computer == "engine":
            with Supervisor(settings(answer_s=0.2), there) as engine:
                assert engine.reset().done
                assert np.all(engine.run(25)["y"] == 0.25)
                assert [event.kind for event in engine.events() if event.trips] == ["rig dead"]
                assert engine.reset().word == "still unhealthy"
                assert int(engine.file.status["stale"]) > 25
        else:
            client = RigClient(there, 1, answer_s=0.2)
            for _ in range(20):
                assert client.read().tolist() == [0.25, 0.25]
                client.write(np.zeros(1))
            with pytest.raises(DataError, match="the rig does not answer"):
                client.read()
            client.close()
        thread.join()


def test_a_successor_joins_when_the_engine_before_it_is_silent():
    """It died without an end, and the successor's sample 0 was lost: that is not for ever."""
    rig = Counter()
    session = RigSession(rig)
    for k in range(5):
        ask(session, k, 1.0, k, FIRST)
    for k in range(1, SILENT):
        assert ask(session, k, 2.0, k, SECOND) == []
    for _ in range(3 * SILENT):
        assert ask(session, SILENT - 1, 2.0, 1, SECOND) == []  # late copies are no life
    ask(session, 5, 1.0, 5, FIRST)  # it lives: the count begins anew
    for k in range(SILENT, 2 * SILENT - 1):
        assert ask(session, k, 2.0, k, SECOND) == []
    assert rig.told == [1.0] * 5
    at = 2 * SILENT - 1
    assert ask(session, at, 2.0, at, SECOND) == [5.0, 1.0]
    assert ask(session, at + 1, 2.0, at + 1, SECOND) == [6.0, 2.0]
    assert ask(session, 6, 1.0, 6, FIRST) == []


def test_a_rig_with_its_own_time_goes_on_without_an_engine():
    """Two periods after the last request its outputs are zero."""
    rig = Counter()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as engine,
    ):
        here.bind((LOOPBACK, 0))
        engine.connect(here.getsockname())
        engine.settimeout(5.0)
        done = threading.Event()
        given = {"period_s": 0.01, "lives": lambda: not done.is_set()}
        thread = threading.Thread(target=serve_rig, args=(rig, here), kwargs=given)
        thread.start()
        for k in (0, 1):
            engine.send(asked(k, 3.0, k))
            engine.recv(1024)
        while len(rig.told) < 6:
            thread.join(0.01)
        engine.send(asked(-1, 0.0, 2))
        done.set()
        thread.join(5.0)
        assert not thread.is_alive()
    assert rig.told[0] == 3.0
    assert not any(rig.told[1:])


class Standing(EngineRig):
    """Sensors that stand at one, and all outputs that it was told."""

    def __init__(self) -> None:
        self.told: list[list[float]] = []

    def read(self) -> np.ndarray:
        return np.ones(SENSORS)

    def write(self, u: np.ndarray) -> None:
        self.told.append(u.tolist())


@pytest.mark.usefixtures("compiler")
def test_a_rig_with_its_own_time_takes_the_outputs_of_a_killed_engine_to_zero():
    """Of a real engine in real time, with a law engaged: nobody else is left to do it."""
    rig, gain = Standing(), np.eye(OUTPUTS, SENSORS) * 0.2
    with (
        served_by_thread(rig, period_s=0.02) as there,
        Supervisor(plain_settings(), there, real_time=True) as engine,
    ):
        assert engine.load(static_package(gain)).done

        def drives() -> bool:  # a busy machine trips the engine as late, maybe before the law engages
            engine.reset()
            engine.command("engage", values=[1.0])
            return wait_until(lambda: rig.told and rig.told[-1] == [0.2, 0.2], longest_s=2.0)

        driven = wait_until(drives)
        os.kill(int(engine.file.status["pid"]), signal.SIGKILL)
        at_zero = wait_until(lambda: rig.told[-1] == [0.0, 0.0])
        more = len(rig.told) + 5
        assert wait_until(lambda: len(rig.told) >= more)
    assert driven
    assert at_zero
    assert not np.any(rig.told[-5:])


def wait_until(holds: Callable[[], object], longest_s: float = 20.0) -> bool:
    end = time.monotonic() + longest_s
    while not holds() and time.monotonic() < end:
        time.sleep(0.005)
    return bool(holds())


def test_what_cannot_go_to_another_process_is_refused():
    rig = Counter()
    rig.handle = lambda: None
    with pytest.raises(ConfigError, match="cannot go to another process"):
        ServedRig(rig)
    for period_s in (-1.0, 0.0, np.nan, np.inf):  # its process ended on these, behind a port that was given
        with pytest.raises(ConfigError, match="a period of"):
            ServedRig(Counter(), period_s=period_s)
    for port in (-1, 0, 1 << 16, 2.5, "a", None):
        with pytest.raises(ConfigError, match="port"):
            UdpRig(port)
