"""Names of modes, from participation in rigid motions, motion as one beam, and strain energy."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from middeck.structure.eigenproblem.repeated import repeated_apart
from middeck.structure.modes.motions.equivalent_beam import beam_motion, on_one_line, turned_bodies
from middeck.structure.modes.motions.rigid_motions import AXES, motions_within, rigid_motions
from middeck.structure.modes.motions.strain_shares import PARTS, device_strain, strain_energy
from middeck.structure.modes.motions.strained_parts import leading_parts, strained_parts
from middeck.structure.modes.names.kinds import HALF, HELD, in_one_piece, strainless_motions
from middeck.structure.rest.equilibrium import Equilibrium


class Wording(NamedTuple):
    """Words for the deformation in a mode; how it shares in the planes, where it is bending of one beam."""

    words: str
    bent: Float[np.ndarray, "2 2"] | None = None


UNCLEAR = 0.25  # two bendings are in one plane, or across, to less than this; else half, as at 45 degrees
ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
LOCAL, BENDING = "local: ", "bending"
COMPONENT, INSIDE = "component", "deformation of {}"  # which only the program that reduced it can name
# Share of the kinetic energy that makes a mode one of the article as a beam; share of the strain energy in
# appended parts that makes it none.
WHOLE = 0.6
TIES = 4  # the last of `PARTS` are no members
TINY = float(np.finfo(float).tiny)


def name_modes(
    equilibrium: Equilibrium,
    M: sp.csr_array,
    lam: Float[np.ndarray, " mode"],
    shapes: Float[np.ndarray, "coordinate mode"],
    kind: tuple[str, ...],
    rigid_names: tuple[str, ...],
) -> tuple[str, ...]:
    """Names of modes, the rigid ones first.

    One that something else than strain holds has the name of the rigid motion that takes the largest part of
    its mass. A flexible one has that of its deformation: see `deformation_names`.
    """
    first = len(rigid_names)
    held = [m for m, k in enumerate(kind) if k in HELD]
    hung = dict(zip(held, _hung_names(equilibrium, M, lam[held], shapes[:, held]), strict=True))
    deformed = deformation_names(equilibrium, M, lam, shapes)
    groups = repeated_apart(equilibrium.model.tree, M, lam, shapes)
    beside = {int(m): set(group.tolist()) for group in groups for m in group}
    names: list[str] = list(rigid_names)
    count: Counter[str] = Counter()
    for m in range(first, len(kind)):
        base = hung.get(m, deformed[m].words)
        count[base] += 1
        plain = m in hung or base.startswith(LOCAL)
        order, bent = count[base], deformed[m].bent
        if m not in hung and bent is not None:
            before = [j for j in range(first, m) if j not in hung and j not in beside.get(m, ())]
            order = _order(bent, [deformed[j].bent for j in before])
        names.append((base if order == 1 else f"{base} {order}") if plain else f"{_ordinal(order)} {base}")
    return tuple(names)


def _order(bent: np.ndarray, before: Sequence[np.ndarray | None]) -> int:
    """Place of a bending among those in its plane: one across is none of them, one half way is half of one.

    Modes of one frequency, of which any basis will do, have half of each plane.
    """
    shared = np.array([np.sum(bent * other) for other in before if other is not None])
    clear = np.where(shared > 1.0 - UNCLEAR, 1.0, np.where(shared < UNCLEAR, 0.0, 0.5))
    return 1 + int(clear.sum() + 0.5)


def deformation_names(
    equilibrium: Equilibrium,
    M: sp.csr_array,
    lam: Float[np.ndarray, " mode"],
    shapes: Float[np.ndarray, "coordinate mode"],
) -> list[Wording]:
    """Words for the deformation of each mode, not numbered.

    In an article along one line it is the deformation with most strain energy, and so where `WHOLE` of the
    strain energy is in a mast (see `BeamMotion`). In any other that is slender, or is strained axially, it is
    the motion of the whole as one beam, if `WHOLE` of the kinetic energy is that; else "local: PART" where
    parts with half of the strain energy can be named or "local: turn of BODY" where that has half of the
    kinetic energy; or "overall", with the deformation of the members. Two that are nearly equal are both
    named, and modes of one frequency that `turn_apart` leaves alike are named alike.
    """
    mean = np.eye(len(lam))  # over each group: a mean over all of its modes does not depend on their basis
    for group in repeated_apart(equilibrium.model.tree, M, lam, shapes):
        mean[np.ix_(group, group)] = 1.0 / len(group)
    strain = mean @ strain_energy(equilibrium, shapes)
    if not len(lam) or (on_one_line(equilibrium) and not equilibrium.model.structure.components):
        return [Wording(PARTS[i]) for i in np.argmax(strain, axis=1)]
    parts, share = strained_parts(equilibrium, shapes)
    if on_one_line(equilibrium):
        inside = [INSIDE.format(leading_parts(parts, row)[0]) for row in mean @ share]
        most = [PARTS[i] for i in np.argmax(strain, axis=1)]
        return [Wording(inside[m] if part == COMPONENT else part) for m, part in enumerate(most)]
    whole = beam_motion(equilibrium, shapes)
    share, (bodies, turning) = mean @ share, _turning(equilibrium, M, shapes)
    names: list[Wording] = []
    for m in range(len(lam)):
        named, of_it = leading_parts(parts, share[m])
        deformation = leading_parts(PARTS, strain[m] / max(strain[m].sum(), TINY))[0]
        tied = strain[m, len(PARTS) - TIES :].sum() > HALF * strain[m].sum()
        # A truss works axially whatever it does: such strain says nothing of the whole.
        as_beam = whole is not None and not tied and (whole.slender or deformation == PARTS[0])
        beam = whole if as_beam else None
        if beam is not None and mean[m] @ beam.mast >= WHOLE:
            names.append(_bent(deformation, mean[m], beam.mast_lateral))
        elif beam is not None and mean[m] @ beam.fit >= WHOLE > mean[m] @ beam.appended:
            words = leading_parts(beam.names, mean[m] @ beam.share)[0]
            names.append(_bent(words, mean[m], beam.lateral))
        elif of_it >= HALF:
            names.append(Wording(f"{LOCAL}{named}" if tied else f"{LOCAL}{named}, {deformation}"))
        elif (turned := leading_parts(bodies, mean[m] @ turning))[1] >= HALF:
            names.append(Wording(f"{LOCAL}turn of {turned[0]}"))
        else:
            names.append(Wording(f"overall {deformation}"))
    return names


def _bent(words: str, mean: np.ndarray, lateral: np.ndarray) -> Wording:
    return Wording(words, np.einsum("n,nij->ij", mean, lateral) if BENDING in words else None)


def _turning(
    equilibrium: Equilibrium, M: sp.csr_array, shapes: np.ndarray
) -> tuple[tuple[str, ...], Float[np.ndarray, "mode body"]]:
    """Bodies by the names of their frames, and the part of the kinetic energy that their turning has."""
    model = equilibrium.model
    turn = equilibrium.moves(shapes)[model.body_point, 3:]
    twice = np.sum((turned_bodies(equilibrium) @ turn) ** 2, axis=1)
    names = tuple(model.frames[frame] for frame in model.points.frame[model.body_point])
    return names, (twice / np.einsum("im,im->m", shapes, M @ shapes)).T


def _ordinal(count: int) -> str:
    """First to tenth, then 11th, 12th, 21st ...

    >>> [_ordinal(n) for n in (2, 11, 21, 112)]
    ['second', '11th', '21st', '112th']
    """
    if count <= len(ORDINALS):
        return ORDINALS[count - 1]
    teens = count % 100 in (11, 12, 13)
    return f"{count}{'th' if teens else {1: 'st', 2: 'nd', 3: 'rd'}.get(count % 10, 'th')}"


def _hung_names(equilibrium: Equilibrium, M: sp.csr_array, lam: np.ndarray, shapes: np.ndarray) -> list[str]:
    """Label of each mode's largest effective mass, each motion's relative to its own.

    Of motions that clamps and links leave: all of an article that floats in one piece.
    """
    if equilibrium.model.held is None and in_one_piece(equilibrium.model):
        motions, names = rigid_motions(equilibrium, M)
    else:
        motions, names = motions_within(equilibrium, M, strainless_motions(equilibrium, M))
    own = np.einsum("im,im->m", motions, M @ motions)
    own = np.where(own > 0.0, own, np.inf)  # a straight line of masses has no inertia about itself
    effective = (motions.T @ (M @ shapes)) ** 2 / own[:, None]
    gravity, sprung = equilibrium.environment.gravity, _are_sprung(equilibrium, lam, shapes)
    return [
        _hung_label(names[i], gravity, on_springs)
        for i, on_springs in zip(np.argmax(effective, axis=0), sprung, strict=True)
    ]


def _are_sprung(equilibrium: Equilibrium, lam: np.ndarray, shapes: np.ndarray) -> list[bool]:
    """Whether strain of devices, springs and bushings restores each mode more than weight and pull do."""
    elastic = device_strain(equilibrium, shapes)
    others = 0.5 * lam - strain_energy(equilibrium, shapes).sum(axis=1) - elastic
    return (elastic > np.abs(others)).tolist()


def _hung_label(motion: str, gravity: Float[np.ndarray, "3"], on_springs: bool) -> str:
    """The usual name of a rigid motion under gravity, and of a payload's turn; others keep their own.

    A pendulum is what weight, or the pull of a loaded cable, brings back; on springs that motion is a sway.
    """
    what, _, axis = motion.partition(" ")
    if what == "gimbal":
        return motion if on_springs else f"payload pendulum {axis}"
    if what == "slide" or not np.any(gravity):
        return motion
    vertical = axis == AXES[int(np.argmax(np.abs(gravity)))]
    if what == "translation":
        return "bounce" if vertical else f"{'sway' if on_springs else 'pendulum'} {axis}"
    return "yaw" if vertical else f"tilt {axis}"
