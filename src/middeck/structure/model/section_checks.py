"""Requirements of a section's stiffness."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from middeck.errors import ConfigError

# Rows of a 4x4 in the order of the 6x6: extension, shear y, shear z, twist, curvature y, curvature z.
RIGID_IN_SHEAR = (0, 3, 4, 5)
# Rounding after scaling to a unit diagonal: decimal input of a semidefinite matrix is negative by that.
ROUNDING = 1e-9


def check_stiffness(stiffness: np.ndarray) -> None:
    """Raise a `ConfigError` that says what is wrong with a 4x4 or 6x6 stiffness."""
    faults = [*stiffness_faults(stiffness)]
    if faults:
        advice = "order: extension, (shears,) twist, curvatures"
        raise ConfigError("; ".join(faults), where="section", hint=advice)


def stiffness_faults(stiffness: np.ndarray) -> Iterator[str]:
    """Faults of a stiffness, whose diagonal may be infinite."""
    if stiffness.shape not in ((4, 4), (6, 6)):
        yield f"a section stiffness has 4x4 or 6x6 numbers, not {'x'.join(map(str, stiffness.shape))}"
        return
    diagonal = np.real(np.diag(stiffness))
    rigid = np.isinf(diagonal)
    off = np.real(np.where(np.eye(len(diagonal), dtype=bool), 0.0, stiffness))
    if np.any(np.isnan(diagonal)) or not np.all(np.isfinite(off)) or np.any(diagonal < 0.0):
        yield "a section stiffness has an entry that is not a number, or a negative diagonal"
        return
    scale = np.sqrt(np.where(rigid | (diagonal == 0.0), 1.0, diagonal))
    unit = off / np.outer(scale, scale) + np.diag(np.where(rigid, 1.0, diagonal) / scale**2)
    if np.any(np.abs(unit - unit.T) > ROUNDING):
        i, j = np.unravel_index(int(np.argmax(np.abs(unit - unit.T))), unit.shape)
        yield f"a section stiffness is not symmetric: {off[i, j]:g} and {off[j, i]:g} at ({i + 1}, {j + 1})"
    elif np.any(off[rigid]):
        yield "a strain of infinite stiffness is coupled with another"
    elif float(least := np.linalg.eigvalsh(unit)[0]) < -ROUNDING:
        yield (
            f"a section stiffness is indefinite: its least eigenvalue, with a unit diagonal, is {least:.3g}; "
            "some strain would give energy"
        )
