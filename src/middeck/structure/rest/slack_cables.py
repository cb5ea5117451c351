"""A cable cannot push: refused where it would."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import EquilibriumError


def refuse_slack_reactions(attach: tuple[str, ...], reaction: np.ndarray) -> None:
    """While devices are tuned: `EquilibriumError` for an attach point that would be pushed up."""
    for name, value in zip(attach, reaction, strict=True):
        if value <= 0.0:
            raise EquilibriumError(
                f"the cable at {name!r} would be slack: its pinned reaction is {value:.3f} N",
                where=f"suspension at {name!r}",
                hint="move the attach points so that each carries load, or hang the article by fewer",
                reactions_n=dict(zip(attach, map(float, reaction), strict=True)),
            )


def refuse_slack_cables(devices: Sequence[str], tension: Float[np.ndarray, " tie"]) -> None:
    """Raise `EquilibriumError` at rest for a cable that would push; the springs that follow may push."""
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
