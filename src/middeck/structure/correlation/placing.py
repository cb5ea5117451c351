"""Nodes of the model for the numbered nodes of a test: by place where the test has coordinates, else by
number."""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from middeck.errors import ConfigError
from middeck.structure.assembly.mesh import Model
from middeck.structure.correlation.measured_modes import AXES, MeasuredModes, drawn_at
from middeck.structure.model.links import Link
from middeck.structure.modes.results.component_outputs import points_inside

# Largest distance, over the size of the article, of a measured node from its node of the article.
NEAR = 0.01
LISTED = 10
# Metres between nodes at one place: rounding of what a file states.
PINNED = 1e-9


def place_channels(model: Model, measured: MeasuredModes) -> MeasuredModes:
    """``measured`` with the model's names in place of numbers; channels that name a frame are kept.

    Number 3 is the node "3", or else the only node with this number at the end of its name ("n3"). A node
    with coordinates is the model's node at that place as drawn (within 1 % of the article's size); its number
    decides only where several stand there, or none. Nodes that links pin to another at its place do not count
    beside it. Where no node is, attach points are sought, then points inside components. What is not in the
    model is left out, with a warning.

    Raises `ConfigError` if no channel is in the model.
    """
    points = [point.name for point in model.structure.attach_points]
    names = [node.name for node in model.structure.nodes], points, points_inside(model)
    kinds = [{name: drawn_at(model, name) for name in kind} for kind in names]
    known = {*model.frames, *kinds[1], *kinds[2]}
    here = measured.position_m
    located = {} if here is None else kinds[0]
    numbers = dict.fromkeys(n for n in measured.node if n.isdigit() and (n not in known or n in located))
    found: dict[str, str | None] = {}
    remarks: list[str] = []
    for number in numbers:
        at = None if here is None else here[measured.node.index(number)]
        found[number], odd = _place(model, number, at, kinds)
        remarks += odd
    for exact in dict.fromkeys(n for n in measured.node if n in known and n not in numbers):
        if here is not None:
            remarks += _elsewhere(model, exact, exact, here[measured.node.index(exact)])
    absent = [n for n, name in found.items() if name is None]
    keep = [k for k, n in enumerate(measured.node) if found.get(n, n) is not None]
    if absent and not keep:
        names = ", ".join(n.name for n in model.structure.nodes[:LISTED])
        raise ConfigError(
            f"no node of the test is in the model: {list_names(absent)}",
            where="measured channels",
            hint=f"nodes of the model are {names}; number the nodes alike, or give coordinates in its frame",
        )
    if absent:
        left = len(measured.node) - len(keep)
        remarks.append(
            f"{left} channels of nodes that are not in the model are left out: {list_names(absent)}"
        )
    std = measured.shape_std
    lines = [[_named(n, found, known, kinds) for n in line] for line in measured.lines]
    return replace(
        measured,
        node=tuple(found.get(measured.node[k]) or measured.node[k] for k in keep),
        direction=tuple(measured.direction[k] for k in keep),
        shape=measured.shape[keep],
        shape_std=None if std is None else std[keep],
        position_m=None if here is None else here[keep],
        lines=tuple(tuple(part) for line in lines for part in unbroken(line)),
        warnings=(*measured.warnings, *remarks),
    )


def _named(
    node: str, found: dict[str, str | None], known: set[str], kinds: list[dict[str, np.ndarray]]
) -> str | None:
    """A node of a line by the model's name; one without channels, as a fixed one, by its number alone."""
    if node in found or node in known or not node.isdigit():
        return found.get(node, node if node in known else None)
    return next((name for names in kinds if (name := _with_number(names, node))), None)


def unbroken(line: Sequence[str | None]) -> list[list[str]]:
    """The pieces of a line between nodes that are not in the model."""
    parts = [list(names) for there, names in groupby(line, lambda name: name is not None) if there]
    return [[name for name in part if name] for part in parts if len(part) > 1]


def _place(
    model: Model, number: str, at: np.ndarray | None, kinds: list[dict[str, np.ndarray]]
) -> tuple[str | None, list[str]]:
    """The node of the model, and what is odd about it."""
    by_number = next((name for names in kinds if (name := _with_number(names, number))), None)
    if at is None:
        return by_number, []
    reach = NEAR * _size(model)
    near = next((names for kind in kinds if (names := _near(kind, at, reach))), [])
    if by_number is not None and (by_number in near or not near):
        return by_number, _elsewhere(model, number, by_number, at)
    if len(near) > 1:
        pinned = _pinned_to(model, near)
        near = [name for name in near if name not in pinned]
    if len(near) != 1:
        several = (
            f"node {number} of the test stands where {' and '.join(near)} do: which of them is it? Give "
            "it the number of that node in its name, or its name in a JSON survey"
        )
        return None, [several] if near else []
    odd = [f"node {number} of the test stands where {near[0]} does, not {by_number}: taken as {near[0]}"]
    return near[0], odd if by_number else []


def _with_number(names: dict[str, np.ndarray], number: str) -> str | None:
    """The only one of this number, or with it at the end."""
    alike = [n for n in names if n.isdigit() and int(n) == int(number)] or [
        n for n in names if (m := re.search(r"\d+$", n)) and int(m[0]) == int(number)
    ]
    return alike[0] if len(alike) == 1 else None


def _near(places: dict[str, np.ndarray], at: np.ndarray, reach: float) -> list[str]:
    return [n for n, x in places.items() if np.linalg.norm(x - at) <= reach]


def _pinned_to(model: Model, names: list[str]) -> set[str]:
    """Nodes that a link keeps at the place of another of them: the pinned ends of bars."""
    return {
        link.second
        for link in model.structure.links
        if isinstance(link, Link)
        and {link.first, link.second} <= set(names)
        and set(link.along) == set(AXES[:3])
        and not np.any(link.offset)
        and np.allclose(drawn_at(model, link.first), drawn_at(model, link.second), rtol=0.0, atol=PINNED)
    }


def _elsewhere(model: Model, number: str, name: str, at: np.ndarray) -> list[str]:
    away = float(np.linalg.norm(drawn_at(model, name) - at))
    if away <= NEAR * _size(model):
        return []
    return [
        f"node {number} of the test lies {away:.3g} m from {name} of the model: is its frame the model's?"
    ]


def _size(model: Model) -> float:
    drawn = np.array([drawn_at(model, node.name) for node in model.structure.nodes])
    return float(np.ptp(drawn, axis=0).max())


def list_names(names: Sequence[str]) -> str:
    """The first ten names, and how many more there are."""
    more = len(names) - LISTED
    return ", ".join(names[:LISTED]) + (f" and {more} more" if more > 0 else "")
