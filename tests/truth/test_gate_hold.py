"""The gate closes the engine's hold beside a package, and what an engine does not run does not pass."""

from __future__ import annotations

import dataclasses
import shutil

import numpy as np
import pytest
import scipy.linalg as sla
from test_gate import lead, one_port

from engine_cases import SENSORS, plain_settings, random_package, still_article
from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.realtime.engine.interface.adaptive_gain import AdaptiveGain
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest, hash_hold
from middeck.realtime.engine.process import supervisor
from middeck.realtime.engine.rigs.linear_article import linear_article
from middeck.realtime.gate.gate import NO_HOLD, examine_package
from middeck.realtime.gate.linear_law import linear_law
from middeck.realtime.gate.package_with_hold import with_hold
from middeck.realtime.gate.steps_on_rig import GateRig, GateTrials, check_dry_run, check_engagement
from middeck.realtime.gate.steps_without_rig import GateMargins, GateStep
from middeck.realtime.package.filter_sections import LoopPath, Section, static_gain
from middeck.realtime.package.package_bytes import encode_package
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.reference import ReferenceLaw
from middeck.realtime.package.vectors import add_test_vectors
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from ungated import Supervisor

PERIOD_S = 0.002
WAY, RATE, PUSH, TURN = Port("way", "m"), Port("rate", "m/s"), Port("push", "N"), Port("turn", "N m")
MARGINS = GateMargins(gain_db=3.0, phase_deg=10.0)


def engine_of(sensors, outputs, hold, **changes) -> EngineSettings:
    return EngineSettings(
        period_s=PERIOD_S,
        sensors=tuple(SensorTest(port=port, range=1.0) for port in sensors),
        drives=tuple(Drive(port=port, lower=-4.0, upper=4.0) for port in outputs),
        hold=hold,
        **changes,
    )


def mass(stiffness: float) -> Plant:
    """A mass of 1 kg on a spring; below zero it falls away. Its rate is read too."""
    system = StateSpace([[0.0, 1.0], [-stiffness, -0.02]], [[0.0], [1.0]], np.eye(2), np.zeros((2, 1)))
    return Plant(dynamics=system, inputs=(PUSH,), outputs=(WAY, RATE))


def damper(gain: float = 2.0, **changes):
    """By a filtered difference of the way."""
    lag = SampledStateSpace([[0.9]], [[1.0]], [[gain]], [[-10.0 * gain]], period_s=PERIOD_S)
    return package_law(Compensator(lag, (WAY,), (PUSH,)), "damper", input_range=1.0, limit=2.0, **changes)


SPRING = (LoopPath(0, 0, static_gain(-60.0)), LoopPath(1, 0, static_gain(-8.0)))


def test_the_held_law_is_the_sum_of_package_and_hold():
    """Random law, hold and plant, ports of the hold's own: the map of a sample, column by column."""
    rng = np.random.default_rng(3)
    ports = [Port(f"y{k}", "m") for k in range(4)], [Port(f"u{k}", "N") for k in range(3)]
    law = SampledStateSpace(
        0.5 * rng.standard_normal((3, 3)), rng.standard_normal((3, 2)), rng.standard_normal((2, 3)),
        rng.standard_normal((2, 2)), period_s=PERIOD_S,
    )  # fmt: skip
    reads, drives = [2, 0], [1, 0]
    names = tuple(ports[0][k] for k in reads), tuple(ports[1][k] for k in drives)
    package = package_law(Compensator(law, *names), "law", form="dense", unstable=True)
    sections = [Section(rng.standard_normal(3), np.array([-0.5, 0.06]) * k) for k in (1.0, 0.5, -1.0)]
    hold = tuple(LoopPath(i, o, s) for (i, o), s in zip([(3, 2), (0, 1), (2, 2)], sections, strict=True))
    held = with_hold(package, engine_of(*ports, hold))
    A, B, C = (rng.standard_normal(shape) for shape in ((5, 5), (5, 3), (4, 5)))
    fade = 0.3

    def step(z):
        x, own, memory = z[:5], z[5:8], z[8:].reshape(3, 2).copy()
        y, u = C @ x, np.zeros(3)
        c = law.C @ own + law.D @ y[reads]
        for path, s in zip(hold, memory, strict=True):
            out = path.section.b[0] * y[path.input] + s[0]
            s[0] = path.section.b[1] * y[path.input] - path.section.a[0] * out + s[1]
            s[1] = path.section.b[2] * y[path.input] - path.section.a[1] * out
            u[path.output] += out
        u[drives] += fade * c
        return np.concatenate([A @ x + B @ u, law.A @ own + law.B @ y[reads], memory.ravel()])

    by_hand = np.column_stack([step(column) for column in np.eye(14)])
    made = linear_law(held, fade).sampled
    where = [[p.name for p in side].index for side in ports]
    Cp = C[[where[0](port.name) for port in held.inputs]]
    Bp = B[:, [where[1](port.name) for port in held.outputs]]
    loop = np.block([[A + Bp @ made.D @ Cp, Bp @ made.C], [made.B @ Cp, made.A]])

    def poly(M):
        found = np.poly(M)
        return found[: np.flatnonzero(np.abs(found) > 1e-9 * np.abs(found).max())[-1] + 1]

    assert np.allclose(poly(loop), poly(by_hand), rtol=1e-8)


