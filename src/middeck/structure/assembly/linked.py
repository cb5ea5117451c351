"""Links at a configuration: free coordinates, their part of the potential, and how they stay closed.

At every configuration some coordinates follow the others (`redundant_constraints`), and every step ends with
the links closed by those. So all that descends, balances or vibrates sees independent coordinates: the
gradient with multipliers that leave none at the dependent ones, and the tangent with the second order of the
links times these, which is the exact second derivative of the energy in the independent coordinates.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Inexact

from middeck.errors import ConfigError, EquilibriumError
from middeck.structure.assembly.freedom import Freedom
from middeck.structure.assembly.link_rows import GROUND, LinkState, link_state
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.places import (
    Placement,
    carried_turning,
    moved_since,
    poses_at,
    root_levers,
    symmetric,
    transport,
)
from middeck.structure.assembly.redundant_constraints import NEARLY, Closing, close_rows
from middeck.structure.elements.frames import Configuration, move_carried
from middeck.structure.elements.motion_since_drawn import summed, uncarried
from middeck.structure.model.article import JointState
from middeck.structure.model.connectivity import some_names

# Part of the arm of a row by which a closed one may be open, and what is rounding of it.
OPEN, CLOSED = 1e-9, 1e-15
MOST_ROUNDS = 30


def static_coordinates(model: Model) -> Bool[np.ndarray, " coordinate"]:
    """Free coordinates in statics: roots, sprung joints and modal coordinates.

    Of a node that is held along axes of its clamp they are in those axes, see `static_freedom`.
    """
    return _moving(model, (JointState.SPRUNG, JointState.INTERNAL))


def dynamic_coordinates(model: Model) -> Bool[np.ndarray, " coordinate"]:
    """Free coordinates in dynamics: roots, free and sprung joints, modal coordinates."""
    return _moving(model, (JointState.FREE, JointState.SPRUNG, JointState.INTERNAL))


def _moving(model: Model, states: tuple[JointState, ...]) -> np.ndarray:
    joints = [joint.state in states for joint in model.structure.joints]
    free = np.concatenate([np.ones(6 * model.tree.roots, dtype=bool), np.array(joints, dtype=bool)])
    return free if model.held is None else free & ~model.held.fixed


def static_freedom(model: Model, config: Configuration, *, in_world: bool = False) -> Freedom:
    """Free coordinates in statics (`static_coordinates`) at ``config``, in carried coordinates or W."""
    return _freedom(model, static_coordinates(model), config, in_world)


def dynamic_freedom(model: Model, config: Configuration, *, in_world: bool = False) -> Freedom:
    """Free coordinates in dynamics (`dynamic_coordinates`), otherwise as `static_freedom`."""
    return _freedom(model, dynamic_coordinates(model), config, in_world)


def _freedom(model: Model, moving: np.ndarray, config: Configuration, in_world: bool) -> Freedom:
    axes = None if model.held is None else model.held.axes
    if model.links is None:
        return Freedom(moving, axes)
    close = _closing(model, links_at(model, config), config, moving, in_world=in_world)
    return Freedom(close.independent, axes, close.basis, moving)


def check_links(model: Model) -> None:
    """Raise `ConfigError` for a link that nearly repeats others as drawn: rounding would decide."""
    if model.links is None:
        return
    close = _closing(model, links_at(model, model.rest), model.rest, dynamic_coordinates(model))
    if len(close.nearly):
        row = int(close.nearly[0])
        raise ConfigError(
            f"{model.links.label[row]} nearly repeats other links or clamps: less than {NEARLY:g} of it is "
            "independent, so that rounding decides whether it holds anything",
            where=f"link {model.structure.links[int(model.links.link[row])].name!r}",
            hint="give places and axes with all their digits, or release what the others hold already",
        )


def ties_to_ground(model: Model) -> bool:
    """Whether an equation ties motions in W, which do not turn with the article."""
    return model.links is not None and bool(np.any(model.links.ends[:, 0] == GROUND))


def link_warnings(model: Model, config: Configuration) -> tuple[str, ...]:
    """A sentence for each row of links that repeats others at ``config``."""
    if model.links is None:
        return ()
    label = model.links.label
    close = _closing(model, links_at(model, config), config, dynamic_coordinates(model))
    return tuple(
        f"{label[row]} repeats "
        + (some_names([label[other] for other in others]) if others else "what clamps and locks hold already")
        + ": motions are as without it, and how the two share a load is not determined"
        for row, others in close.spare
    )


def links_at(model: Model, config: Configuration) -> LinkState:
    """The constraints of the links at ``config``; only for a model that has some."""
    at = poses_at(model, config)
    assert model.links is not None
    return _state(model, at, model.pose_map.jacobian(at.poses), config)


def _state(model: Model, at: Placement, J: sp.csr_array, config: Configuration) -> LinkState:
    assert model.links is not None
    ends = np.maximum(model.links.ends, 0).ravel()
    turned = np.zeros(model.tree.size, np.result_type(config.angle))
    turned[6 * model.tree.roots :] = config.angle - model.rest.angle
    return link_state(model.links, J, at.world, moved_since(model, at, ends), turned)


def _closing(
    model: Model, state: LinkState, config: Configuration, moving: np.ndarray, *, in_world: bool = False
) -> Closing:
    rows, since = state.jacobian, None if in_world else config.since_drawn
    if since is not None and since.carries:
        rows = rows @ transport(config, model.tree)
    axes = None if model.held is None else model.held.axes
    rows = rows if axes is None else rows @ axes
    length = float(np.linalg.norm(np.ptp(model.rest.x, axis=0)))
    carried = ~uncarried(since, model.tree.size)
    close = close_rows(sp.csr_array(rows), moving, model.tree.turns, carried, length)
    return dataclasses.replace(close, axes=axes)


def static_closing(model: Model, config: Configuration) -> tuple[LinkState, Closing]:
    """The links at ``config`` and the dependent coordinates in statics."""
    state = links_at(model, config)
    return state, _closing(model, state, config, static_coordinates(model))


def close_links(
    model: Model, config: Configuration, moving: Bool[np.ndarray, " coordinate"]
) -> tuple[LinkState, Closing]:
    """The links at ``config`` and those of the ``moving`` coordinates that depend on others, in W."""
    state = links_at(model, config)
    return state, _closing(model, state, config, moving, in_world=True)


def link_part(
    model: Model, config: Configuration, gradient: Float[np.ndarray, " coordinate"], *, in_world: bool
) -> tuple[Float[np.ndarray, " coordinate"], sp.csr_array]:
    """Contribution of links to a ``gradient`` and its tangent, in carried coordinates or those of W.

    The multipliers are those of statics: what free joints hold there is theirs.
    """
    at = poses_at(model, config)
    J = model.pose_map.jacobian(at.poses)
    state = _state(model, at, J, config)
    T = transport(config, model.tree)
    multiplier = multipliers(model, config, state, T.T @ gradient if in_world else gradient)
    pull = state.jacobian.T @ multiplier
    bent = _bent(model, at, J, state, multiplier)
    since = config.since_drawn
    if in_world or since is None or not since.carries:
        return pull, bent
    bent = T.T @ bent @ T + summed(carried_turning(root_levers(config), pull), model.tree.size)
    return T.T @ pull, symmetric(sp.csr_array(bent))


def bent_links(
    model: Model, config: Configuration, multiplier: Inexact[np.ndarray, " row"]
) -> tuple[LinkState, sp.csr_array]:
    """The links at ``config``, and their second derivatives times multipliers, in W; analytic."""
    assert model.links is not None
    at = poses_at(model, config)
    J = model.pose_map.jacobian(at.poses)
    state = _state(model, at, J, config)
    return state, _bent(model, at, J, state, multiplier)


def _bent(
    model: Model, at: Placement, J: sp.csr_array, state: LinkState, multiplier: np.ndarray
) -> sp.csr_array:
    turning = model.pose_map.second_order(at.poses, state.load(multiplier))
    return symmetric(
        sp.csr_array(state.bent(multiplier, J) + model.pattern.matrix(J.data, {"turning": turning}))
    )


def multipliers(
    model: Model, config: Configuration, state: LinkState, gradient: Float[np.ndarray, " coordinate"]
) -> Float[np.ndarray, " row"]:
    """Multipliers of the rows of links that balance a ``gradient`` in carried coordinates."""
    return _closing(model, state, config, static_coordinates(model)).multipliers(gradient)


def followed(
    model: Model, config: Configuration, moved: Float[np.ndarray, " coordinate"]
) -> Float[np.ndarray, " coordinate"]:
    """First-order displacements of the dependent coordinates, as carried coordinates have ``moved``."""
    if model.links is None:
        return np.zeros_like(moved)
    state, close = static_closing(model, config)
    return close.follow(state.jacobian @ (transport(config, model.tree) @ moved))


def torn(model: Model, config: Configuration, moved: Float[np.ndarray, " coordinate"]) -> EquilibriumError:
    """The error of links that cannot close: after carried coordinates have ``moved`` from where they do."""
    state, close = static_closing(model, config)
    change = state.jacobian @ (transport(config, model.tree) @ (moved + followed(model, config, moved)))
    worst = int(np.argmax(np.abs(change / close.size)))
    return EquilibriumError(
        f"the links cannot close: what else holds or moves the frames contradicts {state.rows.label[worst]}",
        where=f"link {model.structure.links[int(state.rows.link[worst])].name!r}",
        hint="release a direction of the link or of a clamp, or prescribe displacements that fit",
    )


def closed(model: Model, config: Configuration) -> Configuration | None:
    """``config`` with its links closed by their dependent coordinates; None where they do not close.

    Newton's method from nearby; it ends where rounding does, or a round does no good.
    """
    if model.links is None:
        return config
    before = np.inf
    best = config
    for _ in range(MOST_ROUNDS):
        state, close = static_closing(model, config)
        left = float(np.abs(state.value / close.size).max(initial=0.0))
        if not left < before:
            break
        best, before = config, left
        if left <= CLOSED:
            break
        config = move_carried(model.tree, config, close.follow(state.value))
    return best if before < OPEN else None
