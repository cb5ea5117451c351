"""The result file of a benchmark whose cases can be run one by one: rows of the others are kept."""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parents[1]
DATA = HERE.parents[1] / "shared" / "data"

Rows = list[dict[str, Any]]
Case = Callable[[argparse.Namespace], Rows]


def options_of(description: str | None, cases: Mapping[str, Case]) -> argparse.ArgumentParser:
    """The options of every such benchmark."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peer-python")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--only", nargs="*", choices=list(cases), default=list(cases))
    parser.add_argument("--ledgers", type=Path)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--made", default=datetime.date.today().isoformat())
    return parser


def rows_before(name: str) -> Rows:
    """The rows of the last run; none before the first."""
    path = _path(name)
    return json.loads(path.read_text())["rows"] if path.exists() else []


def write_rows(name: str, command: str, cases: Mapping[str, Case], options: argparse.Namespace) -> None:
    """Run the cases that ``options`` names and write them among the rows kept. A row's case begins with the
    name of its case."""
    before, rows = rows_before(name), []
    for case, make in cases.items():
        kept = [r for r in before if _word(r["case"]) == case]
        rows += make(options) if case in options.only else kept
    if options.peer_python is None:
        _keep_peers(rows, before)
    result = {
        "made": options.made,
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, one used",
        "command": command,
        "rows": rows,
    }
    _path(name).parent.mkdir(exist_ok=True)
    _path(name).write_text(json.dumps(result, indent=1) + "\n")
    for row in rows:
        print(f"{row['case']:30s} {row['measure']:45s} {row['value']:10.4g} {row['unit']} / {row['level']}")


def _word(title: str) -> str:
    return title.split()[0].rstrip(",")


def _path(name: str) -> Path:
    return HERE / "results" / f"{name}.json"


def _keep_peers(rows: Rows, before: Rows) -> None:
    """Errors of a peer of a stated version do not change; its times are not kept."""
    known = {(r["case"], r["measure"]): r["peers"] for r in before}
    for row in rows:
        if row["unit"] != "CPU s":
            row["peers"] = row["peers"] or known.get((row["case"], row["measure"]), {})
