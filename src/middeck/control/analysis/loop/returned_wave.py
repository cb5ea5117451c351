"""The wave around a delayed loop at frequencies so high that only its direct terms are left.

There the loop depends on the phase w T of their common delay T only: each turn of it repeats (a neutral
equation; Hale and Verduyn Lunel 1993, section 9.6).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.loop.feedback_loop import FeedbackLoop
from middeck.systems.plants.plant import remove_delays
from middeck.values import record

TURN = np.linspace(0.0, 2.0 * np.pi, 361)
"""Phases [rad] of one turn of the delay."""


@record
class ReturnedWave:
    """The direct terms of a loop; the plant's have one delay.

    Attributes:
        through: The plant's.
        law: The compensator's.
        delay_s: The delay [s] of all paths with a direct term.
    """

    through: Float[np.ndarray, "output input"]
    law: Float[np.ndarray, "input output"]
    delay_s: float

    def halves(self, s: np.ndarray) -> tuple[Complex[np.ndarray, "phase output input"], np.ndarray]:
        """G and K, where the delay is a phase of the imaginary ``s`` [rad]."""
        G = np.exp(-np.asarray(s, dtype=complex))[:, None, None] * self.through
        return G, np.broadcast_to(self.law.astype(complex), (len(G), *self.law.shape))


def returned_wave(loop: FeedbackLoop) -> ReturnedWave | None:
    """The wave that returns through the direct terms of a loop; None without a delay, for different delays,
    and where nothing returns.
    """
    if loop.plant.period_s is not None or not loop.plant.delayed:
        return None
    through, law = remove_delays(loop.plant).system.D, loop.law.D
    late = loop.plant.delay_s[through != 0.0]
    if not np.any(law @ through) or not late[0] or np.any(late != late[0]):
        return None
    return ReturnedWave(through, law, float(late[0]))
