"""Connections of nodes."""

from collections.abc import Iterable, Iterator, Sequence

from middeck.structure.model.article import JointState, Structure
from middeck.structure.model.environment import GroundBushing

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


def carried_by(structure: Structure, joint: str) -> set[str]:
    """The frames that turn with ``joint`` by joints alone: its own, and those of the joints on it."""
    carried = {joint}
    for _ in structure.joints:
        carried |= {j.name for j in structure.joints if j.parent in carried}
    return carried


def ties_across(structure: Structure, joint: str, grounded: Sequence[GroundBushing] = ()) -> tuple[str, ...]:
    """Links, bushings and components that fit as drawn and tie the parts that ``joint`` carries to others.

    So do bushings to the ground, ``grounded``. Another angle of the joint draws them anew, but not the parts
    that they tie.
    """
    carried = carried_by(structure, joint)
    frame = {point.name: point.frame for point in structure.attach_points}
    ties = [(tie.name, tie.frames) for tie in (*structure.links, *structure.components)]
    ties += [(b.name, (frame[b.start], frame[b.end])) for b in structure.bushings]
    ties += [(b.name, (frame[b.attach], "")) for b in grounded]  # no frame is named so
    return tuple(name for name, ends in ties if carried.intersection(ends) and not carried.issuperset(ends))


def turned_by_redrawing(structure: Structure, joint: str, grounded: Sequence[GroundBushing] = ()) -> str:
    """A fault of giving ``joint`` another angle than it is drawn at; empty for none."""
    ties = ties_across(structure, joint, grounded)
    if not ties:
        return ""
    return (
        f"joint {joint!r} cannot go to another angle than it is drawn at: {some_names(ties)} would be drawn "
        "anew to fit, and what they tie would not turn with it"
    )


REDRAW = (
    'let a stiff spring turn it (state = "sprung", a high stiffness, its rest angle), or draw the article '
    "at that angle"
)
"""What helps where a joint cannot go to another angle."""


def redrawing_commands(structure: Structure, grounded: Sequence[GroundBushing] = ()) -> Iterator[str]:
    """Faults of commands that move driven joints from where they are drawn."""
    for joint in structure.joints:
        if joint.state is JointState.DRIVEN and joint.target != joint.angle:
            redrawn = turned_by_redrawing(structure, joint.name, grounded)
            if redrawn:
                yield f"{redrawn}: {REDRAW}"


def some_names(names: Sequence[str]) -> str:
    """All names of a few, the first of many.

    >>> some_names(["a", "b"]), some_names([f"n{i}" for i in range(9)])
    ("'a', 'b'", "'n0', 'n1', 'n2', 'n3', 'n4', 'n5' and 3 more")
    """
    shown = ", ".join(map(repr, names[:SHOWN]))
    return shown if len(names) <= SHOWN else f"{shown} and {len(names) - SHOWN} more"
