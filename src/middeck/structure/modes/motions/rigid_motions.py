"""Rigid-body motions of a structure, and a named basis of the modes that cost no energy."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from middeck.structure.assembly.linked import dynamic_coordinates
from middeck.structure.elements.frames import rigid_columns
from middeck.structure.elements.rotations import skew
from middeck.structure.model.article import JointState
from middeck.structure.rest.equilibrium import Equilibrium

AXES = "xyz"
TURNS = slice(3, 6)  # the rotations among the motions
BODY, HALF = 6, 0.5
# A motion that is less than this part new is one that earlier ones contain, e.g. a second coaxial joint.
NEW_PART = 1e-3


def rigid_motions(
    equilibrium: Equilibrium, M: sp.csr_array
) -> tuple[Float[np.ndarray, "coordinate motion"], tuple[str, ...]]:
    """Unit translations along and rotations about the world axes, then a unit move of every moving joint.

    Rotations are about the centre of mass; a joint moves relative to its carrier, with all that it carries.
    """
    model = equilibrium.model
    roots = model.tree.roots
    about_origin = rigid_columns(model.tree, equilibrium.config, np.zeros(3))
    motions = rigid_columns(model.tree, equilibrium.config, centre_of_mass(about_origin, M))
    own = np.array([joint.state is not JointState.INTERNAL for joint in model.structure.joints], dtype=bool)
    moving = np.flatnonzero(dynamic_coordinates(model)[6 * roots :] & own)
    joints = np.zeros((model.tree.size, len(moving)))
    joints[6 * roots + moving, np.arange(len(moving))] = 1.0
    names = [f"translation {a}" for a in AXES] + [f"rotation {a}" for a in AXES]
    for joint in (model.structure.joints[j] for j in moving):
        names.append(f"{'slide' if joint.slides else 'gimbal'} {joint.name.replace('_', ' ')}")
    return np.hstack([motions, joints]), tuple(names)


def motions_within(
    equilibrium: Equilibrium, M: sp.csr_array, space: Float[np.ndarray, "coordinate free"]
) -> tuple[Float[np.ndarray, "coordinate motion"], tuple[str, ...]]:
    """Those `rigid_motions` of which ``space``, mass-orthonormal, has half or more; all where it has none so.

    A joint takes along what links tie to it: its motion is then that of ``space`` with a unit move of this
    joint, none of the others, and the least energy.
    """
    motions, names = rigid_motions(equilibrium, M)
    motions = np.hstack([motions[:, :BODY], _with_links(motions[:, BODY:], space, M)])
    part = np.sum((space.T @ (M @ motions)) ** 2, axis=0)
    able = part >= HALF * np.einsum("im,im->m", motions, M @ motions)
    if not np.any(able):
        return motions, names
    return motions[:, able], tuple(n for n, a in zip(names, able, strict=True) if a)


def _with_links(joints: np.ndarray, space: np.ndarray, M: sp.csr_array) -> np.ndarray:
    """Unit moves of joints; those that links do not leave as they are, with what is linked to them."""
    own = np.argmax(np.abs(joints), axis=0)
    moves = np.linalg.pinv(space[own], rcond=NEW_PART**2)
    within = np.abs(space[own] @ moves - np.eye(len(own))).max(axis=0, initial=0.0) < NEW_PART
    outside = _norm(joints - space @ (space.T @ (M @ joints)), M) >= NEW_PART * _norm(joints, M)
    return np.where(within & outside, space @ moves, joints)


def centre_of_mass(
    motions: Float[np.ndarray, "coordinate motion"], M: sp.csr_array
) -> Float[np.ndarray, "3"]:
    """Centre of mass, from the coupling of rotations with translations; the origin without mass.

    A device's moving mass counts along its cable only: rotations about the point found then couple least with
    translations, wherever the article stands.
    """
    coupled = motions.T @ (M @ motions)
    mass = coupled[: TURNS.start, : TURNS.start]
    if not mass[0, 0] > 0.0:
        return np.zeros(3)
    # A rotation about c instead of the origin has the translation (axis x -c) besides.
    arms = (mass @ skew(np.eye(3))).reshape(9, 3)
    return np.linalg.lstsq(arms, coupled[: TURNS.start, TURNS].T.reshape(9))[0]


def rigid_basis(
    equilibrium: Equilibrium, M: sp.csr_array, space: Float[np.ndarray, "coordinate rigid"]
) -> tuple[Float[np.ndarray, "coordinate rigid"], tuple[str, ...]]:
    """A named, mass-orthonormal basis of the rigid-body modes: translations, rotations, joints in turn.

    Any basis of the null space is as good; this one separates the translations, which no internal torque
    moves, from the rest. Motions that the structure resists in part come last, the freest of them first;
    those that it resists wholly are skipped. Such a mode has the name of the motion that it is most of, not
    of the one that it shares most momentum with: the roll of a slender article has little about any axis.
    """
    motions, motion_names = rigid_motions(equilibrium, M)
    motions = np.hstack([motions[:, :BODY], _with_links(motions[:, BODY:], space, M)])
    whole = _norm(motions, M)
    inside = space @ (space.T @ (M @ motions))
    free = _norm(motions - inside, M) < NEW_PART * whole
    basis = np.zeros((len(space), 0))
    names: list[str] = []
    # A straight line of masses has no inertia about itself.
    waiting = unnamed = np.flatnonzero(whole > 0.0).tolist()
    while waiting and len(names) < space.shape[1]:
        left = {i: _without(inside[:, i], basis, M) for i in waiting}
        new = {i: float(_norm(left[i][:, None], M)[0] / whole[i]) for i in waiting}
        waiting = [i for i in waiting if new[i] > NEW_PART]
        best = next((i for i in waiting if free[i]), max(waiting, key=new.__getitem__, default=None))
        if best is not None:
            mode = left[best] / (new[best] * whole[best])
            named = best if free[best] else max(unnamed, key=_amounts(motions, mode, M).__getitem__)
            basis = np.column_stack([basis, mode])
            names.append(motion_names[named])
            waiting.remove(best)
            unnamed = [i for i in unnamed if i != named]
    missing = space.shape[1] - len(names)
    if missing:  # mechanisms that are no single motion, e.g. a hinged frame or a loose part
        rest = space - basis @ (basis.T @ (M @ space))
        turn = np.linalg.svd(space.T @ (M @ rest))[0][:, :missing]
        basis = np.column_stack([basis, space @ turn])
        names += [f"mechanism {i + 1}" for i in range(missing)]
    return basis, tuple(names)


def _amounts(motions: np.ndarray, mode: np.ndarray, M: sp.csr_array) -> Float[np.ndarray, " motion"]:
    """Part of each motion in the combination of all that is nearest to ``mode``, by its inertia.

    That of rotations is their largest: about axes across each other, the larger angle counts.
    """
    own = _norm(motions, M)
    unit = motions / np.where(own > 0.0, own, 1.0)
    parts = np.linalg.lstsq(unit.T @ (M @ unit), unit.T @ (M @ mode), rcond=NEW_PART**2)[0]
    parts[TURNS] *= own[TURNS].max() / np.where(own[TURNS] > 0.0, own[TURNS], np.inf)
    return np.abs(parts)


def _norm(motions: np.ndarray, M: sp.csr_array) -> np.ndarray:
    """Norm of each column in the mass metric."""
    return np.sqrt(np.einsum("im,im->m", motions, M @ motions))


def _without(motion: np.ndarray, basis: np.ndarray, M: sp.csr_array) -> np.ndarray:
    """The part of ``motion`` that is orthogonal to ``basis``."""
    for _ in range(2):  # Gram and Schmidt, twice for orthogonality at rounding level
        motion = motion - basis @ (basis.T @ (M @ motion))
    return motion
