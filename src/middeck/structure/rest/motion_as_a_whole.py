"""The motion of an article as a whole: the rigid body that fits it best, and a place where nothing fixes one.

An article that floats rests anywhere, and one that hangs from one point faces any way. It is taken where it
is nearest to its drawing, so that the axes of a test mean the same whatever way Newton's method took.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.linked import ties_to_ground
from middeck.structure.assembly.mass import carried_mass, mass_matrix
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import Configuration, rigid_columns
from middeck.structure.elements.rotations import rotation_exp, rotation_log
from middeck.structure.rest.damped_descent import descend
from middeck.structure.rest.imbalance import article_size, imbalance_scale
from middeck.structure.rest.rest_criteria import NewtonResult
from middeck.structure.rest.rigid_and_deforming_steps import turn_whole

# Extent of the attach points, over the largest, below which they form a line or a point.
FLAT = 1e-6
# Distance of anchors from a vertical line, over the article's size, that is rounding.
IN_LINE = 1e-9
# Steps that take away what a turn rounds, 1e-8 of the weight far from the origin. They turn it by 1e-7 in
# their turn, and what turning back by that rounds is nothing.
POLISH, POLISHED = 4, 2
FIT_ITERATIONS = 50
FITTED = 1e-14


def face_as_drawn(model: Model, loads: Loads, settled: NewtonResult) -> NewtonResult:
    """The same rest state, moved as near to the drawing as motion without resistance allows.

    Of what floats that is any motion, of what hangs from one vertical line a turn about it.
    """
    held = model.held is not None or ties_to_ground(model) or len(loads.ground.point) or np.any(loads.push)
    still = np.array_equal(settled.config.x, model.rest.x) and np.array_equal(settled.config.R, model.rest.R)
    if held or still or not settled.residual < settled.enough:
        return settled
    at, scale = settled, imbalance_scale(model, loads)
    for _ in range(POLISHED):
        config = _faced(model, loads, at.config)
        if config is None:
            return settled
        mass = carried_mass(model, config, loads)
        config, assembly, steps, _ = descend(model, config, loads, mass, scale, settled.enough, POLISH)
        at = dataclasses.replace(at, config=config, assembly=assembly, residual=steps[-1][0])
        if len(steps) == 1:
            break
    # Beside a support so stiff that its rounding shows, the state as it was found is the better one.
    return at if at.residual < settled.enough else settled


def _faced(model: Model, loads: Loads, config: Configuration) -> Configuration | None:
    """Turned to the drawing, and moved to it where nothing holds it; None where it is held."""
    gravity = float(np.linalg.norm(loads.gravity))
    if gravity == 0.0 and not len(loads.anchor):
        R, centre, shift = fit_rigid(model, model.rest, config)
        return turn_whole(config, rotation_log(R.T), centre + shift, -shift)
    if gravity > 0.0:
        up = -loads.gravity / gravity
        across = np.linalg.norm(np.cross(loads.anchor - loads.anchor[0], up), axis=1)
        if across.max() > IN_LINE * article_size(model):
            return None
        _, heading = split_rotation(fit_rotation(model, model.rest, config), up)
        return turn_whole(config, -heading * up, loads.anchor[0], np.zeros(3))
    return None


def split_rotation(
    R: Float[np.ndarray, "3 3"], up: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3"], float]:
    """Tilt, a rotation vector normal to ``up``, and the heading after it: R = exp(heading up) exp(tilt).

    >>> up = np.array([0.0, 1.0, 0.0])
    >>> tilt, heading = split_rotation(rotation_exp(0.3 * up) @ rotation_exp(np.array([0.1, 0, 0])), up)
    >>> (tilt.round(12) + 0.0).tolist(), round(heading, 12)
    ([0.1, 0.0, 0.0], 0.3)
    """
    across = np.cross(up @ R, up)
    sine = float(np.linalg.norm(across))
    tilt = across * (np.arctan2(sine, up @ R @ up) / sine) if sine > 0.0 else across
    return tilt, float(rotation_log(R @ rotation_exp(tilt).T) @ up)


def fit_rotation(model: Model, start: Configuration, end: Configuration) -> Float[np.ndarray, "3 3"]:
    """Rotation of the rigid body at ``start`` that fits ``end`` best, by mass (`fit_rigid`)."""
    return fit_rigid(model, start, end)[0]


def fit_rigid(
    model: Model, start: Configuration, end: Configuration
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """R, c and d, so that R (x - c) + c + d of the x at ``start`` fit ``end`` best, errors weighed by mass.

    The error of a frame is its displacement and rotation vector from where the rigid body has it; by
    Gauss-Newton from the mean of their turns: from none, those to both sides of 180 deg would cancel out.
    c is amid the article, however far from the origin that is drawn.
    """
    M, centre = start.once("whole mass", model, lambda: mass_matrix(model, start)), start.x.mean(axis=0)
    T = rigid_columns(model.tree, start, centre)
    T[:, 3:] /= (size := article_size(model))
    rigid, begun, there = T.T @ (M @ T), start.x - centre, end.x - centre
    U, _, Vt = np.linalg.svd(np.einsum("fij,fkj->ik", end.R, start.R))
    fit, shift = U * [1.0, 1.0, np.linalg.det(U @ Vt)] @ Vt, np.zeros(3)
    for _ in range(FIT_ITERATIONS):
        # In the axes of the rigid body, so that the mass is that of the start.
        x = (there - shift) @ fit - begun
        turn = np.array([rotation_log(fit.T @ b @ a.T) for a, b in zip(start.R, end.R, strict=True)])
        error = np.zeros(model.tree.size)
        error[: 6 * model.tree.roots] = np.hstack([x, turn]).ravel()
        # Masses in one line have no inertia about it, and do not say how it is turned: the mean does.
        step = np.linalg.lstsq(rigid, T.T @ (M @ error), rcond=FLAT**2)[0]
        shift = shift + fit @ step[:3]
        fit = fit @ rotation_exp(step[3:] / size)
        if np.abs(step[3:]).max() < FITTED * size:
            break
    return fit, centre, shift