def test_a_hold_makes_a_package_pass_or_fail():
    """What falls away without it is held; a hold that drives the mass out fails every package beside it."""
    models, engine = {"mass": mass(-20.0)}, engine_of((WAY, RATE), (PUSH,), SPRING)
    alone = examine_package(damper(), models, MARGINS)
    assert [step.name for step in alone.steps if not step.passed] == ["model mass"]
    beside = examine_package(damper(), models, MARGINS, settings=engine)
    assert beside.passed, beside.steps
    # Below a third of the motor's force the hold alone lets it fall too; the law's command may be missing.
    found = (
        "nothing grows at any of 20 limits of outputs, but at 4 what does so without the law too; "
        "not proved for limits that come and go: no multipliers are found; smaller ranges of the sensors, "
        "larger limits or less authority may do (the engine's effort trip stands behind)"
    )
    assert beside.steps[-1].said == found
    assert (beside.hold, alone.hold) == (hash_hold(engine), hash_hold(engine_of((WAY,), (PUSH,), ())))
    none = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))
    push = SampledStateSpace(*none, [[30.0]], period_s=PERIOD_S)
    faster = package_law(Compensator(push, (WAY,), (PUSH,)), "faster", input_range=1.0, limit=2.0)
    steps = examine_package(faster, models, MARGINS, settings=engine).steps
    assert [step.name for step in steps if not step.passed] == ["recovery mass"]
    # Of s^2 + 2.42 s - 20 + 0.3 (60 - 30), which without the law is 0.65 1/s.
    assert steps[-1].said.startswith("while 0.3 of push is applied: a root at 0 Hz grows (2.3")
    outward = dataclasses.replace(engine, hold=(LoopPath(1, 0, static_gain(0.05)),))
    spoilt = examine_package(damper(), {"mass": mass(40.0)}, MARGINS, settings=outward)
    (step,) = [step for step in spoilt.steps if not step.passed]
    assert step.said.startswith("at a fade of 0: a root at 1.007 Hz grows")  # sqrt(40) / 2 pi


@pytest.mark.usefixtures("compiler")
def test_a_dry_run_is_made_beside_the_hold():
    engine = engine_of((WAY, RATE), (PUSH,), SPRING)
    trials = GateTrials(dry_s=4.0, disturbance=1e-3)
    assert not check_dry_run(damper(), "mass", mass(-20.0), trials).passed
    beside = check_dry_run(damper(), "mass", mass(-20.0), trials, engine)
    assert beside.passed, beside.said
    weak = dataclasses.replace(damper(), lower=np.array([-1e-4]), upper=np.array([1e-4]), vectors=None)
    said = check_dry_run(add_test_vectors(weak), "mass", mass(-20.0), trials, engine).said
    assert "push would get" in said or "trip: effort push" in said


def test_what_the_engine_does_not_run_does_not_pass():
    """An inner loop of the package's own passes for other computers, and not for this one."""
    own = add_test_vectors(
        dataclasses.replace(damper(), paths=(LoopPath(0, 0, static_gain(-1.0)),), vectors=None)
    )
    models, engine = {"mass": mass(40.0)}, engine_of((WAY, RATE), (PUSH,), SPRING)
    assert examine_package(own, models, GateMargins(gain_db=0.0, phase_deg=0.0)).passed
    verdict = examine_package(own, models, MARGINS, settings=engine)
    (step,) = [step for step in verdict.steps if not step.passed]
    assert step.name == "interface"
    assert step.said == (
        "not for this engine: an inner loop of its own: the hold belongs to the engine's settings"
    )
    for wrong, said in (
        (engine_of((RATE,), (PUSH,), ()), "without way of the package"),
        (dataclasses.replace(engine, period_s=0.004), "500 Hz"),
        (engine_of((Port("way", "rad"), RATE), (PUSH,), SPRING), "without way of the package"),
        (engine_of((WAY, RATE), (TURN,), ()), "without push of the package"),
    ):
        with pytest.raises(ConfigError, match=said):
            with_hold(damper(), wrong)


