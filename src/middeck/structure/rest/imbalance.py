"""Imbalance of a state of rest: its residual at each coordinate, over the weight or the largest load."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.energy import Assembly, assemble_carried
from middeck.structure.assembly.environment_loads import Loads, no_loads
from middeck.structure.assembly.freedom import Freedom
from middeck.structure.assembly.mesh import Model

STANDARD_GRAVITY = 9.80665


def imbalance_scale(model: Model, loads: Loads) -> Float[np.ndarray, " coordinate"]:
    """Scale of the residual at each coordinate: the weight, for a moment times a length.

    The weight is that on the ground where there is none, or of an article without mass the force by which
    prescribed displacements strain it as drawn. The length is half the article's size, or a metre if
    that is less: strict for large articles and for small ones.
    """
    weight = imbalance_weight(model, loads)
    return np.where(model.tree.turns, weight * min(article_size(model), 1.0), weight)


def imbalance_weight(model: Model, loads: Loads) -> float:
    """The weight or the largest load [N], whichever is more; the weight on the ground if there is none."""
    mass, applied = model.structure.mass, np.linalg.norm(loads.push.reshape(-1, 2, 3), axis=2)
    force, moment = applied.max(axis=0, initial=0.0)
    weight = mass * float(np.linalg.norm(loads.gravity))
    most = max(weight, float(force), float(moment) / min(article_size(model), 1.0))
    return most or mass * STANDARD_GRAVITY or _displaced_force(model) or float(np.finfo(float).tiny)


def _displaced_force(model: Model) -> float:
    """Largest force [N] of prescribed displacements on the article as drawn, all other nodes held there."""
    if model.held is None or not np.any(model.held.moved):
        return 0.0
    pushed = np.zeros(model.tree.size)
    pushed[: model.held.moved.size] = model.held.moved.ravel()
    at = assemble_carried(model, model.rest, no_loads())
    force, moment = np.abs(at.tangent @ pushed)[: model.held.moved.size].reshape(-1, 2, 3).max(axis=(0, 2))
    return float(max(force, moment / min(article_size(model), 1.0)))


def article_size(model: Model) -> float:
    """Half the extent of the article as drawn [m], at least its radius of gyration; a metre for a point."""
    return model.rest.once("size", model, lambda: _article_size(model))


def _article_size(model: Model) -> float:
    x = model.rest.x
    inertia = np.trace(model.body_inertia, axis1=1, axis2=2).sum()
    gyration = np.sqrt(0.5 * inertia / model.structure.mass) if model.structure.mass > 0.0 else 0.0
    arms = np.linalg.norm(model.points.offset, axis=1).max(initial=0.0)
    size = max(0.5 * float(np.linalg.norm(np.ptp(x, axis=0))), float(arms), float(gyration))
    return size or 1.0


def imbalance(at: Assembly, free: Freedom, scale: np.ndarray) -> float:
    """Largest residual force or moment at the coordinates that move in statics, over its ``scale``."""
    return float(np.abs(free.part(at.gradient) / scale[free.active]).max(initial=0.0))
