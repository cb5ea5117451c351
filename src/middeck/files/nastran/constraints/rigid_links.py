"""Rigid links of all six components: which grid carries which; one that rides has no freedom of its own."""

from collections.abc import Container, Iterator
from typing import NamedTuple

from middeck.files.nastran.deck.entries import ALL, Entries, Entry, raise_some
from middeck.files.nastran.deck.nastran_numbers import integer, real
from middeck.files.toml.faults import DocumentFault


class RigidLink(NamedTuple):
    """One dependent grid and the one that carries it, by an entry and the field that names it."""

    rider: int
    carrier: int
    entry: Entry
    key: str


def find_carriers(entries: Entries, grids: Container[int]) -> dict[int, int]:
    """The grid without a carrier of its own on which each dependent grid rides in the end.

    Links of fewer components are `partial_links`, and those with independent components at several grids are
    `rigid_elements`. Raises `ConfigError` for grids that are not there or dependent twice, and for links that
    close on themselves.
    """
    faults: list[DocumentFault] = []
    by: dict[int, RigidLink] = {}
    for link in (*_rbe2(entries, faults), *_rbar(entries)):
        first = by.get(link.rider)
        if link.rider not in grids or link.carrier not in grids:
            absent = link.carrier if link.rider in grids else link.rider
            faults.append(link.entry.fault(f"there is no grid {absent}", link.key))
        elif first is not None:
            line = first.entry.card.line()
            faults.append(
                link.entry.fault(
                    f"grid {link.rider} is dependent twice; first by {first.entry.label} "
                    f"at {line[1]}:{line[2]}",
                    link.key,
                )
            )
        else:
            by[link.rider] = link
    raise_some(faults)
    carriers: dict[int, int] = {}
    for rider, link in by.items():
        chain = {rider}
        at = link.carrier
        while at in by and at not in carriers:
            if at in chain:
                raise_some([link.entry.fault("these rigid links close on themselves", link.key)])
            chain.add(at)
            at = by[at].carrier
        end = carriers.get(at, at)
        carriers.update(dict.fromkeys(chain, end))
    return carriers


def grids_of(entry: Entry, faults: list[DocumentFault]) -> list[int]:
    """The dependent grids of an RBE2: a list, perhaps with THRU; a last real is its thermal expansion."""
    texts = [text for text in entry["gm"] if text is not None]
    if texts and real(texts[-1]) is not None:
        texts.pop()
    return expand(entry, texts, "gm", faults)


def expand(entry: Entry, texts: list[str], key: str, faults: list[DocumentFault]) -> list[int]:
    """A list of grids in which ``a THRU b`` stands for all from a to b, which may be one."""
    found: list[int] = []
    through = False
    for text in texts:
        number = integer(text)
        if text == "THRU" and found and not through:
            through = True
        elif number is None or number <= 0 or (through and not 0 <= number - found[-1] <= 100_000):
            what = f"{found[-1]} THRU {text}" if through else repr(text)
            faults.append(entry.fault(f"{what} in a list of grids", key))
            return []
        elif through:
            found += range(found[-1] + 1, number + 1)
            through = False
        else:
            found.append(number)
    if through or not found:
        faults.append(entry.fault("a list of grids without an end", key))
    return found


def partial_links(
    entries: Entries, faults: list[DocumentFault]
) -> Iterator[tuple[Entry, str, int, int, str]]:
    """RBE2 and RBAR of some components: entry, field, the grid of all six, the other and its components."""
    for entry in entries.of("RBE2"):
        if entry["cm"] != ALL:
            yield from ((entry, "gm", entry["gn"], rider, entry["cm"]) for rider in grids_of(entry, faults))
    for entry in entries.of("RBAR"):
        match (entry["cna"] or "", entry["cnb"] or "", entry["cma"] or "", entry["cmb"] or ""):
            case ("123456", "", "", some) if some not in ("", ALL):
                yield entry, "cmb", entry["ga"], entry["gb"], some
            case ("", "123456", some, "") if some not in ("", ALL):
                yield entry, "cma", entry["gb"], entry["ga"], some
            case _:
                pass


def _rbe2(entries: Entries, faults: list[DocumentFault]) -> list[RigidLink]:
    return [
        RigidLink(rider, entry["gn"], entry, "gm")
        for entry in entries.of("RBE2")
        if entry["cm"] == ALL
        for rider in grids_of(entry, faults)
    ]


def _rbar(entries: Entries) -> list[RigidLink]:
    links: list[RigidLink] = []
    for entry in entries.of("RBAR"):
        ends = (entry["cna"] or "", entry["cnb"] or "", entry["cma"] or "", entry["cmb"] or "")
        match ends:
            case ("123456", "", "", "" | "123456"):
                links.append(RigidLink(entry["gb"], entry["ga"], entry, "gb"))
            case ("", "123456", "" | "123456", ""):
                links.append(RigidLink(entry["ga"], entry["gb"], entry, "ga"))
            case _:
                pass  # see `partial_links` and `rigid_elements`
    return links
