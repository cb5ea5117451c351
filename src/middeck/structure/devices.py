"""Springs and cables between two points: energy, force and tangent.

A spring at length l pulls with T = preload + k (l - length); its energy is preload (l - length) +
k (l - length)^2 / 2. A cable is the same law and must not push.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.values import record


@record
class SpringLaw:
    """Preload [N] at ``length`` [m] and stiffness [N/m] of each spring."""

    preload: Float[np.ndarray, " spring"]
    stiffness: Float[np.ndarray, " spring"]
    length: Float[np.ndarray, " spring"]


@record
class SpringState:
    """Tension [N], energy [J], gradient and Hessian in (x of end, x of start)'s difference end - start."""

    tension: Float[np.ndarray, " spring"]
    energy: Float[np.ndarray, " spring"]
    gradient: Float[np.ndarray, "spring 3"]
    hessian: Float[np.ndarray, "spring 3 3"]


def spring_state(law: SpringLaw, span: Float[np.ndarray, "spring 3"]) -> SpringState:
    """State of springs whose end minus start is ``span``; a span of zero length has no direction."""
    length = np.linalg.norm(span, axis=1)
    n = span / length[:, None]
    stretch = length - law.length
    tension = law.preload + law.stiffness * stretch
    nn = n[:, :, None] * n[:, None, :]
    hessian = law.stiffness[:, None, None] * nn + (tension / length)[:, None, None] * (np.eye(3) - nn)
    energy = law.preload * stretch + 0.5 * law.stiffness * stretch**2
    return SpringState(tension, energy, tension[:, None] * n, hessian)
