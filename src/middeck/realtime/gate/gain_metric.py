r"""Metrics in which a loop contracts at all gains of a disc.

Let T = C (z - A)^-1 B be that of the loop closed at the centre. 1 - d T is regular on the unit circle for all
|d| <= h if and only if the bounded real lemma's Riccati equation

    X = A' X A + C' C + A' X B (1 / h^2 - B' X B)^-1 B' X A

has a stabilising solution; then A(d)' X A(d) < X for all these gains, at any rate of change. Its dual Y gives
A(d) Y A(d)' < Y. Both come out of one doubling (Chu, Fan and Lin 2005, Linear Algebra and its Applications
396). Between X and the inverse of Y lies their geometric mean, the metric of balanced coordinates, in which
the loop contracts as well (Heinz 1951, Math. Annalen 123); decay rates cancel in it, so that it moves
little with the gain. Nothing here is trusted: `gain_path` verifies what the metrics promise.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.realtime.gate.gain_loop import GainLoop, closed_at
from middeck.realtime.gate.gain_plan import Disc
from middeck.systems.state_space.balancing import balance
from middeck.values import record

DOUBLINGS = 60
SETTLED = 1e-13
TRIES = (
    (0.8, 0.1, 1.0),
    (0.5, 0.1, 1.0),
    (0.5, 0.01, 1.0),
    (0.2, 0.01, 1.0),
    (0.2, 0.01, 0.8),
    (0.2, 0.01, 0.6),
    (0.2, 0.01, 0.3),
)
"""Share of the decay that is given up, weight of the states beside the command, and share of the radius: the
first that is solved."""


@record
class Metric:
    """The norm |T x|, with S close to the inverse of T."""

    T: Float[np.ndarray, "state state"]
    S: Float[np.ndarray, "state state"]


def start_metric(A: Float[np.ndarray, "state state"]) -> Metric | None:
    """Balanced coordinates of a stable ``A`` with every state as input and output."""
    _, units = balance(A)
    metric = Metric(np.diag(1.0 / units), np.diag(units))
    for _ in range(3):  # the first takes its units from rows and columns only
        at = metric.T @ A @ metric.S
        decay = 1.0 - 0.5 * (1.0 - _radius(at))
        X, Y = _gramian(at.T / decay), _gramian(at / decay)
        found = None if X is None or Y is None else _mean(X, Y)
        if found is None:
            return None
        metric = _after(found, metric)
    return metric


def disc_metric(
    loop: GainLoop, disc: Disc, units: Float[np.ndarray, " command"], near: Metric
) -> Metric | None:
    """The metric of the disc, states weighed as ``near`` has them; None where the equation is not solved.

    ``units`` are those of the commands, as `find_response` has them.
    """
    centre, radius = disc.centre, disc.radius
    A = near.T @ closed_at(loop, centre) @ near.S
    drive, sense = near.T @ loop.B * units, loop.C @ near.S / units[:, None]
    spectral = _radius(A)
    if not spectral < 1.0:
        return None
    driven, sensed = np.linalg.norm(drive), np.linalg.norm(sense)
    even = sensed / driven if driven > 0.0 and sensed > 0.0 else 1.0
    driving, sensing = even * drive @ drive.T, sense.T @ sense / even
    for given_up, weight, share in TRIES:
        decay = 1.0 - given_up * (1.0 - spectral)
        beside = weight * (decay - spectral) / radius * np.eye(len(A))
        h = share * radius / decay
        solved = _double(A / decay, sensing + beside, -(h**2) * (driving + beside))
        found = None if solved is None else _mean(h * solved[0], solved[1] / h)
        if found is not None:
            return _after(found, near)
    return None


def _radius(A: np.ndarray) -> float:
    return float(np.abs(np.linalg.eigvals(A)).max(initial=0.0))


def _after(metric: Metric, first: Metric) -> Metric:
    return Metric(metric.T @ first.T, first.S @ metric.S)


def _gramian(A: np.ndarray) -> np.ndarray | None:
    """Sum of A^k A'^k, by doubling."""
    total, power = np.eye(len(A)), A
    for _ in range(DOUBLINGS):
        more = power @ total @ power.T
        total, power = total + more, power @ power
        if not np.isfinite(total).all():
            return None
        if np.abs(more).max(initial=0.0) <= SETTLED * np.abs(total).max(initial=0.0):
            return 0.5 * (total + total.T)
    return None


def _double(a: np.ndarray, x: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Stabilising solutions of X = A'X (1 + G X)^-1 A + X_0, and of its dual, negated."""
    one = np.eye(len(a))
    with np.errstate(all="ignore"):
        for _ in range(DOUBLINGS):
            try:
                turned = np.linalg.inv(one + g @ x)
            except np.linalg.LinAlgError:
                return None
            through = a @ turned
            more = a.T @ x @ turned @ a
            g, x, a = _even(g + through @ g @ a.T), _even(x + more), through @ a
            if not (np.isfinite(x).all() and np.isfinite(g).all()):
                return None
            if np.abs(more).max(initial=0.0) <= SETTLED * np.abs(x).max(initial=0.0):
                return x, -g
    return None


def _even(matrix: np.ndarray) -> np.ndarray:
    return 0.5 * (matrix + matrix.T)


def _mean(X: np.ndarray, Y: np.ndarray) -> Metric | None:
    """The geometric mean of X and the inverse of Y: balanced coordinates (Laub et al. 1987, IEEE TAC 32)."""
    try:
        left, right = np.linalg.cholesky(X), np.linalg.cholesky(Y)
        U, size, V = np.linalg.svd(left.T @ right)
    except np.linalg.LinAlgError:
        return None
    if not np.all(size > 0.0):
        return None
    root = np.sqrt(size)
    return Metric((U / root).T @ left.T, right @ (V.T / root))