def alone_it_falls():
    return (GateStep(name="model mass", passed=False, said="it falls away"),)


@pytest.mark.usefixtures("compiler")
def test_a_verdict_with_its_proof_lets_the_gain_adapt_and_no_other_does():
    """From the gate to the engine: what the proof is of is what the engine has."""
    gain = AdaptiveGain(
        maximum=1.1, minimum=0.9, rate=0.05, sensor="way", band_hz=(1.0, 9.0), quiet_rms=0.1, loud_rms=0.2
    )
    engine, models = engine_of((WAY, RATE), (PUSH,), SPRING, adaptive=gain), {"mass": mass(-20.0)}
    verdict = examine_package(damper(), models, MARGINS, gain=gain, settings=engine)
    assert verdict.passed, verdict.steps
    failed = tuple(dataclasses.replace(proof, proved=False) for proof in verdict.proofs)
    for none in ({"gain": None}, {"proofs": ()}, {"proofs": failed}, {"steps": alone_it_falls()}):
        assert dataclasses.replace(verdict, **none).proved_gain is None
    rig = linear_article(mass(-20.0), PERIOD_S, ["push"], ["way", "rate"])
    with Supervisor(engine, rig) as loop:
        assert loop.load(damper()).done
        assert loop.command("adapt", values=[1.0]).word == "not proved"
        assert loop.load(damper(1.9), proof=verdict.proved_gain).word == "bad proof"
        assert loop.load(damper(), proof=verdict.proved_gain).done
        assert loop.command("adapt", values=[1.0]).done
        assert loop.load(encode_package(damper(1.9))).done  # where no verdict is asked for
    for hold, word in ((verdict.hold, "done"), (NO_HOLD, "not admitted")):
        with Supervisor(engine, rig, admitted={verdict.sha256: hold}) as loop:
            assert loop.load(damper()).word == loop.load(encode_package(damper())).word == word
            for other in (damper(1.9), encode_package(damper(1.9)), b""):
                assert loop.load(other).reason.startswith("no gate has passed this package")
            assert [event.kind for event in loop.events()] == ["loaded"] * 2 * (word == "done")
    with supervisor.Supervisor(engine, rig) as loop:  # nobody has said what gates have passed
        answer = loop.load(damper())
        assert answer.word == "not admitted"
        assert 'admitted="ungated"' in answer.reason
        assert not loop.events()
    faster = dataclasses.replace(engine, adaptive=dataclasses.replace(gain, rate=0.051))
    with Supervisor(faster, rig) as loop:
        assert loop.load(damper(), proof=verdict.proved_gain).done
        assert loop.command("adapt", values=[1.0]).word == "not proved"


@pytest.mark.parametrize("neither", [None, "any", [("package", "hold")]])
def test_what_is_admitted_is_verdicts_or_said_to_be_ungated(neither):
    with pytest.raises(ConfigError, match="admitted = "):
        supervisor.Supervisor(engine_of((WAY,), (PUSH,), ()), None, admitted=neither)


def test_a_rig_with_another_hold_is_not_the_engine_that_was_asked_for():
    """Paper and models beside one hold, and an engagement beside another, are a verdict on neither."""
    engine = engine_of((WAY, RATE), (PUSH,), SPRING)
    rig = linear_article(mass(-20.0), PERIOD_S, ["push"], ["way", "rate"])
    for other in ((), SPRING[:1]):
        bench = GateRig(rig, dataclasses.replace(engine, hold=other))
        with pytest.raises(ConfigError, match="another hold"):
            examine_package(damper(), {"mass": mass(-20.0)}, MARGINS, rig=bench, settings=engine)


def test_the_drives_of_a_rig_without_a_hold_limit_the_law():
    """A lead that rests within its own limits swings on where the rig's drive is slow: it is refused."""
    w = 4.0 * np.pi
    light = one_port(StateSpace([[0.0, w], [-w, -0.004 * w]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]))
    law = add_test_vectors(package_law(lead(0.5, 3.0, 60.0), "law", input_range=1.0, limit=1.0))
    (y,), (u,) = law.inputs, law.outputs
    engine = EngineSettings(
        period_s=law.period_s,
        sensors=(SensorTest(port=y, range=1.0),),
        drives=(Drive(port=u, lower=-1.0, upper=1.0, slew_rate=5.0),),
    )
    rig = GateRig(linear_article(light, law.period_s, [u.name], [y.name]), engine)
    assert examine_package(law, {"light": light}).passed
    for given in ({"rig": rig}, {"settings": engine}):
        verdict = examine_package(law, {"light": light}, **given)
        assert not verdict.passed
        assert "grows" in verdict.steps[-1].said


