"""One evaluation of measured shapes against a model's: pairs, measures, and the values a profile judges.

Kept apart from everything that is prepared once, so that a Monte Carlo run goes through the same lines as
the test.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.optimize import linear_sum_assignment
from scipy.special import chdtri

from middeck.structure.correlation.assurance import (
    coordinate_assurance,
    largest_other,
    modal_assurance,
    orthogonality,
)
from middeck.structure.correlation.measured_modes import UNSEEN
from middeck.structure.correlation.review_criteria import Criterion, Quantity, Scope
from middeck.values import record

# Modes are one pair only if neither frequency is more than this times the other: a few sensors may see
# shapes alike that are octaves apart.
WINDOW = 2.0
# Part of its MAC that a pair an octave apart loses: at few channels many shapes are equal to rounding.
NEARER = 1e-6
# Chance at which the noise of a test takes a channel at rest for one that moves.
BY_CHANCE = 1e-4


@record(kw_only=True)
class Candidates:
    """The model at the channels: the modes that a measured one may be paired with.

    Attributes:
        significant: Whether each has more effective mass than the profile's part.
        fundamental: Whether each is the lowest mode of kind flexible, or has its frequency. Rank would not
            do: a stiff suspension has modes above it.
        has_fundamental: Whether the model has such a mode, among the candidates or not.
    """

    frequency_hz: Float[np.ndarray, " candidate"]
    shape: Float[np.ndarray, "channel candidate"]
    mass: Float[np.ndarray, "channel channel"]
    significant: Bool[np.ndarray, " candidate"]
    fundamental: Bool[np.ndarray, " candidate"]
    has_fundamental: bool


@record(kw_only=True)
class Evaluation:
    """Comparison of the test with the model; rows of matrices are the model's, columns the test's.

    Attributes:
        pairs: (candidate, measured), one to one, in the order of the measured modes.
        frequency_error: Frequency error of each pair, model over test less one.
        mac: Over all candidates and measured modes.
        comac: COMAC of each channel, over the pairs.
        at_rest: Channels that neither side moves beyond the noise of the test: their COMAC is meaningless.
        cross_orthogonality: Between the pairs.
        self_orthogonality: Among all measured modes.
    """

    pairs: Int[np.ndarray, "pair 2"]
    frequency_error: Float[np.ndarray, " pair"]
    mac: Float[np.ndarray, "candidate measured"]
    comac: Float[np.ndarray, " channel"]
    at_rest: Bool[np.ndarray, " channel"]
    cross_orthogonality: Float[np.ndarray, "pair pair"]
    self_orthogonality: Float[np.ndarray, "measured measured"]


def evaluate_shapes(
    model: Candidates,
    frequency_hz: Float[np.ndarray, " measured"],
    shape: Complex[np.ndarray, "channel measured"],
    std: Float[np.ndarray, "channel measured"],
) -> Evaluation:
    """Pair and compare; ``std`` is the noise of ``shape``."""
    mac = modal_assurance(model.shape, shape)
    pairs = nearby_pairs(mac, model.frequency_hz, frequency_hz)
    ours, theirs = pairs.T
    a, b = model.shape[:, ours], shape[:, theirs]
    return Evaluation(
        pairs=pairs,
        frequency_error=model.frequency_hz[ours] / frequency_hz[theirs] - 1.0,
        mac=mac,
        comac=coordinate_assurance(a, b),
        at_rest=_at_rest(a, b, std[:, theirs]),
        cross_orthogonality=orthogonality(a, b, model.mass),
        self_orthogonality=orthogonality(shape, shape, model.mass),
    )


def nearby_pairs(mac: np.ndarray, ours_hz: np.ndarray, theirs_hz: np.ndarray) -> Int[np.ndarray, "pair 2"]:
    """Pairs with the largest sum of MAC among modes of neighbouring frequencies.

    Of shapes that are equal at the channels the nearer in frequency counts.
    """
    apart = np.abs(np.log(ours_hz[:, None] / theirs_hz)) / np.log(WINDOW)
    score = np.where(apart <= 1.0, mac * (1.0 - NEARER * apart**2), 0.0)
    i, j = linear_sum_assignment(score, maximize=True)
    pairs = np.stack([i, j], axis=1)[score[i, j] > 0.0]
    return pairs[np.argsort(pairs[:, 1], kind="stable")]


def _at_rest(a: np.ndarray, b: np.ndarray, std: np.ndarray) -> Bool[np.ndarray, " channel"]:
    """Channels at which the noise ``std`` of ``b`` may be all that moves, by chi squared over the pairs."""
    noise = np.maximum(std, UNSEEN * np.abs(b).max(axis=0))
    scaled = a * (np.abs(np.sum(a * b.conj(), axis=0)) / np.sum(a**2, axis=0))
    most = np.maximum(*(np.sum(np.abs(side / noise) ** 2, axis=1) for side in (scaled, b)))
    return most <= chdtri(b.shape[1], BY_CHANCE)


def criterion_values(
    model: Candidates, found: Evaluation, criterion: Criterion
) -> tuple[Float[np.ndarray, " item"], Int[np.ndarray, " item"]]:
    """Values that ``criterion`` judges, and the pairs (for a COMAC the moving channels) they belong to."""
    if criterion.quantity is Quantity.COMAC:
        moving = np.flatnonzero(~found.at_rest)
        return found.comac[moving], moving
    values = _of_pairs(found, criterion.quantity)
    judged = np.flatnonzero(members(model, found.pairs[:, 0], criterion.group))
    return values[judged], judged


def _of_pairs(found: Evaluation, quantity: Quantity) -> np.ndarray:
    ours, theirs = found.pairs.T
    match quantity:
        case Quantity.FREQUENCY_ERROR:
            return np.abs(found.frequency_error)
        case Quantity.MAC:
            return found.mac[ours, theirs]
        case Quantity.CROSS_DIAGONAL:
            return np.diag(found.cross_orthogonality)
        case Quantity.CROSS_OFF_DIAGONAL:
            return largest_other(found.cross_orthogonality)
        case _:
            return largest_other(found.self_orthogonality)[theirs]


def members(model: Candidates, ours: np.ndarray, group: Scope) -> np.ndarray:
    """Whether each of the candidates ``ours`` belongs to a group of modes."""
    if group is Scope.ALL:
        return np.ones(len(ours), dtype=bool)
    fundamental = model.fundamental[ours]
    if group is Scope.FUNDAMENTAL:
        return fundamental
    significant = model.significant[ours] & ~fundamental
    return significant if group is Scope.SIGNIFICANT else ~significant & ~fundamental


def nothing_passes(model: Candidates, criterion: Criterion) -> bool:
    """Whether ``criterion`` is met where no pair applies: not if the fundamental was not measured."""
    return not (criterion.group is Scope.FUNDAMENTAL and model.has_fundamental)
