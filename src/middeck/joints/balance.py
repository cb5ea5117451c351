"""Torques of joint elements within a step and end angles of the joints, solved together."""

from collections.abc import Callable, Sequence

import numpy as np

from middeck.errors import NumericalError
from middeck.joints.element import JointElement
from middeck.joints.friction import Friction

MOST_ITERATIONS = 100
"""Most iterations: 60 halvings of a bracket; Newton's method takes three or four."""
UNSETTLED = "the torques of the joints' elements do not settle within a step"


class Balance:
    """Mean torques T with end = free - compliance T and T = T(end), joint by joint until converged.

    A monotone law and a symmetric positive compliance are the gradient of a convex function, on which
    coordinate descent converges. One joint is solved directly.
    """

    def __init__(self, elements: Sequence[tuple[JointElement, ...]], compliance: list[list[float]]) -> None:
        self.joints = [
            (j, parts, _only_friction(parts), row[j], [(i, c) for i, c in enumerate(row) if i != j])
            for j, (parts, row) in enumerate(zip(elements, compliance, strict=True))
        ]

    def solve(
        self, inner: list[list[float]], begin: list[float], free: list[float], guess: list[float]
    ) -> list[float]:
        """Torques from the elements' states, the joints' start angles and their end angles without torque."""
        torque = guess.copy()
        alone = len(torque) == 1
        for _ in range(MOST_ITERATIONS):
            settled = True
            for j, parts, friction, own, others in self.joints:
                pushed = 0.0
                for i, coefficient in others:
                    pushed += coefficient * torque[i]
                left, last = free[j] - pushed, torque[j]
                if friction is not None:
                    new = friction(begin[j], left, inner[j][0], own)
                else:
                    new = _balance_one(parts, inner[j], begin[j], left, own)
                change = abs(new - last)
                if change > 0.0:
                    torque[j] = new
                    if settled:
                        # Rounding of the end angle, seen as a torque.
                        noise = 4e-16 * (abs(left - own * new) + abs(begin[j])) / own
                        settled = change <= 1e-14 * abs(new) + noise
            if settled or alone:
                return torque
        raise NumericalError(UNSETTLED, hint="more substeps in a tick")


def _only_friction(parts: tuple[JointElement, ...]) -> Callable[[float, float, float, float], float] | None:
    """`Friction.balance` of a joint that has friction alone."""
    return parts[0].balance if len(parts) == 1 and isinstance(parts[0], Friction) else None


def _balance_one(
    parts: tuple[JointElement, ...], states: list[float], begin: float, free: float, compliance: float
) -> float:
    """Mean torque of one joint: the bracketed root of a function of slope one or more."""
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
    return torque
