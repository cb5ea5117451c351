"""``middeck promise``: predictions of compensators in orbit, as a sealed document."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import figures, options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, number, show
from middeck.errors import ConfigError

if TYPE_CHECKING:
    from middeck.updating.promise.blocks_of_draws import Measured
    from middeck.updating.promise.plan import Plan
    from middeck.updating.refinement.refine import Refined

NAMED = 4
"""Lost cases of a sweep that the screen names; the document has all."""
EXAMPLES = """\
  middeck promise articles/mace-simple.toml \\
    data/virtual-survey/promise.toml -o promise.json
  middeck promise articles/mace-simple.toml \\
    data/virtual-survey/promise.toml --date 2026-11-23 --json
"""


@click.command("promise", cls=options.Verb, examples=EXAMPLES)
@options.article
@click.argument("plan", metavar="[PLAN]", required=False)
@click.option("--load-cases", metavar="FILE", help="Promise what gauges read under these load cases.")
@click.option("--date", metavar="YYYY-MM-DD", help="Date of the document.  [default: today]")
@options.written("-o", "--output", "target", endings=(".json",), help="Write the document, with a hash.")
@options.written(
    "--plants",
    "plants_file",
    endings=(".json",),
    metavar="PLANTS.json",
    help="Write the drawn plants too, in the same folder: gate and qualify then accept the promise.",
)
@options.written(
    "--ledger",
    endings=(".ledger",),
    cls=options.Updated,
    help="Store draws here: after an interruption the same command continues.",
)
@click.option(
    "--workers", type=click.IntRange(min=1), help="Processes that draw, with --ledger.  [default: 1]"
)
@figures.figure
@options.printing
def verb(
    article: str,
    plan: str | None,
    load_cases: str | None,
    date: str | None,
    target: str | None,
    plants_file: str | None,
    ledger: str | None,
    workers: int | None,
    figure_file: str | None,
    as_json: bool,
) -> None:
    """Predict, with probabilities, what compensators do in orbit.

    ARTICLE is refined on the surveys that PLAN names (docs/reference/files.md). Plants are drawn within the
    remaining uncertainty, and every compensator is tested on all of them. The document gives the probability
    of stability, quantiles of the performance in decibels, the parameter on which the result depends most,
    and the distance to the best possible compensator. It holds the hashes of its content and of all input
    files, and is the same with and without --ledger and --workers. With --load-cases it promises gauge
    readings of the refined article at rest.
    """
    from middeck.files.json.output import write_json
    from middeck.files.setups import find_document

    if (plan is None) == (load_cases is None):
        raise ConfigError(
            "neither a plan nor load cases" if plan is None else "a plan and load cases at once",
            where="promise",
            hint="PLAN, or --load-cases FILE",
        )
    folder = None if plan is None or target is None else Path(target).parent
    if plants_file is not None and Path(plants_file).parent != folder:
        raise ConfigError(f"--plants {plants_file}", hint="a PLAN, and -o PROMISE.json in the same folder")
    if workers is not None and ledger is None:
        raise ConfigError(f"--workers {workers}", hint="--ledger FILE, in which the processes' draws meet")
    if ledger is not None and plan is None:
        raise ConfigError(f"--ledger {ledger}", hint="a PLAN: load cases have no draws")
    body, day = find_document(article, "article"), options.day(date)
    if plan is None:
        document = _at_rest(body, str(load_cases), day)
    else:
        document = _of_loops(body, plan, day, plants_file, (ledger, workers or 1) if ledger else None)
    if target is not None:
        write_json(target, document)
    if figure_file is not None:
        figures.write_promise(document, {}, figure_file)
    warnings = {"warnings": document["refined"]["warnings"]}
    show(as_json, document if as_json else warnings, *_blocks(document, target))


def _of_loops(
    body: Path, plan: str, day: str, plants_file: str | None, kept: tuple[str, int] | None
) -> dict[str, Any]:
    """``kept`` are the ledger of the draws and the number of processes."""
    from middeck.files.json.hash_seal import SEAL
    from middeck.files.json.output import write_json
    from middeck.files.promises.plans import load_plan
    from middeck.files.promises.promise_documents import hash_files, promise_document
    from middeck.files.promises.promise_plants import plants_document

    with reading(plan):
        loaded = load_plan(plan, body)
    files = hash_files(loaded.files)
    with reading(body, plan):
        refined = md.refine(loaded.structure, *loaded.refinement.of_refine)
        measured = None if kept is None else _measured(refined, loaded.plan, (body, Path(plan)), files, *kept)
        promised = md.promise(refined, loaded.plan, measured)
    plants = None
    if plants_file is not None:
        drawn = plants_document(promised, loaded.plan)
        write_json(plants_file, drawn)
        plants = Path(plants_file).name, drawn[SEAL]
    return promise_document(refined, loaded.plan, promised, files=files, date=day, plants=plants)


def _measured(
    refined: Refined,
    plan: Plan,
    files: tuple[Path, Path],
    digests: tuple[tuple[str, str], ...],
    ledger: str,
    workers: int,
) -> dict[str, list[Measured]]:
    from middeck.cli.shown.progress import left_words, status
    from middeck.files.promises.campaign import measured_in_ledger

    with status("promise") as show_stage:
        return measured_in_ledger(
            refined,
            plan,
            files,
            digests,
            ledger,
            workers=workers,
            progress=lambda p: show_stage(
                f"{p.done} of {p.total} blocks of draws; {left_words(p.remaining_s) or 'the rest'}"
            ),
        )


def _at_rest(body: Path, load_cases: str, day: str) -> dict[str, Any]:
    from middeck.files.promises.promise_documents import hash_files, loads_document
    from middeck.files.refinements.promised_loads import load_promised_loads

    asked = load_promised_loads(load_cases, body)
    asked.require_some()
    files = hash_files(asked.files)
    with reading(body, load_cases):
        refined = md.refine(asked.structure, *asked.refinement.of_refine)
        deflections = asked.of(refined)
        modes = md.predict_modes(refined, asked.environment, count=asked.modes) if asked.modes else None
    return loads_document(refined, asked.environment_name, deflections, modes, files=files, date=day)


def _blocks(document: dict[str, Any], target: str | None) -> Sequence[str | ScreenTable]:
    blocks: list[str | ScreenTable] = []
    for place in document["environments"]:
        blocks += [_modes(place)] if place["modes"] else []
        blocks += [_removed(place)] if "removed" in place else []
        if "compensators" in place:
            blocks += [_loops(place, document), *_with_friction(place, document), _sweep(place)]
            blocks += [_highest(place, document)]
        blocks += [_readings(place)] if place.get("load_cases") else []
    blocks += ["", "not valid for", *(f"  {limit}" for limit in document["not_valid_for"])]
    return [*blocks, f"sha256 {document['sha256']}", *([f"wrote {target}"] if target else [])]


def _modes(place: dict[str, Any]) -> ScreenTable:
    rows = [
        [
            str(k),
            m["name"],
            f"{m['frequency_hz']:.4f}",
            "{:.4f} to {:.4f}".format(*m["interval_95_hz"]),
            f"{100.0 * m['damping']:.2f}",
            f"{100.0 * m['seen']:.0f}",
            "-" if m["ground_hz"] is None else f"{m['ground_hz']:.4f}",
            "-" if m["ground_hz"] is None else f"{100.0 * (m['frequency_hz'] / m['ground_hz'] - 1.0):+.2f}",
        ]
        for k, m in enumerate(place["modes"], start=1)
    ]
    headers = ["", "mode", "frequency [Hz]", "95 % interval [Hz]", "damping [%]", "measured [%]",
               "on the ground [Hz]", "change from the ground [%]"]  # fmt: skip
    return ScreenTable(f"promised in {place['name']}: modes", headers, rows)


def _removed(place: dict[str, Any]) -> ScreenTable:
    """Contributions of gravity to each frequency on the ground; * where they cannot be separated."""
    removed = place["removed"]
    rows = [
        [
            f"{mode['name']} *" if k in removed["unclear"] else mode["name"],
            *(f"{share:+.4f}" for share in (*shares, sum(shares))),
        ]
        for k, (mode, shares) in enumerate(zip(place["modes"], removed["share_hz"], strict=True), start=1)
    ]
    title = f"promised in {place['name']}: effects on the ground, in survey {removed['survey']} [Hz]"
    return ScreenTable(title, ["mode", *removed["effects"], "together"], rows)


def _readings(place: dict[str, Any]) -> ScreenTable:
    rows = [
        [
            case["name"],
            r["gauge"],
            f"{r['value']:.5g}",
            "{:.5g} to {:.5g}".format(*r["interval_95"]),
            r["unit"],
            f"{100.0 * case['strained_as_in_the_tests']:.0f}",
        ]
        for case in place["load_cases"]
        for r in case["readings"]
    ]
    headers = ["load case", "gauge", "reading", "95 % interval", "unit", "strained as in the tests [%]"]
    return ScreenTable(f"promised in {place['name']}: readings", headers, rows)


def _loops(place: dict[str, Any], document: dict[str, Any]) -> ScreenTable:
    at = {share: k for k, share in enumerate(document["shares"])}

    def level(db: Sequence[float | None], share: float) -> str:
        return number(db[at[share]], ".2f", "unstable")

    def distance(bound: dict[str, float | None]) -> str:
        worst, least = bound["worst_db"], bound["no_linear_law_below_db"]
        return "-" if worst is None or least is None else f"{worst - least:.2f}"

    rows = [
        [
            c["name"],
            f"{100.0 * c['probability_stable']:.1f}",
            f"{100.0 * c['at_least']:.1f}",
            *(level(c["db"], share) for share in (0.5, 0.025, 0.975, 0.99)),
            distance(c["bound"]),
            c["unstable_mode"] or "-",
            c["risk"]["of"] or "-",
        ]
        for c in place["compensators"]
    ]
    headers = ["compensator", "stable [%]", "at least", "median [dB]", "2.5 %", "97.5 %", "99 %",
               "worst above the bound [dB]", "unstable mode", "depends most on"]  # fmt: skip
    return ScreenTable(f"promised in {place['name']}: {document['draws']} draws", headers, rows)


def _with_friction(place: dict[str, Any], document: dict[str, Any]) -> list[ScreenTable]:
    """The cost of friction, where the plan states any."""
    if "friction" not in place:
        return []
    middle = document["shares"].index(0.5)

    rows: list[list[str]] = []
    for c in place["compensators"]:
        with_it, without = c["db"][middle], c["without_friction_db"][middle]
        cost = None if with_it is None or without is None else with_it - without
        moves = ", ".join(f"{n} {number(t, '.2f')}" for n, t in c["travel_over_slip_angle"].items())
        stable = f"{100.0 * c['stable_while_sticking']:.1f}"
        row = [number(x, ".2f") for x in (with_it, without, cost, c["simulation_error_db"])]
        rows.append([c["name"], *row, stable, moves])
    headers = ["compensator", "median [dB]", "without friction [dB]", "cost [dB]", "error of a draw [dB]",
               "stable while sticking [%]", "rms angle over slip angle"]  # fmt: skip
    return [ScreenTable(f"promised in {place['name']}: friction of joints", headers, rows)]


def _sweep(place: dict[str, Any]) -> ScreenTable:
    """Compensators that hold the refined article with its modes shifted, and cases in which others fail."""
    swept = place["sweep"]
    rows = [
        [c["name"], f"{c['sweep']['stable']} of {c['sweep']['cases']}", _few(c["sweep"]["lost"])]
        for c in place["compensators"]
    ]
    first, others = swept["first_bending_percent"], swept["others_percent"]
    title = (
        f"promised in {place['name']}: sweep of {first:g} % on {', '.join(swept['first_bending']) or 'none'} "
        f"and {others:g} % on {len(swept['others'])} others"
    )
    return ScreenTable(title, ["compensator", "stable", "unstable cases"], rows)


def _few(lost: Sequence[str]) -> str:
    more = f", and {len(lost) - NAMED} more" if len(lost) > NAMED else ""
    return (", ".join(lost[:NAMED]) or "-") + more


def _highest(place: dict[str, Any], document: dict[str, Any]) -> str:
    asked, needed = f"{100.0 * document['probability']:g} %", document["draws_needed"]
    if document["draws"] < needed:
        return f"\n{document['draws']} draws cannot promise {asked}: {needed} that are all stable would"
    if place["highest"] is None:
        return f"\nno compensator of the ladder is stable with {asked} (95 % confidence)"
    return f"\nhighest that is stable with {asked} (95 % confidence): {place['highest']}"
