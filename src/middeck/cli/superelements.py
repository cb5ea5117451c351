"""Decks of superelements as articles with components: the part of ``middeck convert`` that writes them."""

from __future__ import annotations

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from middeck.errors import ConfigError

if TYPE_CHECKING:
    from middeck.cli.settings import ConvertSettings


def joined_superelements(deck: str, chosen: ConvertSettings, name: str, target: str | None) -> dict[str, Any]:
    """Convert, check as it is read back, write the article and the files of its components; the report."""
    from middeck.cli.blame import reading
    from middeck.cli.summary import summary_numbers
    from middeck.files.article_toml import document_text
    from middeck.files.components import write_component
    from middeck.files.documents import load_structure
    from middeck.files.nastran.assembly import convert_assembly
    from middeck.files.nastran.units import parse_units
    from middeck.structure.summary.summary import summarise

    if chosen.units is None:
        raise ConfigError(
            "a deck of superelements does not state its units", where=deck, hint="--units, such as mm-kg-s-mN"
        )
    units = parse_units(chosen.units)
    # The files of components go by the name of the article, so that two articles share a folder.
    name = name if target is None else Path(target).stem
    made, parts = convert_assembly(deck, units, chosen.mass_formulation, name)
    text = document_text(made.document, f"From {deck} by middeck convert, units {units.name}.")
    with TemporaryDirectory() as folder:
        trial = Path(folder)
        for file, part in parts.items():
            write_component(trial / file, part)
        (trial / "article.toml").write_text(text, encoding="utf-8")
        with reading(deck):
            summary = summarise(load_structure(trial / "article.toml"))
        if target is not None:
            for file in parts:
                shutil.copyfile(trial / file, Path(target).parent / file)
            shutil.copyfile(trial / "article.toml", target)
    return {
        "schema": "middeck.convert/1",
        "deck": deck,
        "written": target,
        "environment": None,
        "components": list(parts),
        "units": units._asdict() | {"force": units.force},
        "mass_formulation": chosen.mass_formulation,
        "cards": sum(made.read.values()),
        "read": made.read,
        "converted": made.converted,
        "left_out": [{"card": card, "count": count, "why": why} for card, count, why in made.left_out],
        "notes": made.notes,
        "warnings": summary.warnings,
        **summary_numbers(summary),
    }
