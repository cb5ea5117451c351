"""Warnings for modes between suspension and flexible, and for modes damped as the other kind."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.structure.modes.names.kinds import HELD, kinds_by_rank, undecided
from middeck.structure.rest.equilibrium import Equilibrium

SHOWN = 6
CURE = "keep the two apart by a softer suspension (bounce_hz, cable_length) or a stiffer article"


def kind_warnings(
    equilibrium: Equilibrium,
    omega: Float[np.ndarray, " mode"],
    kind: tuple[str, ...],
    name: tuple[str, ...],
    rigid_share: Float[np.ndarray, " mode"],
    strain_share: Float[np.ndarray, " mode"],
) -> tuple[str, ...]:
    """One sentence for all such modes: their frequencies, what depends on their kind, and what to do."""
    damping = equilibrium.model.structure.damping
    ranked = kinds_by_rank(equilibrium, kind) if damping.by_rank else kind
    doubted = set(undecided(rigid_share, strain_share).tolist()) | {
        m for m in range(len(kind)) if ranked[m] != kind[m]
    }
    if not doubted:
        return ()
    ratio = {k: damping.suspension if k in HELD else damping.flexible for k in set(ranked)}
    loosely = "suspension" if equilibrium.model.held is None else "rigid motion"
    said: list[str] = []
    for m in sorted(doubted):
        called = f"mode {m} {name[m]!r} at {omega[m] / (2.0 * np.pi):.4g} Hz"
        shares = f"its strain share is {strain_share[m]:.0%} and {rigid_share[m]:.0%} of its motion is rigid"
        said.append(
            f"{called} is damped as {ranked[m]} ({ratio[ranked[m]]:g}) by rank, but {shares}, which makes it "
            f"{kind[m]}"
            if damping.by_rank
            else f"{called} is part {loosely}, part flexible: {shares}, so that it counts as {kind[m]}"
        )
    listed = "; ".join(said[:SHOWN]) + (f"; and {len(said) - SHOWN} more modes" if len(said) > SHOWN else "")
    if damping.by_rank:
        return (
            f"{listed}. A ratio of the wrong kind makes a peak wrong in height; "
            'damping.rule = "shares" weighs both ratios by energy',
        )
    return (
        f"{listed}. Name, damping ratio and partner in orbit of such a mode are uncertain; {CURE}, or give "
        "it its own ratio ([damping.mode])",
    )
