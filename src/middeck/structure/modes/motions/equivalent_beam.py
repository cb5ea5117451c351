"""Motion of a slender article as one beam: bending, torsion or axial motion of its cross-sections.

Sections across the long axis that stay plane and keep their form move by three translations and three
rotations, each a polynomial along that axis. The part of a mode's kinetic energy in such motion depends on no
basis and no unit; nothing is cut into slices, so that no node falls on either side of a boundary.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre

from middeck.structure.elements.frames import points_in_world
from middeck.structure.modes.motions.rigid_motions import AXES
from middeck.structure.modes.motions.strain_shares import member_energy
from middeck.structure.modes.motions.strained_parts import straight_lines
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.values import record

# Members that depart from one line by less than this part of its length are one line.
ONE_LINE = 1e-3
# Least length over width (root mean squares): of a beam, and of what has a long axis at all.
SLENDER, DISTINCT = 1.5, 1.1
LETTERED = 0.9  # cosine to a world axis that gives a direction its letter
# Polynomials along the axis: at least for bending, and so few that not any motion fits.
FEWEST, MOST, FRAMES_EACH = 4, 12, 4
# Few points beside the axis may not tell torsion and bending apart: opposite parts would have all shares.
RCOND = 1e-3
# Extent along the beam, over its length, below which a part is appended to it; and how many parts count.
SHORT, FEW = 0.1, 4
# Extent of a line of members, over the length, from which it is a mast, if others along it extend less.
LONG, BESIDE = 0.5, 0.2


@record(kw_only=True)
class BeamMotion:
    """Motion of sections, and where the strain is.

    ``names`` are characters of motion, ``share`` theirs in that of the sections, ``fit`` the part of the
    kinetic energy that this has, ``appended`` the part of the strain energy in the `FEW` short lines that
    have most, ``mast`` the part in a line of members that is alone over most of the length, such as a boom
    on a box: whatever moves the rest, that line bends, twists or stretches. ``lateral`` has the squares and
    the product of the motions along the two directions across: for motion in one plane the projection on its
    direction, as trace of 1; ``mast_lateral`` is that of the mast. ``slender`` is false of an article whose
    width is not small: only where the strain of its members says nothing of the whole is it named as a beam.
    """

    names: tuple[str, ...]
    share: Float[np.ndarray, "mode character"]
    fit: Float[np.ndarray, " mode"]
    appended: Float[np.ndarray, " mode"]
    lateral: Float[np.ndarray, "mode 2 2"]
    mast: Float[np.ndarray, " mode"]
    mast_lateral: Float[np.ndarray, "mode 2 2"]
    slender: bool


def on_one_line(equilibrium: Equilibrium) -> bool:
    """Whether all members lie in one straight line, or there are none."""
    model = equilibrium.model
    x = points_in_world(model.points, model.drawn)[model.element_ends.ravel()]
    if not len(x):
        return True
    spread = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    return bool(spread[1] <= ONE_LINE * spread[0])


def beam_motion(equilibrium: Equilibrium, shapes: Float[np.ndarray, "coordinate mode"]) -> BeamMotion | None:
    """Motion of ``shapes`` as one beam; None for an article without a long axis."""
    model = equilibrium.model
    place, half = points_in_world(model.points, equilibrium.poses), np.repeat(0.5 * model.beams.length, 2)
    ends = model.element_ends.ravel()
    middle = half @ place[ends] / half.sum()
    r = place - middle
    both = r[model.element_ends].sum(axis=1)  # integrals over straight elements: no name hangs on the mesh
    moments = (half[:, None] * r[ends]).T @ r[ends] + (half[::2, None] * both).T @ both
    spread, axes = np.linalg.eigh(moments / 3.0)
    if not spread[2] >= DISTINCT**2 * spread[1]:
        return None
    axis = axes[:, 2] * np.sign(axes[np.argmax(np.abs(axes[:, 2])), 2])
    across, planes = _across(axis)
    seen = np.concatenate([ends, model.body_point])
    mass = np.concatenate([np.repeat(0.5 * model.beams.length * model.beams.rho_A, 2), model.body_mass])
    changes = equilibrium.moves(shapes)
    weight = np.sqrt(mass)[:, None]
    turning = turned_bodies(equilibrium)
    terms = int(np.clip(len(np.unique(model.points.frame[seen])) // FRAMES_EACH, FEWEST, MOST))
    families = _families(r[seen], axis, across, terms)
    # A body's turn counts too: one that nods on a still beam is no motion of the beam.
    along, turns = r[model.body_point] @ axis, (np.zeros(3), axis, *(np.cross(e, axis) for e in across))
    columns = np.hstack([
        np.vstack([(weight[:, :, None] * f).reshape(3 * len(seen), -1), turned])
        for f, turned in zip(families, _turns(r[seen] @ axis, along, turns, terms, turning), strict=True)
    ])  # fmt: skip
    moved = (weight[:, :, None] * changes[seen, :3]).reshape(3 * len(seen), -1)
    turned = (turning @ changes[model.body_point, 3:]).reshape(3 * len(turning), shapes.shape[1])
    u = np.vstack([moved, turned])
    B = columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    c = np.linalg.lstsq(B, u, rcond=RCOND)[0]
    width = np.cumsum([0, *(f.shape[2] for f in families)])
    energy = np.array([
        np.sum((B[:, a:b] @ c[a:b]) ** 2, axis=0) for a, b in pairwise(width)
    ]).T  # fmt: skip
    whole = np.sum(u**2, axis=0)
    fit = np.sum((B @ c) ** 2, axis=0) / np.where(whole > 0.0, whole, 1.0)
    names = ("axial", "torsion", *planes)
    if len(planes) == 1:
        energy = np.column_stack([energy[:, :2], energy[:, 2:].sum(axis=1)])
    total = energy.sum(axis=1, keepdims=True)
    share = energy / np.where(total > 0.0, total, 1.0)
    own = [(B[:, a:b] @ c[a:b])[: 3 * len(seen)].reshape(len(seen), 3, -1) for a, b in pairwise(width[2:])]
    aside = np.stack([np.einsum("i,pim->pm", e, f) for e, f in zip(across, own, strict=True)])
    lines = _Lines(equilibrium, shapes, r[ends] @ axis)
    on_mast = np.repeat(lines.of_element == lines.mast, 2)
    own = np.einsum("ai,pim->apm", across, changes[ends[on_mast], :3])
    slender = bool(spread[2] >= SLENDER**2 * spread[1])
    return BeamMotion(
        names=names,
        share=share,
        fit=fit,
        appended=lines.appended(),
        lateral=_planes_of(aside),
        mast=lines.on_mast(),
        mast_lateral=_planes_of(own),
        slender=slender,
    )


def _planes_of(aside: Float[np.ndarray, "2 point mode"]) -> Float[np.ndarray, "mode 2 2"]:
    """Squares and product of two motions across, of a trace of 1."""
    lateral = np.einsum("apm,bpm->mab", aside, aside)
    size = np.trace(lateral, axis1=1, axis2=2)[:, None, None]
    return lateral / np.where(size > 0.0, size, 1.0)


def turned_bodies(equilibrium: Equilibrium) -> Float[np.ndarray, "body 3 3"]:
    """Square roots of the inertia of the bodies, in W: |root turn|^2 is twice the energy."""
    model = equilibrium.model
    own, axes = np.linalg.eigh(model.body_inertia)
    root = (axes * np.sqrt(np.maximum(own, 0.0))[:, None, :]) @ axes.transpose(0, 2, 1)
    R = equilibrium.poses.R[model.points.frame[model.body_point]]
    return R @ root @ R.transpose(0, 2, 1)


def _turns(
    s: np.ndarray, at: np.ndarray, turns: Sequence[np.ndarray], terms: int, turning: np.ndarray
) -> list[np.ndarray]:
    """Turns of the bodies ``at`` their places in each family; bending has the shifts first."""
    P = _polynomials(s, at, terms)
    out = [np.einsum("bij,j,bt->bit", turning, turn, P).reshape(3 * len(at), terms) for turn in turns]
    return [*out[:2], *(np.hstack([0.0 * turned, turned]) for turned in out[2:])]


def _polynomials(s: np.ndarray, at: np.ndarray, terms: int) -> np.ndarray:
    """Legendre's on the range of ``s``, at some places of it."""
    return legendre.legvander(2.0 * (at - s.min()) / max(np.ptp(s), np.finfo(float).tiny) - 1.0, terms - 1)


