"""Whatever goes wrong around an engine, in whatever state: it ends in SAFE or in correct completion."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from engine_campaigns import CAMPAIGNS, cases_of
from engine_faults import (
    ARTICLE,
    HOLDING,
    KINDS,
    OF_THE_DESIGN,
    RIG,
    STATES,
    engine_in,
    fault_settings,
    play,
)
from engine_rigs import (
    PIECE_S,
    end_of_normal_operation,
    engaging_step,
    nominal_article,
)
from repeats import repeats

pytestmark = pytest.mark.usefixtures("compiler")
SEEDS = range(25)
RUN = 48  # half minutes of normal operation in one go
ARTICLES = repeats(["dm", "simple"])
MOVING = tuple(state for state in STATES if state != "safe")


def _cases(kind):
    """Every state and seed; first a state that moves from kind to kind, one under control, then another."""
    cases, at = list(itertools.product(SEEDS, STATES)), KINDS.index(kind)
    first = [(0, STATES[at % len(STATES)]), (1, "control"), (2, STATES[(at + 2) % len(STATES)])]
    return [*first, *(case for case in cases if case not in first)]


def test_there_are_many_kinds():
    """By the names of the design's list, each played by kinds of its own."""
    assert len(OF_THE_DESIGN) >= 30
    assert sorted(kind for kinds in OF_THE_DESIGN.values() for kind in kinds) == sorted(KINDS)
    assert CAMPAIGNS["kinds of fault in every state"].whole == len(KINDS) * len(STATES) * len(SEEDS)


@pytest.mark.parametrize("kind", KINDS)
def test_it_ends_in_safe_or_in_correct_completion(kind):
    wrong = {}
    for seed, state in _cases(kind)[: cases_of("kinds of fault in every state") // len(KINDS)]:
        ending = play(kind, state, seed)
        if ending.why:
            wrong[seed, state] = ending
    assert not wrong


@pytest.mark.parametrize("state", MOVING)
@pytest.mark.parametrize("kind", ["sensor nan", "sensor inf", "sensor out of range"])
def test_a_sample_that_cannot_be_trips_in_itself(kind, state):
    """The command of that very sample is on its way from the last one to the safe state's."""
    settings = fault_settings()
    for seed in range(cases_of("samples that cannot be, in every state") // (3 * len(MOVING))):
        rng = np.random.default_rng([7, seed])
        start = HOLDING + int(rng.integers(100, 400))
        rig = dataclasses.replace(nominal_article(*ARTICLE), faults=RIG[kind](rng, start), seed=seed)
        wave = 0.02 * rng.standard_normal((50, len(settings.drives)))
        with engine_in(state, start, rig, settings, waveform=wave) as engine:
            engine.events()
            (sample,) = engine.run(1)
            (trip,) = [event for event in engine.events() if event.trips]
            assert engine.state == "safe"
        assert trip.sample == start
        assert trip.kind == ("range" if kind == "sensor out of range" else "not finite")
        assert np.isfinite(sample["u"]).all()


@pytest.mark.parametrize("state", STATES)
def test_stop_takes_one_sample(state):
    for seed in range(cases_of("STOP in every state") // len(STATES)):
        rng = np.random.default_rng([8, seed])
        start = HOLDING + int(rng.integers(100, 400))
        rig = dataclasses.replace(nominal_article(*ARTICLE), seed=seed)
        settings = fault_settings()
        wave = 0.02 * rng.standard_normal((50, len(settings.drives)))
        with engine_in(state, start, rig, settings, waveform=wave) as engine:
            engine.events()
            engine.stop()
            engine.run(1, keep=False)
            (trip,) = [event for event in engine.events() if event.trips]
            assert (engine.state, trip.kind, trip.sample) == ("safe", "stop", start)


@pytest.mark.parametrize("article", ARTICLES)
def test_engaging_adds_at_most_one_hundredth_of_the_limit_to_a_step(article):
    """Sample by sample, beside the step that hold or whole law would take there."""
    for seed in range(cases_of("engaging and disengaging") // len(ARTICLES)):
        assert engaging_step(seed, article) <= 0.01


@pytest.mark.parametrize("article", ARTICLES)
def test_nothing_trips_in_normal_operation(article):
    """Under the study's disturbance and noise: 24 simulated hours; `make test` runs 72 minutes."""
    runs = cases_of("normal operation: half minutes of 24 h") // len(ARTICLES) // RUN
    for seed in range(runs):
        state, events = end_of_normal_operation(seed, article, RUN * PIECE_S)
        assert state == "control", events
