"""Proof that a sampled system does not decay."""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.realtime.gate.norm_bound import is_positive, rounding_of_sums
from middeck.systems.state_space.balancing import balance


def is_proved_to_grow(
    A: Float[np.ndarray, "state state"], size: Float[np.ndarray, "state state"], error: float
) -> bool:
    """Whether every matrix within ``error`` times ``size`` of ``A``, entry by entry, has a growing motion.

    A P with A' P A < P and x' P x < 0 for one x proves it: along that motion x' P x falls from below zero
    (Lyapunov's theorem of instability; LaSalle 1976, "The Stability of Dynamical Systems").

    >>> one = np.ones((1, 1))
    >>> is_proved_to_grow(1.01 * one, one, 1e-12), is_proved_to_grow(0.99 * one, one, 1e-12)
    (True, False)
    """
    balanced, units = balance(A)
    size = size * units / units[:, None]
    values, vectors = np.linalg.eig(balanced)
    if not np.abs(values).max(initial=0.0) > 1.0:
        return False
    lead = vectors[:, np.argmax(np.abs(values))]
    x = max(np.real(lead), np.imag(lead), key=lambda part: float(np.linalg.norm(part)))
    try:
        solved = np.asarray(sla.solve_discrete_lyapunov(balanced.T, np.eye(len(A))))
    except np.linalg.LinAlgError:
        return False
    P = 0.5 * (solved + solved.T)
    terms = rounding_of_sums(2 * len(A) + 8)
    magnitude, worth = np.abs(P), np.abs(balanced) + error * size
    lost = terms * (worth.T @ magnitude @ worth + magnitude)
    moved = error * (size.T @ magnitude @ worth + worth.T @ magnitude @ size)
    falls = is_positive(P - balanced.T @ P @ balanced, lost + moved)
    return falls and float(x @ P @ x) < -terms * float(np.abs(x) @ magnitude @ np.abs(x))
