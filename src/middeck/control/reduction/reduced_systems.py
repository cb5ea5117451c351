"""Results of reductions."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from middeck.control.law.compensator import Compensator
from middeck.systems.plants.plant import Plant
from middeck.values import record


@record(kw_only=True)
class ReducedPlant:
    """A plant of lower order with the same ports.

    Attributes:
        plant: The reduced plant, modal if it was.
        order: Its states.
        kept, dropped: Names of the modes kept exactly, and of those left out.
        error: The largest error within the band.
    """

    plant: Plant
    order: int
    kept: tuple[str, ...]
    dropped: tuple[str, ...]
    error: float


@record(kw_only=True)
class ReducedCompensator(Compensator):
    """A compensator of lower order, with its errors against the original.

    Attributes:
        order: States.
        method: ``"performance"``, ``"stability"``, ``"coprime"`` or ``"balanced"``: the one that gave this
            law.
        steps: Attempts and their outcomes, in words.
        hankel: Singular values by which states were chosen; what they measure depends on the method.
        bound: 2 (sum of those left out) for ``"balanced"``, None for the others.
        error: Largest gain of the difference K - K_r over all frequencies, in the sizes of the ports.
        loop_error: Largest gain of (K - K_r) G (I - K G)^-1, one for each plant. Below one it proves
            stability, if K and K_r have equally many unstable poles (Anderson and Liu 1989).
        stable: Whether the loop with each plant is stable, delays exact (`decide_stability`).
        cost_ratio: H2 cost of each plant relative to that with the original; ``inf`` where unstable with
            approximated delays.
    """

    order: int
    steps: tuple[str, ...]
    hankel: Float[np.ndarray, " value"]
    bound: float | None
    error: float
    loop_error: Float[np.ndarray, " plant"]
    stable: Bool[np.ndarray, " plant"]
    cost_ratio: Float[np.ndarray, " plant"]
