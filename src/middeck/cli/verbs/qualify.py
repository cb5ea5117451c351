"""``middeck qualify``: a compensator on plants that it was not designed for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import click

import middeck as md
from middeck.cli import figures, options
from middeck.cli.shown.screen import ScreenTable, cells, show
from middeck.study.words import fields

if TYPE_CHECKING:
    from middeck.cli.given.plants_to_try import Law
    from middeck.control.qualification import Qualified

EXAMPLES = """\
  middeck qualify gimbal.json articles/mace-dm.toml --count 12 \\
    --environment lab --environment orbit --rate 100,250
  middeck qualify law.json model.json --shift 300:1000 0.5 \\
    --angle-noise 1e-7 --disturbance 0.1 --require stable --require gain_db=6
"""
POSITIVE = options.POSITIVE
AT_LEAST = ("gain_db", "phase_deg", "delay_ms", "disk", "damping")
AT_MOST = ("db", "control_rms")


@click.command("qualify", cls=options.Verb, examples=EXAMPLES)
@click.argument("law_file", metavar="LAW.json|mat")
@options.tried
@options.several(
    "--rate",
    "rates_hz",
    metavar="HZ,HZ",
    type=options.Frequencies(),
    help="Test the loop at these sampling rates too.",
)
@click.option("--limits", is_flag=True, help="Find the largest stable shift of each mode, up to 20 %.")
@options.defaulted("--angle-noise", default=2e-5, type=POSITIVE, help=options.SENSOR_NOISE)
@options.defaulted("--disturbance", default=1e-2, type=POSITIVE, help=options.INPUT_NOISE)
@options.several(
    "--require",
    "required",
    metavar="LIMIT",
    help="stable, gain_db=6, phase_deg=30, delay_ms=1, disk=0.5, damping=0.01, db=-20 or control_rms=1: "
    "exit code 1 if a row fails.",
)
@figures.figure
@options.common
def verb(
    law_file: str,
    tried: options.TypedPlants,
    required: tuple[str, ...],
    figure_file: str | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Test a compensator on plants that it was not designed for.

    Each PLANT is an article in each environment, a fitted model.json, or a promise.json with its drawn
    plants. Each is tried with and without shifted modes, in continuous time and at each rate. The table gives
    stability with exact delays, margins at the plant's inputs, and the rms of the measured outputs under
    disturbance and noise over all frequencies, relative to that without control (dB, less is better). --rate
    adds a sample and hold; a warning follows if the delays of a model may include one already. --set takes
    the keys of articles and environments.
    """
    requirements = tuple(map(read_requirement, required))
    law, found, allowed, hold_notes = _qualify(law_file, tried, given)
    rows = [_row(q) for q in found]
    document = describe(law_file, law, rows, requirements, hold_notes) | {"allowed_shift": allowed}
    if figure_file is not None:
        from middeck.plot.qualification import qualification_figure

        limits = [(r.quantity, r.limit) for r in requirements if r.limit is not None]
        title = f"{law_file}: stable on {document['stable']} of {len(rows)}"
        figures.write_figure(
            qualification_figure(rows, limits, title),
            figure_file,
            key="qualify",
            title=title,
            description="Margins, damping and rms of the compensator on each plant.",
        )
    show(as_json, document, *_tables(document))
    if not document["passed"]:
        click.get_current_context().exit(1)


