"""The benchmark pages say what the results say."""

from __future__ import annotations

import json
import re
import sys

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
