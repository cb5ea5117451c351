"""What a run on a rig takes and refuses, and where it begins."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.errors import ConfigError, DataError, NumericalError
from middeck.joints import balance
from middeck.joints.attachment import JointElements
from middeck.joints.friction import Friction
from middeck.laboratory.rig.linear_view import close_rig
from middeck.laboratory.rig.parts.computer import place_law
from middeck.laboratory.rig.parts.motors import Motor
from middeck.laboratory.rig.parts.sensors import Encoder, Sampler
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.runs import StopRule, find_steady_start, run_closed_loop, run_open_loop
from middeck.laboratory.rig.ticks.simulate_rig import DivergedError, simulate_rig, switch_on
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace
from plant_builders import sum_of_modes
from rig_checks import on_rig

RATE = 200.0
T = 1.0 / RATE


def two_bodies():
    """Two springs with a body of one unit each, and nothing between them."""
    modal = sum_of_modes(2.0 * np.pi * np.array([2.0, 3.0]), 0.01, np.eye(2), np.eye(2))
    inputs, outputs = (tuple(Port(f"{k}{i}", unit) for i in "ab") for k, unit in (("u", "N m"), ("y", "rad")))
    return Plant(dynamics=modal, inputs=inputs, outputs=outputs)


def rig_of(**more):
    return build_rig(two_bodies(), **{"sample_hz": RATE, "delay_s": 0.01} | more)


def rng():
    return np.random.default_rng(0)


U = np.random.default_rng(1).standard_normal((200, 2))


def test_friction_at_a_steady_start_gives_no_more_than_its_slip_torque():
    """By the impulse of a tick: what friction takes from each body is at most slip torque times a tick."""
    t = T * np.arange(200)
    u = np.cos(2.0 * np.pi * np.outer(t, [2.0, 3.0]))
    slip = np.array([0.02, 0.005])
    joints = [
        JointElements(f"u{i}", f"y{i}", (Friction(float(s), 200.0),)) for i, s in zip("ab", slip, strict=True)
    ]
    rigs = [rig_of(joints=each) for each in (joints, [])]
    ends = []
    for rig in rigs:
        loop = close_rig(rig, place_law(None, rig.inputs, rig.outputs, T))
        start = find_steady_start(rig, loop, u, switch_on(rig, None, 0.0, rng()))
        angle = rig.plant.read @ start.x
        ends.append(next(simulate_rig(rig, None, [u[:1]], rng(), start)).state.x)
    # At least ten times as far out as it gives way before it slips.
    assert np.all(np.abs(angle) > 10.0 * slip / 200.0)
    rate = two_bodies().dynamics.omega * (ends[1] - ends[0])[1::2]
    assert np.all(np.abs(rate) <= slip * T * (1.0 + 1e-9))
    assert np.all(np.abs(rate) > 0.5 * slip * T)


@pytest.mark.parametrize("limits", [(0.02, 1e9), (1e9, 0.02)])
def test_of_two_stops_of_an_output_the_tighter_holds(limits):
    stops = [StopRule("ya", limit) for limit in limits]
    run = run_open_loop(rig_of(), 10.0 * U, periods=1, rng=rng(), stops=stops)
    assert run.cause.startswith("stopped: ya at ")
    y = np.abs(run.partial.y[0, 0, :, 0])
    assert y[-1] > 0.02 >= y[:-1].max()


@pytest.mark.parametrize("motors", [None, {"ua": Motor(torque_limit=1.0), "ub": Motor()}], ids=["lin", "not"])
@pytest.mark.parametrize("steady", [False, True])
def test_an_excitation_is_checked_before_it_is_used(motors, steady):
    rig = rig_of(motors=motors)
    bad = U.copy()
    bad[5] = np.nan
    for u, kind, says in (
        (U[:, 0], ConfigError, r"shape \(200,\) for 2 motors"),
        (U[:, :1], ConfigError, r"shape \(200, 1\) for 2 motors"),
        (U[:0], ConfigError, "0 samples"),
        (bad, DataError, "not finite"),
    ):
        with pytest.raises(kind, match=says):
            run_open_loop(rig, u, periods=1, rng=rng(), steady=steady)
    for periods in (0, 1.5):
        with pytest.raises(ConfigError, match=f"{periods} periods of 200 samples"):
            run_open_loop(rig, U, periods=periods, rng=rng(), steady=steady)


def test_what_a_rig_is_built_from_is_checked():
    with pytest.raises(ConfigError, match=r"1\.5 substeps in a tick"):
        rig_of(substeps=1.5)
    with pytest.raises(ConfigError, match="-5 s old"):
        rig_of(age_s=-5)


def test_a_start_of_another_rig_or_law_is_refused():
    lag = SampledStateSpace([[0.5]], [[1.0, 0.0]], [[0.1], [0.0]], np.zeros((2, 2)), period_s=T)
    for motors in (None, {"ua": Motor(torque_limit=1.0), "ub": Motor()}):
        rig, other = rig_of(motors=motors), rig_of(motors=motors, delay_s=0.05)
        for law, start in (
            (None, switch_on(other, None, 0.0, rng())),
            (on_rig(rig, lag), switch_on(rig, None, 0.0, rng())),
        ):
            with pytest.raises(ConfigError, match="of the start has the shape"):
                list(simulate_rig(rig, law, [U], rng(), start))


def test_torques_that_do_not_settle_are_no_divergence(monkeypatch):
    monkeypatch.setattr(balance, "MOST_ITERATIONS", 0)
    rig = rig_of(joints=[JointElements("ua", "ya", (Friction(0.1, 10.0),))])
    with pytest.raises(NumericalError, match="do not settle within a step"):
        run_open_loop(rig, U, periods=1, rng=rng())


@pytest.mark.parametrize("sensors", [None, {"ya": Encoder(1e-3), "yb": Sampler()}], ids=["lin", "not"])
def test_a_torque_that_overflows_in_the_last_tick_is_no_record(sensors):
    """The plant has not moved yet: only what is issued has left the range of numbers."""
    law = SampledStateSpace([[1.0]], [[0.0, 0.0]], [[1.0], [0.0]], np.zeros((2, 2)), period_s=T)
    rig = rig_of(delay_s=0.05, sensors=sensors)
    start = switch_on(rig, on_rig(rig, law), 0.0, rng())
    start = dataclasses.replace(start, computer=np.array([1e308]))
    assert np.isfinite(next(simulate_rig(rig, on_rig(rig, law), [U[:3]], rng(), start)).torque).all()
    with pytest.raises(DivergedError, match="overflows"):
        list(simulate_rig(rig, on_rig(rig, law), [np.full((3, 2), 1e308)], rng(), start))


@pytest.mark.parametrize("scale", [1.0, 1e3, 1e6, 1e7])
def test_stability_does_not_depend_on_the_unit_of_time(scale):
    """Undamped modes are stable, and ones that grow by 6e-4 a cycle are not, at 200 Hz and at 2 GHz."""
    omega = 2.0 * np.pi * scale * np.random.default_rng(2).uniform(0.2, 80.0, 20)
    shape = np.random.default_rng(3).standard_normal((1, 20))
    for zeta, stable in ((0.0, True), (-1e-4, False)):
        modal = sum_of_modes(omega, zeta, shape.T, shape, names=tuple(map(str, range(20))))
        plant = Plant(dynamics=modal, inputs=(Port("u", "N m"),), outputs=(Port("y", "rad"),))
        rig = build_rig(plant, sample_hz=RATE * scale, delay_s=2.0 * T / scale)
        run = run_closed_loop(rig, None, U[:, :1], periods=1, rng=rng(), rest_s=0.0)
        assert (run.cause == "") == stable
