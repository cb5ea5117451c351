"""The undeformed article in the place of the one at rest, moved with it as one body.

A spring that starts unstretched lets an article sink by metres before it carries it, and a yaw may come with
that. Neither is a deformation, and gravity does not see them; cables left behind at the drawn height would.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.linked import ties_to_ground
from middeck.structure.elements.frames import Configuration, frame_poses, points_in_world
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.rest.motion_as_a_whole import fit_rotation, split_rotation


def carry_along(orbit: Equilibrium, lab: Equilibrium) -> tuple[Equilibrium, Float[np.ndarray, "3 3"]]:
    """``orbit`` with its geometry moved to where ``lab`` has the article, and the rotation of that motion.

    It turns about the direction of gravity only, by the heading of the rigid body that fits best by mass (by
    all of its rotation where there is no gravity), and shifts until its attach points are on average where
    they are at rest: only devices depend on where the whole article is.
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
