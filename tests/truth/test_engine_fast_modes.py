"""A mode of 20 or 45 Hz that a law destabilises in closed loop, far below any limit of an angle.

Rate feedback through a delay damps what is slow and drives what is fast, until the motor saturates.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.control.law.compensator import Compensator
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.engine.rigs.linear_article import linear_article
from middeck.realtime.engine.trials.standard_trips import standard_monitors
from middeck.realtime.package.package_law import package_law
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
PERIOD_S, DELAY_S, LIMIT, ENVELOPE = 0.002, 0.014, 0.5, np.radians(2.0)
ANGLE, RATE, TORQUE = Port("angle", "rad"), Port("angle_rate", "rad/s"), Port("torque", "N m")
SLOW, FAST_DAMPING = (0.8, 0.02, 0.05), 0.003
# Frequency, what a torque does to the mode, gain of the law.
FAST = [(20.0, 0.24, 64.0), (45.0, 0.84, 15.0)]


def article_of(hz, push):
    modes = [SLOW, (hz, FAST_DAMPING, push)]
    w = [2.0 * np.pi * f for f, _, _ in modes]
    A = sla.block_diag(*([[0.0, 1.0], [-f * f, -2.0 * q * f]] for f, (_, q, _) in zip(w, modes, strict=True)))
    B = np.array([[value] for _, _, b in modes for value in (0.0, b)])
    plant = Plant(
        dynamics=StateSpace(A, B, np.array([[1.0, 0.0] * 2, [0.0, 1.0] * 2]), np.zeros((2, 1))),
        inputs=(TORQUE,),
        outputs=(ANGLE, RATE),
    )
    return linear_article(
        delay_plant(plant, DELAY_S), PERIOD_S, ["torque"], ["angle", "angle_rate"],
        disturbed=["torque"], disturbance_rms=0.005, sensor_noise=[1e-6, 1e-4], seed=3,
    )  # fmt: skip


def package_of(gain):
    law = SampledStateSpace(
        np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), [[0.0, -gain]], period_s=PERIOD_S
    )
    return package_law(Compensator(law, (ANGLE, RATE), (TORQUE,)), "damper", limit=LIMIT, ramp_s=0.3)


def settings_of(**changes):
    sensors = SensorTest(port=ANGLE, range=0.5, envelope=ENVELOPE), SensorTest(port=RATE, range=20.0)
    drives = (Drive(port=TORQUE, lower=-LIMIT, upper=LIMIT),)
    return EngineSettings(period_s=PERIOD_S, sensors=sensors, drives=drives, **changes)


def run(settings, article, gain, seconds):
    """Records from the command to engage, and the trips by their places in them."""
    with Supervisor(settings, article, ring=1 << 15) as engine:
        assert engine.load(package_of(gain)).done
        assert engine.reset().done
        engine.run(500, keep=False)
        assert engine.command("engage", values=[1.0]).done
        first, records = engine.sample, engine.run(settings.samples(seconds))
        return records, [(event.sample - first, event.kind) for event in engine.events() if event.trips]


def growth(article, gain):
    """Of the loop without a limit [1/s], and the frequency [Hz], by its own poles."""
    poles = np.linalg.eigvals(article.A - gain * article.B @ article.C[1:])
    top = np.log(poles[np.argmax(np.abs(poles))]) / PERIOD_S
    return np.real(top), abs(np.imag(top)) / (2.0 * np.pi)


@pytest.mark.parametrize(("hz", "push", "gain"), FAST)
def test_a_fast_mode_that_a_law_destabilises_swings_at_hundredths_of_a_degree(hz, push, gain):
    """With the envelope alone it swings on, as large as the describing function of the motor's limit says."""
    article = article_of(hz, push)
    rate, found_hz = growth(article, gain)
    assert rate > 0.5
    assert abs(found_hz - hz) < 0.06 * hz  # at the limit the law is weaker, and the mode where it was
    records, trips = run(settings_of(effort_s=0.0), article, gain, 14.0)
    assert not trips
    late = records[-2000:]
    swing = np.sqrt(2.0) * np.std(late["y"][:, 0])
    w, lag = 2.0 * np.pi * hz, DELAY_S + PERIOD_S / 2
    square = 4.0 * LIMIT / np.pi  # the motor is at its limit nearly always
    predicted = square * push * abs(np.cos(w * lag)) / (2.0 * FAST_DAMPING * w * w)
    assert swing == pytest.approx(predicted, rel=0.2)
    assert 0.01 < np.degrees(swing) < 0.1
    assert np.abs(late["y"][:, 0]).max() < 0.05 * ENVELOPE
    assert np.mean(np.abs(late["u"]) >= LIMIT) > 0.7


@pytest.mark.parametrize("guard", ["effort", "band power"])
@pytest.mark.parametrize(("hz", "push", "gain"), FAST)
def test_effort_and_band_power_each_catch_it_before_any_angle(hz, push, gain, guard):
    """Within ten growth times or 2 s of saturation, at hundredths of a degree, and for good."""
    article, bare = article_of(hz, push), settings_of(effort_s=0.0)
    settings = settings_of()
    if guard == "band power":
        normal, trips = run(bare, article, gain / 20.0, 15.0)
        assert not trips
        monitors = standard_monitors(bare, normal["y"], normal["u"])
        settings = dataclasses.replace(bare, monitors=monitors)
        quiet, trips = run(settings, dataclasses.replace(article, seed=4), gain / 20.0, 15.0)
        assert not trips  # nothing of normal operation
        assert np.abs(quiet["u"]).max() > 0.0
    records, ((at, kind),) = run(settings, article, gain, 10.0)
    assert kind == guard
    saturated = np.cumsum(np.abs(records["u"][:, 0]) >= LIMIT)[at] * PERIOD_S
    assert at * PERIOD_S - 0.3 < 10.0 / growth(article, gain)[0] or saturated <= 2.0
    assert np.degrees(np.abs(records["y"][:, 0]).max()) < 0.1
    assert not records["u"][-500:].any()
