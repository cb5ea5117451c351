"""Names of modes, from participation in rigid motions, motion as one beam, and strain energy."""

from __future__ import annotations

from collections import Counter

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from middeck.structure.modes.equivalent_beam import beam_motion, on_one_line
from middeck.structure.modes.kinds import HALF, HELD
from middeck.structure.modes.parts import leading_parts, strained_parts
from middeck.structure.modes.repeated import repeated_apart
from middeck.structure.modes.rigid import AXES, rigid_motions
from middeck.structure.modes.strain import PARTS, strain_energy
from middeck.structure.rest.equilibrium import Equilibrium

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
LOCAL = "local: "
# Of the kinetic energy: makes a mode one of the article as a beam. Of the strain energy, in what is appended
# to the beam: makes it none.
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
    hung = dict(zip(held, _hung_names(equilibrium, M, shapes[:, held]), strict=True))
    deformed = deformation_names(equilibrium, M, lam, shapes)
    names: list[str] = list(rigid_names)
    count: Counter[str] = Counter()
    for m in range(first, len(kind)):
        base = hung.get(m, deformed[m])
        count[base] += 1
        plain = m in hung or base.startswith(LOCAL)
        names.append(_numbered(base, count[base]) if plain else f"{_ordinal(count[base])} {base}")
    return tuple(names)


def deformation_names(
    equilibrium: Equilibrium,
    M: sp.csr_array,
    lam: Float[np.ndarray, " mode"],
    shapes: Float[np.ndarray, "coordinate mode"],
) -> list[str]:
    """What deforms in each mode, not numbered.

    Of an article along one line it is the deformation with most strain energy. Of any other it is the motion
    of the whole as one beam, if `WHOLE` of the kinetic energy is that; else "local: PART" where parts with
    half of the strain energy can be named, or "overall", with the deformation of the members. Two that are
    nearly equal are both named, and modes of one frequency that `turn_apart` leaves alike are named alike.
    """
    mean = _mean_of_groups(len(lam), repeated_apart(equilibrium.model.tree, M, lam, shapes))
    strain = mean @ strain_energy(equilibrium, shapes)
    if not len(lam) or on_one_line(equilibrium):
        return [PARTS[i] for i in np.argmax(strain, axis=1)]
    whole, (parts, share) = beam_motion(equilibrium, shapes), strained_parts(equilibrium, shapes)
    share = mean @ share
    names: list[str] = []
    for m in range(len(lam)):
        named, of_it = leading_parts(parts, share[m])
        deformation = leading_parts(PARTS, strain[m] / max(strain[m].sum(), TINY))[0]
        tied = strain[m, len(PARTS) - TIES :].sum() > HALF * strain[m].sum()
        if whole is not None and not tied and mean[m] @ whole.fit >= WHOLE > mean[m] @ whole.appended:
            names.append(leading_parts(whole.names, mean[m] @ whole.share)[0])
        elif of_it >= HALF:
            names.append(f"{LOCAL}{named}" if tied else f"{LOCAL}{named}, {deformation}")
        else:
            names.append(f"overall {deformation}")
    return names


def _mean_of_groups(count: int, groups: list[Int[np.ndarray, " member"]]) -> np.ndarray:
    """Averages over each group: a mean over all of its modes does not depend on their basis."""
    mean = np.eye(count)
    for group in groups:
        mean[np.ix_(group, group)] = 1.0 / len(group)
    return mean


def _numbered(base: str, count: int) -> str:
    return base if count == 1 else f"{base} {count}"


def _ordinal(count: int) -> str:
    """First to tenth, then 11th, 12th, 21st ...

    >>> [_ordinal(n) for n in (2, 11, 21, 112)]
    ['second', '11th', '21st', '112th']
    """
    if count <= len(ORDINALS):
        return ORDINALS[count - 1]
    teens = count % 100 in (11, 12, 13)
    return f"{count}{'th' if teens else {1: 'st', 2: 'nd', 3: 'rd'}.get(count % 10, 'th')}"


def _hung_names(equilibrium: Equilibrium, M: sp.csr_array, shapes: np.ndarray) -> list[str]:
    """Label of each mode's largest effective mass, each motion's relative to its own."""
    motions, names = rigid_motions(equilibrium, M)
    own = np.einsum("im,im->m", motions, M @ motions)
    own = np.where(own > 0.0, own, np.inf)  # a straight line of masses has no inertia about itself
    effective = (motions.T @ (M @ shapes)) ** 2 / own[:, None]
    labels = [_hung_label(name, equilibrium.environment.gravity) for name in names]
    return [labels[i] for i in np.argmax(effective, axis=0)]


def _hung_label(motion: str, gravity: Float[np.ndarray, "3"]) -> str:
    """The usual name of a rigid motion of a hanging article; without gravity it keeps its own."""
    what, _, axis = motion.partition(" ")
    if what == "gimbal":
        return f"payload pendulum {axis}"
    if what == "slide" or not np.any(gravity):
        return motion
    vertical = axis == AXES[int(np.argmax(np.abs(gravity)))]
    if what == "translation":
        return "bounce" if vertical else f"pendulum {axis}"
    return "yaw" if vertical else f"tilt {axis}"
