"""The undeformed article where the one at rest hangs: moved with it, and deformed not at all.

A spring that starts unstretched lets an article sink by metres before it carries it, and a yaw may come with
that. Neither is a deformation, and gravity does not see them; cables left behind at the drawn height would.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.linked import ties_to_ground
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.elements.frames import Configuration, frame_poses, points_in_world, rigid_columns
from middeck.structure.elements.rotations import rotation_exp, rotation_log
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.suspension.attitude import split_rotation

FIT_ITERATIONS = 50
FITTED = 1e-14


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


def turn_shapes(
    shapes: Float[np.ndarray, "coordinate mode"], roots: int, R: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "coordinate mode"]:
    """Shapes of the article turned by ``R``: displacements and rotation vectors turn, joint angles do not."""
    turned = shapes.copy()
    vectors = shapes[: 6 * roots].reshape(2 * roots, 3, -1)
    turned[: 6 * roots] = np.einsum("ij,njm->nim", R, vectors).reshape(6 * roots, -1)
    return turned


def _feet(lab: Equilibrium, config: Configuration) -> Float[np.ndarray, "device 3"]:
    world = points_in_world(lab.model.points, frame_poses(lab.model.tree, config))
    return world[lab.loads.attach_point]


def _turn(orbit: Equilibrium, lab: Equilibrium) -> Float[np.ndarray, "3 3"]:
    if ties_to_ground(lab.model):  # its equations hold motions along and about W
        return np.eye(3)
    fit = _fit_rotation(orbit, lab.config)
    size = float(np.linalg.norm(lab.loads.gravity))
    if size == 0.0:
        return fit
    up = -lab.loads.gravity / size
    return rotation_exp(split_rotation(fit, up)[1] * up)


def _fit_rotation(start: Equilibrium, end: Configuration) -> Float[np.ndarray, "3 3"]:
    """Rotation of the best-fit rigid body from ``start`` to ``end``, weighted by mass (Gauss-Newton)."""
    tree, x = start.model.tree, start.config.x
    T = rigid_columns(tree, start.config, np.zeros(3))
    weighted = mass_matrix(start.model, start.config) @ T
    fit, p = np.eye(3), np.zeros(3)
    for _ in range(FIT_ITERATIONS):
        # In the axes of the rigid body, so that the mass is that of the start.
        turn = [rotation_log(fit.T @ b @ a.T) for a, b in zip(start.config.R, end.R, strict=True)]
        error = np.zeros(tree.size)
        error[: 6 * tree.roots] = np.hstack([(end.x - p) @ fit - x, np.array(turn)]).ravel()
        # A body without inertia about some axis may turn about it as it likes.
        step, *_ = np.linalg.lstsq(T.T @ weighted, weighted.T @ error, rcond=None)
        p = p + fit @ step[:3]
        fit = fit @ rotation_exp(step[3:])
        if np.abs(step[3:]).max() < FITTED:
            break
    return fit
