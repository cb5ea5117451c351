"""Rigid modes behind delays that are no sums: each double pole kept once, with what the delays add to it.

With R2 / s^2 + R1 / s + D from inputs to outputs and P(s) = 1 - s tau + s^2 ... for the delay of each path,

    R2 / s^2 + (R1 - tau R2) / s + R2 (P - 1 + s tau) / s^2 + R1 (P - 1) / s + D P,

path by path. Of P = D_p + C (s - A)^-1 B the last three are C A^-2, C A^-1 and C in front of the same states:
no pole at the origin. The first two have as many integrators as their ranks ask for. Where outputs see one
input at different times, one output less another is that input integrated once: a state of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.systems.modal import ModalSystem, output_rows
from middeck.systems.statespace import StateSpace, add

RANK = 1e-12
"""Singular values below this share of the largest are rounding of a few products."""


def approximate_late_rigid(
    rigid: ModalSystem, delay_s: Float[np.ndarray, "output input"], banks: Sequence[StateSpace]
) -> tuple[StateSpace, int]:
    """Rigid modes with P of each path; and how many states, the first, are integrators.

    ``banks`` hold, input by input, P to each output.
    """
    rows = output_rows(rigid)
    R2, R1 = rows.position @ rigid.psi, rows.rate @ rigid.psi
    whole = integrals = _integrate(R2, R1 - delay_s * R2)
    for i, late in enumerate(banks):
        once = np.linalg.solve(late.A.T, late.C.T).T
        twice = np.linalg.solve(late.A.T, once.T).T
        C = R2[:, [i]] * twice + R1[:, [i]] * once + rows.direct[:, [i]] * late.C
        drive = np.arange(len(banks))[None] == i
        whole = add(whole, StateSpace(late.A, late.B * drive, C, rows.direct[:, [i]] * late.D * drive))
    return whole, len(integrals.A)


def _integrate(R2: np.ndarray, R1: np.ndarray) -> StateSpace:
    """R2 / s^2 + R1 / s with the fewest states: v' = M u, q' = v + X u, e' = F u, y = L q + Y v + E e."""
    L, M = _factors(R2)
    into, out = np.linalg.pinv(L), np.linalg.pinv(M)
    X = into @ R1
    Y = (R1 - L @ X) @ out
    E, F = _factors(R1 - L @ X - Y @ M, float(np.abs(R1).max(initial=0.0)))
    r, e = len(M), len(F)
    A = np.zeros((2 * r + e, 2 * r + e))
    A[:r, r : 2 * r] = np.eye(r)
    return StateSpace(A, np.vstack([X, M, F]), np.hstack([L, Y, E]), np.zeros(R2.shape))


def _factors(R: np.ndarray, size: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """R = L M with as many columns and rows as its rank."""
    left, value, right = np.linalg.svd(R, full_matrices=False)
    rank = int(np.sum(value > RANK * max(size, value.max(initial=0.0))))
    root = np.sqrt(value[:rank])
    return left[:, :rank] * root, root[:, None] * right[:rank]
