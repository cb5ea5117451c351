"""Answers of a rig that do not come, come among others, or are none: what the engine does without them."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from importlib import resources

import numpy as np
import pytest

from engine_cases import OUTPUTS, SENSORS, kinds, plain_settings, random_article, random_package
from middeck.errors import DataError
from middeck.realtime.engine.interface.checksum import checksum
from middeck.realtime.engine.interface.header import constants
from middeck.realtime.engine.process import commanded_engine
from middeck.realtime.engine.process.compile import build_engine
from middeck.realtime.engine.process.launch import DriverRig, UdpRig
from middeck.realtime.engine.rigs.engine_rig import EngineRig
from middeck.realtime.engine.rigs.rig_server import LOOPBACK
from middeck.realtime.engine.rigs.udp_replies import REPLY, REQUEST, seal, unseal
from middeck.realtime.engine.trials.trial import Stage, run_trial
from middeck.realtime.engine.trials.udp_client import RigClient
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")


@contextlib.contextmanager
def answering(reply, raw=None):
    """A rig whose ``reply(sample, session)`` gives the datagrams for a request."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind((LOOPBACK, 0))
        opened.settimeout(0.1)
        ended = threading.Event()

        def serve():
            while not ended.is_set():
                try:
                    data, sender = opened.recvfrom(1 << 16)
                except OSError:
                    continue
                sample, _, session = REQUEST.unpack_from(unseal(data, "ASKED"))
                for datagram in reply(sample, session) if not raw else raw(data):
                    opened.sendto(datagram, sender)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield UdpRig(opened.getsockname()[1])
        finally:
            ended.set()
            thread.join()


def sensors_of(sample, session):
    y = 0.01 * np.sin(sample + np.arange(SENSORS))
    return seal(REPLY.pack(sample, session, 1, 0) + y.astype("<f8").tobytes(), "ANSWERED")


def test_a_missed_answer_is_borne_as_a_late_sample_is():
    """As many in a row as ``late_most`` allows; the last sample stands for them. One more trips."""
    lost = {10, 15, 16, 25, 26, 27}
    settings = plain_settings(period_s=0.04, late_s=1e3, late_most=2)
    with (
        answering(lambda sample, session: [] if sample in lost else [sensors_of(sample, session)]) as rig,
        Supervisor(settings, rig, real_time=True) as engine,
    ):
        engine.run(3)
        assert engine.reset().done
        records = engine.run(30)
        trips = [event for event in engine.events() if event.trips]
        assert [(trip.kind, trip.sample) for trip in trips] == [("no answer", 27)]
        assert int(engine.file.status["missed"]) == len(lost)
    y = {int(row["sequence"]) - 1: row["y"].tolist() for row in records}
    assert y[10] == y[9] != y[11]
    assert y[16] == y[15] == y[14] != y[17]


def test_before_the_first_answer_nothing_is_borne():
    """There is no last sample to stand for it: a rig that is silent from the start trips at once."""
    settings = plain_settings(period_s=0.02, late_s=1e3, late_most=5)
    with answering(lambda sample, session: []) as rig, Supervisor(settings, rig, real_time=True) as engine:
        engine.reset()
        engine.run(3)
        assert engine.state == "safe"


def test_a_rig_that_is_lost_is_not_taken_for_one_whose_outputs_did_not_arrive(tmp_path):
    """What can never come again is not borne as what came late is."""
    text = resources.files("middeck.realtime.engine").joinpath("source", "rig_driver.c").read_text()
    for was, becomes in (
        ("whole i;", "static int turn;\n    whole i;\n\n    if (++turn > 20)\n        return RIG_LOST;"),
        ("to the watchdog */\n    return RIG_READ", "*/\n    return alive < 19 ? RIG_READ : RIG_MISSED"),
        ("return NULL; /*", "return &driver; /*"),
    ):
        assert text.count(was) == 1
        text = text.replace(was, becomes)
    source = tmp_path / "driver.c"
    source.write_text(text)
    program = build_engine(driver=source, flags=("-O0",))
    settings = plain_settings(period_s=0.02, late_s=1e3, late_most=5)
    with Supervisor(settings, DriverRig(), real_time=True, program=program) as engine:
        engine.reset()
        engine.run(30)
        assert [event.kind for event in engine.events() if event.trips] == ["rig dead"]


