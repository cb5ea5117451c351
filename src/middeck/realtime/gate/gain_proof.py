"""The proof of a loop over an interval of gains: plan, metrics, pieces, and how fast the gain may move."""

import dataclasses
import itertools
import math

import numpy as np

from middeck.realtime.gate.gain_loop import GainLoop, closed_at, size_at
from middeck.realtime.gate.gain_metric import Metric, disc_metric, start_metric
from middeck.realtime.gate.gain_path import (
    SAMPLED,
    Piece,
    bound_fade,
    bound_joints,
    bound_piece,
    constant_piece,
    contracts,
    join_metrics,
)
from middeck.realtime.gate.gain_plan import (
    SHARE,
    Disc,
    Response,
    Undecided,
    disc_radius,
    find_response,
    plan_discs,
    scan_gains,
    whole_disc,
)
from middeck.realtime.gate.norm_bound import is_proved_to_grow
from middeck.values import record

SLACK = 1.0 + 1e-6
"""A step of the gain is taken as so much larger: the computer's own rounding."""
ONE_MORE = 1.0 + 1e-15
"""For the rounding of a product or quotient of bounds."""
SPLITS = 6
"""How often a piece that is not verified is halved."""
SETTLING = 6
SEARCHED = 5
"""Halvings of the interval that holds the largest proved step."""


@record(kw_only=True)
class Proved:
    """The outcome of a proof.

    Attributes:
        constant, moving: Bounds of the factor by which the norm changes in a sample, at constant gains and
            with the declared step; 1 or more where nothing is proved.
        step: A step of the gain in a sample up to which it is proved.
        fade: A bound of the factor by which the norm grows while the gain goes one way, however fast.
        weakest: The gains between which ``constant`` is reached.
    """

    constant: float = math.inf
    moving: float = math.inf
    step: float = 0.0
    fade: float = math.inf
    weakest: tuple[float, float] | None = None
    pieces: int = 0
    unstable_gain: float | None = None
    said: str = ""


@record
class _Affine:
    """A loop whose matrix is affine in k = g / (1 - g D), D a number."""

    loop: GainLoop
    direct: float

    def of(self, gain: float) -> float:
        return gain / (1.0 - gain * self.direct)

    def gain(self, k: float) -> float:
        return k / (1.0 + k * self.direct)


def prove_interval(loop: GainLoop, low: float, high: float, step: float) -> Proved:
    """The loop at every gain from ``low`` to ``high``, constant or moved by at most ``step`` in a sample."""
    affine = _make_affine(loop, high)
    if isinstance(affine, str):
        return Proved(said=f"not decided: {affine}")
    ends = affine.of(low), affine.of(high)
    # dk = dg / ((1 - g D) (1 - g' D)), least where 1 - g D is.
    stretch = min(1.0 - low * affine.direct, 1.0 - high * affine.direct) ** -2.0
    found = _prove(affine, ends, step * stretch * SLACK)
    unstable = None if found.unstable_gain is None else min(max(found.unstable_gain, low), high)
    return dataclasses.replace(found, step=found.step / (stretch * SLACK), unstable_gain=unstable)


def _make_affine(loop: GainLoop, high: float) -> _Affine | str:
    if not np.any(loop.D):
        return _Affine(loop, 0.0)
    if loop.D.shape != (1, 1):
        return "several commands act on their own measurement within a sample; delay the model or the law"
    direct = float(loop.D[0, 0])
    if high * direct >= 1.0 - 1e-6:
        return f"the loop through the direct terms has no solution at a gain of {1.0 / direct:.4g}"
    return _Affine(dataclasses.replace(loop, D=np.zeros((1, 1))), direct)


def _prove(affine: _Affine, ends: tuple[float, float], step: float) -> Proved:
    loop = affine.loop
    outside = _look_for_growth(affine, ends)
    if outside is not None:
        return outside
    response = find_response(loop, *ends)
    pieces = _one_metric(loop, response, ends)
    if pieces is None:
        discs = plan_discs(response, *ends)
        if isinstance(discs, Undecided):
            return Proved(said=f"not decided: no disc of gains is stable about {affine.gain(discs.gain):.4g}")
        found = _many_metrics(loop, response, discs, ends)
        if isinstance(found, Undecided):
            return Proved(
                said=f"not decided: no metric is verified about a gain of {affine.gain(found.gain):.4g}"
            )
        pieces = found
    bounds = [bound_piece(loop, piece, ends, 0.0) for piece in pieces]
    constant, least = max(bounds), pieces[int(np.argmax(bounds))]
    found = Proved(
        constant=constant,
        weakest=(affine.gain(least.low), affine.gain(min(least.high, ends[1]))),
        fade=bound_fade(pieces),
        pieces=len(pieces),
    )
    if not any(np.any(piece.bend) for piece in pieces):  # one metric for all
        return dataclasses.replace(found, moving=constant, step=math.inf)
    if step == 0.0:
        return dataclasses.replace(found, moving=constant)
    joints = bound_joints(pieces) * ONE_MORE
    limit = _largest_step(loop, pieces, ends, 1.0 / (joints * ONE_MORE), step)
    moving = (
        joints * max(bound_piece(loop, piece, ends, step) for piece in pieces) if limit >= step else math.inf
    )
    return dataclasses.replace(found, moving=moving, step=limit)


