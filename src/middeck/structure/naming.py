"""What a mode is: names found from participation in rigid motions and from strain energy."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from middeck.structure.assembly import element_poses
from middeck.structure.beam import beam_deformations, beam_stiffness
from middeck.structure.equilibrium import Equilibrium
from middeck.structure.frames import frame_poses, pose_jacobian
from middeck.structure.statics import dynamic_coordinates

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
AXES = "xyz"
# A mode of kind "suspension" should bend little and a flexible one much; between, the kind is a convention.
HALF = 0.5


def rigid_motions(equilibrium: Equilibrium) -> tuple[Float[np.ndarray, "coordinate motion"], tuple[str, ...]]:
    """Unit translations along and rotations about the world axes, then a unit turn of every moving joint.

    Rotations are about the world origin; joints turn relative to their carriers, what hangs on them follows.
    """
    model = equilibrium.model
    roots = model.tree.roots
    motions = np.zeros((model.tree.size, 6))
    step = motions[: 6 * roots].reshape(roots, 6, 6)
    step[:, :3, :3] = step[:, 3:, 3:] = np.eye(3)
    for axis in range(3):
        step[:, :3, 3 + axis] = np.cross(np.eye(3)[axis], equilibrium.config.x)
    moving = np.flatnonzero(dynamic_coordinates(model)[6 * roots :])
    joints = np.zeros((model.tree.size, len(moving)))
    joints[6 * roots + moving, np.arange(len(moving))] = 1.0
    names = [f"translation {a}" for a in AXES] + [f"rotation {a}" for a in AXES]
    names += [f"gimbal {model.structure.joints[j].name.replace('_', ' ')}" for j in moving]
    return np.hstack([motions, joints]), tuple(names)


def rigid_basis(
    equilibrium: Equilibrium, M: sp.csr_array, space: Float[np.ndarray, "coordinate rigid"]
) -> tuple[Float[np.ndarray, "coordinate rigid"], tuple[str, ...]]:
    """A named, mass-orthonormal basis of the rigid-body modes: translations, rotations, joints in turn.

    Any basis of the null space is as good; this one separates the translations, which no internal torque
    moves, from the rest. Motions that the structure resists are skipped.
    """
    motions, names = rigid_motions(equilibrium)
    chosen: list[np.ndarray] = []
    found: list[str] = []
    for motion, name in zip(motions.T, names, strict=True):
        size = np.sqrt(motion @ (M @ motion))
        inside = space @ (space.T @ (M @ motion))
        for c in chosen:
            inside = inside - c * (c @ (M @ inside))
        left = np.sqrt(inside @ (M @ inside))
        if left > 1e-3 * size and len(chosen) < space.shape[1]:  # the rest is what earlier ones contain
            chosen.append(inside / left)
            found.append(name)
    missing = space.shape[1] - len(chosen)
    if missing:  # mechanisms that are no single motion, e.g. a hinged frame
        basis = np.array(chosen).T.reshape(len(space), -1)
        rest = space - basis @ (basis.T @ (M @ space))
        u, _, _ = np.linalg.svd(space.T @ (M @ rest))
        chosen += list((space @ u[:, :missing]).T)
        found += [f"mechanism {i + 1}" for i in range(missing)]
    return np.array(chosen).T, tuple(found)


def name_modes(
    equilibrium: Equilibrium,
    M: sp.csr_array,
    K: sp.csr_array,
    shapes: Float[np.ndarray, "coordinate mode"],
    kind: tuple[str, ...],
    rigid_names: tuple[str, ...],
) -> tuple[tuple[str, ...], Float[np.ndarray, " mode"], tuple[str, ...]]:
    """Names, strain-energy shares, and warnings where strain energy disagrees with the kind."""
    strain = _strain_energy(equilibrium, shapes)
    total = 0.5 * np.einsum("im,im->m", shapes, K @ shapes)
    share = np.clip(strain.sum(axis=1) / np.where(total > 0.0, total, np.inf), 0.0, 1.0)
    hung = _hung_names(equilibrium, M, shapes, kind.count("suspension") and len(kind))
    names: list[str] = []
    warnings: list[str] = []
    counts: dict[str, int] = {}
    for m, k in enumerate(kind):
        if k == "rigid":
            names.append(rigid_names[m])
            continue
        base = hung[m] if k == "suspension" else _flexible_name(strain[m])
        counts[base] = counts.get(base, 0) + 1
        names.append(_ordinal_name(base, counts[base], k))
        if (k == "suspension") == (share[m] > HALF) and m < 3 * max(kind.count("suspension"), 1):
            warnings.append(f"mode {m} {names[-1]!r} is called {k} by rank; its strain share is {share[m]:.0%}")
    return tuple(names), share, tuple(warnings)


def _ordinal_name(base: str, count: int, kind: str) -> str:
    if kind == "suspension":
        return base if count == 1 else f"{base} {count}"
    return f"{ORDINALS[count - 1] if count <= len(ORDINALS) else f'{count}th'} {base}"


def _hung_names(equilibrium: Equilibrium, M: sp.csr_array, shapes: np.ndarray, wanted: int) -> list[str]:
    """Name of each mode by its largest participation in a rigid motion about the centre of mass."""
    if not wanted:
        return []
    motions, motion_names = rigid_motions(equilibrium)
    up = _vertical(equilibrium)
    x_cm = _centre_of_mass(motions, M)
    for axis in range(3):
        shift = np.cross(np.eye(3)[axis], x_cm)
        motions[:, 3 + axis] -= motions[:, :3] @ shift
    effective = (motions.T @ (M @ shapes)) ** 2 / np.einsum("im,im->m", motions, M @ motions)[:, None]
    labels = [_hung_label(n, up) for n in motion_names]
    return [labels[i] for i in np.argmax(effective, axis=0)]


def _hung_label(motion: str, up: int) -> str:
    what, _, axis = motion.partition(" ")
    if what == "gimbal":
        return f"payload pendulum {axis}"
    vertical = axis == AXES[up]
    if what == "translation":
        return "bounce" if vertical else f"pendulum {axis}"
    return "yaw" if vertical else f"tilt {axis}"


def _vertical(equilibrium: Equilibrium) -> int:
    return int(np.argmax(np.abs(equilibrium.environment.gravity)))


def _centre_of_mass(motions: np.ndarray, M: sp.csr_array) -> np.ndarray:
    """From the coupling of rotations with translations in the rigid mass matrix."""
    rigid = motions[:, :6].T @ (M @ motions[:, :6])
    return np.array([rigid[2, 4], rigid[0, 5], rigid[1, 3]]) * [-1, -1, -1] / rigid[0, 0]


def _strain_energy(equilibrium: Equilibrium, shapes: np.ndarray) -> Float[np.ndarray, "mode part"]:
    """Elastic energy of each mode: axial, torsion, bending in the three world planes, springs and joints.

    Bending about an own axis of a member counts for the world axis nearest to it.
    """
    model = equilibrium.model
    energy = np.zeros((shapes.shape[1], 6))
    if len(model.element_ends):
        x, T = element_poses(model, equilibrium.config)
        _, derivative = beam_deformations(x, T)
        local = _pose_changes(equilibrium, shapes)[model.element_ends].reshape(len(x), 12, -1)
        d = np.einsum("eia,eam->eim", derivative, local)
        force = np.einsum("eij,ejm->eim", beam_stiffness(model.beams), d)
        density = 0.5 * d * force
        energy[:, 0] = density[:, 0].sum(axis=0)
        energy[:, 1] = density[:, 5].sum(axis=0)
        for own, rows in ((1, (1, 3)), (2, (2, 4))):
            world = np.argmax(np.abs(model.element_triad[:, :, own]), axis=1)
            for axis in range(3):
                energy[:, 2 + axis] += density[world == axis][:, rows].sum(axis=(0, 1))
    energy[:, 5] = _joint_energy(equilibrium, shapes)
    return energy


def _joint_energy(equilibrium: Equilibrium, shapes: np.ndarray) -> np.ndarray:
    joints = equilibrium.model.structure.joints
    k = np.array([j.stiffness for j in joints])
    return 0.5 * k @ shapes[6 * equilibrium.model.tree.roots :] ** 2 if len(joints) else np.zeros(shapes.shape[1])


def _pose_changes(equilibrium: Equilibrium, shapes: np.ndarray) -> Float[np.ndarray, "pose 6 mode"]:
    model = equilibrium.model
    J = pose_jacobian(model.tree, model.points, frame_poses(model.tree, equilibrium.config))
    return (J @ shapes).reshape(-1, 6, shapes.shape[1])


def _flexible_name(strain: np.ndarray) -> str:
    planes = ("bending y-z", "bending x-z", "bending x-y")
    labels = ("axial", "torsion", *planes, "joint")
    return labels[int(np.argmax(strain))]
