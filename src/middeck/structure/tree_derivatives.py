"""How the stiffness and mass of bodies, seen by modes, change as the nodes and joints that carry them move.

A node with its joints and their bodies is a tree of its own: one complex step moves the same coordinate of
every tree at once.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly import Loads, assemble, mass_matrix, no_loads
from middeck.structure.equilibrium import Equilibrium
from middeck.structure.frames import Configuration, joint_chain, move
from middeck.structure.mesh import lay_out
from middeck.structure.patches import STEP, derivative


def tree_gradients(
    rest: Equilibrium, shapes: np.ndarray, left: np.ndarray, right: np.ndarray, lam: np.ndarray
) -> Float[np.ndarray, "coordinate pair"]:
    """Gradient of phi_i'(K - lambda M) phi_j of all trees, without springs, in all coordinates."""
    structure, whole = rest.model.structure, rest.model.tree
    trees = lay_out(
        dataclasses.replace(structure, members=(), springs=(), attach_points=(), actuators=(), sensors=())
    )
    roots = trees.tree.roots
    here = np.concatenate([np.arange(6 * roots), 6 * whole.roots + np.arange(len(whole.parent))])
    carrier = [joint_chain(trees.tree, roots + j)[0] for j in range(len(whole.parent))]
    tree = np.concatenate([np.repeat(np.arange(roots), 6), np.array(carrier, dtype=int)])
    within = np.concatenate([np.tile(np.arange(6), roots), _rank(carrier)])
    none = no_loads()
    loads = Loads(rest.loads.gravity, none.anchor, none.attach_point, none.law, none.mass)
    config = Configuration(rest.config.x[:roots], rest.config.R[:roots], rest.config.angle)
    phi = shapes[here]
    out = np.zeros((whole.size, len(lam)))
    for direction in range(int(within.max()) + 1):
        moved = np.flatnonzero(within == direction)
        q = np.zeros(len(here), dtype=complex)
        q[moved] = STEP * 1j
        at = move(trees.tree, config, q)
        K, M = assemble(trees, at, loads).tangent, mass_matrix(trees, at)
        K.data, M.data = derivative(K.data), derivative(M.data)
        work = phi[:, left] * ((K @ phi)[:, right] - lam * (M @ phi)[:, right])
        total = np.zeros((roots, len(lam)))
        np.add.at(total, tree, work)
        out[here[moved]] = total[tree[moved]]
    return out


def _rank(carrier: list[int]) -> np.ndarray:
    """Of each joint among those of its tree, after the six coordinates of the root."""
    return np.array([6 + carrier[:j].count(c) for j, c in enumerate(carrier)], dtype=int)
