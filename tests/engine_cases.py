"""Engines, articles and packages for the tests of the engine."""

from __future__ import annotations

import functools

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.engine.rigs.linear_article import LinearArticle
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_law import package_law
from middeck.systems.state_space.statespace import SampledStateSpace
from packaged_laws import PERIOD_S, ports, random_law

SENSORS, OUTPUTS = 3, 2


def plain_settings(**changes) -> EngineSettings:
    """Three sensors and two outputs, without a hold or a monitor."""
    y, u = ports(0, SENSORS, OUTPUTS)
    given = {
        "sensors": tuple(SensorTest(port=port, range=10.0) for port in y),
        "drives": tuple(Drive(port=port, lower=-0.5, upper=0.5) for port in u),
        "effort_s": 0.0,
        "heartbeat_s": 0.0,
        "period_s": PERIOD_S,
    }
    return EngineSettings(**{**given, **changes})


def random_article(seed: int = 2, states: int = 6, **changes) -> LinearArticle:
    """A stable article that noise moves."""
    rng = np.random.default_rng(seed)
    A = 0.95 * np.eye(states) + 0.05 * rng.standard_normal((states, states))
    given = {
        "A": A / (1.05 * np.abs(np.linalg.eigvals(A)).max()),
        "B": 1e-2 * rng.standard_normal((states, OUTPUTS)),
        "C": rng.standard_normal((SENSORS, states)),
        "G": 1e-3 * np.eye(states),
        "x": np.zeros(states),
        "sensor_noise": np.full(SENSORS, 1e-3),
        "seed": seed,
    }
    return LinearArticle(**{**given, **changes})


@functools.cache
def random_package(seed: int = 1, states: int = 20, form: str = "auto", **changes) -> ControllerPackage:
    """A law that often reaches its limits, with the path of applied commands."""
    law = random_law(np.random.default_rng(seed), states, SENSORS, OUTPUTS, radii=(0.9, 0.99))
    given = {"input_range": 0.1, "limit": 0.5, "ramp_s": 0.5}
    return package_law(law, "law", form=form, **{**given, **changes})


def still_article(y, **changes) -> LinearArticle:
    """Its sensors stand at ``y``, whatever the outputs do."""
    n = len(y)
    fixed = {"A": np.eye(n), "B": np.zeros((n, OUTPUTS)), "C": np.eye(n), "G": np.zeros((n, 1))}
    return LinearArticle(**{**fixed, "x": np.array(y, float), "sensor_noise": np.zeros(n), **changes})


def static_package(gain, limit=0.5, slew_rate=np.inf, **changes) -> ControllerPackage:
    """u = gain y, without a state."""
    y, u = ports(0, SENSORS, OUTPUTS)
    system = SampledStateSpace(
        np.zeros((0, 0)), np.zeros((0, SENSORS)), np.zeros((OUTPUTS, 0)), gain, period_s=PERIOD_S
    )
    name = changes.pop("name", "law")
    return package_law(Compensator(system, y, u), name, limit=limit, slew_rate=slew_rate, **changes)


def verified(engine):
    """Reset, hold alone, and return when the hold is verified."""
    assert engine.reset().done
    engine.run(engine.settings.samples(0.5) + 60, keep=False)
    assert engine.file.status["hold_verified"] == 1


def kinds(engine):
    return [event.kind for event in engine.events()]
