"""No package passes the gate that a model of it refuses; and each step refuses what it is there for."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla

from engine_campaigns import seeds_of
from middeck.control.law.compensator import Compensator
from middeck.control.lqg.weights import LQGWeights
from middeck.control.sampled.sampled_design import design_sampled_lqg
from middeck.errors import ConfigError
from middeck.realtime.engine.interface.adaptive_gain import AdaptiveGain
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.engine.rigs.linear_article import linear_article
from middeck.realtime.gate.gate import examine_package
from middeck.realtime.gate.linear_law import limited_law, linear_law
from middeck.realtime.gate.recovery_step import check_recovery
from middeck.realtime.gate.steps_on_rig import GateRig, GateTrials
from middeck.realtime.gate.steps_without_rig import FADES, GateMargins, check_interface
from middeck.realtime.package.filter_sections import InputFilter, LoopPath, Section
from middeck.realtime.package.overflow import OWN_COMMANDS
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.reference import ReferenceLaw
from middeck.realtime.package.single_precision import to_single
from middeck.realtime.package.vectors import add_test_vectors
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.sampling.sampled_plant import sample_plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from packaged_laws import PERIOD_S, ports, random_law
from plant_builders import unit_weights

ANY = GateMargins(gain_db=0.0, phase_deg=0.0)


def beam(rng=None, scale=1.0):
    """Three light modes between two inputs and outputs."""
    rng = np.random.default_rng(0) if rng is None else rng
    omega = 2.0 * np.pi * np.array([2.0, 7.0, 19.0]) * scale
    A = sla.block_diag(*([[0.0, w], [-w, -0.02 * w]] for w in omega))
    B, C = np.zeros((6, 2)), np.zeros((2, 6))
    B[1::2], C[:, ::2] = rng.standard_normal((3, 2)), rng.standard_normal((2, 3))
    return StateSpace(A, B, C, np.zeros((2, 2)))


def plant_of(system):
    y, u = ports(0, 2, 2)
    return Plant(dynamics=system, inputs=u, outputs=y)


def closed_radius(system, law):
    """Largest pole of the sampled loop u[k] = law(y[k]), by its own matrices."""
    n, k = len(system.A), law.sampled
    both = sla.expm(np.block([[system.A, system.B], [np.zeros((2, n + 2))]]) * PERIOD_S)
    A, B, C = both[:n, :n], both[:n, n:], system.C
    loop = np.block([[A + B @ k.D @ C, B @ k.C], [k.B @ C, k.A]])
    return float(np.abs(np.linalg.eigvals(loop)).max())


def package_of(rng, gain):
    law = random_law(rng, 6, 2, 2, applied=False, radii=(0.9, 0.99))
    s = law.sampled
    quiet = SampledStateSpace(s.A, s.B, gain * s.C, gain * s.D, period_s=PERIOD_S)
    return package_law(Compensator(quiet, law.inputs, law.outputs), "law", input_range=1.0, limit=1.0)


def limited_to(package):
    """The law while one output, the other, or both get none to nine tenths of what they are asked for."""
    sets, limited = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]), limited_law(package)
    return [limited(np.ones(2), np.maximum(one, g)) for one in sets for g in FADES[:-1]]


def test_no_destabilising_package_passes():
    """The gate agrees with the poles of loops that are closed here, at every fade and every limit."""
    passed = 0
    for seed in seeds_of("random packages at the gate, models of two modes"):
        rng = np.random.default_rng(seed)
        system, package = beam(rng), package_of(rng, 10.0 ** rng.uniform(-2.0, 1.0))
        laws = (*(linear_law(package, fade) for fade in FADES), *limited_to(package))
        stable = all(closed_radius(system, law) < 1.0 for law in laws)
        if not stable or passed < 3:  # those that pass take their time
            assert examine_package(package, {"beam": plant_of(system)}, ANY).passed == stable
            passed += stable
    assert passed == 3


def test_one_model_of_several_is_enough_to_refuse():
    rng = np.random.default_rng(3)
    package = package_of(rng, 1e-3)
    good, bad = beam(np.random.default_rng(3)), beam(np.random.default_rng(3))
    loud = StateSpace(bad.A, 3e3 * bad.B, bad.C, bad.D)
    assert examine_package(package, {"good": plant_of(good)}, ANY).passed
    verdict = examine_package(package, {"good": plant_of(good), "loud": plant_of(loud)}, ANY)
    assert [step.name for step in verdict.steps if not step.passed] == ["model loud"]
    late = examine_package(package, {"late": delay_plant(plant_of(good), 0.004)}, GateMargins(gain_db=200.0))
    assert not late.passed
    assert "margin" in late.steps[-1].said


def test_a_sampled_model_is_judged_as_the_continuous_one_that_it_was_sampled_from():
    """Other programs give sampled plants; with the delays among their states."""
    w = 2.0 * np.pi * 7.0
    mode = StateSpace([[0.0, 1.0], [-w * w, -0.02 * w]], [[0.0], [w * w]], [[1.0, 0.0]], [[0.0]])
    plant = delay_plant(one_port(mode), 0.003)
    gain = AdaptiveGain(maximum=1.0, rate=1.0, minimum=0.2, sensor="y0", band_hz=(1.0, 5.0),
                        quiet_rms=0.1, loud_rms=0.2)  # fmt: skip
    for size, passes in ((-1e-3, True), (-0.5, False)):
        continuous, sampled = (
            examine_package(gain_package(size), {"mode": one}, ANY, gain=gain, trials=GateTrials(dry_s=0.1))
            for one in (plant, sample_plant(plant, PERIOD_S))
        )
        assert sampled.steps == continuous.steps
        assert sampled.passed == passes
    other = examine_package(gain_package(-1e-3), {"mode": sample_plant(plant, 2.0 * PERIOD_S)})
    assert "is sampled at 0.004 s, the package at 0.002 s" in other.steps[1].said


def gain_package(gain):
    y, u = ports(0, 1, 1)
    none = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))
    law = Compensator(SampledStateSpace(*none, [[gain]], period_s=PERIOD_S), y, u)
    return package_law(law, "gain", input_range=1.0, limit=1.0)


def one_port(system):
    y, u = ports(0, 1, 1)
    return Plant(dynamics=system, inputs=u, outputs=y)


def between_fades(square):
    """Closed by -g: s^3 + (1 + g) s^2 + (1 + g) s + a, which Hurwitz finds stable where
    (g - 0.3)^2 > ``square``."""
    constant = 1.0 - 0.09 + square
    A = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-constant, -1.0, -1.0]]
    return StateSpace(A, [[0.0], [0.0], [1.0]], [[2.6, 1.0, 1.0]], [[0.0]])


def test_a_loop_that_is_unstable_at_one_fade_of_eleven_is_refused():
    """By Hurwitz's condition from 0.25 to 0.35 only; and where it is stable there, but with little margin."""
    step = examine_package(gain_package(-1.0), {"hump": one_port(between_fades(0.0025))}, ANY).steps[-1]
    assert not step.passed
    assert step.said.startswith("at a fade of 0.3: a root at 0.181")  # 1.14 rad/s
    weak, least = {"hump": one_port(between_fades(-0.0025))}, GateMargins(gain_db=0.0, phase_deg=5.0)
    step = examine_package(gain_package(-1.0), weak, least).steps[-1]
    assert not step.passed
    assert step.said.startswith("at a fade of 0.2: margins of")  # 11 degrees at full authority


