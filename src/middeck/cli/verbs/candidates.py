"""``middeck candidates``: tests that may be made, ranked by how much they would narrow the predictions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, show
from middeck.study.words import fields

if TYPE_CHECKING:
    from middeck.updating.candidates.rank_tests import Ranking
    from middeck.updating.refinement.refine import Refined

EXAMPLES = """\
  middeck candidates articles/mace-simple.toml \\
    data/virtual-survey/candidates.toml
  middeck candidates articles/mace-simple.toml \\
    data/virtual-survey/candidates.toml --json
"""


@click.command("candidates", cls=options.Verb, examples=EXAMPLES)
@options.article
@click.argument("candidates", metavar="CANDIDATES")
@options.printing
def verb(article: str, candidates: str, as_json: bool) -> None:
    """Rank tests by how much they would narrow the predictions.

    ARTICLE is refined on the tests already made. For each test in CANDIDATES (docs/reference/files.md) the
    refinement is then computed as if that test had been made too. The tests are ranked by how much they
    narrow the promised frequencies and gauge readings, the widest interval first. Each is judged alone and as
    it stands; none is optimised.
    """
    from middeck.files.refinements.candidate_documents import load_candidates
    from middeck.files.setups import find_document

    body = find_document(article, "article")
    asked = load_candidates(candidates, body)
    with reading(body, candidates):
        refined = md.refine(asked.structure, *asked.refinement.of_refine)
        readings = None if asked.loads is None else asked.loads.of
        ranking = md.updating.rank_tests(
            refined, asked.tests, asked.environments, count=asked.modes, readings=readings
        )
    document = describe(refined, ranking)
    show(as_json, document, *_blocks(document))


def describe(refined: Refined, ranking: Ranking) -> dict[str, Any]:
    """The JSON document."""
    from middeck.updating.refinement.findings import findings

    return {
        "schema": "middeck.candidates-ranked/1",
        "article": refined.structure.title,
        "promised": [{**fields(p, "where", "name", "value", "unit", "std")} for p in ranking.promised],
        "widest": ranking.widest,
        "candidates": [
            {
                "name": t.name,
                "ratio_of_the_widest": t.widest,
                "median_ratio": t.median,
                "std": t.std,
                "not_seen": [{"mode": name, "frequency_hz": hz} for name, hz in t.foreseen.unseen],
            }
            for t in ranking.tests
        ],
        "warnings": [
            *findings(refined),
            *(
                f"{t.name}: its channels do not see {name} of {hz:.4g} Hz"
                for t in ranking.tests
                for name, hz in t.foreseen.unseen
            ),
        ],
    }


def _blocks(document: dict[str, Any]) -> list[str | ScreenTable]:
    def percent(std: float) -> str:
        return f"{100.0 * std:.3g}"

    promised = document["promised"]
    w = promised[document["widest"]]
    tests = [
        [
            str(k),
            t["name"],
            percent(t["std"][document["widest"]]),
            f"{t['ratio_of_the_widest']:.3f}",
            f"{t['median_ratio']:.3f}",
            _still_widest(document, t["std"]),
        ]
        for k, t in enumerate(document["candidates"], start=1)
    ]
    best = document["candidates"][0]
    rows = [
        [p["where"], p["name"], f"{p['value']:.5g} {p['unit']}", percent(p["std"]), percent(after)]
        for p, after in zip(promised, best["std"], strict=True)
    ]
    return [
        f"widest: {w['name']} in {w['where']}, {w['value']:.5g} {w['unit']} +- {percent(w['std'])} %",
        ScreenTable(
            "candidates",
            ["", "test", "after +- [%]", "ratio", "median ratio", "widest after the test"],
            tests,
        ),
        ScreenTable(
            f"promised, and after {best['name']}", ["in", "of", "value", "+- [%]", "after +- [%]"], rows
        ),
    ]


def _still_widest(document: dict[str, Any], std: Any) -> str:
    k = max(range(len(std)), key=lambda i: std[i])
    return f"{document['promised'][k]['name']}, {100.0 * std[k]:.3g} %"
