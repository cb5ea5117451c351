"""Elements inside carried parts: whose ends both are, or are carried by, one root."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from middeck.structure.elements.motion_since_drawn import SinceDrawn, chain_within, common_carrier


class Within(NamedTuple):
    """The common carrier of the ends of every element, -1 where there is none.

    Those inside carried parts by ``rows``, with the ``chain`` of each end up to the common carrier.
    """

    outer: Int[np.ndarray, " all"]
    rows: Int[np.ndarray, " element"]
    chain: list[Int[np.ndarray, "element end"]]


class Inside(NamedTuple):
    """Beams and bushings inside carried parts."""

    beams: Within
    bushings: Within


def lay_out_inside(
    since: SinceDrawn | None, roots: int, beams: Int[np.ndarray, "beam 2"], bushings: Int[np.ndarray, "tie 2"]
) -> Inside:
    """Beams and bushings with ends on these frames, of which the first ``roots`` are roots."""
    return Inside(_within(since, roots, beams), _within(since, roots, bushings))


def _within(since: SinceDrawn | None, roots: int, frames: np.ndarray) -> Within:
    outer = np.full(len(frames), -1)
    if since is None or not since.carries:
        return Within(outer, np.zeros(0, dtype=int), [])
    on_roots = np.all(frames < roots, axis=1)
    outer[on_roots] = common_carrier(since, frames[on_roots])
    rows = np.flatnonzero(outer >= 0)
    chain = chain_within(since, frames[rows].ravel(), np.repeat(outer[rows], 2))
    return Within(outer, rows, [link.reshape(-1, 2) for link in chain])
