"""Control: designs, margins, Riccati equations, responses, sweeps and simulations beside their peers.

    python benchmarks/control.py [--peer-python PYTHON] [--data FOLDER] [--only CASES] [--seed SEED]

PYTHON is an interpreter with the peers of peers/control-requirements.txt, in an environment of its own;
without one the peers' columns of the last result are kept. SEED draws the unseen plants, after the designs.
Each case is a module of the folder controlled, with a function rows(options).
Times are CPU seconds of one process with one BLAS thread.
"""

from __future__ import annotations

import argparse
import datetime
import importlib
import json
import os
import platform
import re
from pathlib import Path

HERE = Path(__file__).resolve().parent
RESULT = HERE / "results" / "control.json"
DATA = HERE.parents[1] / "shared" / "data"
CASES = sorted(p.stem for p in (HERE / "controlled").glob("[a-z]*.py"))


def _before() -> list[dict]:
    return json.loads(RESULT.read_text())["rows"] if RESULT.exists() else []


def _keep_peers(rows: list[dict], before: list[dict]) -> None:
    """Errors of a peer of a stated version do not change; its times are not kept."""
    known = {(r["case"], r["measure"]): r["peers"] for r in before}
    for row in rows:
        if row["unit"] != "CPU s":
            row["peers"] = row["peers"] or known.get((row["case"], row["measure"]), {})


def _seed_of(rows: list[dict], otherwise: int) -> int:
    """The seed of the unseen plants, as their rows say it."""
    drawn = (re.search(r"seed (\d+)", row["case"]) for row in rows)
    return next((int(found[1]) for found in drawn if found), otherwise)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peer-python")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--only", nargs="*", choices=CASES, default=CASES)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--made", default=datetime.date.today().isoformat())
    options = parser.parse_args()
    before = _before()
    made_by = options.seed if "multimodel" in options.only else _seed_of(before, options.seed)
    rows: list[dict] = []
    for name in CASES:
        # A row's case begins with the name of its module.
        kept = [r for r in before if r["case"].split()[0] == name]
        rows += importlib.import_module(f"controlled.{name}").rows(options) if name in options.only else kept
    if options.peer_python is None:
        _keep_peers(rows, before)
    result = {
        "made": options.made,
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, one used",
        "command": f"python benchmarks/control.py --seed {made_by}",
        "rows": rows,
    }
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(result, indent=1) + "\n")
    for row in rows:
        print(f"{row['case']:30s} {row['measure']:45s} {row['value']:10.4g} {row['unit']} / {row['level']}")


if __name__ == "__main__":
    main()
