"""Pairs of modes in orbit and in a laboratory, for all comparisons of the two."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.linked import ties_to_ground
from middeck.structure.elements.frames import Configuration, frame_poses, points_in_world
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.gravity.tracking import Spectrum, TrackedShapes, align_repeated, spectrum_of, track
from middeck.structure.gravity.turned_modes import modes_at_rest, turn_modes
from middeck.structure.modes.solve import Modes
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.rest.motion_as_a_whole import fit_rotation, split_rotation

# What rigid-body modes have in common with flexible ones counts by this; of shapes that have as much in
# common, to this part, the nearer in frequency counts (within e^10).
LAST, NEARER, FAR = 1e-3, 1e-3, 10.0


class PairedModes(NamedTuple):
    """The lowest modes in orbit, and where each of them is in the laboratory.

    ``carried`` is the rest state in orbit moved to where the laboratory has the article, ``start`` its modes,
    those of one frequency (rigid-body modes above all) in the basis nearest to the laboratory's. ``at_rest``
    are the same, tilted too as the article rests (`modes_at_rest`): shapes in world axes have more in common
    with the article's there. ``end`` has one mode of the laboratory for each of them.
    """

    carried: Equilibrium
    start: Spectrum
    at_rest: Spectrum
    end: TrackedShapes


def pair_modes(orbit: Modes, lab: Modes, count: int) -> PairedModes:
    """The ``count`` lowest of ``orbit`` with all of ``lab``, one to one, by the largest cross-orthogonality.

    All modes of the laboratory are candidates, suspension modes too; rigid-body modes take flexible ones
    last, for what a clamp or a stiff mount holds has no others. The article is first turned to how it rests,
    which changes none of its own modes.
    """
    carried, heading = carry_along(orbit.equilibrium, lab.equilibrium)
    hung, (free, turn) = spectrum_of(lab), modes_at_rest(orbit, lab)
    free = align_repeated(free, hung.shapes)
    at_rest = Spectrum(free.lam[:count], free.shapes[:, :count], free.mass)
    start = turn_modes(at_rest, carried.model.tree.roots, heading @ turn.T)
    return PairedModes(carried, start, at_rest, track(at_rest, hung, _weight(orbit, lab, count)))


def _weight(orbit: Modes, lab: Modes, count: int) -> Float[np.ndarray, "orbit lab"]:
    rigid = np.array(orbit.kind[:count]) == "rigid"
    own = np.where(rigid, 1.0, orbit.omega[:count])
    apart = np.abs(np.log(np.maximum(lab.omega, np.exp(-FAR) * own[:, None]) / own[:, None]))
    near = 1.0 - NEARER * np.where(rigid[:, None], 1.0, np.minimum(apart / FAR, 1.0))
    return np.where(np.outer(rigid, np.array(lab.kind) == "flexible"), LAST, near)


def shares_of(start: Spectrum, lab: Modes) -> np.ndarray:
    """Share of each mode of ``start`` in each mode of the laboratory: rows orbit, columns lab."""
    weighted = start.mass @ lab.shapes
    size = np.einsum("im,im->m", lab.shapes, weighted)
    return (start.shapes.T @ weighted) ** 2 / size


def carry_along(orbit: Equilibrium, lab: Equilibrium) -> tuple[Equilibrium, Float[np.ndarray, "3 3"]]:
    """``orbit`` with its geometry moved to where ``lab`` has the article, and the rotation of that motion.

    It turns about the direction of gravity only, by the heading of the rigid body that fits best by mass (by
    all of its rotation where there is no gravity), and shifts until its attach points are on average where
    they are at rest: only devices depend on where the whole article is.

    A spring that starts unstretched lets an article sink by metres before it carries it, and a yaw may come
    with that. Neither is a deformation, and gravity does not see them; cables left behind at the drawn height
    would.
    """
    if not len(lab.loads.attach_point):
        return orbit, np.eye(3)
    R = _turn(orbit, lab)
    turned = Configuration(orbit.config.x @ R.T, R @ orbit.config.R, orbit.config.angle)
    shift = (_feet(lab, lab.config) - _feet(lab, turned)).mean(axis=0)
    moved = Configuration(turned.x + shift, turned.R, turned.angle)
    return dataclasses.replace(orbit, config=moved), R


def _feet(lab: Equilibrium, config: Configuration) -> Float[np.ndarray, "device 3"]:
    world = points_in_world(lab.model.points, frame_poses(lab.model.tree, config))
    return world[lab.loads.attach_point]


def _turn(orbit: Equilibrium, lab: Equilibrium) -> Float[np.ndarray, "3 3"]:
    if ties_to_ground(lab.model):  # its equations hold motions along and about W
        return np.eye(3)
    fit = fit_rotation(orbit.model, orbit.config, lab.config)
    size = float(np.linalg.norm(lab.loads.gravity))
    if size == 0.0:
        return fit
    up = -lab.loads.gravity / size
    return rotation_exp(split_rotation(fit, up)[1] * up)