def test_an_engaged_law_that_leaves_a_body_free_is_refused():
    """Without margins asked for: at a fade of zero a free body may rest where it is, and nowhere else."""
    free = one_port(StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]]))
    step = examine_package(gain_package(0.0), {"free": free}, ANY).steps[-1]
    assert not step.passed
    assert step.said.startswith("at a fade of 0.1: a root at 0 Hz does not decay")


def test_a_loop_that_is_not_decided_is_not_passed():
    """At full authority y = -x + y: the loop has no solution."""
    direct = StateSpace([[-1.0]], [[1.0]], [[-1.0]], [[1.0]])
    step = examine_package(gain_package(1.0), {"direct": one_port(direct)}, ANY).steps[-1]
    assert (step.name, step.passed) == ("model direct", False)
    assert step.said.startswith("not decided: ")
    loop = between_fades(0.0025)
    for overflows in (
        dataclasses.replace(loop, B=1e300 * loop.B),
        dataclasses.replace(loop, A=1e200 * loop.A),
    ):
        with np.errstate(all="ignore"):
            step = examine_package(gain_package(-1.0), {"loud": one_port(overflows)}, ANY).steps[-1]
        assert not step.passed
        assert step.said.startswith("not decided: ")


def test_the_linear_law_is_the_package_within_its_limits():
    """At a fade held by the ramp, filters, inner loop and the path of the applied command included."""
    law = random_law(np.random.default_rng(5), 5, 2, 2, radii=(0.9, 0.99))
    section = Section(np.array([0.9, -0.4, 0.1]), np.array([-0.5, 0.2]))
    package = package_law(law, "law", ramp_s=0.1, filters=(InputFilter(1, section),))
    package = add_test_vectors(dataclasses.replace(package, paths=(LoopPath(0, 1, section),)))
    y = np.random.default_rng(6).standard_normal((300, 2))
    for level in (0, 20, 50):
        reference, fade = ReferenceLaw(package), None
        linear, x, worst = None, None, 0.0
        for row in y:
            reference.level = level  # held where it is
            fade = float(reference.fade())
            linear = linear_law(package, fade).sampled if linear is None else linear
            x = np.zeros(len(linear.A)) if x is None else x
            worst = max(worst, float(np.abs(reference.step(row) - (linear.C @ x + linear.D @ row)).max()))
            x = linear.A @ x + linear.B @ row
        assert worst < 1e-10


