"""State units that equalise rows and columns of a matrix (Parlett and Reinsch 1969)."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float


def balance(
    A: Float[np.ndarray, "state state"],
) -> tuple[Float[np.ndarray, "state state"], Float[np.ndarray, " state"]]:
    """``A`` in balanced units, and the units: powers of two, without permutations."""
    with np.errstate(invalid="ignore"):  # SciPy reads units of 1e19 and more as permutations too
        balanced, (unit, _) = cast("Any", sla.matrix_balance(A, separate=True, permute=False))
    return np.asarray(balanced), np.asarray(unit)
