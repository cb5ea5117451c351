"""Number of roots of a loop with exact delays right of a vertical line, by the argument principle.

With f = det(1 - K G) and f_n the same with delays approximated, f / f_n has no open-loop poles: it has the
roots of the delayed loop as zeros and those of the approximation, which are eigenvalues, as poles. Its change
of phase along the line is therefore the difference of the two numbers of roots right of it, whatever
integrators and rigid modes the plant has.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from middeck.control.analysis.loop.feedback_loop import FeedbackLoop, Halves
from middeck.control.analysis.loop.frequency_lines import HALF_WIDTHS, MOST_DELAY_LINES, PER_DECADE
from middeck.control.analysis.stability.delayed_roots import find_open_poles
from middeck.errors import NumericalError
from middeck.systems.delay.delay_approximation import evaluate_approximation
from middeck.systems.plants.plant import remove_delays

STEP = 0.7
"""Largest change of phase [rad] accepted from line to line."""
ROUNDS, DOUBLINGS = 60, 40
WALLS = 4
"""Number of vertical lines tried where the roots found and counted disagree right of the first."""


def clear_walls(real: np.ndarray, reach: float) -> list[float]:
    """Re s of vertical lines left of the axis, each in the middle of a wide gap between roots within
    ``reach``.

    Unstable roots, and all that are nearer to the axis than the line, lie to its right and are counted. The
    line of the widest gap comes first, then those nearer to the axis.
    """
    inside = np.sort(real[(real > -reach) & (real < 0.0)])
    edges = np.concatenate([[-reach], inside, [0.0]])
    width, middle = np.diff(edges), 0.5 * (edges[1:] + edges[:-1])
    first = int(np.argmax(width))
    nearer = first + 1 + np.argsort(-width[first + 1 :], kind="stable")[: WALLS - 1]
    return [float(middle[k]) for k in (first, *np.sort(nearer))]


def count_more(loop: FeedbackLoop, halves: Halves, order: int, roots: np.ndarray, wall: float) -> int | None:
    """Roots right of ``wall`` of the delayed loop minus those of its approximation; None if unclear."""
    phase = _phase(loop, halves, order)
    omega = _wall_lines(loop, halves, roots, wall)
    ratio, away = phase(wall + 1j * omega)
    for _ in range(ROUNDS):
        step = np.angle(ratio[1:] * np.conj(ratio[:-1]))
        coarse = (np.abs(step) > STEP) & (np.diff(omega) > 1e-14 * omega[1:])
        if not coarse.any():
            break
        middle = 0.5 * (omega[:-1] + omega[1:])[coarse]
        between, _ = phase(wall + 1j * middle)
        place = np.flatnonzero(coarse) + 1
        omega, ratio = np.insert(omega, place, middle), np.insert(ratio, place, between)
    step = np.angle(ratio[1:] * np.conj(ratio[:-1]))
    # Beyond the last line both loop gains are small: the phase is that of 1 - K G itself.
    half_turns = (away[-1] - step.sum()) / np.pi
    near = round(float(half_turns)) if np.isfinite(half_turns) else 0
    clear = np.all(np.abs(step) <= STEP) and abs(half_turns - near) < 0.1
    return near if clear else None


def _phase(
    loop: FeedbackLoop, halves: Halves, order: int
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """f / f_n of size one, and its phase where both loops are small."""
    delay_s = loop.plant.delay_s

    def evaluate(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        G, K = halves(s)
        identity = np.eye(K.shape[1])
        exact = identity - K @ G
        smoothed = evaluate_approximation(delay_s, order, s)
        near = identity - K @ (G * np.exp(s[:, None, None] * delay_s) * smoothed)
        ratio = np.linalg.slogdet(exact)[0] * np.conj(np.linalg.slogdet(near)[0])
        away = [np.angle(np.linalg.eigvals(M[-1])).sum() for M in (exact, near)]
        return ratio, np.full(len(s), away[0] - away[1])

    return evaluate


def _wall_lines(
    loop: FeedbackLoop, halves: Halves, roots: np.ndarray, wall: float
) -> Float[np.ndarray, " line"]:
    """Frequencies from zero to where the loop is small, dense beside the roots and for the delay."""
    size = np.abs(np.concatenate([roots, find_open_poles(loop)[0]]))
    moving = size[size > 1e-9 * size.max(initial=0.0)]
    low, high = (0.01 * moving.min(), 2.0 * moving.max()) if len(moving) else (0.01, 100.0)
    top = _where_small(halves, wall, high, direct_gain(loop))
    centre, width = np.abs(np.imag(roots)), np.abs(np.real(roots) - wall)
    beside = centre[:, None] + width[:, None] * np.concatenate([-HALF_WIDTHS, HALF_WIDTHS])
    longest = float(loop.plant.delay_s.max())
    waves = np.arange(1, min(int(2.0 * top * longest) + 1, MOST_DELAY_LINES)) * 0.5 / longest
    lines = np.geomspace(low, top, int(PER_DECADE * np.log10(top / low)) + 2)
    omega = np.unique(np.concatenate([[0.0], lines, beside.ravel(), waves]))
    return omega[(omega >= 0.0) & (omega <= top)]


def _where_small(halves: Halves, wall: float, omega: float, direct: float) -> float:
    """Frequency above which the loop gain is below the mean of one and ``direct``."""
    for _ in range(DOUBLINGS):
        G, K = halves(wall + 1j * omega * np.array([1.0, 1.3, 1.7, 2.3]))
        if np.abs(np.linalg.eigvals(K @ G)).max(initial=0.0) < 0.5 * (1.0 + direct):
            return omega
        omega *= 2.0
    raise NumericalError(
        "stability with delays: the loop gain does not fall with frequency",
        hint="a plant or compensator that rolls off: no direct term",
    )


def direct_gain(loop: FeedbackLoop) -> float:
    """Gain of one round trip through the direct terms; one or more is unstable.

    Exact where all paths with a direct term have one delay; otherwise an upper bound from absolute values.
    """
    if not loop.plant.delayed:
        return 0.0
    through, law = remove_delays(loop.plant).system.D, loop.law.D
    delays = loop.plant.delay_s[through != 0.0]
    if not np.any(delays):
        return 0.0
    alike = bool(np.all(delays == delays[0]))
    if not alike:
        through, law = np.abs(through), np.abs(law)
    gain = float(np.abs(np.linalg.eigvals(law @ through)).max(initial=0.0))
    if not alike and gain >= 1.0:
        raise NumericalError(
            f"the loop has a direct term of gain {gain:.3g} through paths of different delays",
            hint="add a roll-off to the compensator or the plant",
        )
    return gain
