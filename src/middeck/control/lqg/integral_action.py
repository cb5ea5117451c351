"""Integral action: the integrals of measurements as states of the design model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float


def append_integrals(
    A: Float[np.ndarray, "x x"],
    B: Float[np.ndarray, "x u"],
    C: Float[np.ndarray, "y x"],
    D: Float[np.ndarray, "y u"],
    integral: Sequence[int],
) -> tuple[np.ndarray, np.ndarray]:
    """A and B with the integrals of some rows of y as last states."""
    rows, count = list(integral), len(integral)
    longer = np.block([[A, np.zeros((len(A), count))], [C[rows], np.zeros((count, count))]])
    return longer, np.vstack([B, D[rows]])