def _qualify(
    law_file: str, tried: options.TypedPlants, given: dict[str, Any]
) -> tuple[Law, tuple[Qualified, ...], list[dict[str, Any]] | None, list[str]]:
    import numpy as np

    from middeck.cli.given.compensators import load_law
    from middeck.cli.given.plants_to_try import all_plants, allowed_shifts, gather_plants, hold_warnings

    law = load_law(law_file)
    gathered = gather_plants(tried, law)
    allowed = allowed_shifts(gathered.plants, law) if given["limits"] else None
    plants = all_plants(gathered, law, tried)
    u, y = (tuple(port.name for port in side) for side in (law.outputs, law.inputs))
    intensity = given["disturbance"] ** 2 * np.eye(len(u))
    noise = np.full(len(y), given["angle_noise"] ** 2)
    weights = md.LQGWeights(
        output=np.ones(len(y)), input=np.ones(len(u)), disturbed=u, process=intensity, sensor=noise
    )
    rates = tuple(rate for rates in given["rates_hz"] for rate in rates)
    found = md.qualify_compensator(law, plants, weights, rates_hz=rates)
    return law, found, allowed, hold_warnings(gathered, law, weights, rates, tried.delay_s)


def _row(found: Qualified) -> dict[str, Any]:
    """Numbers of one row, the least of all its loops; still infinite where there is no limit."""
    loops, unlimited, known = found.loops, math.inf if found.stable else None, found.stability

    def least(values: Any) -> Any:
        return min(values, default=unlimited) if found.stable else None

    weakest = min(loops, key=lambda loop: loop.disk.alpha, default=None)
    return {
        **fields(found, "plant", "setting", "stable"),
        "pole_hz": known.frequency_hz if known else None,
        "decay_per_s": known.margin if known else None,
        "damping": known.damping if known else None,
        "gain_db": least(loop.gain_db for loop in loops),
        "phase_deg": least(math.degrees(loop.phase_limit_rad) for loop in loops),
        "delay_ms": least(1e3 * loop.delay_limit_s for loop in loops),
        "disk": least(loop.disk.alpha for loop in loops),
        "weakest_loop": None if weakest is None else weakest.channel,
        **fields(found, "unheld", "undecided", "rms"),
        # Without an rms of its own to compare with there are no decibels.
        "db": found.db if math.isfinite(found.db) else None,
        "control_rms": found.control_rms if found.stable else None,
    }


def describe(
    law_file: str,
    law: Law,
    rows: list[dict[str, Any]],
    requirements: tuple[Requirement, ...],
    hold_notes: list[str],
) -> dict[str, Any]:
    """The JSON document; infinite or unknown values are null."""
    from middeck.files.laws.compensators import how_made

    def finite(value: Any) -> Any:
        return None if isinstance(value, float) and not math.isfinite(value) else value

    judged = [
        {
            "require": requirement.text,
            "failed": [f"{r['plant']}, {r['setting']}" for r in rows if not meets(requirement, r)],
        }
        for requirement in requirements
    ]
    return {
        "schema": "middeck.qualify/1",
        "law": {
            "file": law_file,
            **how_made(law),
            "order": len(law.dynamics.A),
            "period_s": law.period_s,
            "reads": [port.name for port in law.inputs],
            "drives": [port.name for port in law.outputs],
        },
        "rows": [{key: finite(value) for key, value in row.items()} for row in rows],
        "stable": sum(row["stable"] for row in rows),
        "requirements": judged,
        "passed": not any(r["failed"] for r in judged),
        "warnings": [*_warnings(law, rows), *hold_notes],
    }


def _warnings(law: Law, rows: list[dict[str, Any]]) -> list[str]:
    import numpy as np

    lines = [
        f"{plant}: nothing at these ports holds {', '.join(modes)}, which does not decay"
        for plant, modes in {r["plant"]: r["unheld"] for r in rows if r["unheld"]}.items()
    ]
    lines += [f"{r['plant']}, {r['setting']}: {r['undecided']}" for r in rows if r["undecided"]]
    if np.any(law.dynamics.D) and any(r["setting"] == "continuous" for r in rows):
        lines.append(
            "the compensator passes sensor noise on directly: white noise has no rms without a rate (--rate)"
        )
    elif any(row["stable"] and row["db"] is None for row in rows):
        lines.append(
            "no dB where the plant does not decay without control: its own rms is infinite; "
            "compare the rms itself"
        )
    return lines


