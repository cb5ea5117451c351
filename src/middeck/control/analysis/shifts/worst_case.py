"""Worst plant of a box: all corners, then a search from the worst of them; the result has exact delays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from middeck.control.analysis.loop.feedback_loop import FeedbackLoop, evaluate_halves, form_loop
from middeck.control.analysis.rms.measure_rms import measure_metric
from middeck.control.analysis.stability.stability import LoopStability, decide_loop, loop_poles, require_known
from middeck.control.law.compensator import Compensator
from middeck.control.law.delay_order import approximation_order
from middeck.control.law.partition import partition_modes
from middeck.control.law.uncertainty import Uncertainty, corner_positions, finished_plants, parameter_names
from middeck.control.loop.closed_loop import close_loop
from middeck.control.loop.performance import Performance, loop_metric
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.stability import none_grows
from middeck.values import record

SEARCHED = 4
"""Number of corners from which the search starts, besides the middle."""
FIRST_STEP, LAST_STEP = 0.5, 1e-3
UNSTABLE = 1e6
"""Offset of unstable loops in the ranking, above any sensitivity."""

Objective = Callable[[Float[np.ndarray, " parameter"]], float]


@record(kw_only=True)
class WorstCase:
    """Worst plant found in a box.

    Attributes:
        parameters: Names of the numbers of a position.
        position: Position in the box, each number from -1 to 1.
        stability: Stability of that plant, delays exact.
        metric: The performance metric there; ``inf`` where unstable; None where no performance was asked for.
        nominal_metric: The same in the middle of the box.
        tried: Plants evaluated.
    """

    parameters: tuple[str, ...]
    position: Float[np.ndarray, " parameter"]
    stability: LoopStability
    metric: float | None
    nominal_metric: float | None
    tried: int


def find_worst_case(
    plant: Plant,
    compensator: Compensator,
    uncertainty: Uncertainty,
    *,
    performance: Performance | None = None,
    corners: int | None = None,
    rng: np.random.Generator | None = None,
) -> WorstCase:
    """Plant of the box that is farthest into, or nearest to, instability, or of the worst performance.

    Of unstable plants that with the fastest growth. Where all are stable, that with the worst
    ``performance``, or without one that with the largest sensitivity (I - K G)^-1 at the frequencies of the
    poles: the decay of the slowest pole says nothing where it is of a mode that the loop hardly moves.

    Evaluates all corners, or ``corners`` of them drawn with ``rng``, then searches along the parameters from
    the middle and the worst corners with halved steps. Ranking uses approximated delays, of the order that
    the fastest mode needs; stability and metric of the result are exact. The result is a lower bound of the
    true worst (`measure_disk_margin` bounds from the other side).

    Raises `ConfigError` for a box that does not fit the plant (`perturb_plant`), or too many corners without
    ``corners``; `NumericalError` where stability of a plant cannot be decided (`decide_stability`).
    """
    positions = corner_positions(uncertainty, corners, rng)
    tried = 0

    def plant_at(position: np.ndarray) -> Plant:
        return finished_plants(plant, uncertainty, position[None])[0]

    def closeness(position: np.ndarray) -> float:
        nonlocal tried
        tried += 1
        return _closeness(form_loop(plant_at(position), compensator))

    def cost(position: np.ndarray) -> float:
        nonlocal tried
        tried += 1
        assert performance is not None
        return _rough_metric(plant_at(position), compensator, performance)

    near = np.array([closeness(p) for p in positions])
    worst = _climb(closeness, positions, near)
    stability = decide_loop(form_loop(plant_at(worst), compensator))
    metric = nominal = None
    if performance is not None:
        if stability.stable:
            worst = _climb(cost, positions, np.array([cost(p) for p in positions]))
            stability = decide_loop(form_loop(plant_at(worst), compensator))
        nominal = measure_metric(plant_at(positions[0]), compensator, performance)
        metric = measure_metric(plant_at(worst), compensator, performance)
    return WorstCase(
        parameters=parameter_names(uncertainty),
        position=worst,
        stability=stability,
        metric=metric,
        nominal_metric=nominal,
        tried=tried,
    )


def _closeness(loop: FeedbackLoop) -> float:
    """Closeness to instability: the peak sensitivity of a stable loop; any unstable loop ranks above, by
    growth.

    The rightmost pole is no measure where it belongs to a mode that the loop hardly moves; the sensitivity at
    the poles' frequencies is.
    """
    require_known(loop)
    rates = loop_poles(loop)
    if not none_grows(rates, loop.period_s):
        return UNSTABLE * (1.0 + float(np.real(rates).max(initial=-np.inf)))
    omega = np.imag(rates)[np.imag(rates) > 0.0]
    G, K = evaluate_halves(loop)(1j * omega)
    difference = np.eye(K.shape[1]) - K @ G
    sound = difference[np.isfinite(difference).all(axis=(1, 2))]
    least = np.linalg.svd(sound, compute_uv=False)[:, -1]
    return min(1.0 / float(least.min(initial=1.0)), UNSTABLE) if len(least) else 0.0


def _climb(
    objective: Objective, positions: np.ndarray, values: np.ndarray
) -> Float[np.ndarray, " parameter"]:
    """Search from the middle and the worst corners until no step along a parameter makes it worse."""
    starts = dict.fromkeys([0, *(int(k) for k in np.argsort(-values, kind="stable")[:SEARCHED])])
    found = [_pattern_search(objective, positions[k], float(values[k])) for k in starts]
    return max(found, key=lambda each: each[1])[0]


def _pattern_search(
    objective: Objective, start: np.ndarray, value: float
) -> tuple[Float[np.ndarray, " parameter"], float]:
    """Steps along each parameter within the box, halved where none helps (Hooke and Jeeves 1961)."""
    best, step = start.copy(), FIRST_STEP
    while step > LAST_STEP:
        moved = False
        for i in range(len(best)):
            for sign in (1.0, -1.0):
                trial = best.copy()
                trial[i] = np.clip(best[i] + sign * step, -1.0, 1.0)
                if trial[i] == best[i]:
                    continue
                there = objective(trial)
                if there > value:
                    best, value, moved = trial, there, True
                    break
        if not moved:
            step *= 0.5
    return best, value


def _rough_metric(plant: Plant, law: Compensator, performance: Performance) -> float:
    active = partition_modes(plant).active
    order = approximation_order(active, law.system)
    return loop_metric(close_loop(approximate_delays(active, order), law), performance)
