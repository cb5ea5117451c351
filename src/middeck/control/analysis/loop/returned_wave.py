"""The wave around a delayed loop at frequencies so high that only its direct terms are left.

There the loop depends on the phases w T_k of their delays T_k only, and repeats with each turn of the largest
time of which all are multiples (a neutral equation; Hale and Verduyn Lunel 1993, section 9.6). Delays without
such a time come as near as wanted to all phases at once (Kronecker).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.loop.feedback_loop import FeedbackLoop
from middeck.systems.plants.plant import remove_delays
from middeck.values import record

STEPS = 360
"""Phases of each turn of the longest delay."""
MOST, PARTS = 200, 40
"""The largest multiple of their common time that delays may be; and the parts of the longest to which they
are rounded where there is none, for lines alone."""
COMMON = 1e-9
"""Distance from a multiple, relative to the common time, within which a delay is one."""


@record
class ReturnedWave:
    """The direct terms of a loop; the plant's have delays that are multiples of one time.

    Attributes:
        through: The plant's.
        law: The compensator's.
        multiples: Delay of each path of the plant, as a multiple of ``common_s``.
        common_s: The common time [s].
    """

    through: Float[np.ndarray, "output input"]
    law: Float[np.ndarray, "input output"]
    multiples: Float[np.ndarray, "output input"]
    common_s: float

    @property
    def turn(self) -> Float[np.ndarray, " phase"]:
        """Phases [rad] of one turn of the common time."""
        return np.linspace(0.0, 2.0 * np.pi, STEPS * int(self.multiples.max()) + 1)

    def halves(self, s: np.ndarray) -> tuple[Complex[np.ndarray, "phase output input"], np.ndarray]:
        """G and K, where the common time is a phase of the imaginary ``s`` [rad]."""
        return self.halves_at(np.asarray(s, dtype=complex)[:, None, None] * self.multiples)

    def halves_at(
        self, lag: Complex[np.ndarray, "phase output input"]
    ) -> tuple[Complex[np.ndarray, "phase output input"], np.ndarray]:
        """G and K where each path turns by an imaginary lag [rad] for its own."""
        G = np.exp(-lag) * self.through
        return G, np.broadcast_to(self.law.astype(complex), (len(G), *self.law.shape))


def returned_wave(loop: FeedbackLoop) -> ReturnedWave | None:
    """The wave that returns through the direct terms of a loop; None without a delay, of delays without a
    common time, and where nothing returns.
    """
    if loop.plant.period_s is not None or not loop.plant.delayed:
        return None
    through, law = remove_delays(loop.plant).system.D, loop.law.D
    delays = np.unique(loop.plant.delay_s[through != 0.0])
    if not np.any(law @ through) or not delays.max():
        return None
    common_s = common_time(delays[delays > 0.0])
    if common_s is None:
        return None
    multiples = np.where(through != 0.0, np.round(loop.plant.delay_s / common_s), 0.0)
    return ReturnedWave(through, law, multiples, common_s)


def common_time(delay_s: Float[np.ndarray, " delay"]) -> float | None:
    """The largest time [s] of which all delays are multiples, `MOST` at most; None where there is none.

    >>> round(common_time(np.array([0.010, 0.004])), 9)
    0.002
    """
    shortest, longest = delay_s.min(), delay_s.max()
    for part in range(1, int(MOST * shortest / longest) + 1):
        multiple = delay_s * part / shortest
        if np.all(np.abs(multiple - np.round(multiple)) < COMMON * part):
            return float(shortest / part)
    return None


def repeating_loop(loop: FeedbackLoop) -> tuple[FeedbackLoop, ReturnedWave | None]:
    """The loop with the wave that returns; with rounded delays where its own have no common time.

    The rounded ones are for lines alone. None, and the loop as it is, where nothing returns.
    """
    wave = returned_wave(loop)
    if wave is not None or not loop.plant.delayed:
        return loop, wave
    even = _with_common_time(loop)
    wave = returned_wave(even)
    return (loop if wave is None else even), wave


def _with_common_time(loop: FeedbackLoop) -> FeedbackLoop:
    """The loop with its delays rounded to parts of the longest, one at least: whose lines are those of the
    loop, and whose waves return where those of the loop do."""
    delay_s = loop.plant.delay_s
    part_s = float(delay_s.max()) / PARTS
    parts = np.where(delay_s > 0.0, np.maximum(np.round(delay_s / part_s), 1.0), 0.0)
    return dataclasses.replace(loop, plant=dataclasses.replace(loop.plant, delay_s=parts * part_s))
