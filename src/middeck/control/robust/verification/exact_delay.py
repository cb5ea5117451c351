"""Growth rates of loops with delays: poles of a fine Pade approximation, corrected with exp(-s tau)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.h2.closed_cost import Law
from middeck.control.law.partition import partition_modes
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.poles.stability import growth_limits

RIGHTMOST, NEWTON_STEPS = 6, 3
DECIDES = 30.0
NEAR, DOUBT = 1e-3, 2.0
"""Largest correction relative to the pole; a root further away belongs to another pole. And from how many of
these corrections on a pole's distance from its limit leaves nothing to decide."""


def exact_growth(
    plants: Sequence[Plant], law: Law, poles: Sequence[Complex[np.ndarray, " state"]]
) -> Float[np.ndarray, " plant"]:
    """Largest growth of each loop's roots beyond their `growth_limits`; ``poles`` have approximated delays.

    Of the poles furthest right, those that a correction of `NEAR` can carry across their limit are carried
    by Newton steps on det(I - K(s) G(s)) to roots with the exact delay. Where that determinant has no root
    nearby (a pole that the loop does not move) the pole itself counts.
    """
    return np.array([_growth(p, law, values) for p, values in zip(plants, poles, strict=True)], dtype=float)


def _growth(plant: Plant, law: Law, values: np.ndarray) -> float:
    if not plant.delayed:
        return _beyond(values)
    roots = values[np.imag(values) >= 0.0]
    roots = roots[np.argsort(-np.real(roots))]
    lead = roots[:RIGHTMOST]
    open_ = np.abs(np.real(lead) - growth_limits(lead)) <= DOUBT * NEAR * np.abs(lead)
    # Roots so far left that exp(-s tau) overflows do not decide stability.
    open_ &= -np.real(lead) * plant.delay_s.max(initial=0.0) < DECIDES
    if open_.any():
        lead[open_] = _corrected(plant, law, lead[open_])
    return _beyond(roots)


def _beyond(roots: Complex[np.ndarray, " root"]) -> float:
    return float((np.real(roots) - growth_limits(roots)).max(initial=-np.inf))


def _corrected(plant: Plant, law: Law, poles: Complex[np.ndarray, " pole"]) -> Complex[np.ndarray, " pole"]:
    active = remove_delays(partition_modes(plant).active)
    system = active.system
    u, y = active.input_indices(active.u), active.output_indices(active.y)
    delay_s = plant.delay_s[np.ix_(y, u)]
    G = system.A, system.B[:, u], system.C[y], system.D[np.ix_(y, u)]
    root, near = poles.copy(), np.ones(len(poles), dtype=bool)
    for _ in range(NEWTON_STEPS):
        try:
            g, dg = _transfer(*G, root)
            k, dk = _transfer(law.A, law.B, law.C, np.zeros((len(u), len(y))), root)
            delay = np.exp(-root[:, None, None] * delay_s)
            g, dg = g * delay, (dg - delay_s * g) * delay
            loop = np.eye(len(u)) - k @ g
            # d log det M / ds = tr(M^-1 M'); the step of Newton is minus its inverse.
            slope = np.trace(np.linalg.solve(loop, -(dk @ g + k @ dg)), axis1=1, axis2=2)
        except np.linalg.LinAlgError:  # exactly on a root, or on a pole that the loop does not move
            break
        step = np.divide(-1.0, slope, out=np.zeros_like(slope), where=np.abs(slope) > 0.0)
        # An iterate away from its pole belongs to another, or diverges.
        near = near & (np.abs(root + step - poles) <= NEAR * np.abs(poles))
        root = np.where(near, root + step, poles)
    return root


def _transfer(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, s: np.ndarray
) -> tuple[Complex[np.ndarray, "pole output input"], Complex[np.ndarray, "pole output input"]]:
    """C (s - A)^-1 B + D and its derivative, at several s."""
    resolvent = s[:, None, None] * np.eye(len(A)) - A
    first = np.linalg.solve(resolvent, np.broadcast_to(B.astype(complex), (len(s), *B.shape)))
    return C @ first + D, -C @ np.linalg.solve(resolvent, first)
