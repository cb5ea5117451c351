"""The ledger of long runs: one row in ``results.json`` for each file whose campaigns ran whole."""

from __future__ import annotations

import datetime
import json
from collections import Counter
from pathlib import Path

import pytest

HERE = Path(__file__).parent
LEDGER = HERE / "results.json"


class LongResults:
    """Writes a file's row when it has run to its end, so that a run that is killed keeps what came before."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.rows: dict[str, Counter[str]] = {}
        self.seconds: Counter[str] = Counter()
        self.running: dict[object, str] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        file = report.nodeid.partition("::")[0]
        worker = getattr(report, "node", None)  # xdist keeps a file on one worker (conftest.py)
        before = self.running.get(worker, file)
        self.running[worker] = file
        if before != file:
            self._write(before)
        self.seconds[file] += report.duration
        row = self.rows.setdefault(file, Counter())
        if report.when == "call" or report.outcome != "passed":
            row["error" if report.failed and report.when != "call" else report.outcome] += 1

    def pytest_sessionfinish(self, exitstatus: int) -> None:
        if exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
            for file in self.running.values():
                self._write(file)

    def _write(self, file: str) -> None:
        rows = json.loads(LEDGER.read_text())["files"] if LEDGER.exists() else {}
        counts = {
            k: self.rows[file][k] for k in ("passed", "failed", "error", "skipped") if self.rows[file][k]
        }
        today = datetime.datetime.now(datetime.UTC).date().isoformat()
        rows[file] = {"date": today, "seconds": round(self.seconds[file]), **counts}
        rows = {name: rows[name] for name in sorted(rows) if (HERE.parent / name).exists()}
        LEDGER.write_text(json.dumps({"seed": self.seed, "files": rows}, indent=1) + "\n")
