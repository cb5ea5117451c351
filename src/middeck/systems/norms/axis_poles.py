"""Outputs of infinite rms: a driven pole on the imaginary axis that they see.

A body held by its rate alone drifts: its place has no rms from zero frequency on, its rate has one. Beside a
pole at j w0 a regular response changes by less the nearer two lines are; one with a residue by more.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Complex

from middeck.systems.poles.stability import growth_limits, rest_limits

NEAR, NEARER = 1e-4, 1e-6
"""Distances of lines from the pole, over that of the next pole."""
SEEN = 1e-7
"""Least change between the nearer lines, over the response about the pole, that rounding of a single pole
without residue does not make."""


def on_axis(values: Complex[np.ndarray, " pole"], w1: float, w2: float) -> Bool[np.ndarray, " pole"]:
    """Whether each pole [rad/s] lies on the axis within the band, up to rounding."""
    omega, rate = np.abs(np.imag(values)), np.real(values)
    there = (rate >= -rest_limits(values)) & (rate <= growth_limits(values))
    return there & (omega >= w1) & (omega <= w2)


def unbounded_outputs(
    response: Callable[[np.ndarray], Complex[np.ndarray, "line output input"]],
    values: Complex[np.ndarray, " pole"],
    w1: float,
    w2: float,
) -> Bool[np.ndarray, " output"]:
    """Outputs that see a pole on the axis within ``w1`` to ``w2`` [rad/s], of all ``values``.

    Of several poles that coincide, which rounding may give a residue, an output in doubt is unbounded.
    """
    count = response(np.array([w2])).shape[1]
    found = np.zeros(count, dtype=bool)
    upper = np.real(values) + 1j * np.abs(np.imag(values))
    for w0 in np.unique(np.imag(upper[on_axis(values, w1, w2)])):
        apart = np.abs(np.concatenate([upper, np.conj(upper)]) - 1j * w0)
        scale = float(np.min(apart, where=apart > NEARER * w2, initial=w2))
        about = np.linalg.norm(response(w0 + scale * np.array([0.5, 1.0, 2.0])), axis=2).max(axis=0)
        wide, close = (
            np.linalg.norm(np.diff(response(w0 + d * scale * np.array([1.0, 2.0])), axis=0)[0], axis=1)
            for d in (NEAR, NEARER)
        )
        found |= (close > wide) & (close > SEEN * about)
    return found
