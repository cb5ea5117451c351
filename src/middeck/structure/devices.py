"""Springs and cables between two points: energy, force and tangent.

A spring at length l pulls with T = preload + k (l - length); its energy is preload (l - length) +
k (l - length)^2 / 2. A cable is the same law and must not push.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import EquilibriumError
from middeck.values import record


@record
class SpringLaw:
    """Preload [N] at ``length`` [m] and stiffness [N/m] of each spring."""

    preload: Float[np.ndarray, " spring"]
    stiffness: Float[np.ndarray, " spring"]
    length: Float[np.ndarray, " spring"]


@record
class SpringState:
    """Tension [N], energy [J], gradient and Hessian in the difference, end minus start."""

    tension: Float[np.ndarray, " spring"]
    energy: Float[np.ndarray, " spring"]
    gradient: Float[np.ndarray, "spring 3"]
    hessian: Float[np.ndarray, "spring 3 3"]


def spring_state(law: SpringLaw, span: Float[np.ndarray, "spring 3"]) -> SpringState:
    """State of springs whose end minus start is ``span``.

    With c = preload - k length the force is (k + c/l) span: a spring of no free length has c = 0 and is
    linear everywhere, at l = 0 too. Raises `EquilibriumError` for any other spring whose ends coincide: its
    force has no direction.
    """
    k, c = law.stiffness, law.preload - law.stiffness * law.length
    length = np.linalg.norm(span, axis=1)
    if np.any((length == 0.0) & (c != 0.0)):
        raise EquilibriumError(
            "the ends of a spring coincide, so that its force has no direction",
            hint="move its anchor or attach point, or give it a free length of zero",
        )
    length_or_one = np.where(length > 0.0, length, 1.0)
    n = span / length_or_one[:, None]
    c_per_length = c / length_or_one
    tension = c + k * length
    stretch = length - law.length
    energy = law.preload * stretch + 0.5 * k * stretch**2
    across = np.eye(3) - n[:, :, None] * n[:, None, :]
    hessian = k[:, None, None] * np.eye(3) + c_per_length[:, None, None] * across
    return SpringState(tension, energy, (k + c_per_length)[:, None] * span, hessian)
