"""Parts of an article that a dynamicist would name, and the share of each mode's strain energy in them."""

from __future__ import annotations

import itertools
import re
from collections import Counter

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float
from scipy.sparse.csgraph import connected_components

from middeck.structure.elements.rotations import cross
from middeck.structure.model.article import Structure
from middeck.structure.model.member_mesh import member_geometry
from middeck.structure.modes.motions.strain_shares import part_energy
from middeck.structure.rest.equilibrium import Equilibrium

# A part whose share is at least so much of the largest one is named with it: symmetric parts tie at 1.
ALIKE = 0.8
# Two members run on in one line where the sine of their angle is less.
STRAIGHT = 1e-3
MOST = 0.75  # share of all members from which on a part says nothing
STATION = re.compile(r"_\d+$")
NUMBERED = re.compile(r"(.*?[^\W\d])[ _./-]*\d+")


def strained_parts(
    equilibrium: Equilibrium, shapes: Float[np.ndarray, "coordinate mode"]
) -> tuple[tuple[str, ...], Float[np.ndarray, "mode part"]]:
    """Names of parts and their shares of the strain energy of each mode; zero where there is none."""
    structure = equilibrium.model.structure
    energy = part_energy(equilibrium, shapes)
    names = [
        *member_parts(structure),
        *(f"spring {s.name}" for s in structure.springs),
        *(f"{'slide' if j.slides else 'joint'} {j.name}" for j in structure.joints),
        *(f"bushing {b.name}" for b in structure.bushings),
        *(f"component {c.name}" for c in structure.components),
    ]
    parts = tuple(dict.fromkeys(names))
    place = {name: i for i, name in enumerate(parts)}
    share = np.zeros((len(parts), shapes.shape[1]))
    np.add.at(share, [place[name] for name in names], energy.T)
    whole = energy.sum(axis=1)
    return parts, (share / np.where(whole > 0.0, whole, 1.0)).T


def leading_parts(parts: tuple[str, ...], share: Float[np.ndarray, " part"]) -> tuple[str, float]:
    """The part with the largest share, together with those that have nearly as much, and their share.

    Names are in the order of the alphabet: that of the shares may depend on rounding.

    >>> leading_parts(("hub", "left", "right"), np.array([0.1, 0.45, 0.45]))
    ('left and right', 0.9)
    """
    if not len(share) or not share.max() > 0.0:
        return "", 0.0
    named = np.flatnonzero(share >= ALIKE * share.max())
    first, *others = sorted(parts[i] for i in named)
    words = first if not others else f"{first} and {others[0] if len(others) == 1 else f'{len(others)} more'}"
    return words, float(share[named].sum())


def member_parts(structure: Structure) -> tuple[str, ...]:
    """The part of each member: its name without its number, or the name of its section, else its line.

    Where the section changes along a member it is that of its start, without the number of the station. A
    name that is made of its nodes' has no number of its own. Names or sections are taken, whichever make
    more parts, if they distinguish members: more than one part, fewer than members, and none with `MOST` of
    them. A line is of members of one section that run on straight.
    """
    names = [member.name for member in structure.members]
    of_nodes = [f"{member.start}-{member.end}" for member in structure.members]
    stems = [
        match[1] if name != nodes and (match := NUMBERED.fullmatch(name)) else name
        for name, nodes in zip(names, of_nodes, strict=True)
    ]
    sections = [STATION.sub("", m.section_name) if m.stations else m.section_name for m in structure.members]
    groups = [stems, sections]
    distinct = [
        g for g in groups if 1 < len(set(g)) < len(g) and max(Counter(g).values()) < MOST * len(g) and all(g)
    ]
    if distinct:
        return tuple(max(distinct, key=lambda g: len(set(g))))
    lines = straight_lines(structure)
    if len(set(lines)) == 1:
        return tuple(names)
    ends: dict[int, list[str]] = {}
    for name, line in zip(names, lines, strict=True):
        ends.setdefault(line, []).append(name)
    called = {line: own[0] if len(own) == 1 else f"{own[0]}..{own[-1]}" for line, own in ends.items()}
    return tuple(called[line] for line in lines)


def straight_lines(structure: Structure) -> list[int]:
    """Number of the first member of each member's line."""
    members, along = structure.members, member_geometry(structure).triad[:, :, 0]
    at: dict[str, list[int]] = {}
    for m, member in enumerate(members):
        at.setdefault(member.start, []).append(m)
        at.setdefault(member.end, []).append(m)
    pairs = [pair for some in at.values() for pair in itertools.combinations(some, 2)]
    met = np.array(pairs, dtype=int).reshape(-1, 2)
    sine = np.linalg.norm(cross(along[met[:, 0]], along[met[:, 1]]), axis=1)
    on = [(a, b) for a, b in met[sine < STRAIGHT].tolist() if members[a].section == members[b].section]
    a, b = np.array(on, dtype=int).reshape(-1, 2).T
    graph = sp.coo_array((np.ones(len(a)), (a, b)), shape=(len(members),) * 2)
    _, first, line = np.unique(
        connected_components(graph, directed=False)[1], return_index=True, return_inverse=True
    )
    return first[line].tolist()
