"""Names of modes, from participation in rigid motions and from strain energy."""

from __future__ import annotations

from collections import Counter

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from middeck.structure.modes.kinds import HELD
from middeck.structure.modes.rigid import AXES, rigid_motions
from middeck.structure.modes.strain import PARTS, strain_energy
from middeck.structure.rest.equilibrium import Equilibrium

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")


def name_modes(
    equilibrium: Equilibrium,
    M: sp.csr_array,
    shapes: Float[np.ndarray, "coordinate mode"],
    kind: tuple[str, ...],
    rigid_names: tuple[str, ...],
) -> tuple[str, ...]:
    """Names of modes, the rigid ones first.

    One that something else than strain holds has the name of the rigid motion that takes the largest part of
    its mass, a flexible one that of the part where most of its strain energy is.
    """
    strain = strain_energy(equilibrium, shapes)
    held = [m for m, k in enumerate(kind) if k in HELD]
    hung = dict(zip(held, _hung_names(equilibrium, M, shapes[:, held]), strict=True))
    names: list[str] = list(rigid_names)
    count: Counter[str] = Counter()
    for m in range(len(rigid_names), len(kind)):
        base = hung.get(m, PARTS[int(np.argmax(strain[m]))])
        count[base] += 1
        names.append(_numbered(base, count[base]) if m in hung else f"{_ordinal(count[base])} {base}")
    return tuple(names)


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
