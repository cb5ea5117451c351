"""The torques that the elements of joints exert within a step, and where the joints end: solved together."""

from __future__ import annotations

import numpy as np

from middeck.errors import NumericalError
from middeck.joints.element import JointElement
from middeck.joints.friction import Friction

MOST_ITERATIONS = 100
"""A root between brackets takes 60 halvings at most; Newton's method takes three or four."""


def balance_torques(
    elements: list[tuple[JointElement, ...]],
    inner: list[list[float]],
    begin: list[float],
    free: list[float],
    compliance: list[list[float]],
    guess: list[float],
) -> list[float]:
    """Mean torques T with end = free - compliance T and T = T(end), joint after joint until none moves.

    A monotone law and a symmetric positive compliance are the gradient of a convex function, on which
    descent along one coordinate after the other converges. One joint is done in one go.
    """
    if len(elements) == 1:
        return [_balance_one(elements[0], inner[0], begin[0], free[0], compliance[0][0])[0]]
    torque = list(guess)
    for _ in range(MOST_ITERATIONS):
        moved = 0.0
        for j, parts in enumerate(elements):
            row, others = compliance[j], 0.0
            for i, other in enumerate(torque):
                if i != j:
                    others += row[i] * other
            own = row[j]
            new, end = _balance_one(parts, inner[j], begin[j], free[j] - others, own)
            # Rounding of the end angle, seen as a torque.
            noise = 4e-16 * (abs(end) + abs(begin[j])) / own
            change = abs(new - torque[j]) - 1e-14 * abs(new) - noise
            moved = change if change > moved else moved
            torque[j] = new
        if moved <= 0.0:
            return torque
    raise NumericalError(
        "the torques of the joints' elements do not settle within a step", hint="take a shorter internal step"
    )


def _balance_one(
    parts: tuple[JointElement, ...], states: list[float], begin: float, free: float, compliance: float
) -> tuple[float, float]:
    """Mean torque and end angle of one joint: the bracketed root of a function of slope one or more."""
    if len(parts) == 1 and isinstance(parts[0], Friction):
        torque = parts[0].balance(begin, free, states[0], compliance)
        return torque, free - compliance * torque
    low, high = -np.inf, np.inf
    end = free
    torque = 0.0
    for _ in range(MOST_ITERATIONS):
        torque = slope = 0.0
        for part, state in zip(parts, states, strict=True):
            mean, rise = part.mean_torque(begin, end, state)
            torque += mean
            slope += rise
        over = end - free + compliance * torque
        if over > 0.0:
            high = end
        else:
            low = end
        new = end - over / (1.0 + compliance * slope)
        if not low <= new <= high:
            new = 0.5 * (low + high)
        if abs(new - end) <= 4e-16 * (abs(end) + abs(begin)):
            break
        end = new
    return torque, end
