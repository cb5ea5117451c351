"""Requirements of a 6x6 stiffness."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.model.clamps import check_axes

# Relative rounding of printed numbers, over the largest entry of a matrix scaled to a unit diagonal.
ROUNDED = 1e-9


def bushing_faults(
    name: str, stiffness: Float[np.ndarray, "6 6"], axes: Float[np.ndarray, "3 3"]
) -> Iterator[str]:
    """Faults of a bushing: no numbers, not symmetric, or work to be had from a deformation."""
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
