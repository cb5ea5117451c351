"""From three meshes to none: Romberg's table in even powers of h, with the observed order beside it."""

from __future__ import annotations

import numpy as np

# Differences between meshes that are smaller are rounding, and say nothing about the order.
NOISE = 1e-7


def extrapolate(hz: np.ndarray) -> dict:
    """Limits of the columns of ``hz`` (3 meshes, mode), every mesh twice as fine as the one before.

    ``order`` is that of the three meshes, None where their differences are noise. ``error`` is relative, the
    largest of all modes: the distance to the limit that uses the observed order and no second term.
    """
    first, last = np.diff(hz, axis=0)
    measurable = np.abs(last) > NOISE * hz[-1]
    ratio = np.where(measurable, first / np.where(measurable, last, 1.0), 4.0)
    once = hz[1:] + np.stack([first, last]) / 3.0
    limit = once[1] + (once[1] - once[0]) / 15.0
    other = hz[-1] + last / (np.where(ratio > 1.0, ratio, 4.0) - 1.0)
    return {
        "hz": limit,
        "order": [
            round(float(np.log2(r)), 3) if m and r > 1.0 else None
            for m, r in zip(measurable, ratio, strict=True)
        ],
        "error": float(np.max(np.abs(other / limit - 1.0))),
    }
