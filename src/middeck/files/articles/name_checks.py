"""Faults of the names in an article: given twice, or without a thing that they name."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from middeck.files.articles.link_form import link_names, linked_frames
from middeck.files.articles.names import attach_names, joint_names, named_tables, names_in
from middeck.files.toml.faults import PathFault, finding, nearest, show
from middeck.files.toml.lines import Path
from middeck.files.toml.tables import Table, array_of, table_of, tables

# Ports at a point of a frame, and what the user calls them.
AT_POINT = {"force": "a force", "accelerometer": "an accelerometer", "displacement": "a displacement"}


def name_findings(data: Table) -> Iterator[PathFault]:
    """Faults of names: given twice, or without a thing that they name."""
    yield from _names(data)
    yield from _references(data)


def _names(data: Table) -> Iterator[PathFault]:
    """Frames share one name space; attach points, members and either side of ports have theirs."""
    frames = _named(data, "node")
    for i, t in tables(data, "gimbal"):
        frames += [(("gimbal", i, "name"), f"{t.get('name')}_{a}") for a in "xz"]
    for table in ("revolute", "proof_mass"):
        frames += _named(data, table)
    yield from given_twice(frames, "frame")
    points: list[tuple[Path, Any]] = [
        (("suspension", "nodes", i), n) for i, n in enumerate(array_of(table_of(data, "suspension"), "nodes"))
    ]
    yield from given_twice([*points, *_named(data, "attach")], "attach point")
    yield from given_twice(_named(data, "load_case"), "load case")
    yield from given_twice(_named(data, "component"), "component")
    yield from given_twice(_named(data, "wheel"), "wheel")
    yield from given_twice(link_names(data), "link")
    for kind in ("strut", "spring", "bushing"):
        ends = [(i, t, t.get("name", f"{t.get('from')}-{t.get('to')}")) for i, t in tables(data, kind)]
        yield from given_twice([((kind, i, "name" if "name" in t else "from"), n) for i, t, n in ends], kind)
    for kind in ("actuator", "sensor"):
        ports: list[tuple[Path, Any]] = [((kind,), name) for name in _default_ports(data, kind)]
        yield from given_twice([*ports, *_named(data, kind)], kind)


def _named(data: Table, table: str) -> list[tuple[Path, Any]]:
    return [((table, i, "name"), t.get("name")) for i, t in tables(data, table)]


def _default_ports(data: Table, kind: str) -> list[str]:
    ports = [f"bus_{a}" for a in "xyz"] if "wheel_node" in data else []
    for _, t in tables(data, "gimbal"):
        ports += [f"{t.get('name')}_rel_{a}" for a in "xz"]
        ports += [f"{t.get('name')}_in_{a}" for a in "xz"] if kind == "sensor" else []
    ports += [str(t.get("name")) for _, t in tables(data, "wheel")]
    slides_or_turns = (*tables(data, "revolute"), *tables(data, "proof_mass"))
    return ports + [f"{t.get('name')}_rel" for _, t in slides_or_turns]


def given_twice(named: Sequence[tuple[Path, Any]], kind: str) -> Iterator[PathFault]:
    """Names, each with its path, that stand a second time."""
    return given_again(named, f"a second {kind} of this name", "give each its own name")


def given_again(named: Sequence[tuple[Path, Any]], message: str, hint: str) -> Iterator[PathFault]:
    """Names given before in ``named``; the form has refused those that are no text."""
    seen: set[Any] = set()
    for path, name in named:
        if isinstance(name, str) and name in seen:
            yield finding(path, message, name, hint=hint)
        seen.add(name if isinstance(name, str) else None)


def _references(data: Table) -> Iterator[PathFault]:
    nodes, joints = dict.fromkeys(names_in(data, "node")), dict.fromkeys(joint_names(data))
    frames, points = nodes | joints, dict.fromkeys(attach_names(data))
    sections = dict.fromkeys(named_tables(data, "section"))
    unknown = partial(
        unknown_name, carriers={str(t.get("name")): t.get("frame") for _, t in tables(data, "attach")}
    )
    if "wheel_node" in data:
        yield from unknown(("wheel_node",), data["wheel_node"], nodes, "node")
    wanted = [
        ("strut", "from", nodes, "node"),
        ("strut", "to", nodes, "node"),
        ("strut", "section", sections, "section"),
        ("gimbal", "node", frames, "frame"),
        ("revolute", "parent", frames, "frame"),
        ("proof_mass", "node", frames, "frame"),
        ("attach", "frame", frames, "frame"),
        ("wheel", "frame", frames, "frame"),
        ("spring", "from", points, "attach point"),
        ("spring", "to", points, "attach point"),
        ("sensor", "axis_frame", frames, "frame"),
        ("bushing", "from", points, "attach point"),
        ("bushing", "to", points, "attach point"),
    ]
    for i, component in tables(data, "component"):
        for grid, name in table_of(component, "nodes").items():
            yield from unknown(("component", i, "nodes", grid), name, frames, "frame")
    for ends in linked_frames(data):
        for path, name in ends:
            yield from unknown(path, name, frames, "frame")
    yield from _case_references(data, nodes, frames, unknown)
    for table, key, known, kind in wanted:
        for i, t in tables(data, table):
            if key in t:
                yield from unknown((table, i, key), t[key], known, kind)
    for table in ("actuator", "sensor"):
        for i, t in tables(data, table):
            frame, anywhere = t.get("frame"), "axis" in t or str(t.get("kind")) in AT_POINT
            if not anywhere and isinstance(frame, str) and frame in nodes:
                message = f"is no joint, so that the {table} needs an axis"
                yield finding((table, i, "frame"), message, frame, hint="axis = [x, y, z] in its axes")
            # With an axis it may be on any frame: one that is misspelt may be meant.
            yield from unknown((table, i, "frame"), frame, frames, "frame")
    for i, name in enumerate(array_of(table_of(data, "suspension"), "nodes")):
        yield from unknown(("suspension", "nodes", i), name, frames, "frame")


def _case_references(
    data: Table, nodes: Collection[str], frames: Collection[str], unknown: Callable[..., Iterator[PathFault]]
) -> Iterator[PathFault]:
    """Frames and nodes that load cases name."""
    wanted = (("load", "frame", frames), ("mass", "frame", frames), ("prescribed", "node", nodes))
    for i, case in tables(data, "load_case"):
        for table, key, known in wanted:
            for k, t in tables(case, table):
                yield from unknown(("load_case", i, table, k, key), t.get(key), known, key)


def unknown_name(
    path: Path, name: Any, known: Collection[str], kind: str, carriers: Mapping[str, Any] | None = None
) -> Iterator[PathFault]:
    """A name that is not ``known``; ``carriers`` are the frames of attach points, which may be meant."""
    if isinstance(name, str) and name not in known:
        hint = nearest(name, known) or f"define a {kind} first"
        if carriers and carriers.get(name, name) != name and kind != "section":
            frame = show(carriers[name])
            place = f"its offset in offsets_m.{path[-1]}" if path[0] == "component" else "its offset_m"
            hint = f"it is an attach point on {frame}: name that, and {place} as the place there"
        yield finding(path, f"no {kind} of this name", name, hint=hint)
