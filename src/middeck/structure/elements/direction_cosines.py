"""Cosines that links hold constant, by the poses of their frames: values, first and second derivatives.

All is made of two things. One is the motion of a frame as another sees it, a displacement and a rotation
vector (`bushings.RelativeMotion`), of which a constraint is a constant linear combination. The other is the
cosine of an angle between a direction p = Q_A a of one frame and q = Q_B b of the other,

    d(p.q) = (p x q).(theta_A - theta_B),
    d2(p.q) = theta'(sym(pq') - (p.q)1)theta for each frame,  theta_A'((p.q)1 - qp')theta_B for both,

in the chart exp(theta) R of a pose, which has no angle at which it ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Inexact

from middeck.structure.elements.bushings import TURN_A, TURN_B
from middeck.structure.elements.rotations import cross

Array = np.ndarray


class Cosines(NamedTuple):
    """Change since drawn of cosines between directions of two frames, with slope in both poses."""

    value: Inexact[np.ndarray, " cosine"]
    slope: Inexact[np.ndarray, "cosine 12"]
    p: Inexact[np.ndarray, "cosine 3"]
    q: Inexact[np.ndarray, "cosine 3"]

    def second_order(self, weight: Inexact[np.ndarray, " cosine"]) -> Inexact[np.ndarray, "cosine 12 12"]:
        """Second derivatives, each times its ``weight``."""
        pq = self.p[:, :, None] * self.q[:, None, :]
        qp = np.swapaxes(pq, 1, 2)
        dot = np.einsum("ci,ci->c", self.p, self.q)[:, None, None] * np.eye(3)
        out = np.zeros((len(weight), 12, 12), np.result_type(weight, pq))
        out[:, TURN_A, TURN_A] = out[:, TURN_B, TURN_B] = 0.5 * (pq + qp) - dot
        out[:, TURN_A, TURN_B] = dot - qp
        out[:, TURN_B, TURN_A] = dot - pq
        return weight[:, None, None] * out


def cosines(
    first: Inexact[np.ndarray, "cosine 3"],
    second: Inexact[np.ndarray, "cosine 3"],
    turn: Inexact[np.ndarray, "cosine 2 3 3"],
) -> Cosines:
    """Cosines between drawn directions of frames; ``turn``: rotations since drawn minus the identity."""
    moved_p, moved_q = (np.matvec(turn[:, k], n) for k, n in enumerate((first, second)))
    p, q = first + moved_p, second + moved_q
    value = np.sum(moved_p * second + first * moved_q + moved_p * moved_q, axis=1)
    normal = cross(p, q)
    slope = np.zeros((len(first), 12), np.result_type(normal))
    slope[:, TURN_A], slope[:, TURN_B] = normal, -normal
    return Cosines(value, slope, p, q)