def _tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    law, rows = document["law"], document["rows"]
    margins = ("gain_db:.2f", "phase_deg:.1f", "delay_ms:.3g")
    headers = ["plant", "setting", "stable", "pole Hz", "damping", "gain dB", "phase deg", "delay ms", "disk"]
    lines = [
        [
            row["plant"],
            row["setting"],
            "yes" if row["stable"] else "NO",
            *cells(row, "pole_hz:.4g", "damping:.4f"),
            *("none" if cell == "-" and row["stable"] else cell for cell in cells(row, *margins)),
            *cells(row, "disk:.3f", "db:.2f", "rms:.3g", "control_rms:.3g"),
        ]
        for row in rows
    ]
    kind = "continuous" if law["period_s"] is None else f"sampled at {1.0 / law['period_s']:g} Hz"
    made = f", {law['method']}" if law["method"] else ""
    failed = [
        f"FAILED       {judged['require']}: {'; '.join(judged['failed'])}"
        for judged in document["requirements"]
        if judged["failed"]
    ]
    met = [f"met          {j['require']}" for j in document["requirements"] if not j["failed"]]
    return [
        f"compensator  {law['order']} states, {kind}{made}",
        f"from         {', '.join(law['reads'])} to {', '.join(law['drives'])}",
        f"stable       {document['stable']} of {len(rows)}",
        ScreenTable("least margins of the loops, and rms", [*headers, "rms dB", "rms", "control rms"], lines),
        *_limits(document["allowed_shift"]),
        *(["", *met, *failed] if document["requirements"] else []),
    ]


def _limits(allowed: list[dict[str, Any]] | None) -> list[str | ScreenTable]:
    if allowed is None:
        return []
    keys = ("plant", "mode", "down_percent:.4g", "down_hz:.4g", "up_percent:.4g", "up_hz:.4g")
    limited = [
        cells(shift, *keys)
        for shift in allowed
        if shift["down_percent"] is not None or shift["up_percent"] is not None
    ]
    rest = f"\n{len(allowed) - len(limited)} modes may shift by 20 % and more both ways, each alone"
    table = ScreenTable(
        "shift of one mode at which the loop becomes unstable, and the frequency that then grows",
        ["plant", "mode", "down %", "at Hz", "up %", "at Hz"],
        limited,
    )
    return [table, rest] if limited else [rest]


STABLE = "stable"


class Requirement(NamedTuple):
    """One limit; ``limit`` is None for stability itself."""

    quantity: str
    limit: float | None
    at_most: bool = False

    @property
    def text(self) -> str:
        """The requirement in words."""
        if self.limit is None:
            return STABLE
        return f"{self.quantity} {'<=' if self.at_most else '>='} {self.limit:g}"


def read_requirement(text: str) -> Requirement:
    """``stable``, or ``QUANTITY=LIMIT``, which a row must reach or not exceed.

    >>> [read_requirement(text).text for text in ("stable", "db=-20")]
    ['stable', 'db <= -20']
    """
    if text == STABLE:
        return Requirement(STABLE, None)
    name, _, number = text.partition("=")
    try:
        limit = float(number)
    except ValueError:
        limit = math.nan
    known = (*AT_LEAST, *AT_MOST)
    if name not in known or not math.isfinite(limit):
        what = f"--require {text}: stable, or one of {', '.join(known)} with its limit, as {known[0]}=6"
        raise click.UsageError(what)
    return Requirement(name, limit, name in AT_MOST)


def meets(requirement: Requirement, row: Mapping[str, Any]) -> bool:
    """Whether a row meets the requirement; an unstable row or an unknown value does not."""
    if not row[STABLE] or requirement.limit is None:
        return bool(row[STABLE])
    value = row[requirement.quantity]
    if value is None or math.isnan(value):
        return False
    return value <= requirement.limit if requirement.at_most else value >= requirement.limit
