"""Nodes of an article that no member, spring or component joins to the rest."""

import itertools
from collections.abc import Iterator

from middeck.files.articles.link_form import linked_frames
from middeck.files.toml.faults import Finding, finding
from middeck.files.toml.lines import Path
from middeck.files.toml.tables import Table, array_of, table_of, tables
from middeck.structure.model.connectivity import separate_parts, some_names


def unconnected(data: Table) -> Iterator[Finding]:
    """Members, springs and components must join all nodes; what they leave out is named at its first node."""
    place = {t["name"]: i for i, t in tables(data, "node") if isinstance(t.get("name"), str)}
    for part in separate_parts(list(place), _joined(data, set(place)))[1:]:
        path: Path = ("node", place[part[0]], "name")
        if len(part) == 1:
            message = "an unconnected node: no strut, spring or link joins it"
        else:
            message = f"a disconnected part: no strut, spring or link joins {some_names(part)} to the rest"
        yield finding(path, message, part[0], hint="add a [[strut]] from or to it, or remove it")


def _joined(data: Table, nodes: set[str]) -> list[tuple[str, str]]:
    """Pairs of nodes; where an end names nothing, another finding, all nodes used count as one part."""
    carrier = {name: name for name in nodes}
    for _, t in tables(data, "gimbal"):
        carrier |= {f"{t.get('name')}_x": str(t.get("node")), f"{t.get('name')}_z": str(t.get("node"))}
    for table, key in (("revolute", "parent"), ("proof_mass", "node")):
        carrier |= {str(t.get("name")): str(t.get(key)) for _, t in tables(data, table)}
    frame = {str(name): str(name) for name in array_of(table_of(data, "suspension"), "nodes")}
    frame |= {str(t.get("name")): str(t.get("frame")) for _, t in tables(data, "attach")}
    ends = [(str(t.get("from")), str(t.get("to"))) for _, t in tables(data, "strut")]
    for _, t in (*tables(data, "spring"), *tables(data, "bushing")):
        ends.append((frame.get(str(t.get("from")), ""), frame.get(str(t.get("to")), "")))
    for _, t in tables(data, "component"):
        ends += itertools.pairwise(map(str, table_of(t, "nodes").values()))
    for tied in linked_frames(data):
        ends += itertools.pairwise(str(name) for _, name in tied)
    pairs = [(_carrier(start, carrier), _carrier(end, carrier)) for start, end in ends]
    used = [name for pair in pairs for name in pair]
    return pairs if nodes.issuperset(used) else list(itertools.pairwise(n for n in used if n in nodes))


def _carrier(frame: str, carrier: dict[str, str]) -> str:
    """The node that a frame is fixed to in the end; a ring of joints, refused elsewhere, ends anywhere."""
    for _ in carrier:
        if carrier.get(frame, frame) == frame:
            break
        frame = carrier[frame]
    return frame
