"""``middeck convert``: a Nastran deck as an article."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, show
from middeck.errors import ConfigError

if TYPE_CHECKING:
    from middeck.cli.given.checked_options import ConvertSettings
    from middeck.files.nastran.article.article_sections import Formulation
    from middeck.files.nastran.article.convert import Conversion
    from middeck.files.nastran.deck.deck import Deck
    from middeck.files.nastran.deck.units import Units

IN_DOUBLE = "--reals double: rounded, grids that two systems put in one place are apart"

EXAMPLES = """\
  middeck convert data/nastran-truss/full.dat --units mm-kg-s-mN -o full.toml
  middeck convert data/nastran-truss/full.dat --units mm-kg-s \\
    --mass-formulation coupled --json
"""


@click.command("convert", cls=options.Verb, examples=EXAMPLES)
@click.argument("deck")
@click.option(
    "--units",
    metavar="UNITS",
    help="Units of the deck, such as mm-kg-s-mN, m-kg-s-N, mm-t-s-N, "
    "in-slinch-s-lbf; a deck does not state them.",
)
@click.option(
    "--mass-formulation",
    type=click.Choice(("consistent", "coupled", "lumped", "deck")),
    help="Mass of the members: consistent, with rotary inertia; coupled, as NX Nastran 9 with COUPMASS; "
    "lumped, half at each end; deck, coupled or lumped as its PARAM COUPMASS says.  [default: consistent]",
)
@click.option(
    "--subcase",
    type=int,
    metavar="NUMBER",
    help="Subcase of case control; needed if subcases differ in more than loads.",
)
@click.option(
    "--reals",
    type=click.Choice(("double", "single")),
    help="Precision of the deck's numbers: double, as written; single, as Nastran's tables of 32-bit words "
    "hold them.  [default: double]",
)
@options.output("target", options.ARTICLES, "Write the article.", "ARTICLE")
@options.written(
    "--environment",
    "held_target",
    endings=options.ARTICLES,
    metavar="ENVIRONMENT",
    help="Write SPC (as clamps), springs to the ground and gravity as an environment.",
)
@options.common
def verb(
    deck: str,
    units: str | None,
    mass_formulation: str | None,
    subcase: int | None,
    reals: str | None,
    target: str | None,
    held_target: str | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Convert a Nastran DECK to an article, in SI units.

    Bars, beams, rods, masses, springs, bushings, point loads, rigid links, averages (RBE3) and equations
    (MPC) are converted. Constraints, springs to the ground and gravity go to the file of --environment. Cards
    that do not affect the modes are left out, listed and counted. A card that affects them and cannot be
    converted is an error with file, line, card and field. Superelements whose matrices are in OUTPUT4 or
    punched DMIG become components, in NPZ files beside the article. Without --units the command names the
    likeliest set and writes nothing. --set takes units, mass_formulation, subcase and reals.
    """
    from middeck.cli.given.checked_options import ConvertSettings, settle
    from middeck.files.nastran.deck.deck import asked_formulation

    given = {"units": units, "mass_formulation": mass_formulation, "subcase": subcase, "reals": reals}
    chosen = settle(ConvertSettings, given, overrides)
    source, known, name, parts = _read(deck, chosen, target)
    asked = chosen.mass_formulation
    formulation = asked_formulation(source) if asked == "deck" else asked
    from middeck.files.nastran.article.convert import convert_deck  # not for a deck that cannot be read

    try:
        made = convert_deck(source, known, formulation, name, parts)
    except ConfigError as error:
        if chosen.reals == "single" and _is_converted_in_double(deck, chosen, formulation):
            error.hint = IN_DOUBLE
        raise
    if target and made.holds and not held_target:
        raise _not_held(source.path)
    from middeck.cli.shown.mass_and_attitude import (
        about_lines,
        about_point,
        measure_lines,
        summary_lines,
        summary_numbers,
    )
    from middeck.files.articles.build import usual_damping

    flexible, suspension = usual_damping()
    summary = _written(made, source, known, formulation, target, held_target)
    numbers = summary_numbers(summary)
    about = None if made.reference is None else about_point(summary, *made.reference)
    document = {
        "schema": "middeck.convert/1",
        "deck": deck,
        "written": target,
        "environment": held_target,
        "components": list(made.components),
        "units": known._asdict() | {"force": known.force},
        "mass_formulation": formulation,
        "damping": {"flexible": flexible, "suspension": suspension},
        "subcase": chosen.subcase,
        "reals": chosen.reals,
        "cards": source.cards,
        "read": made.read,
        "converted": made.converted,
        "left_out": [{"card": card, "count": count, "why": why} for card, count, why in made.left_out],
        "notes": made.notes,
        "warnings": summary.warnings,
        **numbers,
        "grid_point_weight": about,
    }
    lines = [*summary_lines(numbers), *measure_lines(numbers), *(about_lines(about) if about else ())]
    show(as_json, document, *_blocks(document), *lines)


def _is_converted_in_double(deck: str, chosen: ConvertSettings, formulation: Formulation) -> bool:
    """Whether only the rounding of its numbers keeps a deck from being converted."""
    from middeck.files.nastran.article.convert import convert_deck
    from middeck.files.nastran.deck.deck import read_deck
    from middeck.files.nastran.deck.units import parse_units

    try:
        convert_deck(read_deck(deck, chosen.subcase), parse_units(chosen.units or ""), formulation, "a")
    except ConfigError:
        return False
    return True


