"""Steps of a structure: the motion as a whole apart from what deforms it, and the size of both."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from middeck.structure.assembly.freedom import whole_motions
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import Configuration, move_carried, placed, rigid_columns
from middeck.structure.elements.motion_since_drawn import SinceDrawn
from middeck.structure.elements.rotations import cross, turn_of
from middeck.structure.rest.imbalance import article_size
from middeck.structure.rest.rest_criteria import UNMOVED


def move_whole(
    model: Model, config: Configuration, q: Float[np.ndarray, " coordinate"], mass: sp.csr_array
) -> Configuration:
    """Like `move_carried` to first order, but the rigid motion in ``q`` (by mass) strains nothing.

    Straight displacements stretch what turns: by 1e-3 of its length for a turn of 0.05, far more than a stiff
    member bears, so that a descent with them would have to creep.
    """
    tree, held = model.tree, model.held
    rigid, rest = split_rigid(model, config, q, mass)
    # What is pinned must stay in place to second order too.
    middle = config.x.mean(axis=0)
    centre = middle if held is None or not len(held.pinned) else config.x[held.pinned[0]]
    step = rest[: 6 * tree.roots].reshape(-1, 2, 3) @ (np.eye(3) + turn_of(rigid[3:])).T
    turned = turn_whole(config, rigid[3:], centre, rigid[:3] + cross(rigid[3:], centre - middle))
    return move_carried(tree, turned, np.concatenate([step.ravel(), rest[6 * tree.roots :]]))


def turn_whole(
    config: Configuration,
    rotation: Float[np.ndarray, "3"],
    centre: Float[np.ndarray, "3"],
    shift: Float[np.ndarray, "3"],
) -> Configuration:
    """The configuration turned by the ``rotation`` vector about ``centre``, then shifted, in W."""
    turn, since = turn_of(rotation), config.since_drawn
    if since is None:
        R = np.eye(3) + turn
        return Configuration(centre + shift + (config.x - centre) @ R.T, R @ config.R, config.angle)
    own = since.carrier < 0
    # Far from the origin a place rounds by more than what moved it.
    arm = since.drawn - centre + since.shift
    moved = since.shift + np.where(own[:, None], shift + arm @ turn.T, 0.0)
    turns = since.turn + np.where(own[:, None, None], turn + turn @ since.turn, 0.0)
    return placed(SinceDrawn(since.drawn, since.carrier, moved, turns), config.angle)


def split_rigid(
    model: Model, config: Configuration, q: Float[np.ndarray, " coordinate"], mass: sp.csr_array
) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, " coordinate"]]:
    """Translation, and rotation about the mean place, nearest to ``q`` by mass, and what is left; carried.

    Of a clamped article such as leave every node in place that is held along any way.
    """
    tree = model.tree
    T = rigid_columns(tree, config, config.x.mean(axis=0))
    whole = np.eye(6) if model.held is None else whole_motions(model.held, T)
    if config.since_drawn is not None:
        T[: 6 * tree.roots].reshape(tree.roots, 36)[config.since_drawn.carrier >= 0] = 0.0
    motions = T if model.held is None else T @ whole
    weighted = mass @ motions
    rigid, *_ = np.linalg.lstsq(motions.T @ weighted, weighted.T @ q, rcond=None)
    return whole @ rigid, q - motions @ rigid


def stride(model: Model, q: Float[np.ndarray, " coordinate"]) -> float:
    """The largest change that carried coordinates make: a turn [rad], or a shift over the article's size."""
    return float(np.abs(np.where(model.tree.turns, q, q / article_size(model))).max(initial=0.0))


def unmoved(model: Model, config: Configuration) -> float:
    """`stride` of a step that is rounding: `UNMOVED` of the motion since the drawn state."""
    since, drawn = config.since_drawn, model.rest
    shift = config.x - drawn.x if since is None else since.shift
    turn = config.R - drawn.R if since is None else since.turn
    joints = np.where(model.tree.slides, 1.0 / article_size(model), 1.0) * (config.angle - drawn.angle)
    most = max(np.abs(shift).max() / article_size(model), np.abs(turn).max(), np.abs(joints).max(initial=0.0))
    return UNMOVED * float(most)


def deformation(
    model: Model, config: Configuration, q: Float[np.ndarray, " coordinate"], mass: sp.csr_array
) -> float:
    """`stride` without the translation of the whole, which may be of any length."""
    rigid, rest = split_rigid(model, config, q, mass)
    return max(float(np.abs(rigid[3:]).max()), stride(model, rest))
