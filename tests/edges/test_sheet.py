"""Our articles, environments and study hold the data sheet's numbers, all of them and no others."""

from __future__ import annotations

import functools
import tomllib
from pathlib import Path
from typing import Any

import pytest

from middeck.files.articles.form import ArticleForm
from middeck.files.environments.form import EnvironmentForm
from middeck.files.studies.form import StudyForm
from middeck.files.toml.overrides import KeyState, OverriddenDocument, parse_override, reach

ROOT = Path(__file__).parents[2]
SHEET = tomllib.loads((ROOT / "tests/reference/mace-article.toml").read_text(encoding="utf-8"))

# What our files say beyond the sheet: the mesh, the single-loop experiment, the mirror, Figure 6's settings
# (prose in the sheet) and the numbers of their own forms.
OURS = (
    *("schema", "seed", "mesh.", "siso.", "sito.", "promise.", "mirror.", "figure_6."),
    *("constants.gravity_direction", "rig.gimbal_presliding_deg"),
)


def leaves(value: Any, path: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], Any]]:
    if isinstance(value, dict):
        return [leaf for k, v in value.items() for leaf in leaves(v, (*path, k))]
    if isinstance(value, list):
        return [leaf for i, v in enumerate(value) for leaf in leaves(v, (*path, str(i)))]
    return [(path, value)]


def read(name: str) -> dict[str, Any]:
    return tomllib.loads((ROOT / name).read_text(encoding="utf-8"))


@functools.cache
def targets() -> list[OverriddenDocument]:
    return [
        OverriddenDocument("study", read("studies/mace-1993.toml"), StudyForm),
        *(OverriddenDocument(n, read(f"articles/mace-{n}.toml"), ArticleForm, n) for n in ("dm", "simple")),
        *(
            OverriddenDocument(f"lab-{n}", read("environments/lab.toml"), EnvironmentForm, n)
            for n in ("dm", "simple")
        ),
    ]


SHEET_LEAVES = [(path, value) for path, value in leaves(SHEET) if path != ("schema",)]


def found(path: tuple[str, ...]) -> list[tuple[str, tuple[str | int, ...], Any]]:
    """Document, path and value of everything that the sheet's name ``path`` reaches."""
    override = parse_override(".".join(path) + "=0")
    hits: list[tuple[str, tuple[str | int, ...], Any]] = []
    for target in targets():
        if override.article in ("", target.article):
            how, place = reach(target.data, target.form, override.segments)
            if how is KeyState.PRESENT:
                value = target.data
                for key in place:
                    value = value[key]
                hits.append((target.name, place, value))
    return hits


@pytest.mark.parametrize("table", dict.fromkeys(path[0] for path, _ in SHEET_LEAVES))
def test_every_value_of_the_sheet_is_ours(table: str) -> None:
    for path, value in SHEET_LEAVES:
        if path[0] == table:
            hits = found(path)
            assert hits, f"the sheet's name {path} leads nowhere"
            assert [v for _, _, v in hits] == [value] * len(hits), path
            assert len(hits) <= (1 if table == "article" else 2), path


def test_no_number_is_ours_alone() -> None:
    reached = {(name, place) for path, _ in SHEET_LEAVES for name, place, _ in found(path)}
    ours = {
        (t.name, path)
        for t in targets()
        for path, value in leaves(t.data)
        if isinstance(value, int | float)
        and not isinstance(value, bool)
        and not ".".join(path).startswith(OURS)
    }
    assert ours <= {(name, tuple(map(str, place))) for name, place in reached}
