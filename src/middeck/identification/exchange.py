"""Out of a local minimum: give up the mode that is missed least for one where the residual is largest.

A search from a subspace start can hold a mode that does little while two modes elsewhere are fitted by one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from middeck.identification.design import residual_of
from middeck.identification.fit_data import Data
from middeck.identification.polish import Polished
from middeck.identification.start import Options, Start, start_at
from middeck.identification.terms import Layout, columns, fractions, unpack
from middeck.identification.weights import Spread

# Lines over which the residual's peak is looked for, as a share of the frequency: a mode of 1 % is so wide.
PEAK_WIDTH = 0.01
# How many of the least missed modes are tried in turn.
CANDIDATES = 3


def exchanges(data: Data, options: Options, best: Polished, spread: Spread) -> Iterator[Start]:
    """Starts that have one pair (or two real poles) of ``best`` replaced by one at the residual's peak."""
    layout = best.layout
    point = unpack(layout, best.refined.theta)
    weighted = Data(data.s, data.H, 1.0 / np.sqrt(spread.at(best.share)))
    pairs = np.flatnonzero(layout.pair)
    single = np.flatnonzero(~np.asarray(layout.pair))
    units = [np.array([m]) for m in pairs] + ([single[:2]] if len(single) >= 2 else [])
    missed = [_missed(weighted, best, _columns_of(layout, unit)) for unit in units]
    omega = _peak(weighted, best)
    light = np.median(-np.real(point.poles[pairs]) / np.abs(point.poles[pairs])) if len(pairs) else 0.01
    new = omega * (-min(float(light), 0.05) + 1j)
    for k in np.argsort(missed)[:CANDIDATES]:
        rest = np.setdiff1d(np.arange(len(point.poles)), units[k])
        poles, pair = point.poles[rest], np.asarray(layout.pair)[rest]
        place = int(np.sum(pair))
        yield start_at(
            weighted, options, np.insert(poles, place, new), np.insert(pair, place, True), point.delay_s
        )


def _columns_of(layout: Layout, unit: np.ndarray) -> np.ndarray:
    pairs = int(np.sum(layout.pair))
    if layout.real_constants:
        return unit
    return np.concatenate([[2 * m, 2 * m + 1] if m < pairs else [pairs + m] for m in unit])


def _missed(data: Data, best: Polished, block: np.ndarray) -> float:
    """By how much the cost rises without the columns ``block``, the others solved for again."""
    layout = best.layout
    point = unpack(layout, best.refined.theta)
    X = columns(layout, point, fractions(layout, point.poles, data.s), data.s)
    rise = 0.0
    for o, linear in enumerate(best.refined.step.linear):
        A = (X * data.weight[o]).reshape(len(X), -1).view(float)
        inverse = np.linalg.pinv(A @ A.T, hermitian=True)
        x = linear[block]
        rise += float(x @ np.linalg.pinv(inverse[np.ix_(block, block)], hermitian=True) @ x)
    return rise


def _peak(data: Data, best: Polished) -> float:
    """Angular frequency where most is left in a band as wide as a mode."""
    r = residual_of(best.layout, data, best.refined.theta, best.refined.step.linear) * data.weight
    power = np.concatenate([[0.0], np.cumsum(np.sum(np.abs(r) ** 2, axis=(0, 2)))])
    omega = np.imag(data.s)
    low = np.searchsorted(omega, omega * (1.0 - PEAK_WIDTH))
    high = np.searchsorted(omega, omega * (1.0 + PEAK_WIDTH), side="right")
    inner = (low > 0) & (high < len(omega))
    left = np.where(inner, power[high] - power[low], 0.0)
    return float(omega[int(np.argmax(left))])
