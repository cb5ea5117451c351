"""Joints within their travel: what a mechanism's stops allow."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import EquilibriumError
from middeck.structure.model.article import Structure


def check_travel(structure: Structure, angle: Float[np.ndarray, " joint"]) -> None:
    """Raise `EquilibriumError` where a sprung joint would rest beyond its stops.

    Held joints are checked with the structure; a sprung one goes where its load puts it.
    """
    for joint, at in zip(structure.joints, angle, strict=True):
        low, high = joint.travel
        if not low <= at <= high:
            unit = "m" if joint.slides else "rad"
            raise EquilibriumError(
                f"joint {joint.name!r} would rest at {at:.4g} {unit}, beyond its travel {low:g} to {high:g}",
                where=f"joint {joint.name!r}",
                hint="a stiffer spring, or one that is unstressed on the other side (rest), centres it",
                angle=float(at),
            )