def steps_of(package, plant=None):
    models = {"beam": plant_of(beam()) if plant is None else plant}
    return {step.name: step for step in examine_package(package, models, ANY).steps}


def test_each_step_refuses_what_it_is_there_for():
    good = package_of(np.random.default_rng(1), 1e-4)
    assert all(step.passed for step in steps_of(good).values())
    open_ended = steps_of(
        add_test_vectors(dataclasses.replace(good, upper=np.array([1.0, np.inf]), vectors=None))
    )
    assert "output u1 has no limit" in open_ended["interface"].said
    assert "model beam" not in open_ended  # nothing is tried after a step that is not passed
    other = Plant(dynamics=beam(), inputs=(Port("u0", "N"), Port("v", "N m")), outputs=ports(0, 2, 2)[0])
    assert "drives u1" in steps_of(good, other)["interface"].said
    unit = Plant(dynamics=beam(), inputs=(Port("u0", "lbf"), Port("u1", "N m")), outputs=ports(0, 2, 2)[0])
    assert "N m" in steps_of(good, unit)["interface"].said
    slow = Plant(
        dynamics=SampledStateSpace(0.5 * np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), period_s=0.01),
        inputs=ports(0, 2, 2)[1], outputs=ports(0, 2, 2)[0],
    )  # fmt: skip
    assert "sampled at 0.01 s" in steps_of(good, slow)["interface"].said
    void = plant_of(dataclasses.replace(beam(), A=np.full_like(beam().A, np.nan)))
    assert "not finite" in steps_of(good, void)["interface"].said
    vectors = dataclasses.replace(good.vectors, u=np.nextafter(good.vectors.u, 9.0))
    assert "sample 1 of 48" in steps_of(dataclasses.replace(good, vectors=vectors))["vectors"].said
    for samples, engaged, unmoved in (
        (1, good.vectors.engaged, "1 samples do not move input y0, input y1, output u0, output u1, ramp"),
        (48, np.ones_like(good.vectors.engaged), "48 samples do not move ramp"),
    ):
        cut = [part[:samples] for part in (engaged, good.vectors.y, good.vectors.u)]
        idle = dataclasses.replace(good.vectors, engaged=cut[0], y=cut[1], u=cut[2])
        assert steps_of(dataclasses.replace(good, vectors=idle))["vectors"].said == unmoved
    single = to_single(good)
    assert steps_of(single)["error bound"].passed
    boast = dataclasses.replace(single, error_bound=0.01 * single.error_bound)
    assert "rounding may reach" in steps_of(boast)["error bound"].said
    ringing = dataclasses.replace(
        good,
        filters=(InputFilter(0, Section(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.01]))),),
        vectors=None,
        unstable=True,
    )
    assert "section at input y0 is unstable" in steps_of(add_test_vectors(ringing, 4))["poles"].said
    with pytest.raises(ConfigError, match="no model"):
        examine_package(good, {})
    with pytest.raises(ConfigError, match="margins of"):
        GateMargins(gain_db=-1.0)


def test_a_bound_for_own_commands_is_refused_where_something_fades_them():
    """An adaptive gain, a law that leaves, a rig: each by name; on paper alone the bound is what it says."""
    lag = SampledStateSpace([[0.5]], [[1.0]], [[1e-3]], [[0.0]], period_s=PERIOD_S)
    law = Compensator(lag, *ports(1, 1, 1), applied=np.array([[-800.0]]))
    double = package_law(law, "law", input_range=1.0, limit=3.0)
    single = to_single(double)
    assert single.error_bound_own
    plant, (y, u) = one_port(StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])), ports(0, 1, 1)
    engine = EngineSettings(
        period_s=PERIOD_S,
        sensors=(SensorTest(port=y[0], range=1.0),),
        drives=(Drive(port=u[0], lower=-3.0, upper=3.0),),
    )
    gain = AdaptiveGain(maximum=1.0, rate=1.0, sensor="y0", band_hz=(1.0, 5.0), quiet_rms=0.1, loud_rms=1.0)
    rig = GateRig(linear_article(plant, PERIOD_S, ["u0"], ["y0"]), engine)
    for given, what in (
        ({"gain": gain}, "an adaptive gain"), ({"engaged": double}, "the cross-fade from law"),
        ({"rig": rig}, "the rig's engine"), ({}, ""),
    ):  # fmt: skip
        steps = examine_package(single, {"lag": plant}, ANY, **given).steps
        (step,) = (step for step in steps if step.name == "error bound")
        assert step.passed == (not what)
        assert step.said.endswith(f"applied in full, and {what} fades them" if what else OWN_COMMANDS)