def _look_for_growth(affine: _Affine, ends: tuple[float, float]) -> Proved | None:
    """Poles over the interval; where one does not decay there is nothing to prove."""
    gains = scan_gains(*ends)
    poles = [np.linalg.eigvals(closed_at(affine.loop, float(k))) for k in gains]
    largest = np.array([np.abs(each).max(initial=0.0) for each in poles])
    if largest.max() < 1.0 - 1e-12:
        return None
    worst = int(np.argmax(largest))
    k = float(gains[worst])
    pole = poles[worst][np.argmax(np.abs(poles[worst]))]
    hertz = abs(np.angle(pole)) / (2.0 * np.pi * affine.loop.period_s)
    at = f"a root at {hertz:.4g} Hz"
    if is_proved_to_grow(closed_at(affine.loop, k), size_at(affine.loop, k), SAMPLED):
        gain = affine.gain(k)
        return Proved(unstable_gain=gain, said=f"unstable at a gain of {gain:.4g}: {at} grows")
    hint = "; hold it by the inner loop" if worst == 0 else ""
    return Proved(said=f"not decided at a gain of {affine.gain(k):.4g}: {at} does not decay{hint}")


def _one_metric(loop: GainLoop, response: Response, ends: tuple[float, float]) -> list[Piece] | None:
    disc = whole_disc(response, *ends)
    near = start_metric(closed_at(loop, 0.5 * sum(ends)))
    if disc is None or near is None:
        return None
    metric = disc_metric(loop, disc, response.units, near)
    if metric is None:
        return None
    piece = constant_piece(*ends, metric)
    return [piece] if contracts(loop, piece, ends, 0.0, 1.0) else None


def _many_metrics(
    loop: GainLoop, response: Response, discs: list[Disc], ends: tuple[float, float]
) -> list[Piece] | Undecided:
    """Verified pieces from end to end; or a gain about which none is.

    The centre of the last disc may lie beyond the interval.
    """
    metrics = _find_metrics(loop, response, discs)
    if isinstance(metrics, Undecided):
        return metrics
    if len(discs) == 1:
        outer = [constant_piece(*ends, metrics[0])]
    else:
        outer = [
            constant_piece(ends[0], discs[0].centre, metrics[0]),
            constant_piece(discs[-1].centre, ends[1], metrics[-1]),
        ]
    pieces = [piece for piece in outer if piece.high > piece.low]
    for piece in pieces:
        if not contracts(loop, piece, ends, 0.0, 1.0):
            return Undecided(piece.low)
    for (one, other), pair in zip(itertools.pairwise(discs), itertools.pairwise(metrics), strict=True):
        made = _between(loop, response, (one.centre, other.centre, ends[1]), pair, SPLITS)
        if isinstance(made, Undecided):
            return made
        pieces += made
    return sorted(pieces, key=lambda piece: piece.low)


def _find_metrics(loop: GainLoop, response: Response, discs: list[Disc]) -> list[Metric] | Undecided:
    """A metric for each disc, from the last to the first; or the gain that has none."""
    last = discs[-1]
    near = start_metric(closed_at(loop, last.centre))
    if near is None:
        return Undecided(last.centre)
    for _ in range(SETTLING):  # states are weighed as the neighbour has them, and the last has none
        near = disc_metric(loop, last, response.units, near) or near
    metrics: list[Metric] = []
    for disc in reversed(discs):
        near = disc_metric(loop, disc, response.units, near)
        if near is None:
            return Undecided(disc.centre)
        metrics.append(near)
    return metrics[::-1]


def _between(
    loop: GainLoop,
    response: Response,
    gains: tuple[float, float, float],
    metrics: tuple[Metric, Metric],
    splits: int,
) -> list[Piece] | Undecided:
    """The geodesic between two metrics, with more metrics in between where it is not verified.

    ``gains`` are its ends, and the end of the interval, up to which it is needed.
    """
    low, high, top = gains
    if low >= top:
        return []
    piece = join_metrics(low, high, *metrics)
    if contracts(loop, piece, (low, min(high, top)), 0.0, 1.0):
        return [piece]
    middle = 0.5 * (low + high)
    disc = Disc(middle, min(SHARE * disc_radius(response, middle), high - low))
    inner = disc_metric(loop, disc, response.units, metrics[1]) if splits else None
    if inner is None:
        return Undecided(middle)
    first = _between(loop, response, (low, middle, top), (metrics[0], inner), splits - 1)
    if isinstance(first, Undecided):
        return first
    second = _between(loop, response, (middle, high, top), (inner, metrics[1]), splits - 1)
    return second if isinstance(second, Undecided) else first + second


def _largest_step(
    loop: GainLoop, pieces: list[Piece], ends: tuple[float, float], most: float, asked: float
) -> float:
    """A step near the largest at which all pieces are verified; no longer than the shortest piece within."""
    inner = [piece.high - piece.low for piece in pieces if np.any(piece.bend)]
    longest = min(inner, default=math.inf)

    order = list(pieces)

    def holds(step: float) -> bool:
        for k, piece in enumerate(order):
            if not contracts(loop, piece, ends, step, most):
                order.insert(0, order.pop(k))  # it is the first that fails at the next step too
                return False
        return True

    if not holds(0.0):
        return 0.0
    low, high = 0.0, min(longest, asked)
    while holds(high):
        if high >= longest:
            return high
        low, high = high, min(2.0 * high, longest)
    for _ in range(SEARCHED):
        middle = math.sqrt(low * high) if low else high / 4.0
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
