"""The rooms and floors that `CONTRIBUTING.md` lists are those of the import contracts."""

from __future__ import annotations

import re
import tomllib

import pytest
from doc_pages import ROOT

PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
    "contracts"
]
LAYERS = {
    c["containers"][0].removeprefix("middeck").lstrip("."): c["layers"]
    for c in CONTRACTS
    if c["type"] == "layers"
}


def built(layers: list[str]) -> list[set[str]]:
    """The rooms of each layer; one in brackets is to come."""
    rooms = ({room for room in layer.split(" | ") if room[0] != "("} for layer in layers)
    return [layer for layer in rooms if layer]


def test_the_order_of_imports_is_that_of_the_contract():
    (line,) = re.findall(r"^`(cli > .*)`", PAGE, re.MULTILINE)
    assert [set(layer.split(" | ")) for layer in line.split(" > ")] == built(LAYERS[""])


def test_each_room_stands_in_the_table():
    rooms = set().union(*built(LAYERS[""])) - {"arguments", "values", "errors"}
    assert {
        room for room in rooms if f"`{room}/`" not in PAGE.partition("The big rooms have floors")[0]
    } == set()


@pytest.mark.parametrize("room", sorted(set(LAYERS) - {""}))
def test_the_floors_of_a_room_are_those_of_its_contract(room):
    (line,) = re.findall(rf"^- `{room}/`: (.*)[;.]$", PAGE, re.MULTILINE)
    assert [set(floor.split(" and ")) for floor in line.split(", ")] == built(LAYERS[room])[::-1]


def test_what_is_to_come_is_named():
    to_come = set(re.findall(r"\((\w+)\)", " ".join(layer for layers in LAYERS.values() for layer in layers)))
    (sentence,) = re.findall(r"What is to come.*?\.(?=\s[A-Z])", PAGE, re.DOTALL)
    assert set(re.findall(r"`(\w+)` \(", sentence)) == to_come
