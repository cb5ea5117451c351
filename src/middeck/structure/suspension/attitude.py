"""How an article hangs: its tilt, what each device carries, and where its weight lies under what holds it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import Configuration, points_in_world, rigid_columns
from middeck.structure.elements.rotations import rotation_exp, rotation_log
from middeck.structure.modes.motions.rigid_motions import centre_of_mass
from middeck.structure.rest.equilibrium import Equilibrium, node_rotations
from middeck.values import record

# Of the largest extent of the attach points: what is thinner is a line or a point to an engineer.
FLAT = 1e-6
FIT_ITERATIONS = 50
FITTED = 1e-14
SPANS = ("point", "line", "plane", "space")


@record(kw_only=True)
class Attitude:
    """How an article hangs. Rotation vectors [rad] and positions [m] are in W.

    A rotation is split into a tilt, about a level axis, and then a turn about the vertical: no tilt, level.
    A tilt about x is thus one about the drawn article's own x, whatever way it then faces.

    Attributes:
        tilt, heading: Of the rigid body that fits the hung article best by mass: tilt [rad], and turn about
            the vertical.
        node, node_tilt: Name and tilt of every node.
        node_bending: Angle [rad] between the verticals of each node and of the rigid body: the article's own
            bending.
        device, tension: Name and pull [N] of every device and spring.
        hangs_from: What the attach points in use, and clamped nodes, span as drawn: a "point", a "line", a
            "plane" or "space".
        lies_off: From that point, line or plane to the centre of mass, normal to it. A rigid article on a
            point or a level line comes to rest with this vector downwards: what of it is not downwards now,
            tilts it.
    """

    tilt: Float[np.ndarray, "3"]
    heading: float
    node: tuple[str, ...]
    node_tilt: Float[np.ndarray, "node 3"]
    node_bending: Float[np.ndarray, " node"]
    device: tuple[str, ...]
    tension: Float[np.ndarray, " device"]
    hangs_from: str
    lies_off: Float[np.ndarray, "3"]


def estimate_attitude(equilibrium: Equilibrium) -> Attitude:
    """How the article hangs in ``equilibrium``; raises `ConfigError` where there is no gravity."""
    gravity = equilibrium.environment.gravity
    if not np.any(gravity):
        raise ConfigError(
            "level is undefined without gravity",
            where=f"environment {equilibrium.environment.title!r}",
            hint="give it constants.gravity, or take another environment",
        )
    up = -gravity / np.linalg.norm(gravity)
    model = equilibrium.model
    whole, turned = fit_rotation(model, model.rest, equilibrium.config), node_rotations(equilibrium)
    tilt, heading = split_rotation(whole, up)
    nodes = [rotation_exp(v) for v in turned.values()]
    tilts = np.array([split_rotation(R, up)[0] for R in nodes])
    T = rigid_columns(model.tree, model.rest, np.zeros(3))
    span, lies_off = _span(equilibrium, centre_of_mass(T, mass_matrix(model, model.rest)))
    return Attitude(
        tilt=tilt,
        heading=heading,
        node=tuple(turned),
        node_tilt=tilts,
        node_bending=np.array([_angle(up @ R, up @ whole) for R in nodes]),
        device=equilibrium.devices,
        tension=equilibrium.tension,
        hangs_from=span,
        lies_off=lies_off,
    )


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


def _angle(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def fit_rotation(model: Model, start: Configuration, end: Configuration) -> Float[np.ndarray, "3 3"]:
    """Rotation of the rigid body at ``start`` that fits ``end`` best, errors weighed by mass (Gauss-Newton).

    The error of a frame is its displacement and rotation vector from where the rigid body has it. From the
    mean of their turns: from none, those to both sides of 180 deg would cancel out.
    """
    M = mass_matrix(model, start)
    T = rigid_columns(model.tree, start, np.zeros(3))
    rigid = T.T @ (M @ T)
    U, _, Vt = np.linalg.svd(np.einsum("fij,fkj->ik", end.R, start.R))
    fit, p = U * [1.0, 1.0, np.linalg.det(U @ Vt)] @ Vt, np.zeros(3)
    for _ in range(FIT_ITERATIONS):
        # In the axes of the rigid body, so that the mass is that of the start.
        x = (end.x - p) @ fit - start.x
        turn = np.array([rotation_log(fit.T @ b @ a.T) for a, b in zip(start.R, end.R, strict=True)])
        error = np.zeros(model.tree.size)
        error[: 6 * model.tree.roots] = np.hstack([x, turn]).ravel()
        # Masses in one line have no inertia about it, and do not say how it is turned: the mean does.
        step = np.linalg.lstsq(rigid, T.T @ (M @ error), rcond=FLAT**2)[0]
        p = p + fit @ step[:3]
        fit = fit @ rotation_exp(step[3:])
        if np.abs(step[3:]).max() < FITTED:
            break
    return fit


def _span(equilibrium: Equilibrium, centre: np.ndarray) -> tuple[str, Float[np.ndarray, "3"]]:
    """The span of what holds the article, and the part of the way from it to ``centre`` normal to it."""
    model, loads = equilibrium.model, equilibrium.loads
    poses = model.drawn
    held = np.union1d(loads.attach_point, loads.ground.point)
    clamped = [model.frames.index(clamp.node) for clamp in equilibrium.environment.clamps]
    feet = np.concatenate([points_in_world(model.points, poses)[held], poses.p[clamped]])
    middle = feet.mean(axis=0)
    _, size, directions = np.linalg.svd(feet - middle, full_matrices=False)
    rank = int(np.sum(size > FLAT * max(float(size.max(initial=0.0)), np.finfo(float).tiny)))
    along = directions[:rank]
    off = centre - middle
    return SPANS[rank], off - along.T @ (along @ off)
