"""Loops whose gain stays at one or above at infinite frequency: any additional delay destabilises them.

The delayed loop is of neutral type, with a chain of roots whose real parts tend to log(gain)/delay (Hale and
Verduyn Lunel 1993, section 9.6): however short the delay, infinitely many roots are unstable.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Complex, Float

from middeck.control.analysis.loop.feedback_loop import At, FeedbackLoop, broken_at
from middeck.systems.plants.plant import remove_delays

AT_ONE = 1e-9
"""Distance below one at which a gain counts as one: rounding of a few products."""
TURNS = 720
"""Number of phases tried for a wave that returns through delayed paths: steps of half a degree."""


def bears_no_delay(loop: FeedbackLoop, at: At) -> Bool[np.ndarray, " channel"]:
    """Whether any additional delay of a channel destabilises the stable loop, the other channels closed.

    Direct paths without delay are decided by the gain at infinite frequency. Under equal delays, a further
    delay turns the channel's part of the wave against the others by any angle. Under unequal delays a stable
    loop tolerates all angles (`direct_gain`).
    """
    count = len(broken_at(loop, at))
    if loop.plant.period_s is not None:
        return np.zeros(count, dtype=bool)
    through, law = remove_delays(loop.plant).system.D, loop.law.D
    delays = loop.plant.delay_s[through != 0.0]
    if not delays.size or not np.any(law):
        return np.zeros(count, dtype=bool)
    around = [law @ through] if at == "inputs" else [through @ law]
    around = [law @ through, through @ law] if at == "both" else around
    gain = [
        _gain_alone(P, i) if not np.any(delays) else _most_turned(P, i)
        for P in around
        for i in range(len(P))
    ] if np.all(delays == delays[0]) else [0.0] * count  # fmt: skip
    return np.array([g >= 1.0 - AT_ONE for g in gain], dtype=bool)


def _gain_alone(P: Float[np.ndarray, "channel channel"], i: int) -> float:
    """Direct gain of channel i around the loop, the others closed."""
    others = np.arange(len(P)) != i
    rest = np.eye(len(P) - 1) - P[np.ix_(others, others)]
    if np.linalg.matrix_rank(rest) < len(rest):
        return np.inf
    return float(abs(P[i, i] + P[i, others] @ np.linalg.solve(rest, P[others, i])))


def _most_turned(P: Float[np.ndarray, "channel channel"], i: int) -> float:
    """Largest spectral radius over all phase angles of channel i's input."""
    if len(P) == 1:
        return float(abs(P[0, 0]))
    turn: Complex[np.ndarray, "turn one channel"] = np.ones((TURNS, 1, len(P)), dtype=complex)
    turn[:, 0, i] = np.exp(2j * np.pi * np.arange(TURNS) / TURNS)
    return float(np.abs(np.linalg.eigvals(P * turn)).max())
