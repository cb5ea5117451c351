"""Which nodes are connected."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from middeck.structure.model.article import Structure

SHOWN = 6


def separate_parts(nodes: Sequence[str], pairs: Iterable[tuple[str, str]]) -> list[list[str]]:
    """Groups of ``nodes`` that ``pairs`` join, the largest first, each in the order given.

    >>> separate_parts(["a", "b", "c", "d"], [("b", "d"), ("d", "c")])
    [['b', 'c', 'd'], ['a']]
    """
    leader = {name: name for name in nodes}

    def first(name: str) -> str:  # with the way there halved (Tarjan and van Leeuwen 1984)
        while leader[name] != name:
            leader[name] = name = leader[leader[name]]
        return name

    for a, b in pairs:
        leader[first(b)] = first(a)
    parts: dict[str, list[str]] = {}
    for name in nodes:
        parts.setdefault(first(name), []).append(name)
    return sorted(parts.values(), key=len, reverse=True)


def joined_nodes(structure: Structure) -> list[tuple[str, str]]:
    """Pairs of nodes that a member, component or link joins, or a tie between points of them or joints."""
    node = {n.name: n.name for n in structure.nodes}
    for joint in structure.joints:
        node[joint.name] = node[joint.parent]
    at = {point.name: node[point.frame] for point in structure.attach_points}
    pairs = [(member.start, member.end) for member in structure.members]
    pairs += [(at[tie.start], at[tie.end]) for tie in (*structure.springs, *structure.bushings)]
    tied = (*structure.components, *structure.links)
    return pairs + [(node[c.frames[0]], node[f]) for c in tied for f in c.frames[1:]]


def some_names(names: Sequence[str]) -> str:
    """All of a few, the first of many.

    >>> some_names(["a", "b"]), some_names([f"n{i}" for i in range(9)])
    ("'a', 'b'", "'n0', 'n1', 'n2', 'n3', 'n4', 'n5' and 3 more")
    """
    shown = ", ".join(map(repr, names[:SHOWN]))
    return shown if len(names) <= SHOWN else f"{shown} and {len(names) - SHOWN} more"
