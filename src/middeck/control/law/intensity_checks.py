"""Intensities of white noise, checked where they are given."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError


def require_intensity(what: str, intensity: Float[np.ndarray, "w w"]) -> None:
    """Raise `ConfigError` unless the matrix is finite, symmetric and positive semidefinite."""
    if not np.all(np.isfinite(intensity)):
        raise ConfigError(f"{what} is not finite", hint="finite two-sided intensities, unit^2/Hz")
    lowest = np.linalg.eigvalsh(intensity).min(initial=0.0)
    # Rounding of an eigenvalue of a symmetric matrix, relative to its size.
    rounding = 1e-12 * np.abs(intensity).max(initial=0.0)
    if not np.array_equal(intensity, intensity.T) or lowest < -rounding:
        raise ConfigError(
            f"{what} is not symmetric and positive semidefinite",
            hint="a covariance matrix: symmetric, no negative eigenvalue",
        )
