"""Detects a universal file that was cut between two data sets."""

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path

from middeck.files.records.uff58 import AXES, Dataset, Place
from middeck.files.records.uff_sets import TextSet, few, scan_texts

LINES_OF_NODE = {15: 1, 2411: 2}
"""Lines that a node takes in the data sets of places."""
TRACE = 82
ALIKE = 3
"""Nodes that must be measured alike before one that is not makes a file look cut."""


def warnings_on_whole(outputs: Sequence[Dataset], sets: Sequence[Dataset], file: Path) -> Iterator[str]:
    """Warnings where a file seems cut between two data sets, which leaves a file that looks whole, from the
    data sets of ``outputs`` among all ``sets``."""
    measured: dict[Place, set[int]] = {}
    for at in (data.response for data in outputs):
        measured.setdefault(dataclasses.replace(at, direction=0), set()).add(abs(at.direction))
    *others, (last, along) = measured.items() or [(Place("", 0, 0), set[int]())]
    common = set.intersection(*(d for _, d in others)) if others else set()
    if len(others) >= ALIKE and common - along and along <= common:
        lacks = ", ".join(AXES[d] for d in sorted(common - along))
        yield f"the last node, {last.node}, has no {lacks}, as all others have: is the file whole?"
    texts = scan_texts(file, (*LINES_OF_NODE, TRACE))
    places = list(dict.fromkeys(n for text in texts for n in _numbers(text)))
    # A file is cut behind the last node that was reached: one that is only drawn may stand anywhere.
    moving = max({d.response.number for d in outputs}, {d.reference.number for d in outputs}, key=len)
    reached = [k for k, n in enumerate(places) if n in moving]
    ends = {end.number for data in sets for end in (data.response, data.reference)}
    silent = [n for n in places if n not in ends]
    if reached and silent and places.index(silent[0]) > reached[-1]:
        what = f"{len(silent)} of the {len(places)} nodes with places or trace lines have no function"
        yield f"{what} ({few(silent)}): is the file whole?"


def _numbers(text: TextSet) -> Iterator[int]:
    """The nodes of a data set of places or of a trace line, which ends its strokes with zeros."""
    if text.number == TRACE:
        yield from (int(n) for line in text.lines[2:] for n in line.split() if n.isdigit() and int(n))
        return
    for line in text.lines[:: LINES_OF_NODE[text.number]]:
        if (number := line[:10].strip()).isdigit():
            yield int(number)
