"""Packages that destabilise the article trip in time, angles within twice the envelope, without a gate."""

from __future__ import annotations

import csv
import importlib
import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from engine_campaigns import cases_of
from engine_destabilising import SLOW_S, draw, judge, refused_on_paper
from engine_rigs import closed_states, rig_case, settings_of
from engine_truths import attempt, first_attempt, has_weak_motor, on_board, packed, refusals
from middeck.realtime.gate.linear_law import linear_law
from middeck.realtime.gate.package_with_hold import with_hold
from middeck.realtime.gate.steps_on_paper import GateMargins, Tried, check_loops
from repeats import repeats

pytestmark = pytest.mark.usefixtures("compiler")
ROOT = Path(__file__).parents[2]
RIGS = [("dm", "lab"), ("simple", "lab"), ("simple", "orbit"), ("dm", "orbit")]


FIRST = "00041001000200000011000013001101000100000000140102"  # of number 0 to 49: see `first_attempt`


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


def test_packages_that_only_the_truth_destabilises_are_stopped():
    """Laws of six kinds, none like another, stable on both models; frequencies of the truth 2 to 5 % off."""
    laws = set()
    for number in range(cases_of("packages that only the truth destabilises, past the gate")):
        known = number < len(FIRST)
        found = attempt(number, int(FIRST[number])) if known else first_attempt(number)[1]
        assert found is not None
        assert _sound(judge(found.found, *found.family.rig)), number
        laws.add(found.found.law.sampled.A.tobytes())
    assert len(laws) == cases_of("packages that only the truth destabilises, past the gate")


def test_steps_that_refuse_what_only_the_truth_destabilises():
    """Every run, not the margins; nothing before its trip; and margins, which the gate finds itself."""
    for number, steps in repeats([(8, ["dry run", "shadow run", "engagement"]), (2, [])]):
        assert refusals(attempt(number, int(FIRST[number]))) == steps
    weak = attempt(14, int(FIRST[14]))
    assert has_weak_motor(weak)
    law = [Tried("engaged", linear_law(with_hold(packed(weak), settings_of(*weak.family.rig))))]
    models = on_board(*weak.family.rig).values()
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
    counted = [row["note"].split()[1].rstrip(",") for row in results if row["case"] == slow.CASE]
    assert list(Counter(one["family"] for one in listed).values()) == list(map(int, counted))
    assert all(float(one["growth_time_s"]) >= SLOW_S and one["stopped_by"] for one in listed)
    assert all(float(one["angle_over_envelope"]) <= 2.0 for one in listed)
    assert all(float(one["torque_over_limit"]) <= 1.0 for one in listed)
    soon = sorted(listed, key=lambda one: float(one["after_full_authority_s"] or "inf"))
    for family in slow.FAMILIES:
        for one in repeats([one for one in soon if one["family"] == family]):
            again = slow.slow_one(one["family"], int(one["number"]))
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
