"""A page gives the import path of every function and class that is not public, and the path is right."""

from __future__ import annotations

import functools
import re
from pathlib import Path

import pytest
from doc_pages import ROOT

from middeck.cli.shown.advice import public_names

SOURCE = ROOT / "src" / "middeck"
PAGES = sorted([*ROOT.glob("docs/explanation/*.md"), *ROOT.glob("docs/how-to/*.md")])
# Verbs, options and words of the pages that are names of functions too.
WORDS = {
    "check",
    "compare",
    "design",
    "feedback",
    "identify",
    "logarithmic",
    "settle",
    "weighted",
    "Station",
    "_rate",
}


@functools.cache
def sources() -> dict[Path, str]:
    return {file: file.read_text(encoding="utf-8") for file in SOURCE.rglob("*.py*") if file.suffix != ".pyc"}


@functools.cache
def unclear() -> set[str]:
    """Functions and classes that are neither public nor also the name of a field or argument."""
    defined, fields = (
        {name for text in sources().values() for name in re.findall(pattern, text, re.MULTILINE)}
        for pattern in (r"^(?:def|class) (\w+)", r"^    (\w+): ")
    )
    return defined - fields - public_names() - WORDS


def exists(path: str) -> bool:
    """Whether the dotted ``path`` is a module, or a name that its module or package has."""
    *rooms, name = path.split(".")[1:]
    room = SOURCE.joinpath(*rooms)
    holds = sources().get(room.with_suffix(".py")) or sources().get(room / "__init__.pyi") or ""
    holds = holds or sources().get(room / "__init__.py") or ""
    return (room / name).is_dir() or (room / f"{name}.py").exists() or bool(re.search(rf"\b{name}\b", holds))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_name_of_the_page_can_be_imported(page):
    text = page.read_text(encoding="utf-8")
    paths = set(re.findall(r"`(middeck(?:\.\w+)+)`", text))
    assert [path for path in paths if not exists(path)] == []
    lines = re.findall(r"from middeck\S* import (.+)", text)
    known = {word for line in lines for word in re.findall(r"\w+", line)}
    known |= {path.rpartition(".")[2] for path in paths}
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    assert sorted(set(re.findall(r"`([A-Za-z_]\w*)[^`]*`", prose)) & unclear() - known) == []


@pytest.mark.parametrize("page", [p for p in PAGES if p.parent.name == "how-to"], ids=lambda page: page.stem)
def test_a_how_to_names_nothing_deep(page):
    """What it uses stands in ``md`` or in the list of a room; ``middeck.room.name`` at most."""
    text = page.read_text(encoding="utf-8")
    assert re.findall(r"\bmiddeck(?:\.[a-z_]\w*){3,}", text) == []
    assert re.findall(r"\bfrom middeck\.\w+\.", text) == []
