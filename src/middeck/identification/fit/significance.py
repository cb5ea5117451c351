"""How clearly the data show each mode: its output vector over the deviation of that."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from middeck.identification.problem.layout import Point, Start, pack
from middeck.identification.uncertainty.covariance import ModelCovariance

# A residue that is fewer than so many of its deviations may be noise: the search puts the pole where noise
# looks most like a mode, which a test at a given frequency (Wald 1943) does not know of.
DOUBTFUL = 4.0
# Half the distance at which a mode is split, in its decay rates.
SPLIT = 0.125


def mode_significance(covariance: ModelCovariance) -> Float[np.ndarray, " mode"]:
    """Root mean square of each mode's output vector in units of its own covariance (Wald's statistic).

    About one for a mode that is none; zero for one of which the data tell nothing.
    """
    at, x = covariance.at, covariance.unknowns
    scale = np.sqrt(np.maximum(np.diag(covariance.matrix), np.finfo(float).tiny))
    found = np.zeros(len(covariance.model.poles))
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
    at = np.insert(np.arange(len(start.layout.pair)), m, m)
    poles = start.point.poles[at]
    poles[m : m + 2] += 1j * np.array([1.0, -1.0]) * SPLIT * poles[m].real
    return _with_modes(start, at, poles)


def without_modes(start: Start, dropped: Bool[np.ndarray, " mode"]) -> Start:
    """The same model without some of its modes."""
    kept = np.flatnonzero(~dropped)
    return _with_modes(start, kept, start.point.poles[kept])


def _with_modes(start: Start, at: Int[np.ndarray, " mode"], poles: Complex[np.ndarray, " mode"]) -> Start:
    """Modes ``at`` these places of a model, with other poles."""
    layout, point = start.layout, start.point
    chosen = {name: np.asarray(getattr(layout, name))[at] for name in ("pair", "fixed_imag", "pivot")}
    layout = dataclasses.replace(layout, **chosen)
    terms = (at[:, None] * layout.copies + np.arange(layout.copies)).ravel()
    return Start(layout, pack(layout, Point(poles, point.b[terms], point.delay_s, point.psi)))
