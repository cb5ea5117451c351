"""A replayed package: one that came before and comes again, whole and sealed, when it must not."""

from __future__ import annotations

import numpy as np
import pytest

from engine_cases import (
    OUTPUTS,
    SENSORS,
    kinds,
    plain_settings,
    random_package,
    static_package,
    still_article,
)
from middeck.realtime.engine.interface.commands import REASONS
from middeck.realtime.gate.gate import examine_package
from middeck.realtime.package.package_bytes import encode_package, hash_law
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import StateSpace
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
SETTINGS = plain_settings(effort_s=0.5)


def engine_at(level):
    return Supervisor(SETTINGS, still_article([level] * SENSORS))


def tripped():
    """The bytes of a package, and the laws on the blacklist of the engine that it has tripped."""
    data = encode_package(static_package(np.full((OUTPUTS, SENSORS), 0.3), limit=1e-3, input_range=2.0))
    with engine_at(0.5) as engine:
        assert engine.load(data).done
        assert engine.reset().done
        engine.command("engage", values=[1.0])
        engine.run(600, keep=False)
        assert engine.state == "safe"
        answer = engine.load(data)
        assert (answer.word, kinds(engine)[-1]) == ("on blacklist", "refused")
        assert answer.reason == REASONS["on blacklist"]
        return data, engine.blacklist()


def test_a_package_that_has_tripped_and_is_sent_again():
    """To the engine, to the next one, and to the gate, which says what it did."""
    data, listed = tripped()
    with Supervisor(SETTINGS, still_article([0.5] * SENSORS), blacklist=listed) as engine:
        assert engine.load(data).word == "on blacklist"
        assert engine.command("standby").word == "not loaded"
    package = static_package(np.full((OUTPUTS, SENSORS), 0.3), limit=1e-3, input_range=2.0)
    assert encode_package(package) == data
    one = StateSpace(-np.eye(1), np.ones((1, OUTPUTS)), np.ones((SENSORS, 1)), np.zeros((SENSORS, OUTPUTS)))
    model = Plant(dynamics=one, inputs=package.outputs, outputs=package.inputs)
    verdict = examine_package(package, {"lag": model}, blacklist={hash_law(package): "effort u0"})
    assert not verdict.passed
    assert [(step.name, step.said) for step in verdict.steps] == [("blacklist", "it has tripped: effort u0")]


def loaded(engine):
    """A package is loaded: the row of its command."""
    answer = engine.load(random_package())
    assert answer.done
    return engine.file.commands[answer.number % len(engine.file.commands)].copy()


def test_an_upload_of_an_earlier_session_that_is_commanded_again():
    """Row and bytes as they stood: they say whose command it is."""
    with engine_at(0.0) as engine:
        row = loaded(engine)
    with engine_at(0.0) as engine:
        number = int(engine.file.status["acknowledged"]) + 1
        assert int(row["number"]) == number
        engine.file.stage(random_package())
        engine.file.commands[number % len(engine.file.commands)] = row
        engine.file.asks["written"] = number
        answer = engine.answer(number)
        assert answer.word == "other session"
        assert "another supervisor, or from before" in answer.reason
        assert engine.command("standby").word == "not loaded"


def test_an_upload_of_this_session_is_carried_out_once():
    """An old number is not the next one: the engine waits for its next command."""
    with engine_at(0.0) as engine:
        row = loaded(engine)
        assert kinds(engine)[-1] == "loaded"
        old = int(row["number"])
        for number in (old, old + 1):
            engine.file.commands[number % len(engine.file.commands)] = row
            engine.file.asks["written"] = number
            engine.run(50, keep=False)
            assert int(engine.file.status["acknowledged"]) == old
        assert not kinds(engine)
        engine.file.asks["written"] = old
        assert engine.reset().done
