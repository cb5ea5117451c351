"""Places of the ends of beam elements, with the digits that their strain needs."""

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.mesh import Model, select_beams
from middeck.structure.assembly.places import Placement, poses_at
from middeck.structure.elements.beam import BeamProperties
from middeck.structure.elements.beam_deformations import EndStrain, end_strain
from middeck.structure.elements.frames import Configuration
from middeck.structure.elements.motion_since_drawn import Lever, Within, levers, seen_from

# Elements whose derivatives are formed together: their arrays, 10 kB each, should stay in the cache.
CHUNK = 1024


class BeamChunk(NamedTuple):
    """Some of the elements: their rows, properties and ends (see `element_ends`)."""

    rows: slice
    beams: BeamProperties
    ends: tuple[np.ndarray, np.ndarray, EndStrain | None]


def beam_chunks(model: Model, at: Placement) -> Iterator[BeamChunk]:
    """All elements, by those whose derivatives are formed together."""
    for start in range(0, len(model.element_ends), CHUNK):
        rows = slice(start, start + CHUNK)
        yield BeamChunk(rows, select_beams(model.beams, rows), element_ends(model, at, rows))


def element_poses(model: Model, config: Configuration) -> tuple[np.ndarray, np.ndarray]:
    """End positions (element, 2, 3) and triads (element, 2, 3, 3) of all beam elements."""
    return _element_poses(model, poses_at(model, config), slice(None))


def _element_poses(model: Model, at: Placement, rows: slice | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    ends = model.element_ends[rows]
    R = at.poses.R[model.points.frame[ends]]
    return at.world[ends], R @ model.element_triad[rows, None]


def element_ends(
    model: Model, at: Placement, rows: slice | np.ndarray
) -> tuple[np.ndarray, np.ndarray, EndStrain | None]:
    """End positions, which may count from the first end, triads, and the strain where it is known."""
    x, T = _element_poses(model, at, rows)
    if at.since is None:
        return x, T, None
    ends = model.element_ends[rows]
    frame, offset = model.points.frame[ends], model.points.offset[ends]
    shift, turn = at.motion[0][frame], at.motion[1][frame]
    shift = shift + np.matvec(turn, offset)
    triad, length = model.element_triad[rows], model.beams.length[rows]
    local = np.zeros_like(shift)
    local[:, 1] = length[:, None] * triad[:, :, 0] + shift[:, 1] - shift[:, 0]
    if at.since.carries:
        outer = model.inside.beams.outer[rows]
        some = np.flatnonzero(outer >= 0)
        seen = (frame[some].ravel(), offset[some].reshape(-1, 3), np.repeat(outer[some], 2))
        near, turned = seen_from(at.since, *seen)
        shift[some], turn[some] = near.reshape(-1, 2, 3), turned.reshape(-1, 2, 3, 3)
        drawn = length[some, None] * triad[some, :, 0]
        R = at.poses.R[outer[some]]
        local[some, 1] = np.matvec(R, drawn + shift[some, 1] - shift[some, 0])
    return local, T, end_strain(length, triad, shift, turn)


def carried_levers(at: Placement, ends: np.ndarray, part: Within) -> list[Lever]:
    """Motion of the ends inside carried parts as the common carriers see them."""
    return levers(part.chain, at.poses.p, at.world[ends[part.rows]])


def tensioned_beams(beams: BeamProperties, loads: Loads) -> BeamProperties:
    """The elements with the tension that acts on them."""
    if loads.tension == 1.0:
        return beams
    return dataclasses.replace(beams, tension=loads.tension * beams.tension)
