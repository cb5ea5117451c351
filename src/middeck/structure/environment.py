"""Where the structure is: gravity, and what holds it up. Joined to the article by attach-point names."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.values import record


@record
class Suspension:
    """One cable per attach point, rising to an anchor straight above the undeformed attach point.

    The force along a cable is R + k (length - cable_length), with R the vertical reaction when the article
    is pinned at its attach points, and k = (R/g) (2 pi bounce_hz)^2.

    Parameters
    ----------
    attach:
        Names of the attach points that hang on a cable.
    held:
        World directions ("xyz" letters) held at each of them while the reactions are found.
    cable_length:
        Loaded length [m]; it sets the pendulum stiffness.
    bounce_hz:
        Bounce frequency to which every device is tuned.
    """

    attach: tuple[str, ...]
    held: tuple[str, ...]
    cable_length: float
    bounce_hz: float


@record
class AnchoredSpring:
    """A linear spring from an attach point to a fixed anchor in W: stiffness [N/m], free length [m]."""

    name: str
    attach: str
    anchor: Float[np.ndarray, "3"]
    stiffness: float
    free_length: float


@record
class Environment:
    """Gravity vector in the world frame [m/s^2], the suspension and further springs to ground, if any.

    >>> Environment.orbit().gravity.tolist()
    [0.0, 0.0, 0.0]
    """

    title: str
    gravity: Float[np.ndarray, "3"]
    suspension: Suspension | None = None
    springs: tuple[AnchoredSpring, ...] = ()

    @staticmethod
    def orbit() -> Environment:
        """Zero gravity, no suspension: the free, undeformed structure."""
        return Environment("orbit", np.zeros(3))
