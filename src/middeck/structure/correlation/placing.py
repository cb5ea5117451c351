"""Which nodes of the model the numbered nodes of a test are: by place where the test has coordinates, else by
number."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from middeck.errors import ConfigError
from middeck.structure.assembly.mesh import Model
from middeck.structure.correlation.measured_modes import MeasuredModes

# Of the size of the article: how near a node of the test lies to the one that it is.
NEAR = 0.01
LISTED = 10


def place_channels(model: Model, measured: MeasuredModes) -> MeasuredModes:
    """``measured`` with the model's names in place of numbers; channels that name a frame are kept.

    Number 3 is the node "3", or else the only node with this number at the end of its name ("n3"). A node
    with coordinates is the model's node at that place as drawn (within 1 % of the article's size); its number
    decides only where several stand there, or none. What is not in the model is left out, with a warning.

    Raises `ConfigError` if no channel is in the model.
    """
    known = set(model.frames)
    numbers = dict.fromkeys(
        n for n in measured.node if n.isdigit() and (n not in known or _is_located(model, measured, n))
    )
    here = measured.position_m
    found: dict[str, str | None] = {}
    said: list[str] = []
    for number in numbers:
        at = None if here is None else here[measured.node.index(number)]
        found[number], odd = _place(model, number, at)
        said += odd
    for exact in dict.fromkeys(n for n in measured.node if n in known and n not in numbers):
        if here is not None:
            said += _elsewhere(model, exact, exact, here[measured.node.index(exact)])
    absent = [n for n, name in found.items() if name is None]
    keep = [k for k, n in enumerate(measured.node) if found.get(n, n) is not None]
    if absent and not keep:
        names = ", ".join(n.name for n in model.structure.nodes[:LISTED])
        raise ConfigError(
            f"no node of the test is in the model: {_list(absent)}",
            where="measured channels",
            hint=f"nodes of the model are {names}; number the nodes alike, or give coordinates in its frame",
        )
    if absent:
        left = len(measured.node) - len(keep)
        said.append(f"{left} channels of nodes that are not in the model are left out: {_list(absent)}")
    std = measured.shape_std
    return replace(
        measured,
        node=tuple(found.get(measured.node[k]) or measured.node[k] for k in keep),
        direction=tuple(measured.direction[k] for k in keep),
        shape=measured.shape[keep],
        shape_std=None if std is None else std[keep],
        position_m=None if here is None else here[keep],
        warnings=(*measured.warnings, *said),
    )


def _is_located(model: Model, measured: MeasuredModes, name: str) -> bool:
    return measured.position_m is not None and name in {n.name for n in model.structure.nodes}


def _place(model: Model, number: str, at: np.ndarray | None) -> tuple[str | None, list[str]]:
    """The node of the model, and what is odd about it."""
    names = [node.name for node in model.structure.nodes]
    alike = [n for n in names if n.isdigit() and int(n) == int(number)] or [
        n for n in names if (m := re.search(r"\d+$", n)) and int(m[0]) == int(number)
    ]
    by_number = alike[0] if len(alike) == 1 else None
    if at is None:
        return by_number, []
    drawn = np.array([model.drawn.p[model.frames.index(n)] for n in names])
    away = np.linalg.norm(drawn - at, axis=1)
    near = [n for n, d in zip(names, away, strict=True) if d <= NEAR * _size(drawn)]
    if by_number is not None and (by_number in near or not near):
        return by_number, _elsewhere(model, number, by_number, at)
    if len(near) != 1:
        return None, []
    odd = [f"node {number} of the test stands where {near[0]} does, not {by_number}: taken as {near[0]}"]
    return near[0], odd if by_number else []


def _elsewhere(model: Model, number: str, name: str, at: np.ndarray) -> list[str]:
    drawn = np.array([model.drawn.p[model.frames.index(n.name)] for n in model.structure.nodes])
    away = float(np.linalg.norm(model.drawn.p[model.frames.index(name)] - at))
    if away <= NEAR * _size(drawn):
        return []
    return [
        f"node {number} of the test lies {away:.3g} m from {name} of the model: is its frame the model's?"
    ]


def _size(drawn: np.ndarray) -> float:
    return float(np.ptp(drawn, axis=0).max())


def _list(names: list[str]) -> str:
    more = len(names) - LISTED
    return ", ".join(names[:LISTED]) + (f" and {more} more" if more > 0 else "")
