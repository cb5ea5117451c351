"""Bounds of poles in a search: no further than the lines of a response can determine.

A pole at a distance d outside the band with a decay rate far below d has the same response in the band as
one without damping. If the data would have it unstable, a search drives it to no damping at all, and outside
the band the model is worth nothing. It is held at a decay rate of a small share of d, where the band sees
what it would see of less. For the same reason nothing is faster than the band by many times, and a sampled
pair stays below half the sampling rate.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from middeck.identification.levenberg_marquardt import Step
from middeck.identification.problem.data import Data
from middeck.identification.problem.unknowns_layout import Layout

# Least decay rate of a pole outside the band, as a share of its distance. Complex constants follow in phase
# what that changes, which leaves its square: of a continuous model 1e-4 of the term at most, so that no mode
# of 1 % damping is held, however far outside. Between the band and half the sampling rate a sampled model
# has no room for far modes, and what noise asks for ends there: it is held farther off. Real constants
# follow nothing and are changed by 2e-4.
LEAST_DECAY_COMPLEX, LEAST_DECAY_SAMPLED, LEAST_DECAY_REAL = 0.01, 0.25, 0.02
# The least of all, as a share of the lowest line, and the most, as a multiple of the highest.
SLOWEST, FASTEST = 1e-9, 1e3
# A sampled pole that decays by exp(-30) in a period is at zero. A pair stays so close to pi / T.
DEADBEAT, BELOW_NYQUIST = 30.0, 0.999

Vector = Float[np.ndarray, " unknown"]


def bound_theta(layout: Layout, data: Data, theta: Vector) -> Vector:
    """``theta`` with each pole where it may be."""
    modes, pairs, T = len(layout.pair), layout.pairs, layout.options.period_s
    first, last = data.omega[0], data.omega[-1]
    found = theta.copy()
    highest = BELOW_NYQUIST * np.pi / T if T else FASTEST * last
    found[modes : modes + pairs] = np.clip(
        theta[modes : modes + pairs], np.log(SLOWEST * first), np.log(highest)
    )
    omega = np.concatenate([np.exp(found[modes : modes + pairs]), layout.fixed_imag[pairs:]])
    outside = np.maximum(np.maximum(first - omega, omega - last), 0.0)
    of_complex = LEAST_DECAY_SAMPLED if T else LEAST_DECAY_COMPLEX
    share = LEAST_DECAY_REAL if layout.options.real_constants else of_complex
    least = np.maximum(share * outside, SLOWEST * first)
    most = DEADBEAT / T if T else FASTEST * last
    found[:modes] = np.clip(theta[:modes], np.log(least), np.log(np.maximum(most, least)))
    return found


def bounded(
    layout: Layout, data: Data, evaluate: Callable[[Vector, float], Step | None]
) -> Callable[[Vector, float], Step | None]:
    """``evaluate`` at the bounded theta; what a bound holds against the gradient stays where it is."""

    def at_bounds(theta: Vector, below: float) -> Step | None:
        inside = bound_theta(layout, data, theta)
        step = evaluate(inside, below)
        if step is None or np.array_equal(inside, theta):
            return step
        held = (theta - inside) * step.gradient < 0.0
        gradient, gram = step.gradient.copy(), step.gram.copy()
        gradient[held], gram[held], gram[:, held] = 0.0, 0.0, 0.0
        gram[held, held] = np.max(np.diag(step.gram))
        return dataclasses.replace(step, gradient=gradient, gram=gram)

    return at_bounds