def _read(
    deck: str, chosen: ConvertSettings, target: str | None
) -> tuple[Deck, Units, str, dict[str, md.structure.Component]]:
    """The deck, its units, the name of the article, and the components of its superelements."""
    from middeck.files.nastran.components.assembly import has_superelements, read_assembly
    from middeck.files.nastran.deck.deck import read_deck
    from middeck.files.nastran.deck.units import parse_units

    name, units, subcase = article_name(deck), chosen.units, chosen.subcase
    single = chosen.reals == "single"
    if has_superelements(deck):
        if single:
            what = "the matrices of superelements are in the precision of their files"
            raise ConfigError(what, where=deck, hint="leave out --reals")
        if units is None:
            raise _no_units_of_superelements(deck)
        known = parse_units(units)
        # The files of components go by the name of the article, so that two articles share a folder.
        name = name if target is None else Path(target).stem
        source, parts = read_assembly(deck, known, name, subcase)
        return source, known, name, parts
    source = read_deck(deck, subcase, single=single)
    if units is None:
        raise _no_units(source)
    return source, parse_units(units), name, {}


def _not_held(path: str) -> Exception:
    return ConfigError(
        "this deck has SPC or springs to the ground; an article has no place for them, and without them its "
        "modes are those of the free structure",
        where=path,
        hint="--environment FILE.toml writes them to an environment; for the free structure take SPC out of "
        "case control",
    )


def article_name(deck: str) -> str:
    """A name that an article may have, after the deck's file."""
    name = re.sub(r"\W", "-", Path(deck).stem, flags=re.ASCII)
    return name if re.match(r"[A-Za-z_]", name) else f"deck-{name}"


def _no_units_of_superelements(deck: str) -> Exception:
    what = "a deck of superelements does not state its units"
    return ConfigError(what, where=deck, hint="--units, such as mm-kg-s-mN")


SHOWN = 5  # materials in a message


def _no_units(source: Deck) -> Exception:
    from middeck.files.nastran.article.convert import materials_and_size
    from middeck.files.nastran.deck.units import guess_units

    found = [units.name for units in guess_units(*materials_and_size(source))]
    if not found:
        materials, size = materials_and_size(source)
        known = ", ".join(
            f"E {E:g} with density {rho:g}" for E, rho in list(dict.fromkeys(materials))[:SHOWN]
        )
        return ConfigError(
            "a deck does not state its units, and no common set fits this one: "
            f"{f'{known}, ' if known else ''}size {size:g}",
            where=source.path,
            hint="--units with a length, a mass or a force, and a time, such as mm-kg-s",
        )
    others = f" (or {', '.join(found[1:])})" if found[1:] else ""
    return ConfigError(
        f"a deck does not state its units; moduli, densities and size of this one suggest {found[0]}{others}",
        where=source.path,
        hint=f"--units {found[0]}, if these are its units",
    )


def _written(
    made: Conversion,
    source: Deck,
    units: Units,
    formulation: str,
    target: str | None,
    held_target: str | None,
) -> Any:
    """The article as written, read back and meshed; nothing is written where that fails."""
    from middeck.files.articles.components import write_component
    from middeck.files.articles.document import document_text
    from middeck.files.disk.atomic import write_text
    from middeck.structure.assembly.mesh import mesh_structure
    from middeck.structure.summary.summary import summarise

    head = (
        f"From {source.path} by middeck convert, units {units.name}.\n"
        f"Mass formulation of the members: {formulation}"
        + (" (halves at their ends, as bodies of the nodes)." if formulation == "lumped" else ".")
    )
    text = document_text(made.document, head)
    around = document_text(made.environment, head.splitlines()[0])
    with TemporaryDirectory() as folder:
        trial = Path(folder) / "article.toml"
        for name, part in made.components.items():
            write_component(Path(folder) / name, part)
        trial.write_text(text, encoding="utf-8")
        held = Path(folder) / "environment.toml"
        held.write_text(around, encoding="utf-8")
        with reading(source.path):
            article, _ = md.load_setup(trial, held)
            summary = summarise(article)
            if made.components:  # their grids stand where the deck has them
                mesh_structure(article)
        for name in made.components if target else ():
            shutil.copyfile(Path(folder) / name, Path(target or "").parent / name)
    for path, content in ((target, text), (held_target, around)):
        if path is not None:
            write_text(path, content)
    return summary


def _blocks(document: dict[str, Any]) -> list[str | ScreenTable]:
    blocks: list[str | ScreenTable] = [
        f"deck         {document['deck']}, {document['cards']} cards",
        f"units        {document['units']['name']}",
        f"mass         {document['mass_formulation']} (of the members)",
        *(["reals        single precision"] if document["reals"] == "single" else []),
        "damping      {flexible:.0%} of strain, {suspension:.0%} of suspension and weight: defaults, which "
        "[damping] of the article replaces".format(**document["damping"]),
        f"read         {', '.join(f'{n} {card}' for card, n in document['read'].items())}",
        ScreenTable("converted", ["", "number"], [[c, str(n)] for c, n in document["converted"].items()]),
    ]
    rows = [[row["card"], str(row["count"]), row["why"]] for row in document["left_out"]]
    blocks += [ScreenTable("left out", ["card", "number", "why"], rows)] if rows else []
    blocks += [f"\nnote: {note}" for note in document["notes"]]
    written = [file for file in (document["written"], document["environment"]) if file]
    blocks += [f"\nwrote {' and '.join(written)}" if written else "\nnothing written: no -o"]
    return [*blocks, ""]
