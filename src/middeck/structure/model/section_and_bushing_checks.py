"""Requirements of a section's stiffness, and of a bushing's."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.model.clamps import check_axes

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


# Relative rounding of printed numbers, over the largest entry of a matrix scaled to a unit diagonal.
ROUNDED = 1e-9


def bushing_faults(
    name: str, stiffness: Float[np.ndarray, "6 6"], axes: Float[np.ndarray, "3 3"]
) -> Iterator[str]:
    """Faults of a bushing: no finite numbers, not symmetric, or with negative energy."""
    try:
        check_axes(axes, f"bushing {name!r}")
    except ConfigError as error:
        yield f"bushing {name!r}: {error.what}"
    if not np.all(np.isfinite(stiffness)):
        yield f"bushing {name!r} has a stiffness that is not a number"
        return
    diagonal = np.abs(np.diagonal(stiffness))
    size = np.sqrt(np.where(diagonal > 0.0, diagonal, diagonal.max() or 1.0))
    scaled = stiffness / np.outer(size, size)
    apart = np.argwhere(np.abs(scaled - scaled.T) > ROUNDED * max(1.0, np.abs(scaled).max()))
    if len(apart):
        i, j = apart[0].tolist()
        yield (
            f"bushing {name!r} is not symmetric: {stiffness[i, j]:g} in row {i + 1}, column {j + 1} and "
            f"{stiffness[j, i]:g} across the diagonal"
        )
        return
    least = float(np.linalg.eigvalsh(0.5 * (scaled + scaled.T))[0])
    if least < -ROUNDED * max(1.0, np.abs(scaled).max()):
        yield (
            f"bushing {name!r} pushes some deformation further: its stiffness is indefinite, the least "
            f"eigenvalue over its diagonal is {least:.3g}, and must not be negative"
        )
