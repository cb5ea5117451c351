"""A cable cannot push: rest states in which one would are refused."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import EquilibriumError


def refuse_slack_cables(devices: Sequence[str], tension: Float[np.ndarray, " tie"]) -> None:
    """`EquilibriumError` where a cable has no tension; the springs that follow the ``devices`` may push."""
    pull = dict(zip(devices, map(float, tension), strict=False))
    slack = {name: value for name, value in pull.items() if value <= 0.0}
    if slack:
        named = ", ".join(f"{name!r} ({value:.3f} N)" for name, value in slack.items())
        raise EquilibriumError(
            f"slack at equilibrium: the cable of {named}",
            where="suspension",
            hint="a cable cannot push: move the attach points, take a device away or lower its stiffness",
            tension_n=pull,
        )
