"""The engine's clock: deadlines on one grid from the start, whatever a sample takes or a sleep is late by."""

from __future__ import annotations

import numpy as np
import pytest

from engine_cases import plain_settings, random_article
from faked_clock import SupervisorByFakedClock, faked_clock

pytestmark = pytest.mark.usefixtures("compiler")
PERIOD = 2_000_000
LATE_S = 0.0005


def started(clock, late_most=2):
    settings = plain_settings(late_s=LATE_S, late_most=late_most)
    return SupervisorByFakedClock(settings, random_article(), clock=clock)


def grid(clock, engine):
    """Deadlines of all sleeps so far, in periods after the first; the last belongs to the next sample."""
    found = clock.deadlines(1, clock["sleeps"])
    assert len(found) == engine.sample + 1
    assert np.all((found - found[0]) % PERIOD == 0)
    return (found - found[0]) // PERIOD


def test_deadline_k_is_k_periods_after_the_first():
    """To the nanosecond, though sleeps end late by up to a quarter of a period, and samples take time."""
    rng = np.random.default_rng(3)
    with faked_clock() as clock, started(clock) as engine:
        assert engine.reset().done
        for _ in range(300):
            clock["late"], clock["slow"] = (int(n) for n in rng.integers(0, PERIOD // 4, 2))
            engine.run(1, keep=False)
        assert np.array_equal(grid(clock, engine), np.arange(engine.sample + 1))
        assert engine.state == "ready"
        assert engine.file.status["late"] == 0


@pytest.mark.parametrize("where", ["late", "slow"])
@pytest.mark.parametrize(("periods", "trips"), [(1.25, False), (1.75, False), (7.25, True), (2500.5, True)])
def test_deadlines_that_have_passed_are_left_out_and_the_grid_stays(where, periods, trips):
    """A sleep that ends late, or a sample that takes long: the next deadline is the next of the grid to come.

    As many records as there were samples tell how late; more periods at once than samples may be late trip.
    """
    stalled = int(periods * PERIOD)
    with faked_clock() as clock, started(clock) as engine:
        assert engine.reset().done
        engine.run(20, keep=False)
        before = engine.sample
        clock[where] = stalled
        records = engine.run(20)
        found = grid(clock, engine)
        (trip,) = [event for event in engine.events() if event.trips] or [None]
    # A long sample leaves its successor to begin at once, and late by what is left beyond its deadline.
    at = before if where == "late" else before + 1
    late = stalled if where == "late" else stalled - PERIOD
    skipped = late // PERIOD
    assert np.array_equal(found, np.arange(len(found)) + skipped * (np.arange(len(found)) > at))
    sequence = before + np.arange(len(records))
    assert records["late_ns"].tolist() == np.where(sequence == at, late, 0).tolist()
    assert records["step_ns"].max() == (stalled if where == "slow" else 0)
    assert (trip is not None) == trips
    if trip is not None:
        assert (trip.kind, trip.sample, trip.value) == ("lateness", at, late)


@pytest.mark.parametrize("late_most", [0, 2])
def test_as_many_samples_in_a_row_as_allowed_may_be_late(late_most):
    """And one more trips, in itself; one in time between them begins the count anew."""
    late = round(1e9 * LATE_S) + 1
    with faked_clock() as clock, started(clock, late_most) as engine:
        assert engine.reset().done
        for in_row in (late_most, late_most, late_most + 1):
            engine.run(1, keep=False)
            for _ in range(in_row):
                assert engine.state == "ready"
                clock["late"] = late
                engine.run(1, keep=False)
        assert engine.state == "safe"
        assert [event.kind for event in engine.events() if event.trips] == ["lateness"]
        assert engine.file.status["late"] == 3 * late_most + 1
        assert engine.file.status["worst_late_ns"] == late
