"""Lines of a survey without lines of its own: along the article, from one measured node to others.

Between them motion is drawn as even: as the potential along wires of one resistance per length, with that of
the measured nodes given. Parts joined to one measured node only are not drawn: their motion was not measured.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

from middeck.structure.assembly.mesh import Model
from middeck.structure.correlation.measured_modes import drawn_at

# Shares that differ by less are equal to rounding; and the least length, over the article's size, of a line.
SAME, SHORT = 1e-9, 1e-6


class Traced(NamedTuple):
    """Lines, each with what it is of (`Strand`) and the nodes that it joins.

    The motion of ``names``, of which the first are the measured nodes, is ``share`` times that of these.
    """

    lines: tuple[tuple[str, tuple[str, ...]], ...]
    names: tuple[str, ...]
    share: Float[np.ndarray, "name measured"]


def trace_article(model: Model, measured: Sequence[str]) -> Traced:
    """Lines between the ``measured`` nodes along members, links, joints, components and springs."""
    chains = list(_chains(model, set(measured)))
    names = tuple(dict.fromkeys([*measured, *(name for _, chain in chains for name in chain)]))
    index = {name: i for i, name in enumerate(names)}
    pairs = np.array([[index[n] for n in two] for _, chain in chains for two in pairwise(chain)], dtype=int)
    pairs = pairs.reshape(-1, 2)
    at = np.array([drawn_at(model, name) for name in names]).reshape(-1, 3)
    share, reached = _shares(at, pairs, len(measured))
    apart = np.abs(share[pairs[:, 0]] - share[pairs[:, 1]]).max(axis=1, initial=0.0) > SAME
    shown = iter((apart & reached[pairs].all(axis=1)).tolist())
    lines = [
        (what, part) for what, chain in chains for part in _shown(chain, [next(shown) for _ in chain[1:]])
    ]
    return Traced(tuple(lines), names, share)


def _chains(model: Model, measured: set[str]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Chains of joined nodes; of a member's mesh nodes only those that were measured."""
    structure = model.structure
    for m in structure.members:
        inside = (name for k in range(1, m.elements) if (name := f"{m.name}/{k}") in measured)
        yield "member", (m.start, *inside, m.end)
    for joint in structure.joints:
        yield "rigid", (joint.parent, joint.name)
    for what, parts in (("link", structure.links), ("component", structure.components)):
        for part in parts:
            yield from ((what, (part.frames[0], frame)) for frame in part.frames[1:])
    for what, ends in (("spring", model.spring_ends), ("bushing", model.bushing_ends)):
        yield from ((what, (model.frames[i], model.frames[j])) for i, j in model.points.frame[ends])


def _shares(
    at: Float[np.ndarray, "name 3"], pairs: Int[np.ndarray, "pair 2"], count: int
) -> tuple[Float[np.ndarray, "name measured"], Bool[np.ndarray, " name"]]:
    """Share of each of the first ``count`` nodes in all, and which nodes they reach."""
    size = float(np.linalg.norm(np.ptp(at, axis=0))) or 1.0
    length = np.linalg.norm(at[pairs[:, 0]] - at[pairs[:, 1]], axis=1)
    i, j = pairs.T
    joined = sp.coo_array((1.0 / np.maximum(length, SHORT * size), (i, j)), shape=(len(at), len(at)))
    joined = sp.csr_array(joined + joined.T)
    _, part = connected_components(joined, directed=False)
    reached = np.isin(part, part[:count])
    free = np.flatnonzero(reached[count:]) + count
    share = np.zeros((len(at), count))
    share[:count] = np.eye(count)
    if len(free):
        balance = sp.csc_array(sp.diags_array(joined.sum(axis=1)[free]) - joined[free][:, free])
        share[free] = sp.linalg.splu(balance).solve(joined[free][:, :count].toarray())
    return share, reached


def _shown(chain: Sequence[str], shown: Sequence[bool]) -> Iterator[tuple[str, ...]]:
    """The pieces of a chain whose steps are shown."""
    for is_shown, steps in groupby(enumerate(shown), lambda step: step[1]):
        first, *_ = numbers = [k for k, _ in steps]
        if is_shown:
            yield tuple(chain[first : numbers[-1] + 2])
