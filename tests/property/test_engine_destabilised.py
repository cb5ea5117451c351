"""Packages that destabilise the article trip in time, angles within twice the envelope, without a gate."""

from __future__ import annotations

import csv
import importlib
import json
from pathlib import Path

import numpy as np
import pytest

from engine_campaigns import cases_of
from engine_destabilising import SLOW_S, draw, judge, refused_on_paper
from engine_rigs import closed_states, rig_case, settings_of
from engine_truths import attempt, on_board, packed, refusals
from middeck.realtime.gate.linear_law import linear_law
from middeck.realtime.gate.package_with_hold import with_hold
from middeck.realtime.gate.steps_without_rig import GateMargins, Tried, check_loops
from repeats import repeats

pytestmark = pytest.mark.usefixtures("compiler")
ROOT = Path(__file__).parents[2]
RIGS = [("dm", "lab"), ("simple", "lab"), ("simple", "orbit"), ("dm", "orbit")]


def _sound(outcome):
    """One that grows fast was stopped as it must be; a slow one broke no limit."""
    if outcome.rate < 1.0 / SLOW_S:
        return outcome.bounded
    return outcome.sound and outcome.trip and outcome.blacklisted


def test_random_packages_that_destabilise_are_stopped():
    """Wrong gains, signs, channels, delays, and compensators out of the blue, on four rigs in turn."""
    seeds = range(cases_of("random packages past the gate"))
    rigs = [RIGS[k % len(RIGS)] for k in seeds]
    found = {seed: judge(draw(seed, *rig), *rig) for seed, rig in zip(seeds, rigs, strict=True)}
    assert not {seed: outcome for seed, outcome in found.items() if not _sound(outcome)}


@pytest.fixture
def truth(monkeypatch):
    """The benchmark of packages that only the truth destabilises, and its list."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    truth = importlib.import_module("packaged.truth")
    with truth.LISTED.open(encoding="utf-8", newline="") as file:
        return truth, list(csv.DictReader(file))


def test_packages_that_only_the_truth_destabilises_are_stopped(truth):
    """Those of the list, drawn anew: stable on both models, each frequency of the truth off by 2 to 5 %."""
    for one in truth[1][: cases_of("packages that only the truth destabilises, past the gate")]:
        again = attempt(int(one["number"]), int(one["attempt"]))
        assert again is not None, one
        assert 1.0 / again.found.rate == pytest.approx(float(one["growth_time_s"]), rel=0.01)
        assert _sound(judge(again.found, *again.family.rig)), one


def test_a_thousand_that_only_the_truth_destabilises_are_listed(truth):
    """None twice, each with what refused and what stopped it, fast and slow ones together all of them."""
    benchmark, listed = truth
    assert [int(one["number"]) for one in listed] == list(range(1000))
    assert len({(one["decades_of_authority"], one["growth_time_s"]) for one in listed}) == 1000
    fast = [one for one in listed if float(one["growth_time_s"]) < 10.0]
    slow = [one for one in listed if float(one["growth_time_s"]) >= 10.0]
    assert len(fast) + len(slow) == 1000
    for one in fast:
        assert one["stopped_by"] != "nothing"
        assert float(one["after_full_authority_s"]) <= float(one["allowed_s"])
        assert float(one["allowed_s"]) <= 10.0 * float(one["growth_time_s"]) * (1.0 + 1e-3)  # as printed
        assert one["on_blacklist"] == "yes"
    assert all(one["stopped_by"] for one in slow)
    assert all(float(one["angle_over_envelope"]) <= 2.0 for one in listed)
    assert all(float(one["torque_over_limit"]) <= 1.0 for one in listed)
    results = json.loads((ROOT / "benchmarks/results/realtime.json").read_text(encoding="utf-8"))["rows"]
    assert [row for row in results if row["case"] == benchmark.CASE] == benchmark.table_rows(listed, 1000)


def test_the_steps_that_refuse_what_only_the_truth_destabilises_come_out_again(truth):
    """One that passes every run there, one that stops at the first cheap step, and one in between."""
    benchmark, every = truth
    listed = sorted(every, key=lambda one: one["refused_by"].count(",") if one["refused_by"] else 9)
    one_motor = [one for one in listed if one["motors"] == "1"]
    for one in repeats([one_motor[0], one_motor[-1]], 2):
        again = attempt(int(one["number"]), int(one["attempt"]))
        steps = [step for step in one["refused_by"].split(", ") if step and not benchmark.is_last(step)]
        assert refusals(again) == steps


def test_where_6_db_at_a_motor_let_a_model_grow_the_gate_refuses_it(truth):
    """The gate's margins, by its own search of frequencies, agree with poles of loops closed here."""
    weak = [one for one in truth[1] if one["refused_by"].startswith("model") and one["motors"] == "1"]
    for one in repeats(weak):
        again = attempt(int(one["number"]), int(one["attempt"]))
        settings = settings_of(*again.family.rig)
        law = [Tried("engaged", linear_law(with_hold(packed(again), settings)))]
        models = on_board(*again.family.rig).values()
        assert not all(check_loops("model", case.plant, law, GateMargins()).passed for case, _ in models)


def test_no_package_passes_the_gate_on_the_model_that_it_destabilises():
    """Those of the first test, beside the hold of the engine that would run them."""
    seeds = range(cases_of("random packages at the gate, the study's articles"))
    rigs = [RIGS[k % len(RIGS)] for k in seeds]
    found = [refused_on_paper(draw(seed, *rig).law, *rig) for seed, rig in zip(seeds, rigs, strict=True)]
    assert set(found) <= {"interface", "poles", "vectors", "model"}  # not "", which passes on paper


def test_slow_packages_are_listed_one_by_one(monkeypatch):
    """With what stopped each: the list has as many as the benchmark counts, and each comes out again."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    slow = importlib.import_module("packaged.slow")
    with slow.LISTED.open(encoding="utf-8", newline="") as file:
        listed = list(csv.DictReader(file))
    results = json.loads((ROOT / "benchmarks/results/realtime.json").read_text(encoding="utf-8"))["rows"]
    (counted,) = (row["note"].split()[1].rstrip(",") for row in results if row["case"] == slow.CASE)
    assert len(listed) == int(counted)
    assert all(float(one["growth_time_s"]) >= SLOW_S and one["stopped_by"] for one in listed)
    assert all(float(one["angle_over_envelope"]) <= 2.0 for one in listed)
    assert all(float(one["torque_over_limit"]) <= 1.0 for one in listed)
    for one in repeats(sorted(listed, key=lambda one: float(one["after_full_authority_s"] or "inf"))):
        again = slow.slow_one(int(one["number"]))
        assert again["stopped_by"] == one["stopped_by"], one
        assert float(again["growth_time_s"]) == pytest.approx(float(one["growth_time_s"]), rel=0.01)


def test_the_draw_is_what_it_says():
    """Growth of the loop from its poles is the growth that a simulation without limits shows."""
    found = draw(3)
    states = closed_states(rig_case("dm", "lab"), found.article, found.law)
    x = np.random.default_rng(1).standard_normal(len(states))
    sizes = []
    for _ in range(4000):
        x = states @ x
        sizes.append(np.linalg.norm(x))
        x /= sizes[-1]
    rate = np.mean(np.log(sizes[-2000:])) / 0.002
    assert rate == pytest.approx(found.rate, rel=0.02)  # a pair of poles beats within the mean
