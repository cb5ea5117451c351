"""Attitude of a hanging article: tilt, load of each device, and the centre of mass under its supports."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.elements.frames import points_in_world, rigid_columns
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.modes.motions.rigid_motions import centre_of_mass
from middeck.structure.rest.equilibrium import Equilibrium, node_rotations
from middeck.structure.rest.motion_as_a_whole import FLAT, fit_rotation, split_rotation
from middeck.values import record

SPANS = ("point", "line", "plane", "space")


@record(kw_only=True)
class Attitude:
    """Attitude of a hanging article. Rotation vectors [rad] and positions [m] are in W.

    A rotation is split into a tilt, about a level axis, and then a turn about the vertical: no tilt, level.
    A tilt about x is thus one about the drawn article's own x, whatever way it then faces.

    Attributes:
        tilt, heading: Tilt [rad] of the rigid body with the best fit by mass, and its turn about the
            vertical.
        node, node_tilt: Name and tilt of every node.
        node_bending: Angle [rad] between the verticals of each node and of the rigid body: the article's own
            bending.
        device, tension: Name and pull [N] of every device and spring.
        hangs_from: What the attach points in use, and clamped nodes, span as drawn: a "point", a "line", a
            "plane" or "space".
        lies_off: Vector from that point, line or plane to the centre of mass, normal to it. A rigid article
            on a point or a level line comes to rest with this vector downwards: a level component of it
            tilts the article.
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
    """Attitude of the article in ``equilibrium``; raises `ConfigError` where there is no gravity."""
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
    nodes = rotation_exp(np.array([*turned.values()]))
    ups, tilts = up @ nodes, np.array([split_rotation(R, up)[0] for R in nodes])
    T = rigid_columns(model.tree, model.rest, np.zeros(3))
    span, lies_off = _span(equilibrium, centre_of_mass(T, mass_matrix(model, model.rest)))
    return Attitude(
        tilt=tilt,
        heading=heading,
        node=tuple(turned),
        node_tilt=tilts,
        node_bending=np.arctan2(np.linalg.norm(np.cross(ups, up @ whole), axis=1), ups @ (up @ whole)),
        device=equilibrium.devices,
        tension=equilibrium.tension,
        hangs_from=span,
        lies_off=lies_off,
    )


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
