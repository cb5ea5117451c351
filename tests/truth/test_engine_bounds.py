"""What the engine bounds of its own accord: how long a law takes to leave, and what a wheel has stored."""

from __future__ import annotations

import numpy as np
import pytest

from engine_cases import OUTPUTS, SENSORS, kinds, plain_settings, static_package, still_article
from middeck.errors import ConfigError
from middeck.realtime.engine.interface.settings import LEAST_RAMP, Drive
from middeck.realtime.engine.process.supervisor import Supervisor
from packaged_laws import PERIOD_S, ports

pytestmark = pytest.mark.usefixtures("compiler")
STILL = still_article(np.full(SENSORS, 0.5))
RAMP_S, LEAVE_S = 7.0, 0.61
"""3500 samples are no multiple of 305: some samples fall by eleven levels, some by twelve."""


def long_package(gain=0.2, **changes):
    return static_package(np.full((OUTPUTS, SENSORS), gain), limit=0.5, **{"ramp_s": RAMP_S, **changes})


def fallen(ramp, within):
    """3 s^2 - 2 s^3 of the level after each sample, which falls by ramp / within on the average."""
    k = np.arange(within + 2)
    s = np.maximum(ramp - k * ramp // within, 0) / ramp
    return s * s * (3.0 - 2.0 * s)


def test_a_law_leaves_within_what_the_settings_allow():
    """Hours of its own ramp are how it may rise, not how it may leave."""
    settings = plain_settings(ramp_s=0.3, leave_s=LEAVE_S)
    ramp, within = settings.samples(RAMP_S), settings.samples(LEAVE_S)
    with Supervisor(settings, STILL) as engine:
        assert engine.load(long_package()).done
        engine.reset()
        engine.command("engage", values=[1.0])
        risen = engine.run(ramp)["u"][:, 0]
        assert engine.state == "control"
        engine.command("disengage")
        u = engine.run(within + 2)["u"][:, 0]
        assert engine.state == "ready"
        engine.command("engage", values=[1.0])
        again = engine.run(ramp)["u"][:, 0]
    assert np.allclose(u, 0.3 * fallen(ramp, within), atol=1e-12)
    assert np.abs(np.diff(u)).max() <= 0.01 * 0.5
    assert np.array_equal(again, risen)


def test_a_law_that_is_relieved_leaves_as_fast():
    """Beside the other slot, which rises along its own ramp; at the shortest time that settings can name."""
    settings = plain_settings(ramp_s=0.0, leave_s=0.0)
    with Supervisor(settings, STILL) as engine:
        assert engine.load(long_package()).done
        assert engine.load(long_package(-0.1, name="other", ramp_s=0.0), slot=1).done
        engine.reset()
        engine.command("engage", values=[1.0])
        engine.run(settings.samples(RAMP_S), keep=False)
        engine.command("engage", slot=1, values=[1.0])
        records = engine.run(2 * LEAST_RAMP + 2)
        engine.load(long_package(0.1))
        assert engine.state == "control"
    assert np.allclose(records["added_0"][:, 0], 0.3 * fallen(3500, 2 * LEAST_RAMP), atol=1e-12)
    assert np.abs(np.diff(records["u"][:, 0])).max() <= 0.01 * 0.5
    assert np.allclose(records["u"][-1], -0.15)


def test_a_wheel_counts_from_what_it_has_stored():
    """The engine after this one is told where this one has stopped."""
    _, u = ports(0, SENSORS, OUTPUTS)

    def settings(stored):
        first, second = (
            Drive(port=port, lower=-0.5, upper=0.5, momentum=0.5, stored=s)
            for port, s in zip(u, stored, strict=True)
        )
        return plain_settings(drives=(first, second))

    with Supervisor(settings((0.3, -0.7)), STILL) as engine:
        assert engine.momentum.tolist() == [0.3, -0.7]
        engine.reset()
        engine.set_strip("u0", "offset", 0.1)
        engine.set_strip("u1", "offset", 0.1)  # a wheel beyond its limit may come back
        records = engine.run(800)
        assert not any(event.trips for event in engine.events())
    stored = engine.momentum
    pushed = PERIOD_S * np.cumsum(engine.file.ring["u"][: engine.sample], axis=0)[-1]
    assert np.allclose(stored - pushed, (0.3, -0.7), atol=1e-12)
    assert records["u"][-1].tolist() == [0.1, 0.1]
    with Supervisor(settings(stored), STILL) as engine:
        engine.reset()
        engine.set_strip("u0", "offset", 0.1)
        engine.run(600, keep=False)
        assert kinds(engine)[-1] == "momentum"


@pytest.mark.parametrize("stored", [None, np.nan, np.inf])
def test_a_wheel_without_what_it_has_stored_is_refused(stored):
    _, (u, _) = ports(0, SENSORS, OUTPUTS)
    with pytest.raises(ConfigError, match=r"momentum 0\.5 counted from"):
        Drive(port=u, lower=-0.5, upper=0.5, momentum=0.5, stored=stored)