@pytest.mark.parametrize("others", [30, 5000])
def test_datagrams_that_are_no_answers_are_not_read_for_ever(others):
    """A few are passed over; whoever sends nothing else is a rig that will not answer."""
    foreign = [b"no answer", bytes(8 + REPLY.size + 8 * SENSORS)]

    def reply(sample, session):
        spoilt = (foreign * others)[:others]
        return [*spoilt, sensors_of(sample, session)] if others < 64 else spoilt

    settings = plain_settings(answer_s=2.0)
    with answering(reply) as rig:
        with Supervisor(settings, rig) as engine:
            engine.reset()
            engine.run(20)
            assert kinds(engine) == ["reset done"] + (["rig dead"] if others > 64 else [])
        client = RigClient(rig, OUTPUTS, answer_s=2.0)
        if others > 64:
            with pytest.raises(DataError, match="does not answer"):
                client.read()
        else:
            assert client.read().tolist() == (0.01 * np.sin(np.arange(SENSORS))).tolist()
        client.close()


def test_what_is_played_is_what_was_given_at_the_start():
    """Who writes into the shared file later changes nothing, and blames no package with it."""
    wave = np.full((50, OUTPUTS), 0.1)
    with Supervisor(plain_settings(), random_article(), waveform=wave) as engine:
        place = int(engine.file.places["waveform"])
        np.frombuffer(engine.file.map, "<f8", wave.size, place)[:] = np.nan
        engine.reset()
        engine.command("excite", values=[0.0])
        assert np.array_equal(engine.run(50)["excitation"], wave)
        assert engine.state == "identify"


def test_an_excitation_that_is_not_finite_is_refused_at_the_start(tmp_path, monkeypatch):
    monkeypatch.setattr("middeck.realtime.engine.process.supervisor.checked_waveform", lambda wave, _: wave)
    with pytest.raises(DataError, match="an excitation that is not finite"):
        Supervisor(plain_settings(), random_article(), waveform=np.full((5, OUTPUTS), np.nan))


