"""Starts that leave a local minimum: add a mode, remove one, or exchange the least needed for a better one.

A search from a subspace start can hold a mode that does little while one mode is fitted where there are two.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from middeck.identification.model.fit_options import FitOptions
from middeck.identification.order.mode_to_add import Candidate, find_candidate
from middeck.identification.problem.data import Data
from middeck.identification.problem.residual_and_slopes import build_terms
from middeck.identification.problem.transient_projection import as_real
from middeck.identification.problem.unknowns_layout import Point, Start
from middeck.identification.search.refine_and_reweigh import Polished
from middeck.identification.spectra.excess_variance import ExcessVariance
from middeck.identification.start.start import start_at, start_from_point

# Lines over which the residual's peak is looked for, as a share of the frequency: a mode of 1 % is so wide.
PEAK_WIDTH = 0.01
# How many of the least missed modes are tried in turn.
CANDIDATES = 3
# A new mode has the median damping of the others, but no more than this.
HEAVIEST = 0.05


def exchanges(
    data: Data, options: FitOptions, best: Polished, spread: ExcessVariance, *, at_any_rate: bool
) -> Iterator[Start]:
    """Starts with one pair (or two real poles) of ``best`` replaced by the pair that improves the fit most.

    Unless ``at_any_rate``, only where the gain exceeds the loss at once; otherwise also by one at
    the residual's peak: the largest first gain may be a neighbour of a mode that is there already.
    """
    layout = best.layout
    at_best = data.reweighted(1.0 / np.sqrt(spread.at(best.share)))
    missed, new, peak = missed_modes(at_best, best), _found_pole(at_best, best), _at_peak(at_best, best)
    single = layout.pairs + np.argsort(missed[layout.pairs :])[:2]
    units = [np.array([m]) for m in range(layout.pairs)] + ([single] if len(single) == 2 else [])
    given_up = np.array([float(np.sum(missed[unit])) for unit in units])
    for k in np.argsort(given_up)[:CANDIDATES]:
        kept = np.setdiff1d(np.arange(len(missed)), units[k])
        if at_any_rate or new.gain > given_up[k]:
            yield _with(at_best, options, best, kept, new)
        if at_any_rate and new.pole != peak.pole:
            yield _with(at_best, options, best, kept, peak)


def grown(data: Data, options: FitOptions, best: Polished, spread: ExcessVariance) -> Start:
    """``best`` with one pair more, where it lowers the cost most."""
    at_best = data.reweighted(1.0 / np.sqrt(spread.at(best.share)))
    return _with(at_best, options, best, np.arange(len(best.layout.pair)), _found_pole(at_best, best))


def shrunk(data: Data, options: FitOptions, best: Polished, spread: ExcessVariance) -> Start | None:
    """``best`` without its least needed pair; None where it has fewer than two."""
    layout = best.layout
    if layout.pairs < 2:
        return None
    at_best = data.reweighted(1.0 / np.sqrt(spread.at(best.share)))
    point = best.start.point
    kept = np.delete(np.arange(len(layout.pair)), np.argmin(missed_modes(at_best, best)[: layout.pairs]))
    pair = np.asarray(layout.pair)[kept]
    if layout.options.full_rank:
        return start_at(at_best, options, point.poles[kept], pair, point.delay_s)
    return start_from_point(
        options, pair, Point(point.poles[kept], point.b[kept], point.delay_s, point.psi), layout.outputs
    )


def missed_modes(data: Data, best: Polished) -> Float[np.ndarray, " mode"]:
    """Rise of the cost without each mode, the other linear unknowns solved for again."""
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


def _found_pole(data: Data, best: Polished) -> Candidate:
    """The pair that would lower the cost most; in records of experiments, one at the residual's peak."""
    at_peak = _at_peak(data, best)
    if data.drive is not None:
        return at_peak
    light, peak = -at_peak.pole.real / at_peak.pole.imag, at_peak.pole.imag
    return find_candidate(data, best, light, peak) or at_peak


def _at_peak(data: Data, best: Polished) -> Candidate:
    """A pair at the residual's peak, damped as the others are in the median."""
    pairs = best.start.point.poles[: best.layout.pairs]
    light = float(np.median(-np.real(pairs) / np.abs(pairs))) if len(pairs) else PEAK_WIDTH
    return Candidate(_peak(data, best) * (-min(light, HEAVIEST) + 1j), np.zeros(0, dtype=complex), 0.0)


def _with(data: Data, options: FitOptions, best: Polished, kept: np.ndarray, new: Candidate) -> Start:
    """Some of the modes, as they are, and a new pair."""
    layout = best.layout
    point = best.start.point
    poles, pair = point.poles[kept], np.asarray(layout.pair)[kept]
    place = int(np.sum(pair))
    poles, pair = np.insert(poles, place, new.pole), np.insert(pair, place, True)
    if layout.options.full_rank or not len(new.b):
        return start_at(data, options, poles, pair, point.delay_s)
    b = np.insert(point.b[kept], place, new.b, axis=0)
    return start_from_point(options, pair, Point(poles, b, point.delay_s, point.psi), layout.outputs)


def _peak(data: Data, best: Polished) -> float:
    """Angular frequency where most is left in a band as wide as a mode."""
    r = best.residual(data) * data.weight
    power = np.concatenate([[0.0], np.cumsum(np.sum(np.abs(r) ** 2, axis=(0, 2)))])
    omega = data.omega
    low = np.searchsorted(omega, omega * (1.0 - PEAK_WIDTH))
    high = np.searchsorted(omega, omega * (1.0 + PEAK_WIDTH), side="right")
    inner = (low > 0) & (high < len(omega))
    left = np.where(inner, power[high] - power[low], 0.0)
    return float(omega[int(np.argmax(left))])