class _Lines:
    """Straight lines of members: their reach along the axis, and the strain energy of each mode there."""

    def __init__(self, equilibrium: Equilibrium, shapes: np.ndarray, s: np.ndarray) -> None:
        """``s`` are the places of the ends of all elements along the axis."""
        model = equilibrium.model
        first, line = np.unique(straight_lines(model.structure), return_inverse=True)
        self.of_element = line[model.element_member]
        of_end = np.repeat(self.of_element, 2)
        self.low, self.high = np.full(len(first), np.inf), np.full(len(first), -np.inf)
        np.minimum.at(self.low, of_end, s)
        np.maximum.at(self.high, of_end, s)
        self.energy = np.zeros((len(first), shapes.shape[1]))
        np.add.at(self.energy, line, member_energy(equilibrium, shapes).T)
        whole = self.energy.sum(axis=0)
        self.whole = np.where(whole > 0.0, whole, 1.0)
        self.length = float(np.ptp(s))
        self.mast = self._mast(np.sort(s.reshape(-1, 2), axis=1))

    def appended(self) -> Float[np.ndarray, " mode"]:
        """The part of the energy in the `FEW` short lines that have most."""
        short = self.energy[self.high - self.low < SHORT * self.length]
        return np.sort(short, axis=0)[-FEW:].sum(axis=0) / self.whole

    def on_mast(self) -> Float[np.ndarray, " mode"]:
        """The part of the energy in the mast; none where there is none."""
        return self.energy[self.mast] / self.whole if self.mast >= 0 else 0.0 * self.whole

    def _mast(self, ends: Float[np.ndarray, "element 2"]) -> int:
        """The longest line, if it is long and few members run beside it; else -1."""
        line = int(np.argmax(self.high - self.low))
        low, high = self.low[line], self.high[line]
        beside = np.minimum(ends[:, 1], high) - np.maximum(ends[:, 0], low)
        beside = np.maximum(beside, 0.0)[self.of_element != line].sum()
        return line if high - low >= LONG * self.length and beside <= BESIDE * (high - low) else -1


