"""Control: designs, margins, Riccati equations, responses, sweeps and simulations beside their peers.

    python benchmarks/control.py [--peer-python PYTHON] [--data FOLDER] [--only CASES] [--seed SEED]

PYTHON is an interpreter with the peers of peers/control-requirements.txt, in an environment of its own;
without one the peers' columns of the last result are kept. SEED draws the unseen plants, after the designs.
Each case is a module of the folder controlled, with a function rows(options).
Times are CPU seconds of one process with one BLAS thread.
"""

from __future__ import annotations

import argparse
import functools
import importlib
import re
from pathlib import Path

from measured.result_file import Rows, options_of, rows_before, write_rows

CASES = sorted(p.stem for p in (Path(__file__).resolve().parent / "controlled").glob("[a-z]*.py"))


def _case(name: str, options: argparse.Namespace) -> Rows:
    return importlib.import_module(f"controlled.{name}").rows(options)


def _seed_of(rows: Rows, otherwise: int) -> int:
    """The seed of the unseen plants, as their rows say it."""
    drawn = (re.search(r"seed (\d+)", row["case"]) for row in rows)
    return next((int(found[1]) for found in drawn if found), otherwise)


def main() -> None:
    cases = {name: functools.partial(_case, name) for name in CASES}
    parser = options_of(__doc__, cases)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    drawn = "multimodel" in options.only
    seed = options.seed if drawn else _seed_of(rows_before("control"), options.seed)
    write_rows("control", f"python benchmarks/control.py --seed {seed}", cases, options)


if __name__ == "__main__":
    main()