@pytest.mark.parametrize(
    ("drives", "reads", "said"),
    [
        (("u0",), ("y0", "y1"), "beam: the compensator drives u1; the plant has no such input"),
        (("u0", "u1"), ("y1",), "beam: the compensator reads y0; the plant has no such output"),
        (("u0", "v"), ("y0", "y1"), "beam: the compensator drives u1; the plant has no such input"),
        (("u0", "u1", "more"), ("y0", "more", "y1"), ""),
    ],
)
def test_a_model_with_other_ports_is_refused_by_name(drives, reads, said):
    """One too few, of another name; those that the package does not use are none of its business."""
    package, one, system = package_of(np.random.default_rng(1), 1e-4), np.eye(3), beam()
    B, C = (system.B @ one[:2])[:, : len(drives)], (one[:, :2] @ system.C)[: len(reads)]
    plant = Plant(
        dynamics=StateSpace(system.A, B, C, np.zeros((len(C), B.shape[1]))),
        inputs=tuple(Port(name, "N m") for name in drives),
        outputs=tuple(Port(name, "rad") for name in reads),
    )
    step = check_interface(package, {"beam": plant})
    assert step.passed == (not said)
    assert step.said == (said or "inputs: 2, outputs: 2, rate: 500 Hz")


def unstable_lqg(applied=True):
    """An unstable plant, whose LQG law at a low rate of filtering is unstable by itself."""
    plant = StateSpace([[1.2, 1.0], [0.0, 1.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    way, push = (Port("way", "m"),), (Port("push", "N"),)
    named = Plant(dynamics=plant, inputs=push, outputs=way, w=("push",), u=("push",), z=("way",), y=("way",))
    weights = unit_weights(("push",), 1e-2)
    law = design_sampled_lqg(named, weights, 1e3, 0.02)
    return named, law if applied else dataclasses.replace(law, applied=None)


def test_an_unstable_compensator_needs_declaration_and_recovery():
    named, law = unstable_lqg()
    radius = np.abs(np.linalg.eigvals(law.sampled.A)).max()
    if radius < 1.0:
        grown = SampledStateSpace(
            law.sampled.A + (1.02 - radius) * np.eye(2), law.sampled.B, law.sampled.C, law.sampled.D,
            period_s=0.02,
        )  # fmt: skip
        law = Compensator(grown, law.inputs, law.outputs)
    package = package_law(law, "law", input_range=1.0, limit=1.0, unstable=True)
    with pytest.raises(ConfigError, match="undeclared pole of magnitude"):
        dataclasses.replace(package, unstable=False)
    edge = dataclasses.replace(law.sampled, A=np.diag([1.0, 0.5]))  # no rounding: to the gate it is outside
    told = package_law(
        Compensator(edge, law.inputs, law.outputs), "law", input_range=1.0, limit=1.0, unstable=True
    )
    silent = dataclasses.replace(told, unstable=False)
    assert "not declared" in steps_of(silent, named)["poles"].said
    blind = package_law(
        dataclasses.replace(law, applied=None), "law", input_range=1.0, limit=1.0, unstable=True
    )
    assert "while it is limited its estimate grows" in steps_of(blind, named)["poles"].said


def saturated_run(law, system, samples):
    """Largest motion and share of limited samples in the last fifth of a run from far beyond the limits."""
    n, package = len(system.A), package_law(law, "law", input_range=100.0, limit=1.0, unstable=True)
    both = sla.expm(np.block([[system.A, system.B], [np.zeros((1, n + 1))]]) * law.period_s)
    x, reference, motion = np.ones(n), ReferenceLaw(package), []
    for _ in range(samples):
        y = system.C @ x
        u = reference.step(y)
        motion.append([float(y[0]), float(u[0])])
        x = both[:n, :n] @ x + both[:n, n] * u[0]
    last = np.abs(motion[-samples // 5 :])
    assert np.mean(np.abs(np.array(motion[: samples // 20])[:, 1]) == 1.0) > 0.5
    return last[:, 0].max(), np.mean(last[:, 1] == 1.0)


def test_a_declared_unstable_compensator_passes_where_it_recovers_from_saturation():
    """Stable at every fade; without the path of the applied command it never comes back.

    Where its sensors reach further than the proof does it is refused, and told how far that is.
    """
    A = sla.block_diag(*([[0.0, w], [-w, -0.02 * w]] for w in (6.923, 29.18)))
    system = StateSpace(A, [[0.0], [1.0], [0.0], [0.7]], [[1.0, 0.0, -2.96, 0.0]], [[0.0]])
    way, push = (Port("way", "m"),), (Port("push", "N"),)
    plant = Plant(dynamics=system, inputs=push, outputs=way, w=("push",), u=("push",), z=("way",), y=("way",))
    weights = unit_weights(("push",), 3.57e-4)
    law = design_sampled_lqg(plant, weights, 1.298e5, 0.04)
    assert np.abs(np.linalg.eigvals(law.sampled.A)).max() > 1.01
    margins = GateMargins(gain_db=3.0, phase_deg=5.0)
    package = package_law(law, "law", input_range=0.01, limit=1.0, unstable=True)
    verdict = examine_package(package, {"modes": plant}, margins)
    assert verdict.passed, verdict.steps
    assert "proved for limits that come and go, at full authority" in verdict.steps[-1].said
    gain = AdaptiveGain(
        maximum=1.1, minimum=0.9, rate=1.0, sensor="way", band_hz=(1.0, 5.0), quiet_rms=0.1, loud_rms=1.0
    )
    verdict = examine_package(package, {"modes": plant}, margins, gain=gain)
    (failed,) = [step for step in verdict.steps if not step.passed]
    assert (failed.name, failed.said[:31]) == ("adaptive gain", "the law is unstable by itself, ")
    package = package_law(law, "law", input_range=1.0, limit=1.0, unstable=True)
    *others, last = examine_package(package, {"modes": plant}, margins).steps
    assert all(step.passed for step in others)
    assert not last.passed
    assert "not proved to recover: no multipliers are found where it may ask for" in last.said
    blind = dataclasses.replace(law, applied=None)
    package = package_law(blind, "law", input_range=1.0, limit=1.0, unstable=True)
    assert not steps_of(package, plant)["poles"].passed
    motion, limited = saturated_run(law, system, 2500)
    assert motion < 1e-6
    assert limited == 0.0
    motion, limited = saturated_run(blind, system, 2500)
    assert motion > 1e-3
    assert limited > 0.5


def test_one_model_of_several_without_a_proof_is_enough_to_refuse_an_unstable_compensator():
    """Its second mode one in a hundred higher: stable at every fade and limit, but no proof is found."""
    way, push = (Port("way", "m"),), (Port("push", "N"),)

    def two_modes(higher):
        A = sla.block_diag(*([[0.0, w], [-w, -0.02 * w]] for w in (6.923, higher * 29.18)))
        system = StateSpace(A, [[0.0], [1.0], [0.0], [0.7]], [[1.0, 0.0, -2.96, 0.0]], [[0.0]])
        return Plant(
            dynamics=system, inputs=push, outputs=way, w=("push",), u=("push",), z=("way",), y=("way",)
        )

    models = {"modes": two_modes(1.0), "higher": two_modes(1.01)}
    law = design_sampled_lqg(models["modes"], unit_weights(("push",), 3.57e-4), 1.298e5, 0.04)
    package = package_law(law, "law", input_range=0.01, limit=1.0, unstable=True)
    *others, proved, refused = examine_package(package, models, ANY).steps
    assert all(step.passed for step in others)
    assert (proved.name, proved.passed) == ("recovery modes", True)
    assert (refused.name, refused.passed) == ("recovery higher", False)
    assert "it is unstable by itself, and not proved to recover" in refused.said


PAIR = ("push 0", "push 1")


def unstable_pair():
    """Two light modes, and an LQG law of two motors that is unstable by itself."""
    A = sla.block_diag(*([[0.0, w], [-w, -0.02 * w]] for w in (27.34, 37.48)))
    B, C = np.zeros((4, 2)), np.zeros((2, 4))
    B[1::2] = [[-0.848, -0.763], [-1.983, -0.901]]
    C[:, ::2] = [[0.784, -1.389], [0.595, 0.313]]
    ways, pushes = (Port("way 0", "m"), Port("way 1", "m")), tuple(Port(name, "N") for name in PAIR)
    plant = Plant(dynamics=StateSpace(A, B, C, np.zeros((2, 2))), inputs=pushes, outputs=ways, w=PAIR, u=PAIR,
                  z=("way 0", "way 1"), y=("way 0", "way 1"))  # fmt: skip
    weights = LQGWeights(
        output=np.ones(2),
        input=np.ones(2),
        disturbed=PAIR,
        process=np.eye(2),
        sensor=np.array([3e-4, 1.6e-5]),
    )
    return plant, design_sampled_lqg(plant, weights, 7.5e5, 0.02)


def last_motion(plant, package, seconds):
    """Largest motion in the last tenth of a run from far beyond the limits, through the package's steps."""
    system, law, motion = plant.dynamics, ReferenceLaw(package), []
    both = sla.expm(np.block([[system.A, system.B], [np.zeros((2, 6))]]) * package.period_s)
    x = np.full(4, 3.0)
    for _ in range(round(seconds / package.period_s)):
        y = system.C @ x
        motion.append(np.abs(y).max())
        x = both[:4, :4] @ x + both[:4, 4:] @ law.step(y)
    return max(motion[-len(motion) // 10 :])


def test_an_unstable_compensator_recovers_from_each_limit_by_itself_too():
    """Stable at every fade and with all outputs limited; with one motor limited it never comes back."""
    plant, law = unstable_pair()
    assert np.abs(np.linalg.eigvals(law.sampled.A)).max() > 1.05
    given = {"input_range": 100.0, "unstable": True}
    package = package_law(law, "law", limit=1.0, **given)
    assert last_motion(plant, package, 60.0) < 1e-6
    weak = package_law(law, "law", limit=[1.0, 1e-3], **given)
    assert last_motion(plant, weak, 60.0) > 0.1
    steps = examine_package(package, {"modes": plant}, GateMargins(gain_db=3.0, phase_deg=3.0)).steps
    assert [step.name for step in steps if not step.passed] == ["recovery modes"]
    assert "of push 1 is applied" in steps[-1].said


def negative_pair():
    """Two lags, each of whose outputs both motors move, paired so that their relative gain is negative.

    Closed by -k, the loop is (s + 1) 1 + P K. Alone the first motor has 1 + k_1 < 0 (Bristol 1966, IEEE
    Trans. Automatic Control 11): it needs the second, and without it grows by
    log(1 + 0.2 (1 - exp(-T))) / T.
    """
    lags = StateSpace(-np.eye(2), [[1.0, 2.0], [2.0, 1.0]], np.eye(2), np.zeros((2, 2)))
    y, u = ports(0, 2, 2)
    none = np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((2, 0))
    return plant_of(lags), Compensator(SampledStateSpace(*none, np.diag([1.2, -2.0]), period_s=0.02), y, u)


def last_of_lags(package, seconds=60.0):
    law, hold, x = ReferenceLaw(package), np.exp(-package.period_s), np.array([3.0, -3.0])
    for _ in range(round(seconds / package.period_s)):
        x = hold * x + (1.0 - hold) * np.array([[1.0, 2.0], [2.0, 1.0]]) @ law.step(x)
    return np.abs(x).max()


def test_a_law_that_is_stable_by_itself_must_recover_from_limits_too():
    """Ten decibels from instability, and with the second motor limited it never comes back."""
    plant, law = negative_pair()
    packages = {weak: package_law(law, "law", input_range=100.0, limit=[1.0, weak]) for weak in (1.0, 1e-3)}
    assert last_of_lags(packages[1.0]) < 1e-6
    assert last_of_lags(packages[1e-3]) > 0.5
    steps = examine_package(packages[1.0], {"lags": plant}).steps
    assert [step.name for step in steps if not step.passed] == ["recovery lags"]
    assert steps[-1].said.startswith("while 0 of u1 is applied: a root at 0 Hz grows (0.198 1/s)")
    alone = steps_of(package_of(np.random.default_rng(1), 1e-4))
    found = "nothing grows at any of 30 limits of outputs; proved for limits that come and go"
    assert (
        alone["recovery beam"].said
        == found + ", at full authority, while the sensors stay within their ranges"
    )


@pytest.mark.parametrize(("most", "refused"), [(2.0, True), (1.0, False)])
def test_a_law_must_recover_from_limits_at_every_adaptive_gain(most, refused):
    """At twice the gain half the law is the whole, which never comes back from a weak motor."""
    plant, law = negative_pair()
    halved = Compensator(dataclasses.replace(law.sampled, D=0.5 * law.sampled.D), law.inputs, law.outputs)
    package = package_law(halved, "law", input_range=100.0, limit=1.0)
    gain = AdaptiveGain(maximum=most, rate=1.0, sensor="y0", band_hz=(1.0, 5.0), quiet_rms=0.1, loud_rms=1.0)
    verdict = examine_package(package, {"lags": plant}, ANY, gain=gain)
    failed = [step for step in verdict.steps if not step.passed]
    assert [step.name for step in failed] == ["recovery lags at gains from 0 to 2"] * refused
    assert all("while 0 of u1 is applied" in step.said for step in failed)


def test_an_inner_loop_of_the_package_is_no_excuse():
    """The same gains as paths of its own: the article rests without them. What falls anyway is excused."""
    plant, law = negative_pair()
    gains = (1.2, -2.0)
    paths = tuple(LoopPath(k, k, Section(np.array([g, 0.0, 0.0]), np.zeros(2))) for k, g in enumerate(gains))
    silent = Compensator(dataclasses.replace(law.sampled, D=np.zeros((2, 2))), law.inputs, law.outputs)
    package = package_law(silent, "law", input_range=100.0, limit=1.0)
    package = add_test_vectors(dataclasses.replace(package, paths=paths, vectors=None))
    steps = examine_package(package, {"lags": plant}).steps
    assert [step.name for step in steps if not step.passed] == ["recovery lags"]
    assert steps[-1].said.startswith("while 0 of u1 is applied: a root at 0 Hz grows (0.198 1/s)")
    falls = StateSpace(0.1 * np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)))
    falling = dataclasses.replace(package, paths=paths[1:], vectors=None)
    own = LoopPath(0, 0, Section(np.array([-1.0, 0.0, 0.0]), np.zeros(2)))
    falling = add_test_vectors(dataclasses.replace(falling, paths=(own, *paths[1:])))
    assert check_recovery(falling, "falls", plant_of(falls), held=False, alone=None).passed


def test_a_limited_law_is_what_a_package_computes_that_learns_what_is_applied():
    """Sample by sample with filters, an inner loop, and shares of outputs, steps and commands applied."""
    rng = np.random.default_rng(3)
    whole, part = [1.0, 1.0], [0.25, 1.0]
    for gains, steps in (
        ([0.0, 1.0], whole), ([0.3, 0.8], part), (whole, [0.01, 0.5]), (whole, whole), ([0.0, 0.0], whole),
    ):  # fmt: skip
        section = Section(np.array([0.2, 0.3, 0.1]), np.array([-0.5, 0.2]))
        package = package_law(
            random_law(rng, 5, 2, 2), "law", filters=(InputFilter(1, section),), form="dense"
        )
        paths = (LoopPath(0, 1, section), LoopPath(1, 0, section))
        package = add_test_vectors(dataclasses.replace(package, paths=paths, vectors=None))
        drives, commands = np.array(gains), np.array([0.2, 1.0])
        slews, before = np.array(steps), np.zeros(2)
        limited = limited_law(package)(commands, drives, slews).sampled
        silent = dataclasses.replace(package.core, C=0.0 * package.core.C, D=0.0 * package.core.D)
        inner = ReferenceLaw(dataclasses.replace(package, core=silent, vectors=None))
        reference = ReferenceLaw(package)
        reference.level = package.ramp
        reference.engaged = True
        x = np.zeros(len(limited.A))
        for y in rng.standard_normal((60, 2)):
            reference.compute(y)
            inner.compute(y)
            applied = drives * (inner.wanted + commands * (reference.wanted - inner.wanted))
            before = applied = before + slews * (applied - before)
            reference.commit(applied)
            inner.commit(inner.wanted)
            np.testing.assert_allclose(limited.C @ x + limited.D @ y, applied, rtol=1e-9, atol=1e-12)
            x = limited.A @ x + limited.B @ y


def lead(gain, zero, pole):
    """u = -gain (1 + s / zero) / (1 + s / pole) y by Tustin's rule, limited in slew."""
    a, b = 2.0 / PERIOD_S / zero, 2.0 / PERIOD_S / pole
    n0, n1, d0, d1 = 1.0 + a, 1.0 - a, 1.0 + b, 1.0 - b
    A, D = -d1 / d0, -gain * n0 / d0
    C = -gain * n1 / d0 + A * D
    law = SampledStateSpace([[A]], [[1.0]], [[C]], [[D]], period_s=PERIOD_S)
    return Compensator(law, ports(0, 1, 1)[0], ports(0, 1, 1)[1])


def swings_on(plant, package, start, seconds=30.0):
    """Largest motion in the last quarter over that in the one before, from ``start`` at rest."""
    law = package.core
    step = sla.expm(np.block([[plant.dynamics.A, plant.dynamics.B], [np.zeros((1, 3))]]) * PERIOD_S)
    x, z, u, seen = np.array([start, 0.0]), 0.0, 0.0, []
    for _ in range(round(seconds / PERIOD_S)):
        wanted = law.C[0, 0] * z + law.D[0, 0] * x[0]
        u += np.clip(wanted - u, -package.slew[0], package.slew[0])
        z = law.A[0, 0] * z + law.B[0, 0] * x[0]
        x = step[:2, :2] @ x + step[:2, 2] * u
        seen.append(np.hypot(*x))
    quarter = len(seen) // 4
    return max(seen[-quarter:]) / max(seen[-2 * quarter : -quarter])


@pytest.mark.parametrize(("pole", "recovers"), [(60.0, False), (200.0, True)])
def test_a_law_must_recover_from_its_limit_of_slew(pole, recovers):
    """It is stable with the gate's margins; limited in slew it lags, and pumps the mode far from rest."""
    w = 4.0 * np.pi
    system = StateSpace([[0.0, w], [-w, -0.004 * w]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    y, u = ports(0, 1, 1)
    plant = Plant(dynamics=system, inputs=u, outputs=y)
    given = {"input_range": 100.0, "limit": 100.0, "ramp_s": 0.3}
    slow = package_law(lead(0.5, 3.0, pole), "law", slew_rate=5.0, **given)
    assert swings_on(plant, slow, 0.02) < 0.7
    assert (swings_on(plant, slow, 1.0) < 0.7) == recovers
    verdict = examine_package(slow, {"mode": plant})
    assert verdict.passed == recovers
    assert verdict.steps[-1].name == "recovery mode"
    said = (
        "nor for size and slew at once: no multipliers"
        if recovers
        else "of each step of u0 is applied: a root at"
    )
    assert said in verdict.steps[-1].said
    quick = package_law(lead(0.5, 3.0, pole), "law", **given)
    unlimited = examine_package(quick, {"mode": plant})
    assert unlimited.passed
    assert "at once" not in unlimited.steps[-1].said
    motor = Drive(port=u[0], lower=-100.0, upper=100.0, slew_rate=5.0)
    engine = EngineSettings(period_s=PERIOD_S, sensors=(SensorTest(port=y[0], range=100.0),), drives=(motor,))
    assert examine_package(quick, {"mode": plant}, settings=engine).passed == recovers


@pytest.mark.parametrize(
    ("reach", "rate", "passes"), [(2.0, 5.0, False), (0.05, 5.0, True), (100.0, 1e5, True)]
)
def test_a_limit_of_slew_that_no_sensor_s_range_reaches_is_none(reach, rate, passes):
    """The truth is the loop let go from the end of the range, beyond which the engine trips."""
    w = 4.0 * np.pi
    system = StateSpace([[0.0, w], [-w, -0.004 * w]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    package = package_law(lead(0.5, 3.0, 60.0), "law", input_range=reach, limit=300.0, slew_rate=rate)
    plant = one_port(system)
    assert (swings_on(plant, package, reach, seconds=20.0) < 0.7) == passes
    assert check_recovery(package, "mode", plant, held=False, alone=None).passed == passes


def test_a_limit_of_slew_that_is_not_reached_hides_no_other():
    """One motor split into five of a fifth of its rate, beside two quick ones that cancel: the same loop."""
    w = 4.0 * np.pi
    one = StateSpace([[0.0, w], [-w, -0.004 * w]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    seven = StateSpace(one.A, np.repeat(one.B, 7, axis=1), one.C, np.zeros((1, 7)))
    law, parts = lead(0.5, 3.0, 60.0), np.array([[0.2]] * 5 + [[1e-3], [-1e-3]])
    s, (y, u) = law.sampled, ports(0, 1, 7)
    split = SampledStateSpace(s.A, s.B, parts @ s.C, parts @ s.D, period_s=PERIOD_S)
    given = {"input_range": 2.0, "limit": 300.0}
    whole = package_law(law, "law", slew_rate=5.0, **given)
    assert swings_on(one_port(one), whole, 2.0) > 1.0
    package = package_law(Compensator(split, y, u), "law", slew_rate=[1.0] * 5 + [1e5] * 2, **given)
    found = check_recovery(
        package, "mode", Plant(dynamics=seven, inputs=u, outputs=y), held=False, alone=None
    )
    assert not found.passed
    assert "of each step of u0, u1, u2, u3, u4 is applied: a root at" in found.said
