"""The benchmark pages say what the results say."""

from __future__ import annotations

import json
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from doc_pages import ROOT


def test_the_pages_are_made_from_the_results(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    try:
        from run import pages

        for name, text in pages().items():
            assert (ROOT / "docs" / name).read_text(encoding="utf-8") == text, (
                "python benchmarks/run.py --table-only"
            )
    finally:
        for module in ("run", "headlines"):
            sys.modules.pop(module, None)


def test_the_hardware_page_takes_its_numbers_from_the_results():
    rows = json.loads((ROOT / "benchmarks/results/hardware.json").read_text(encoding="utf-8"))["rows"]
    known = [abs(float(number)) for r in rows for number in (r["value"], r["level"] or 0.0)]
    known += [peer["value"] for r in rows for peer in r["peers"].values()]
    known += [float(n) for r in rows for n in re.findall(r"[\d.]+e-\d+|\d+\.\d+", r.get("note", ""))]
    page = (ROOT / "docs/explanation/measured-hardware.md").read_text(encoding="utf-8")
    for number in set(re.findall(r"\d+\.(?:\d+e-\d+|\d\d+)", page)) - {"0.55"}:  # the length of two articles
        digits, _, power = number.partition(".")[2].partition("e")
        step = 10.0 ** (int(power or 0) - len(digits))
        assert any(abs(k - float(number)) <= 0.5001 * step for k in known), number


@pytest.mark.parametrize(("promised", "stable", "below"), [(-1, -1, np.nan), (3, -1, -1.0), (-1, 3, np.nan)])
def test_where_promise_or_truth_has_no_rung_the_frontier_has_no_distance(
    promised, stable, below, monkeypatch
):
    """A rung that is promised where the truth has none is above it."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from measured import promise

    ends = iter([stable + 1, promised + 1])
    monkeypatch.setattr(promise, "_first_not", lambda *_: next(ends))
    monkeypatch.setattr(promise, "group_loop", lambda *_: None)
    for name in ("close_inner", "plant_of", "delay_plant", "design_ladder"):
        monkeypatch.setattr(promise, name, lambda *_: {"law": None})
    monkeypatch.setattr(promise.case, "true_db", lambda *_: -30.0)
    asked = promise.case.plan(promise.RUNGS, 2)
    found = promise._distance(None, SimpleNamespace(plants=()), None, asked)
    np.testing.assert_equal(found.below, below)
    other = promise.Short(below=0.5, came_apart=1.0, given_up=0.5, decades=0.25, pushed_to=-60.0)
    rows = promise._frontier_rows("one", [[found, other]])
    values = {r["measure"]: r["value"] for r in rows}
    assert values["promised above the true one"] == (50.0 if below < 0.0 else 0.0)
    assert values["without one rung that is promised"] == int(np.isnan(below))
