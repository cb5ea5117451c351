"""The benchmark pages say what the results say."""

from __future__ import annotations

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
