"""Measurement models: the simulated gimbal, an article of 46 states, the real mirror and two real arms.

    python benchmarks/identification.py [--peer-python PYTHON] [--data FOLDER] [--only CASES] [--made DATE]

PYTHON is an interpreter with the peers of peers/identification-requirements.txt, in an environment of its
own; without one the peers' columns of the last result are kept. FOLDER holds cubespec_fsm, daisy_robot_arm
and daisy_cd_player_arm. CASES, of gimbal, article, mirror and arms, are run alone and the other rows kept.
Times are CPU seconds of one process with one BLAS thread.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
from pathlib import Path

from measured import arms, article, gimbal, mirror

HERE = Path(__file__).resolve().parent
RESULT = HERE / "results" / "identification.json"
DATA = HERE.parents[1] / "shared" / "data"
CASES = {
    "gimbal": lambda o: gimbal.rows(o.peer_python),
    "article": lambda _: article.rows(),
    "mirror": lambda o: mirror.rows(o.data / "cubespec_fsm", o.peer_python),
    "arms": lambda o: arms.rows(o.data, o.peer_python),
}


def _before() -> list[dict]:
    return json.loads(RESULT.read_text())["rows"] if RESULT.exists() else []


def _keep_peers(rows: list[dict], before: list[dict]) -> None:
    """Errors of a peer of a stated version do not change; its times are not kept."""
    known = {(r["case"], r["measure"]): r["peers"] for r in before}
    for row in rows:
        if row["unit"] != "CPU s":
            row["peers"] = row["peers"] or known.get((row["case"], row["measure"]), {})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peer-python")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--only", nargs="*", choices=CASES, default=list(CASES))
    parser.add_argument("--made", default=datetime.date.today().isoformat())
    options = parser.parse_args()
    before = _before()
    rows: list[dict] = []
    for name, make in CASES.items():
        made = make(options) if name in options.only else [r for r in before if r["case"].startswith(name)]
        rows += made
    if options.peer_python is None:
        _keep_peers(rows, before)
    result = {
        "made": options.made,
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, one used",
        "command": "python benchmarks/identification.py",
        "rows": rows,
    }
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(result, indent=1) + "\n")
    for row in rows:
        print(f"{row['case']:30s} {row['measure']:45s} {row['value']:10.4g} {row['unit']} / {row['level']}")


if __name__ == "__main__":
    main()
