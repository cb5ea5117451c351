"""Share of a mode's omega^2 that may be rounding, or due to the residual of Newton's method."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from middeck.structure.assembly.component_states import place_components
from middeck.structure.assembly.energy import Assembly, geometric_tangent, is_unstrained
from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.freedom import Freedom
from middeck.structure.assembly.linked import static_freedom
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.places import poses_at, transport
from middeck.structure.assembly.strain import strain_energies
from middeck.structure.eigenproblem.eigen import ROUNDING, Eigenpairs
from middeck.structure.elements.frames import Configuration

# An omega^2 of so many times its rounding is good to eight digits, and better as it is.
NEAR = 1e3
# An omega^2 below this part of the largest may be rounding of that, and is where it is off its energy by more
# than the second.
STIFFEST, WRONG = 1e-14, 1e-3


def separate_rigid(
    model: Model,
    config: Configuration,
    loads: Loads,
    pairs: Eigenpairs,
    free: Freedom,
    at: Assembly | None = None,
) -> Eigenpairs:
    """``pairs`` in carried coordinates, the ``free`` ones, the lowest recomputed where they may be rounding.

    An eigensolver rounds to 1e-16 of the stiffest member. The space of the lowest modes is accurate to the
    square of that, and within it the energy is formed as squared strains: then only the geometric stiffness,
    of forces over lengths, and what cancels in the matrix of a component round (Rayleigh-Ritz; Parlett 1980,
    section 11). So a bus on threads that swings once a day is distinguished from one that floats. ``at`` is
    what `assemble_carried` gives there, if it is known.
    """
    near = np.abs(pairs.lam) < np.maximum(NEAR * pairs.noise, STIFFEST * pairs.lam.max(initial=0.0))
    few = int(np.argmin(np.concatenate([near, [False]])))
    if few == 0:
        return pairs
    slack = at is not None and is_unstrained(model, config, at, loads)
    G = sp.csr_array((model.tree.size,) * 2) if slack else geometric_tangent(model, config, loads)
    shapes = free.spread(pairs.shapes[:, :few])
    strained = strain_energies(model, config, loads, shapes)
    energy = strained + shapes.T @ (G @ shapes)
    # Beside members of 1e12 times their stiffness the solver may leave more than its noise.
    error = np.abs(pairs.lam[:few] - np.diag(energy))
    off = (np.abs(pairs.lam) < NEAR * pairs.noise)[:few] | (error > WRONG * np.abs(pairs.lam[:few]))
    few = int(np.max(np.flatnonzero(off), initial=-1)) + 1
    if few == 0:
        return pairs
    lowest, shapes = pairs.shapes[:, :few], shapes[:, :few]
    strained, energy = strained[:few, :few], energy[:few, :few]
    lam, turn = np.linalg.eigh(energy)
    shapes = shapes @ turn
    cancels = np.einsum("im,im->m", np.abs(shapes), abs(G) @ np.abs(shapes))
    cancels += np.einsum("im,ij,jm->m", turn, strained, turn)
    moved = transport(config, model.tree) @ shapes
    # The matrix of a component is no sum of squares, and mixes them.
    for _, part, state, rows in place_components(model, poses_at(model, config), loads):
        strain = np.abs(state.slope @ (rows @ moved))
        cancels += np.einsum("im,im->m", strain, np.abs(part.stiffness) @ strain).max()
    # A shape has noise / omega^2 of the next mode in it, whose energy goes with the square of that.
    noise = float(max(pairs.noise[:few].max(), error[:few].max()))
    mixed = few * noise**2 / pairs.lam[few] if few < len(pairs.lam) else 0.0
    left = ROUNDING * (cancels + noise) + mixed
    if _floats(model, loads):
        # Its six rigid motions have no energy: a kilometre away the strains of their shapes round to more.
        left[:6] = np.maximum(left[:6], STIFFEST * pairs.lam.max())
    known = Eigenpairs(lam, lowest @ turn, left)
    return known.beside(pairs.pick(slice(few, None)))


def _floats(model: Model, loads: Loads) -> bool:
    """Whether nothing joins the article to the ground or pulls it in any direction of W."""
    tied = len(loads.attach_point) or len(loads.ground.point) or model.held is not None
    return not tied and not np.any(loads.gravity) and not np.any(loads.push)


def rounding(
    model: Model,
    config: Configuration,
    pairs: Eigenpairs,
    gradient: Float[np.ndarray, " coordinate"],
    free: Freedom,
    transport: sp.csr_array | None = None,
) -> Float[np.ndarray, " mode"]:
    """Largest |omega^2| [1/s^2] of each mode that counts as zero, at a state that leaves ``gradient``.

    A force or moment g_k left at a frame adds g_k d2x_k to the tangent, and d2x_k is made of the motions of
    that frame and of those that carry it alone: a light rotor does not feel what its bearing lacks. The
    coordinates are carried ones where ``transport`` takes them to W.
    """
    tree = model.tree
    shapes = free.spread(pairs.shapes)
    own = (shapes if transport is None else transport @ shapes) ** 2
    left = np.abs(static_freedom(model, config).within(gradient))
    at_roots = 6 * tree.roots
    moved = own[:at_roots].reshape(tree.roots, 6, -1).max(axis=1)
    force = left[:at_roots].reshape(tree.roots, 6).sum(axis=1)
    noise = pairs.noise + force @ moved
    carried = list(moved)
    for joint, parent in enumerate(tree.parent):
        carried.append(np.maximum(carried[parent], own[at_roots + joint]))
        noise += left[at_roots + joint] * carried[-1]
    return noise
