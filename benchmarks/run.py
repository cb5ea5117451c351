"""Run every benchmark of this folder (or those named), then make docs/benchmarks.md from their results.

python benchmarks/run.py [--table-only] [NAME ...]
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "benchmarks.md"
BENCHMARKS = ("structure", "identification", "control")
HEAD = """# Benchmarks

Made by `make bench` from `benchmarks/results/*.json`; do not edit. Error stands before time, and time only
beside that of a peer in the same run. *Level* is what was asked; a row without one is information.
"""


def main(arguments: list[str]) -> None:
    names = [a for a in arguments if not a.startswith("-")]
    scripts = [HERE / f"{name}.py" for name in BENCHMARKS if not names or name in names]
    if "--table-only" not in arguments:
        for script in scripts:
            subprocess.run([sys.executable, str(script)], check=True)
    results = sorted((HERE / "results").glob("*.json"))
    PAGE.write_text("\n".join([HEAD, *(_section(p.stem, json.loads(p.read_text())) for p in results)]))


def _section(name: str, result: dict) -> str:
    rows = [
        "| case | measure | value | level | met | peers |",
        "| --- | --- | --- | --- | --- | --- |",
        *(_row(row) for row in result["rows"]),
    ]
    made = f"{result['made']}, {result['machine']}, `{result['command']}`"
    return f"## {name.capitalize()}\n\n{made}\n\n" + "\n".join(rows) + "\n"


def _row(row: dict) -> str:
    peers = "; ".join(f"{n} {p['version']}: {_number(p['value'])}" for n, p in row["peers"].items()) or "-"
    met = {True: "yes", False: "**no**", None: "-"}[row["met"]]
    level = "-" if row["level"] is None else _number(row["level"])
    note = f" ({row['note']})" if row.get("note") else ""
    states = f", {row['states']} states" if "states" in row else ""
    value = f"{_number(row['value'])} {row['unit']}".strip()
    return f"| {row['case']}{states} | {row['measure']}{note} | {value} | {level} | {met} | {peers} |"


def _number(value: float | str | None) -> str:
    return "-" if value is None else value if isinstance(value, str) else f"{value:.4g}"


if __name__ == "__main__":
    main(sys.argv[1:])
