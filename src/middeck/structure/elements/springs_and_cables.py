"""Springs and cables between two points: energy, force and tangent.

A spring at length l pulls with T = preload + k (l - length); its energy is preload (l - length) +
k (l - length)^2 / 2. A cable is the same law and must not push.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Inexact

from middeck.errors import EquilibriumError
from middeck.structure.elements.rotations import IDENTITY
from middeck.values import record


@record
class SpringLaw:
    """Preload [N] at ``length`` [m] and stiffness [N/m] of each spring."""

    preload: Inexact[np.ndarray, " spring"]
    stiffness: Inexact[np.ndarray, " spring"]
    length: Inexact[np.ndarray, " spring"]


@record(kw_only=True)
class SpringState:
    """Tension [N], energy [J], gradient and Hessian in the difference, end minus start.

    ``excess`` is what their own tension adds to the gradient where another has taken its place.

    The Hessian is the sum of the ``material`` part, along the spring, and the ``geometric`` one, the tension
    over the length across it.
    """

    tension: Inexact[np.ndarray, " spring"]
    energy: Inexact[np.ndarray, " spring"]
    gradient: Inexact[np.ndarray, "spring 3"]
    excess: Inexact[np.ndarray, "spring 3"]
    material: Inexact[np.ndarray, "spring 3 3"]
    geometric: Inexact[np.ndarray, "spring 3 3"]


NO_SPRINGS = SpringState(
    tension=np.zeros(0),
    energy=np.zeros(0),
    gradient=np.zeros((0, 3)),
    excess=np.zeros((0, 3)),
    material=np.zeros((0, 3, 3)),
    geometric=np.zeros((0, 3, 3)),
)


def spring_state(
    law: SpringLaw,
    span: Inexact[np.ndarray, "spring 3"],
    tension: Inexact[np.ndarray, " spring"] | None = None,
    moved: tuple[Inexact[np.ndarray, "spring 3"], Inexact[np.ndarray, "spring 3"]] | None = None,
) -> SpringState:
    """State of springs whose end minus start is ``span``; ``tension`` replaces their own.

    ``moved``, the span as drawn and by how much it has changed since, has digits that ``span`` has not.

    With c = preload - k length the force is (k + c/l) span: a spring of no free length has c = 0 and is
    linear everywhere, at l = 0 too. Raises `EquilibriumError` for any other spring whose ends coincide: its
    force has no direction.
    """
    k, c = law.stiffness, law.preload - law.stiffness * law.length
    n, length = _direction(span)
    if np.any((length == 0.0) & (c != 0.0)):
        raise EquilibriumError(
            "the ends of a spring coincide, so that its force has no direction",
            hint="move its anchor or attach point, or give it a free length of zero",
        )
    length_or_one = np.where(length == 0.0, 1.0, length)
    stretch = length - law.length if moved is None else _stretch(law, length, *moved)
    own = law.preload + k * stretch
    pull = own if tension is None else tension
    energy = law.preload * stretch + 0.5 * k * stretch**2
    along = n[:, :, None] * n[:, None, :]
    # T/l, and its limit k for a linear spring of no length.
    per_length = np.where(length == 0.0, k, pull / length_or_one)
    return SpringState(
        tension=pull,
        energy=energy,
        gradient=per_length[:, None] * span,
        excess=((own - pull) / length_or_one)[:, None] * span,
        material=k[:, None, None] * along,
        geometric=per_length[:, None, None] * (IDENTITY - along),
    )


def _stretch(law: SpringLaw, length: np.ndarray, drawn: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Elongation against the law's length: that as drawn, and l - l0 = (2 s0 + d) . d / (l + l0) since."""
    before = np.sqrt(np.einsum("si,si->s", drawn, drawn))
    both = np.where(length + before == 0.0, 1.0, length + before)
    return before - law.length + np.einsum("si,si->s", 2.0 * drawn + change, change) / both


def spring_squares(
    law: SpringLaw,
    drawn: Inexact[np.ndarray, "spring 3"],
    change: Inexact[np.ndarray, "spring 3"],
    apart: Inexact[np.ndarray, "spring 3 mode"],
    *,
    along_only: bool = False,
) -> Inexact[np.ndarray, "mode mode"]:
    """The Hessian applied to relative motions ``apart`` of the two ends, as a sum of squares.

    Of the part along the springs alone, or with what their tension over their length holds across them.
    """
    n, length = _direction(drawn + change)
    along = np.einsum("si,sim->sm", n, apart)
    out = along.T @ (law.stiffness[:, None] * along)
    if along_only:
        return out
    across = apart - n[:, :, None] * along[:, None, :]
    tension = spring_state(law, drawn + change, None, (drawn, change)).tension
    held = np.where(length == 0.0, law.stiffness, tension / np.where(length == 0.0, 1.0, length))
    return out + np.einsum("sim,s,sin->mn", across, held, across)


def predicted_tension(
    law: SpringLaw,
    drawn: Inexact[np.ndarray, "spring 3"],
    change: Inexact[np.ndarray, "spring 3"],
    apart: Inexact[np.ndarray, "spring 3"],
) -> Inexact[np.ndarray, " spring"]:
    """The tension after end and start have moved ``apart`` further, to first order."""
    n, _ = _direction(drawn + change)
    tension = spring_state(law, drawn + change, None, (drawn, change)).tension
    return tension + law.stiffness * np.einsum("si,si->s", n, apart)


def _direction(span: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors along springs, zero for those of no length, and the lengths; analytic."""
    length = np.sqrt(np.einsum("si,si->s", span, span))
    return span / np.where(length == 0.0, 1.0, length)[:, None], length
