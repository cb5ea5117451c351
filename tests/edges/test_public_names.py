"""``import middeck``: light, typed, and exactly the names that are documented."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import middeck

README = Path(__file__).parents[2] / "README.md"
SOURCE = Path(middeck.__file__).parent
ROOMS = sorted(name for name in middeck.__all__ if (SOURCE / name).is_dir())
PLACES = ["middeck", *(f"middeck.{room}" for room in ROOMS)]


def own_names(place: ModuleType) -> list[str]:
    """The public names of a place, without the rooms in it."""
    return [name for name in place.__all__ if place is not middeck or name not in ROOMS]


NAMES = [(place, name) for place in PLACES for name in own_names(import_module(place))]


def test_every_name_is_there_and_completed() -> None:
    for place in map(import_module, PLACES):
        assert len(set(place.__all__)) == len(place.__all__)
        assert set(place.__all__) <= set(dir(place))


def test_each_name_resolves_to_itself_and_says_what_it_is() -> None:
    for place, name in NAMES:
        value = getattr(import_module(place), name)
        assert value.__name__ == name, place
        assert value.__doc__, (place, name)


@pytest.mark.parametrize("place", PLACES)
def test_each_name_is_listed_with_the_module_that_holds_it(place: str) -> None:
    held = import_module(place)
    stub = ast.parse(Path(held.__file__ or "").with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom) and node.module]
    listed = {name.name: f"{place}.{node.module}" for node in imports for name in node.names}
    assert listed == {name: getattr(held, name).__module__ for name in own_names(held)}


def test_a_name_stands_in_one_place() -> None:
    everywhere = [name for _, name in NAMES]
    assert sorted(everywhere) == sorted(set(everywhere))


def test_nouns_and_verbs_of_the_diagram_are_public() -> None:
    (diagram,) = re.findall(r"```\n( Structure \+ Environment.*?)```", README.read_text("utf-8"), re.DOTALL)
    words = set(re.findall(r"\b(?:[A-Z]\w+|\w+_\w+|emulate)\b", diagram))
    assert {"Structure", "Plant", "Rig", "AuthoritySweep", "Study", "close_loop"} <= words
    assert words - set(own_names(middeck)) == set()


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="solve_mode"):
        middeck.solve_mode  # noqa: B018


def test_import_alone_loads_no_library() -> None:
    code = (
        "import middeck, sys; print([m for m in ('numpy', 'scipy', 'click', 'pydantic') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
