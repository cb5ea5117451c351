"""Out of a local minimum: give up the mode that is missed least for one where the residual is largest.

A search from a subspace start can hold a mode that does little while two modes elsewhere are fitted by one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from middeck.identification.fit.data import Data
from middeck.identification.fit.design import build_terms, residual_of
from middeck.identification.fit.layout import unpack
from middeck.identification.fit.own_transients import as_real
from middeck.identification.fit.polish import Polished
from middeck.identification.fit.start import Options, Start, start_at
from middeck.identification.fit.weights import Spread

# Lines over which the residual's peak is looked for, as a share of the frequency: a mode of 1 % is so wide.
PEAK_WIDTH = 0.01
# How many of the least missed modes are tried in turn.
CANDIDATES = 3
# A new mode has the median damping of the others, but no more than this.
HEAVIEST = 0.05


def exchanges(data: Data, options: Options, best: Polished, spread: Spread) -> Iterator[Start]:
    """Starts that have one pair (or two real poles) of ``best`` replaced by one at the residual's peak."""
    layout = best.layout
    at_best = dataclasses.replace(data, weight=1.0 / np.sqrt(spread.at(best.share)))
    missed = missed_modes(at_best, best)
    single = layout.pairs + np.argsort(missed[layout.pairs :])[:2]
    units = [np.array([m]) for m in range(layout.pairs)] + ([single] if len(single) == 2 else [])
    for k in np.argsort([float(np.sum(missed[unit])) for unit in units])[:CANDIDATES]:
        yield _with_peak(at_best, options, best, np.setdiff1d(np.arange(len(missed)), units[k]))


def grown(data: Data, options: Options, best: Polished, spread: Spread) -> Start:
    """``best`` with one pair more, at the residual's peak."""
    at_best = dataclasses.replace(data, weight=1.0 / np.sqrt(spread.at(best.share)))
    return _with_peak(at_best, options, best, np.arange(len(best.layout.pair)))


def shrunk(data: Data, options: Options, best: Polished, spread: Spread) -> Start | None:
    """``best`` without the pair that is missed least; None where it has no two."""
    layout = best.layout
    if layout.pairs < 2:
        return None
    at_best = dataclasses.replace(data, weight=1.0 / np.sqrt(spread.at(best.share)))
    point = unpack(layout, best.refined.theta)
    kept = np.delete(np.arange(len(layout.pair)), np.argmin(missed_modes(at_best, best)[: layout.pairs]))
    pair = np.asarray(layout.pair)[kept]
    vectors = None if layout.full or len(layout.powers) else point.b[kept]
    return start_at(at_best, options, point.poles[kept], pair, point.delay_s, vectors)


def missed_modes(data: Data, best: Polished) -> Float[np.ndarray, " mode"]:
    """By how much the cost rises without each mode, the other linear unknowns solved for again."""
    layout = best.layout
    terms = build_terms(layout, data, best.refined.theta)
    missed = np.zeros(len(layout.pair))
    if terms is None:
        return missed
    for o, linear in enumerate(best.refined.step.linear):
        A = as_real(terms.X * data.weight[o])
        inverse = np.linalg.pinv(A @ A.T, hermitian=True)
        for m in range(len(missed)):
            own = layout.columns_of(m)
            block = inverse[np.ix_(own, own)]
            missed[m] += float(linear[own] @ np.linalg.pinv(block, hermitian=True) @ linear[own])
    return missed


def _with_peak(data: Data, options: Options, best: Polished, kept: np.ndarray) -> Start:
    """Some of the modes and one at the residual's peak, damped as the others."""
    layout = best.layout
    point = unpack(layout, best.refined.theta)
    pairs = point.poles[: layout.pairs]
    light = np.median(-np.real(pairs) / np.abs(pairs)) if len(pairs) else PEAK_WIDTH
    new = _peak(data, best) * (-min(float(light), HEAVIEST) + 1j)
    poles, pair = point.poles[kept], np.asarray(layout.pair)[kept]
    place = int(np.sum(pair))
    return start_at(data, options, np.insert(poles, place, new), np.insert(pair, place, True), point.delay_s)


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