@pytest.mark.parametrize("heard", [True, False])
def test_a_rig_that_never_answers_is_told_as_the_rig_s(heard):
    """Patience is spent once, not in every sample; the trip says what to try, whichever computer found it."""
    settings = plain_settings(answer_s=1.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind((LOOPBACK, 0))
        rig = UdpRig(opened.getsockname()[1])
        if not heard:
            opened.close()
        package, stages = random_package(input_range=10.0), (Stage("standby", 2.0),)
        # A thousand samples: a second of patience in each would be a quarter of an hour.
        trials = [run_trial(package, settings, rig, stages, computer=one) for one in ("engine", "reference")]
    why = (
        "the rig does not answer; start it first; its port, and how many sensors and outputs it has, "
        "must be the engine's"
    )
    assert [trial.trip for trial in trials] == [f"rig dead at 0 s: {why}", why]
    assert not any(trial.blamed or trial.refused for trial in trials)


class TwoSensors(EngineRig):
    def read(self):
        return np.zeros(SENSORS - 1)

    def write(self, u):
        return None


@pytest.mark.parametrize("computer", ["engine", "reference"])
def test_a_rig_with_other_sensors_is_told_as_the_rig_s(computer):
    package, stages = random_package(input_range=10.0), (Stage("standby", 0.1),)
    settings = plain_settings(answer_s=0.5)
    trial = run_trial(package, settings, TwoSensors(), stages, computer=computer)
    assert trial.trip.endswith("how many sensors and outputs it has, must be the engine's")
    assert not trial.blamed


def old_rig(data):
    """From before there were checks: (sample, sensors) for (sample, alive, outputs)."""
    return [data[:8] + np.full(SENSORS, 0.01).tobytes()]


def other_format(data):
    body = struct.pack("<q", constants()["FORMAT"] + 1)
    return [struct.pack("<Q", checksum(body, constants()["REFUSED_FORMAT"])) + body]


@pytest.mark.parametrize("computer", ["engine", "reference"])
@pytest.mark.parametrize("rig", [old_rig, other_format])
def test_a_rig_of_another_format_is_told_as_such(rig, computer):
    package, stages = random_package(input_range=10.0), (Stage("standby", 0.1),)
    with answering(None, rig) as there:
        trial = run_trial(package, plain_settings(answer_s=0.5), there, stages, computer=computer)
    assert "the rig speaks another format of datagrams" in trial.trip
    assert not trial.blamed


@pytest.mark.parametrize("computer", ["engine", "reference"])
def test_an_echo_before_the_answer_is_no_other_format(computer):
    """It begins with the word of the request, as what a rig from before there were checks answers does."""

    def echoed(data):
        sample, _, session = REQUEST.unpack_from(unseal(data, "ASKED"))
        return [data, seal(REPLY.pack(sample, session, 1, 0) + np.full(SENSORS, 0.01).tobytes(), "ANSWERED")]

    package, stages = random_package(input_range=10.0), (Stage("standby", 0.1),)
    with answering(None, echoed) as there:
        trial = run_trial(package, plain_settings(answer_s=0.5), there, stages, computer=computer)
    assert trial.trip == ""


class ComplexSensors(TwoSensors):
    def read(self):
        return np.full(SENSORS, 0.01 + 0.3j)


@pytest.mark.parametrize("computer", ["engine", "reference"])
def test_a_rig_that_reads_complex_numbers_is_refused(computer, capfd):
    """Their real parts alone are no readings; the rig's process says so."""
    settings, stages = plain_settings(answer_s=0.5), (Stage("standby", 0.1),)
    trial = run_trial(random_package(input_range=10.0), settings, ComplexSensors(), stages, computer=computer)
    said = trial.trip if computer == "reference" else capfd.readouterr().err
    assert "the rig reads numbers of type complex128" in said
    assert trial.trip
    assert len(trial.y) == 0 or not np.any(trial.y)
    assert not trial.blamed


def test_a_rig_that_answers_again_is_heard_again():
    """After it was lost, as soon as an answer comes at once."""
    with (
        answering(lambda sample, session: [] if 5 <= sample < 50 else [sensors_of(sample, session)]) as rig,
        Supervisor(plain_settings(answer_s=0.2), rig) as engine,
    ):
        engine.reset()
        stale = engine.run(50)["y"][-1, 0]
        assert kinds(engine) == ["reset done", "rig dead"]
        assert any((engine.run(20)["y"][:, 0] != stale).any() for _ in range(100))


@pytest.mark.parametrize("real_time", [False, True])
def test_the_alive_number_changes_with_every_sample(real_time):
    """In SAFE, in READY, after a STOP and on the way out: hardware that sees it stand goes to zero itself."""
    seen = {}

    def watched(data):
        sample, alive, session = REQUEST.unpack_from(unseal(data, "ASKED"))
        seen.setdefault(sample, set()).add(alive)
        return [sensors_of(sample, session)]

    settings = plain_settings(period_s=0.004, late_s=1e3, late_most=1000)
    with answering(None, watched) as rig, Supervisor(settings, rig, real_time=real_time) as engine:
        states = [engine.state]
        engine.run(5)
        for act in (engine.reset, engine.stop):
            act()
            engine.run(10)
            states.append(engine.state)
    assert states == ["safe", "ready", "safe"]
    samples = sorted(sample for sample in seen if sample >= 0)
    assert samples == list(range(samples[-1] + 1))
    assert samples[-1] > 25
    assert all(len(seen[k]) == 1 and seen[k] != seen[k + 1] for k in samples[1:-1])


def test_a_slow_rig_is_no_engine_that_does_not_answer(monkeypatch):
    """Patience begins anew with each sample."""
    monkeypatch.setattr(commanded_engine, "PATIENCE_S", 0.5)

    def slowly(sample, session):
        time.sleep(0.05)
        return [sensors_of(sample, session)]

    with answering(slowly) as rig, Supervisor(plain_settings(answer_s=1.0), rig) as engine:
        engine.reset()
        assert len(engine.run(50)) == 50
        assert kinds(engine) == ["reset done"]


def test_a_slow_rig_that_was_lost_is_waited_for_after_a_reset():
    """It was silent once; SAFE asks it in passing, but a reset is taken only where it was just heard."""

    def slowly(sample, session):
        time.sleep(0.005)
        return [] if 5 <= sample < 40 else [sensors_of(sample, session)]

    with answering(slowly) as rig, Supervisor(plain_settings(answer_s=1.0), rig) as engine:
        engine.reset()
        engine.run(60)
        assert (engine.state, kinds(engine)) == ("safe", ["reset done", "rig dead"])
        while not engine.reset().done:
            time.sleep(0.05)
            engine.run(1)
        assert np.ptp(engine.run(30)["y"][:, 0]) > 0.0
        assert (engine.state, kinds(engine)) == ("ready", ["reset done"])
