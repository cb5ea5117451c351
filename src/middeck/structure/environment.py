"""Where the structure is: gravity, and what holds it up. Joined to the article by attach-point names."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.article import Structure
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

    @staticmethod
    def lab(
        structure: Structure, *, cable_length: float = 4.0, bounce_hz: float = 0.25, gravity: float = 9.80665
    ) -> Environment:
        """Gravity along -y and a cable at every attach point of ``structure``.

        For an article along x: the reactions are found with y and z held at each point, and x at the middle
        one only, so that the held article is not strained. Raises `ConfigError` if there is no attach point.
        """
        attach = tuple(point.name for point in structure.attach_points)
        if not attach:
            raise ConfigError(
                "no attach point to hang from",
                where=f"structure {structure.title!r}",
                hint="give it attach_points, or use Environment.orbit()",
            )
        middle = len(attach) // 2
        held = tuple("xyz" if i == middle else "yz" for i in range(len(attach)))
        down = np.array([0.0, -gravity, 0.0])
        return Environment("lab", down, Suspension(attach, held, cable_length, bounce_hz))
