"""Warnings for modes between suspension and flexible, and for modes damped as the other kind."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.structure.modes.kinds import HELD, kinds_by_rank, undecided
from middeck.structure.rest.equilibrium import Equilibrium

CURE = "keep the two apart by a softer suspension (bounce_hz, cable_length) or a stiffer article"


def kind_warnings(
    equilibrium: Equilibrium,
    omega: Float[np.ndarray, " mode"],
    kind: tuple[str, ...],
    name: tuple[str, ...],
    rigid_share: Float[np.ndarray, " mode"],
    strain_share: Float[np.ndarray, " mode"],
) -> tuple[str, ...]:
    """One sentence for each such mode: its frequency, what depends on its kind, and what to do."""
    damping = equilibrium.model.structure.damping
    ranked = kinds_by_rank(equilibrium, kind) if damping.by_rank else kind
    doubted = set(undecided(rigid_share, strain_share).tolist()) | {
        m for m in range(len(kind)) if ranked[m] != kind[m]
    }
    shares = [
        (f"its strain share is {s:.0%}", f"{r:.0%}") for s, r in zip(strain_share, rigid_share, strict=True)
    ]
    said: list[str] = []
    for m in sorted(doubted):
        strain, rigid = shares[m]
        called = f"mode {m} {name[m]!r} at {omega[m] / (2.0 * np.pi):.4g} Hz"
        if damping.by_rank:
            ratio = damping.suspension if ranked[m] in HELD else damping.flexible
            said.append(
                f"{called} is damped as {ranked[m]} by rank, but {strain} and {rigid} of its motion is "
                f"rigid, which makes it {kind[m]}: its ratio {ratio:g} may be that of the wrong kind, and "
                f'its peak wrong in height; damping.rule = "shares" weighs both ratios by energy'
            )
        else:
            loosely = "suspension" if equilibrium.model.held is None else "rigid motion"
            said.append(
                f"{called} is part {loosely}, part flexible: {rigid} of its motion is rigid, and {strain}; "
                f"it counts as {kind[m]}, but its name, damping ratio and partner in orbit are uncertain; "
                f"{CURE}, or give it its own ratio ([damping.mode])"
            )
    return tuple(said)
