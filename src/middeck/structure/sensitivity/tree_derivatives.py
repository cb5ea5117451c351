"""Change of the stiffness and mass of all but members, seen by modes, as nodes and joints move.

A node with its joints, bodies and devices is a tree of its own: one complex step moves the same coordinate of
every tree at once, and all steps are assembled side by side. Trees that a spring of the article ties, or that
are tied to the same third one, take turns.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import Model, lay_out
from middeck.structure.elements.frames import Configuration, move
from middeck.structure.elements.trees import joint_chain
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.sensitivity.models_side_by_side import merge_configurations, merge_loads, merge_models
from middeck.structure.sensitivity.patches import STEP, derivative


def tree_gradients(
    rest: Equilibrium, shapes: np.ndarray, left: np.ndarray, right: np.ndarray, lam: np.ndarray
) -> Float[np.ndarray, "coordinate pair"]:
    """Gradient of phi_i'(K - lambda M) phi_j of all trees and springs, as `element_gradients`."""
    structure, whole = rest.model.structure, rest.model.tree
    trees = lay_out(
        dataclasses.replace(structure, members=(), actuators=(), sensors=(), links=(), components=())
    )
    roots = trees.tree.roots
    here = np.concatenate([np.arange(6 * roots), 6 * whole.roots + np.arange(len(whole.parent))])
    carrier = [joint_chain(trees.tree, roots + j)[0] for j in range(len(whole.parent))]
    tree = np.concatenate([np.repeat(np.arange(roots), 6), np.array(carrier, dtype=int)])
    within = np.concatenate([np.tile(np.arange(6), roots), _rank(carrier)])
    neighbours = _neighbours(trees)
    turn = _take_turns(neighbours)
    config = Configuration(rest.config.x[:roots], rest.config.R[:roots], rest.config.angle)
    moving = [
        (within == d) & (turn[tree] == t) for t in range(turn.max() + 1) for d in range(within.max() + 1)
    ]
    steps = [move(trees.tree, config, STEP * 1j * m) for m in moving]
    raft, at = merge_models([trees] * len(steps)), merge_configurations(steps)
    loads = merge_loads(raft, [_loads(rest, trees)] * len(steps))
    own = np.concatenate(raft.coordinates)
    phi = np.zeros((len(own), shapes.shape[1]))
    phi[own] = np.tile(shapes[here], (len(steps), 1))
    K, M = assemble(raft.model, at, loads).tangent, mass_matrix(raft.model, at, loads)
    K.data, M.data = derivative(K.data), derivative(M.data)
    work = phi[:, left] * ((K @ phi)[:, right] - lam * (M @ phi)[:, right])
    out = np.zeros((whole.size, len(lam)))
    for which, coordinates in zip(moving, raft.coordinates, strict=True):
        total = np.zeros((roots, len(lam)))
        np.add.at(total, _moved_near(neighbours, tree[which])[tree], work[coordinates])
        out[here[which]] = total[tree[which]]
    return out


def _rank(carrier: list[int]) -> np.ndarray:
    """Number of each joint among those of its tree, after the six coordinates of the root."""
    return np.array([6 + carrier[:j].count(c) for j, c in enumerate(carrier)], dtype=int)


def _loads(rest: Equilibrium, trees: Model) -> Loads:
    """The same loads at the attach points of the trees."""
    number = {int(pose): i for i, pose in enumerate(rest.model.attach_point)}
    points = [trees.attach_point[number[int(pose)]] for pose in rest.loads.attach_point]
    ground = [trees.attach_point[number[int(pose)]] for pose in rest.loads.ground.point]
    return dataclasses.replace(
        rest.loads,
        attach_point=np.array(points, dtype=int),
        ground=dataclasses.replace(rest.loads.ground, point=np.array(ground, dtype=int)),
    )


def _neighbours(trees: Model) -> list[set[int]]:
    """The trees that a spring or a bushing ties to each tree."""
    out: list[set[int]] = [set() for _ in range(trees.tree.roots)]
    for ends in trees.points.frame[np.concatenate([trees.spring_ends, trees.bushing_ends])]:
        a, b = (joint_chain(trees.tree, int(frame))[0] for frame in ends)
        out[a].add(b)
        out[b].add(a)
    return out


def _take_turns(neighbours: list[set[int]]) -> np.ndarray:
    """A number for each tree, another one than that of its neighbours and of theirs."""
    turn = np.full(len(neighbours), -1)
    for tree, near in enumerate(neighbours):
        taken = {int(turn[t]) for n in near for t in (n, *neighbours[n]) if t != tree}
        turn[tree] = next(k for k in range(len(neighbours)) if k not in taken)
    return turn


def _moved_near(neighbours: list[set[int]], moved: np.ndarray) -> np.ndarray:
    """The tree that moves among each tree and its neighbours; itself where none does."""
    near = np.arange(len(neighbours))
    for tree in moved:
        near[list(neighbours[tree])] = tree
    return near
