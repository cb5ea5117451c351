"""Engines, articles and packages for the tests of the engine."""

from __future__ import annotations

import functools

import numpy as np

from middeck.realtime.engine.article import LinearArticle
from middeck.realtime.engine.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.package.build import package_law
from middeck.realtime.package.package import ControllerPackage
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
