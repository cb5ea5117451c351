"""How clearly the data show each mode: its output vector over the deviation of that."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from middeck.identification.problem.layout import Point, Start, pack
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.unknowns import places_of, unknowns_of

# A residue that is fewer than so many of its deviations may be noise: the search puts the pole where noise
# looks most like a mode, which a test at a given frequency (Wald 1943) does not know of.
DOUBTFUL = 4.0
# Half the distance at which a mode is split, in its decay rates.
SPLIT = 0.125


def mode_significance(covariance: ModelCovariance) -> Float[np.ndarray, " mode"]:
    """Root mean square of each mode's output vector in units of its own covariance (Wald's statistic).

    About one for a mode that is none; zero for one of which the data tell nothing.
    """
    model, at = covariance.model, places_of(covariance.model, covariance.structure)
    x = unknowns_of(model, covariance.structure)
    scale = np.sqrt(np.maximum(np.diag(covariance.matrix), np.finfo(float).tiny))
    found = np.zeros(len(model.poles))
    for m in range(len(found)):
        own = at.c[:, m][at.c[:, m] >= 0]
        among = covariance.matrix[np.ix_(own, own)] / scale[own, None] / scale[own]
        z = x[own] / scale[own]
        size, direction = np.linalg.eigh(among)
        # Correlations of one up to rounding leave a direction of no variance, which tells nothing.
        clear = size > len(own) * np.sqrt(np.finfo(float).eps)
        found[m] = (
            np.sqrt(np.mean(np.square(direction[:, clear].T @ z) / size[clear])) if clear.any() else 0.0
        )
    return np.where(np.isfinite(found), found, 0.0)


def with_split(start: Start, m: int) -> Start:
    """The same model with two modes in the place of pair ``m``, an eighth of its half-power width apart."""
    layout, point = start.layout, start.point
    at = np.insert(np.arange(len(layout.pair)), m, m)
    more = dataclasses.replace(
        layout,
        pair=np.asarray(layout.pair)[at],
        fixed_imag=layout.fixed_imag[at],
        pivot=np.asarray(layout.pivot)[at],
    )
    poles = point.poles[at]
    poles[m : m + 2] += 1j * np.array([1.0, -1.0]) * SPLIT * point.poles[m].real
    terms = (at[:, None] * layout.copies + np.arange(layout.copies)).ravel()
    return Start(more, pack(more, Point(poles, point.b[terms], point.delay_s, point.psi)))


def without_modes(start: Start, dropped: Bool[np.ndarray, " mode"]) -> Start:
    """The same model without some of its modes."""
    layout, point, kept = start.layout, start.point, ~dropped
    fewer = dataclasses.replace(
        layout,
        pair=np.asarray(layout.pair)[kept],
        fixed_imag=layout.fixed_imag[kept],
        pivot=np.asarray(layout.pivot)[kept],
    )
    terms = np.repeat(kept, layout.copies)
    return Start(fewer, pack(fewer, Point(point.poles[kept], point.b[terms], point.delay_s, point.psi)))
