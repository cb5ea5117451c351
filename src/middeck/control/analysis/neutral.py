"""Loops whose gain stays at one or above at infinite frequency: the least further delay is one too many.

A delay makes an equation of neutral type of them, with a chain of roots whose real parts go to
log(gain)/delay (Hale and Verduyn Lunel 1993, section 9.6): however short the delay, infinitely many grow.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Complex, Float

from middeck.control.analysis.loop import At, FeedbackLoop, broken_at
from middeck.systems.plant import remove_delays

AT_ONE = 1e-9
"""A gain this near to one counts as one: rounding of a few products, and on the axis is not stable."""
TURNS = 720
"""Phases at which a wave that comes back by delayed paths is looked at: to half a degree."""


def bears_no_delay(loop: FeedbackLoop, at: At) -> Bool[np.ndarray, " channel"]:
    """Channel by channel, whether the stable loop is lost to any further delay there, the others closed.

    Where the direct paths are on time, by the gain at infinite frequency. Where they are delayed alike, a
    further delay turns this channel's part of the wave against the others' by any angle. Where they are
    delayed unlike, a stable loop bears any angles of them all (`direct_gain`).
    """
    count = len(broken_at(loop, at))
    if loop.plant.period_s is not None:
        return np.zeros(count, dtype=bool)
    through, law = remove_delays(loop.plant).system.D, loop.law.D
    late = loop.plant.delay_s[through != 0.0]
    if not late.size or not np.any(law):
        return np.zeros(count, dtype=bool)
    around = [law @ through] if at == "inputs" else [through @ law]
    around = [law @ through, through @ law] if at == "both" else around
    gain = [
        _gain_alone(P, i) if not np.any(late) else _most_turned(P, i)
        for P in around
        for i in range(len(P))
    ] if np.all(late == late[0]) else [0.0] * count  # fmt: skip
    return np.array([g >= 1.0 - AT_ONE for g in gain], dtype=bool)


def _gain_alone(P: Float[np.ndarray, "channel channel"], i: int) -> float:
    """Of channel i round the loop, the others closed; none where those alone have no solution."""
    others = np.arange(len(P)) != i
    rest = np.eye(len(P) - 1) - P[np.ix_(others, others)]
    if np.linalg.matrix_rank(rest) < len(rest):
        return np.inf
    return float(abs(P[i, i] + P[i, others] @ np.linalg.solve(rest, P[others, i])))


def _most_turned(P: Float[np.ndarray, "channel channel"], i: int) -> float:
    """The largest spectral radius with what goes into channel i turned by any angle."""
    if len(P) == 1:
        return float(abs(P[0, 0]))
    turn: Complex[np.ndarray, "turn one channel"] = np.ones((TURNS, 1, len(P)), dtype=complex)
    turn[:, 0, i] = np.exp(2j * np.pi * np.arange(TURNS) / TURNS)
    return float(np.abs(np.linalg.eigvals(P * turn)).max())
