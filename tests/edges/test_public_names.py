"""``import middeck``: light, typed, and exactly the names that are documented."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import middeck

NAMES = sorted(middeck.__all__)


def test_every_name_is_there_and_completed() -> None:
    assert len(set(NAMES)) == len(NAMES)
    assert set(NAMES) <= set(dir(middeck))


@pytest.mark.parametrize("name", NAMES)
def test_each_name_resolves_to_itself_and_says_what_it_is(name: str) -> None:
    value = getattr(middeck, name)
    assert value.__name__ == name
    assert value.__doc__


def test_each_name_is_listed_with_the_room_that_holds_it() -> None:
    stub = ast.parse(Path(middeck.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    listed = {name.name: f"middeck.{node.module}" for node in imports for name in node.names}
    assert listed == {name: getattr(middeck, name).__module__ for name in NAMES}


@pytest.mark.parametrize("noun", ["Structure", "Plant", "Compensator", "ClosedLoop", "Modes", "Equilibrium"])
def test_the_nouns_of_the_diagram_are_public(noun: str) -> None:
    assert noun in NAMES


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="solve_mode"):
        middeck.solve_mode  # noqa: B018


def test_import_alone_loads_no_library() -> None:
    code = (
        "import middeck, sys; print([m for m in ('numpy', 'scipy', 'click', 'pydantic') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