def _across(axis: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Two unit vectors across, one as near to a world axis as can be, and the names of bending along them.

    That is the plane of bending where its normal has a letter, or the letter of the direction; one name for
    both where one of them has neither.
    """
    e = np.eye(3)[int(np.argmin(np.abs(axis)))]
    e = e - (axis @ e) * axis
    e = e / np.linalg.norm(e)
    across = np.array([e, np.cross(axis, e)])
    planes = tuple(_plane(np.cross(axis, direction), direction) for direction in across)
    return across, planes if all(planes) else ("bending",)


def _plane(normal: np.ndarray, direction: np.ndarray) -> str:
    for vector, words in ((normal, "bending {0[0]}-{0[1]}"), (direction, "bending along {1}")):
        nearest = int(np.argmax(np.abs(vector)))
        if abs(vector[nearest]) >= LETTERED:
            return words.format(AXES.replace(AXES[nearest], ""), AXES[nearest])
    return ""


def _families(r: np.ndarray, axis: np.ndarray, across: np.ndarray, terms: int) -> list[np.ndarray]:
    """Motions (point, 3, term): axial, torsion, and bending along each of the two directions across."""
    s = r @ axis
    P = _polynomials(s, s, terms)[:, None, :]
    bending: list[np.ndarray] = []
    for e in across:
        plane = axis * (r @ e)[:, None]  # a section that turns stays plane
        bending.append(np.concatenate([e[None, :, None] * P, plane[:, :, None] * P], axis=2))
    return [axis[None, :, None] * P, np.cross(axis, r)[:, :, None] * P, *bending]