def test_limits_that_leave_an_output_at_zero_are_not_for_that_engine():
    engine = engine_of((WAY, RATE), (PUSH,), ())
    (drive,) = engine.drives
    one_way = dataclasses.replace(drive, lower=0.0)
    law = add_test_vectors(dataclasses.replace(damper(), upper=np.zeros(1), vectors=None))
    verdict = examine_package(
        law, {"mass": mass(-20.0)}, MARGINS, settings=dataclasses.replace(engine, drives=(one_way,))
    )
    (interface,) = (step for step in verdict.steps if step.name == "interface")
    assert not interface.passed
    assert interface.said.endswith("limits that leave more than zero")


@pytest.mark.usefixtures("compiler")
def test_a_package_engages_on_a_rig_beside_a_verified_hold(monkeypatch):
    """So that a trip of the package falls back on what has held, and not on nothing."""
    engine = engine_of((WAY, RATE), (PUSH,), SPRING)
    rig = linear_article(mass(-20.0), PERIOD_S, ["push"], ["way", "rate"], sensor_noise=1e-5)
    seen, command = [], supervisor.Supervisor.command

    def watched(loop, kind, **given):
        seen.append((kind, int(loop.file.status["hold_verified"])))
        return command(loop, kind, **given)

    monkeypatch.setattr(supervisor.Supervisor, "command", watched)
    step, _ = check_engagement(damper(), GateRig(rig, engine), GateTrials(engage_s=1.0))
    assert step.passed, step.said
    assert seen[-2:] == [("engage", 1), ("engage", 1)]


@pytest.mark.parametrize(("period_s", "verify_s"), [(0.03, 2.0), (0.02, 0.0)])
def test_the_gate_waits_for_a_hold_that_rises_by_samples(monkeypatch, period_s: float, verify_s: float):
    """150 samples at least, which at slow rates are longer than the ramp; here by the reference law."""
    monkeypatch.setattr(shutil, "which", lambda *_: None)
    hold = (LoopPath(0, 1, static_gain(-0.02)),)
    slow = plain_settings(hold=hold, period_s=period_s, verify_s=verify_s, ramp_s=0.5)
    assert slow.rise_s > slow.ramp_s + 1.0
    package = dataclasses.replace(random_package(), period_s=period_s)
    bench = GateRig(still_article(np.full(SENSORS, 0.01)), slow)
    step, _ = check_engagement(package, bench, GateTrials(engage_s=0.5))
    assert step.passed, step.said


def test_a_package_whose_sensors_are_clipped_before_the_engine_trips_is_refused():
    """It damps by two readings of one motion; where one is clipped, the other drives the motion out."""
    rates = Port("rate", "m/s"), Port("twin", "m/s")
    w, plain = 2.0 * np.pi, np.zeros((0, 0))
    swing = StateSpace(
        [[0.0, w], [-w, -0.02 * w]], [[0.0], [1.0]], [[0.0, 1.0], [0.0, 1.0]], np.zeros((2, 1))
    )
    plant = Plant(dynamics=swing, inputs=(PUSH,), outputs=rates)
    gain = SampledStateSpace(plain, np.zeros((0, 2)), np.zeros((1, 0)), [[-3.0, 2.0]], period_s=PERIOD_S)
    both = Compensator(gain, rates, (PUSH,))

    def engine(reach):
        drive = Drive(port=PUSH, lower=-2.0, upper=2.0)
        sensors = tuple(SensorTest(port=port, range=10.0, envelope=reach) for port in rates)
        return EngineSettings(period_s=PERIOD_S, sensors=sensors, drives=(drive,))

    package = package_law(both, "both", input_range=[0.1, 10.0], limit=2.0)
    step = sla.expm(np.block([[swing.A, swing.B], [np.zeros((1, 3))]]) * PERIOD_S)
    for start, grows in ((0.05, False), (0.5, True)):
        law, x = ReferenceLaw(package), np.array([0.0, start])
        law.engaged, law.level = True, package.ramp
        for _ in range(1000):
            x = step[:2, :2] @ x + step[:2, 2] * law.step(swing.C @ x)[0]
        assert (np.hypot(*x) > start) == grows
    steps = examine_package(package, {"swing": plant}, MARGINS, settings=engine(1.0)).steps
    (refused,) = [step for step in steps if not step.passed]
    assert refused.name == "interface"
    assert "clips rate at 0.1 m/s, within the 1 m/s of the engine" in refused.said
    assert examine_package(package, {"swing": plant}, MARGINS, settings=engine(0.1)).passed
