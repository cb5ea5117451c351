"""Remove the modes that a fit of a response does not need, and part those that are two."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from middeck.identification.fit.fitted_model import model_of, structure_of
from middeck.identification.order.best_start import leaves_noise
from middeck.identification.order.order_choice import description_length
from middeck.identification.problem.data import Data
from middeck.identification.problem.unknowns_layout import Point, Start, pack
from middeck.identification.search.refine_and_reweigh import Polished, SearchedModel, polish
from middeck.identification.spectra.excess_variance import ExcessVariance
from middeck.identification.uncertainty.covariance import ModelCovariance, estimate_covariance
from middeck.systems.plants.response import FrequencyResponse

# A mode of fewer deviations is worth a try without it; description lengths then decide.
WORTH_A_TRY = 8.0
# Modes of at most so many deviations are all left out at once, in one trial.
NOTHING = 2.0
STEPS = 10
State = TypeVar("State")
# A residue that is fewer than so many of its deviations may be noise: the search puts the pole where noise
# looks most like a mode, which a test at a given frequency (Wald 1943) does not know of.
DOUBTFUL = 4.0
# Half the distance at which a mode is split, in its decay rates; within how many of them its halves are one,
# and within how many its lines are.
SPLIT, NEAR, OWN = 0.125, 3.0, 5.0
# What a mode's lines leave beyond noise, in squares of its deviation, before two modes are tried: what their
# further unknowns add to a description.
BEYOND = 10.0
# Least fall of the description by a second mode: a mode that softens by a thousandth looks like two.
CLEARLY = 25.0


def tidied(measured: FrequencyResponse, data: Data, best: Polished, spread: ExcessVariance) -> Polished:
    """``best`` without modes whose residue may be noise, as long as that shortens the description."""
    return shed(
        best,
        lambda run: _significance(measured, run, spread),
        lambda run, dropped: _without(data, run, spread, dropped),
    )


def parted(data: Data, best: Polished, spread: ExcessVariance) -> Polished:
    """``best`` with two modes in place of each one that they describe better.

    Two modes closer than their width are one to a subspace. They are taken for two where that shortens the
    description, and then leaves noise: friction leaves the same form beside a mode, but more with it.
    """
    return split(best, pairs_of, lambda run, m: _in_two(data, run, m, spread))


def pairs_of(run: SearchedModel) -> Complex[np.ndarray, " pair"]:
    """Oscillating poles of the run [rad/s]."""
    return run.start.point.poles[: run.layout.pairs]


def split(
    state: State,
    pairs: Callable[[State], Complex[np.ndarray, " pair"]],
    in_two: Callable[[State, int], State | None],
) -> State:
    """The run with modes split where ``in_two`` finds that better and both halves stay near the mode."""
    m = 0
    while m < len(poles := pairs(state)):
        found = in_two(state, m)
        if found and stay_near(pairs(found), poles, m):
            state, m = found, m + 1
        m += 1
    return state


def stay_near(found: Complex[np.ndarray, " pair"], poles: Complex[np.ndarray, " single"], m: int) -> bool:
    """Whether both halves of the split pole ``m`` stayed near it (``found``: poles after the refit)."""
    return bool(np.all(np.abs(found[m : m + 2] - poles[m]) < NEAR * abs(poles[m].real)))


def _in_two(data: Data, run: Polished, m: int, spread: ExcessVariance) -> Polished | None:
    own = own_lines(data, pairs_of(run)[m])
    left = np.abs(run.residual(data)[:, own]) ** 2 / spread.at(run.share)[:, own]
    if np.sum(left - 1.0) < BEYOND:
        return None
    two = polish(data, with_split(run.start, m), spread, steps=2 * STEPS, rounds=3, share=run.share)
    if two is None or not leaves_noise(two, spread):
        return None
    return two if length_of(data, two, spread) + CLEARLY < length_of(data, run, spread) else None


def own_lines(data: Data, pole: complex) -> Bool[np.ndarray, " line"]:
    """Lines within some half-power widths of a mode, at least the nearest."""
    width = max(OWN * abs(pole.real), 2.0 * float(np.diff(data.omega).min()))
    return np.abs(data.omega - abs(pole)) < width


def shed(
    state: State,
    significance: Callable[[State], Float[np.ndarray, " mode"]],
    without: Callable[[State, Bool[np.ndarray, " mode"]], State | None],
) -> State:
    """Remove modes that a fit does not need: all insignificant ones at once, then one by one.

    ``significance`` has the deviations of each mode's residue; ``without`` the fit without some modes, or
    None where that is no better.
    """
    kept: set[int] = set()
    at_once = True
    while len(size := significance(state)) > 1:
        weak = size < (NOTHING if at_once else WORTH_A_TRY)
        weak[list(kept)] = False
        if at_once and (np.sum(weak) < 2 or weak.all()):
            at_once = False
            continue
        if not weak.any():
            return state
        least = int(np.argmin(np.where(weak, size, np.inf)))
        fewer = without(state, weak if at_once else np.arange(len(weak)) == least)
        if fewer is not None:
            state, kept = fewer, set()
        elif not at_once:
            kept.add(least)
        at_once = False
    return state


def _significance(
    measured: FrequencyResponse, best: Polished, spread: ExcessVariance
) -> Float[np.ndarray, " mode"]:
    model = model_of(best, measured.inputs, measured.outputs)
    covariance = estimate_covariance(
        model, structure_of(best.layout), measured, assumed=spread.at(best.share), noise=spread.variance
    )
    found = mode_significance(covariance)
    return np.array([found[model.poles == pole].max() for pole in dict.fromkeys(model.poles.tolist())])


def _without(
    data: Data, best: Polished, spread: ExcessVariance, dropped: Bool[np.ndarray, " mode"]
) -> Polished | None:
    """Refined without some modes, if its description is no longer."""
    start = without_modes(best.start, dropped)
    fewer = polish(data, start, spread, steps=STEPS, rounds=2, share=best.share)
    if fewer is None or length_of(data, fewer, spread) > length_of(data, best, spread):
        return None
    return fewer


def length_of(data: Data, run: Polished, spread: ExcessVariance) -> float:
    """Description length of a response by a run."""
    return description_length(run.likelihood, run.layout.unknowns, 2 * data.H.size, spread.alike)


def mode_significance(covariance: ModelCovariance) -> Float[np.ndarray, " mode"]:
    """Root mean square of each mode's output vector in units of its own covariance (Wald's statistic).

    About one for a mode that is none; zero for one on which the data have no information.
    """
    at, x = covariance.at, covariance.unknowns
    scale = np.sqrt(np.maximum(np.diag(covariance.matrix), np.finfo(float).tiny))
    found = np.zeros(len(covariance.model.poles))
    for m in range(len(found)):
        own = at.c[:, m][at.c[:, m] >= 0]
        among = covariance.matrix[np.ix_(own, own)] / scale[own, None] / scale[own]
        z = x[own] / scale[own]
        size, direction = np.linalg.eigh(among)
        # Correlations of one up to rounding leave a direction of no variance, which has no information.
        clear = size > len(own) * np.sqrt(np.finfo(float).eps)
        found[m] = (
            np.sqrt(np.mean(np.square(direction[:, clear].T @ z) / size[clear])) if clear.any() else 0.0
        )
    return np.where(np.isfinite(found), found, 0.0)


def with_split(start: Start, m: int) -> Start:
    """The same model with two modes in the place of pair ``m``, an eighth of its half-power width apart."""
    at = np.insert(np.arange(len(start.layout.pair)), m, m)
    poles = start.point.poles[at]
    # Both halves of a pair near critical damping must stay above the axis.
    apart = min(SPLIT * abs(poles[m].real), 0.5 * abs(poles[m].imag))
    poles[m : m + 2] += 1j * np.array([-1.0, 1.0]) * apart
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
