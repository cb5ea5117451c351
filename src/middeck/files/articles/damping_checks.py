"""Faults of the ``[damping]`` of an article beyond the form of its keys."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

from middeck.files.toml.faults import PathFault, finding, nearest
from middeck.files.toml.tables import Table, table_of, tables

PLACES = ("joint", "spring", "attach")
KEY = {"joint": "c_joint_nms_per_rad", "spring": "c_ns_per_m", "attach": "c_ns_per_m"}
WORDS = {"attach": "attach point"}


def damping_findings(data: Table, known: Mapping[str, Sequence[str]]) -> list[PathFault]:
    """Faults of ``[damping]`` in an article; ``known`` has the names of its parts by key."""
    damping = table_of(data, "damping")
    return [*_table(damping), *_loss_factors(damping, known), *_devices(damping, known)]


def _table(damping: Table) -> Iterator[PathFault]:
    ratios_at = damping.get("table")
    if not isinstance(ratios_at, dict):
        return
    for key in (k for k in ("flexible", "suspension", "rule") if k in damping):
        message = "a ratio or rule beside a table that holds for every mode"
        yield finding(("damping", key), message, damping[key], hint="leave out one of the two")
    f, ratio = (cast("Table", ratios_at).get(key) for key in ("frequency_hz", "ratio"))
    if not isinstance(f, list) or not isinstance(ratio, list):
        return
    frequencies, ratios = cast("list[Any]", f), cast("list[Any]", ratio)
    if len(frequencies) != len(ratios):
        message = f"{len(ratios)} ratios for {len(frequencies)} frequencies; must be one each"
        yield finding(("damping", "table", "ratio"), message)


def _loss_factors(damping: Table, known: Mapping[str, Sequence[str]]) -> Iterator[PathFault]:
    for key in ("material", "section"):
        for name in table_of(damping, key):
            yield from _unknown(("damping", key, name), name, key, known)


def _devices(damping: Table, known: Mapping[str, Sequence[str]]) -> Iterator[PathFault]:
    for i, device in tables(damping, "device"):
        path = ("damping", "device", i)
        places = [p for p in PLACES if p in device]
        if len(places) != 1:
            yield finding(path, f"names {len(places)} places; must be one", hint="joint, spring or attach")
            continue
        (place,) = places
        yield from _unknown((*path, place), device[place], place, known)
        wanted, other = KEY[place], next(k for k in KEY.values() if k != KEY[place])
        if other in device:
            message = f"a damper at a {WORDS.get(place, place)} has {wanted} instead"
            yield finding((*path, other), message, device[other])
        elif wanted not in device:
            yield finding((*path, wanted), f"missing; a damper at a {WORDS.get(place, place)} needs it")


def _unknown(
    path: tuple[str | int, ...], name: Any, key: str, known: Mapping[str, Sequence[str]]
) -> Iterator[PathFault]:
    if isinstance(name, str) and name not in known[key]:
        word = WORDS.get(key, key)
        hint = nearest(name, known[key]) or f"define a {word} first"
        yield finding(path, f"no {word} of this name", name, hint=hint)
