r"""What is proved of a loop whose gain moves: a norm that falls at every sample, verified against rounding.

At the gains g_0 < g_1 < ... stand metrics P_i = T_i' T_i; between two of them P(g) is on their geodesic:
P(g) = T' L^t T with T' T = P_i, T' L T = P_(i+1), L diagonal and t = (g - g_i) / (g_(i+1) - g_i). For a move
from g to g + d within a sample the matrix

    K(t, s, g) = L^(s/2) T A(g) T^-1 L^(-t/2),  s = t + d / (g_(i+1) - g_i)

says how the norm changes. log |K| is convex in (t, s): along any line K is analytic, and imaginary powers of
L are unitary (Hadamard's three lines; Stein and Weiss 1958, Transactions of the AMS 87). |K| is convex in g,
in which A is affine. So the corners t = 0 and 1, d = -step and +step, at the two ends of the gains prove all
gains and all moves between. A move across g_i is held by corners too, where the gains looked at reach one
step beyond both ends. With step = 0 it is the proof for every constant gain.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.realtime.gate.gain_loop import GainLoop, closed_at, size_at
from middeck.realtime.gate.gain_metric import Metric
from middeck.realtime.gate.norm_bound import (
    SPARE,
    UNIT,
    bound_norm,
    frobenius,
    is_below,
    rounding_of_sums,
)
from middeck.values import record

SAMPLED = 1e-12
"""Relative error granted to the matrices of a loop, in what their products add up to: exponentials of a
sampled model are good to some hundred roundings."""
LAST = 1.0 + 16.0 * UNIT
"""For the roundings of the last quotient."""


@record
class Piece:
    """Gains from ``low`` to ``high``, and the geodesic of metrics there.

    Attributes:
        metric: That of the lower end.
        bend: log L / 2 of the module's text; zeros where one metric stands for all.
    """

    low: float
    high: float
    metric: Metric
    bend: Float[np.ndarray, " state"]


@record
class Moved:
    """T A(g) T^-1 as computed, and bounds of the errors of its entries."""

    product: Float[np.ndarray, "state state"]
    error: Float[np.ndarray, "state state"]


def join_metrics(low: float, high: float, first: Metric, second: Metric) -> Piece:
    """The geodesic from ``first`` to ``second``."""
    _, size, V = np.linalg.svd(second.T @ first.S)
    metric = Metric(V @ first.T, first.S @ V.T)
    return Piece(low, high, metric, np.log(np.maximum(size, np.finfo(float).tiny)))


def constant_piece(low: float, high: float, metric: Metric) -> Piece:
    """One metric for all gains."""
    return Piece(low, high, metric, np.zeros(len(metric.T)))


def bound_piece(loop: GainLoop, piece: Piece, bounds: tuple[float, float], step: float) -> float:
    """A bound of the factor by which the norm changes in a sample, over all gains and moves to ``step``."""
    return max(_bound(piece, *corner) for corner in _corners(loop, piece, bounds, step))


def contracts(loop: GainLoop, piece: Piece, bounds: tuple[float, float], step: float, most: float) -> bool:
    """Whether that factor is proved to lie below ``most``."""
    return all(_is_below(piece, *corner, most) for corner in _corners(loop, piece, bounds, step))


def bound_joints(pieces: Sequence[Piece]) -> float:
    """A bound of the factor between the two forms of a metric where pieces meet: 1 but for rounding."""
    worst = 1.0
    for one, other in itertools.pairwise(pieces):
        worst = max(worst, _bound_change(one, other, 1.0), _bound_change(other, one, -1.0))
    return worst


def bound_fade(pieces: Sequence[Piece]) -> float:
    """A bound of the factor between the norms that a state has at two gains, and along any way between.

    On a geodesic the log of the norm changes by the largest bend times the way at most. While a gain that
    goes one way stands anywhere the norm falls, so that this is all by which it grows, at any speed.
    """
    bends = sum(float(np.abs(piece.bend).max(initial=0.0)) for piece in pieces)
    return math.exp(bends) * bound_joints(pieces) ** (len(pieces) - 1) * SPARE


def _bound_change(source: Piece, target: Piece, side: float) -> float:
    """Bound of |T_target x| / |T_source x| at the joint: the source's upper end (1), or the target's (-1)."""
    into, out = target.metric.T, source.metric.S
    up, down = (
        (np.zeros_like(source.bend), source.bend) if side > 0 else (target.bend, np.zeros_like(source.bend))
    )
    grown, shrunk = np.exp(up), np.exp(-down)
    product = grown[:, None] * (into @ out) * shrunk
    error = grown[:, None] * (rounding_of_sums(len(into) + 8) * (np.abs(into) @ np.abs(out))) * shrunk
    left = _left_over(source, down)
    return math.inf if left >= 1.0 else (bound_norm(product) + frobenius(error)) / (1.0 - left) * LAST


def _corners(
    loop: GainLoop, piece: Piece, bounds: tuple[float, float], step: float
) -> list[tuple[Moved, np.ndarray, np.ndarray]]:
    """T A T^-1, the exponents of the target and those of the source, at each corner."""
    gains = max(piece.low - step, bounds[0]), min(piece.high + step, bounds[1])
    moved = [_move(loop, piece.metric, gain) for gain in gains]
    if not np.any(piece.bend):
        return [(each, piece.bend, piece.bend) for each in moved]
    ratio = step / (piece.high - piece.low)
    places = [(t, t + d) for t in (0.0, 1.0) for d in ({-ratio, ratio} if step else {0.0})]
    return [(each, s * piece.bend, t * piece.bend) for each in moved for t, s in places]


def _move(loop: GainLoop, metric: Metric, gain: float) -> Moved:
    n = len(loop.A)
    size = size_at(loop, gain)
    error = (SAMPLED + rounding_of_sums(4 * n + 8)) * (np.abs(metric.T) @ size @ np.abs(metric.S))
    return Moved(metric.T @ closed_at(loop, gain) @ metric.S, error * SPARE)


def _scaled(moved: Moved, up: np.ndarray, down: np.ndarray) -> tuple[np.ndarray, float]:
    grown, shrunk = np.exp(up)[:, None], np.exp(-down)
    product = grown * moved.product * shrunk
    # The exponentials, their exponents and two products.
    inexact = (8.0 + 4.0 * float(np.abs(np.concatenate([up, down])).max(initial=0.0))) * UNIT
    return product, (frobenius(grown * moved.error * shrunk) + inexact * frobenius(product)) * SPARE


def _left_over(piece: Piece, down: np.ndarray) -> float:
    """A bound of the norm of 1 - T S in the coordinates of the source."""
    T, S = piece.metric.T, piece.metric.S
    left = np.abs(np.eye(len(T)) - T @ S) + rounding_of_sums(len(T) + 8) * (np.abs(T) @ np.abs(S))
    return frobenius(np.exp(down)[:, None] * left * np.exp(-down)) * SPARE


def _bound(piece: Piece, moved: Moved, up: np.ndarray, down: np.ndarray) -> float:
    product, error = _scaled(moved, up, down)
    left = _left_over(piece, down)
    return math.inf if left >= 1.0 else (bound_norm(product) + error) / (1.0 - left) * LAST


def _is_below(piece: Piece, moved: Moved, up: np.ndarray, down: np.ndarray, most: float) -> bool:
    product, error = _scaled(moved, up, down)
    left = _left_over(piece, down)
    return left < 1.0 and is_below(product, (most * (1.0 - left) - error) / LAST)
