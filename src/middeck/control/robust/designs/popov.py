"""Popov/H2: a compensator with guaranteed cost over a box of modal frequencies (How and others 1994).

The bound of `middeck.control.robust.designs.popov_bound` is minimised over the compensator and the
multipliers together, by quasi-Newton descent with analytic gradients.
"""

import itertools
from collections.abc import Iterator

import numpy as np

from middeck.control.h2.closed_cost import Law, evaluate_cost
from middeck.control.h2.generalized_plant import GeneralizedPlant
from middeck.control.h2.law_form import LawForm, arrange, pack, scale_states, station_ports, unpack
from middeck.control.law.uncertainty import ModeShift, Uncertainty, corner_positions, end_positions
from middeck.control.lqg.weights import LQGWeights, Shaping
from middeck.control.robust.designs.popov_bound import Multipliers, evaluate_bound, first_multipliers
from middeck.control.robust.problem.directions import Directions, shift_directions
from middeck.control.robust.problem.several_plants import (
    Attempt,
    Problem,
    RobustCompensator,
    models_of,
    pose_problem,
    report_law,
    true_costs,
)
from middeck.control.robust.search.law_scaling import even_scale, parameter_scale
from middeck.control.robust.search.quasi_newton import PATIENCE, descend
from middeck.control.robust.search.smooth_maximum import gradient_row
from middeck.control.robust.search.stabilising_continuation import RESTARTS, approach, carry_on
from middeck.errors import NumericalError
from middeck.systems.plants.plant import Plant
from middeck.values import record

WIDENINGS, WIDEST = (1.0, 2.0, 4.0, 6.0, 9.0), 0.5
"""Widths of the boxes of a start's models relative to the one requested, and their largest half-width."""
FEW = 3
"""Largest number of modes for which all corners of such a box are models."""
ROUGH = 1e-4
MORE, HEAVIER = (1.0, 2.0, 4.0, 8.0), (1.0, 2.0)
"""Factors tried on N (their roots on H of dampings, which have no N), and on all H."""
FURTHEST = 20.0
"""Largest change of the logarithm of a multiplier from its start."""


@record(kw_only=True)
class PopovCompensator(RobustCompensator):
    """A compensator whose ``cost`` bounds that of every plant with modes in the box of frequencies.

    The box is that of `finished_plants`: damping ratios stay. Plants whose dampings 2 zeta omega stay while
    the frequencies move are in it too.

    Attributes:
        directions: Input and output directions and bounds of the uncertain stiffnesses, then dampings.
        multipliers: H and N of each direction; N of a damping is zero.
    """

    directions: Directions
    multipliers: Multipliers


@record(kw_only=True)
class _Place:
    law: Law
    multipliers: Multipliers
    bound: float
    gradient: float
    history: tuple[Attempt, ...]


def design_popov(
    plant: Plant,
    weights: LQGWeights,
    authority: float,
    *,
    uncertainty: Uncertainty,
    shaping: Shaping | None = None,
    tolerance: float = 1e-7,
) -> PopovCompensator:
    """The compensator that minimises a bound on the cost over all frequencies in a box.

    Every mode of ``uncertainty.shifts`` moves independently within its width, also within a group, with
    constant damping ratio; uncertain damping, gain and delay do not enter the bound. The compensator has as
    many states as the nominal model. Other arguments are those of `design_multimodel`; ``costs`` are those at
    the ends of the box.

    Raises `NumericalError` where no compensator was found whose bound covers the box; `ConfigError` where z
    or y reads the acceleration of an uncertain mode, which a shift changes too; and as `design_multimodel`;
    `NotStabilisableError` as `design_multimodel`.
    """
    problem = pose_problem(plant, weights, authority, uncertainty, None, LawForm(), shaping)
    directions = shift_directions(plant, problem.nominal, uncertainty)
    model = models_of(problem, 1.0, 0.0)[0]
    history: tuple[Attempt, ...] = ()
    for place in _covering_starts(plant, problem, uncertainty, model, directions):
        found = _minimise(problem, model, directions, place, tolerance)
        if np.isfinite(found.bound):
            return _result(problem, directions, found)
        history = found.history
    raise NumericalError(
        "no compensator was found whose bound covers the box",
        hint="a smaller uncertainty, a lower authority, or design_multimodel, which guarantees less",
        history=history,
    )


def _minimise(
    problem: Problem, model: GeneralizedPlant, directions: Directions, place: _Place, tolerance: float
) -> _Place:
    """Minimise, restarted in fresh coordinates while that helps; ``inf`` if the bound is lost at once."""
    for _ in range(RESTARTS):
        after = _improve(problem, model, directions, place, tolerance)
        gain = place.bound - after.bound if np.isfinite(after.bound) else -np.inf
        place = after if gain > 0.0 or not np.isfinite(place.bound) else place
        if not gain > 1e-5 * after.bound:
            break
    return place


def _covering_starts(
    plant: Plant,
    problem: Problem,
    uncertainty: Uncertainty,
    model: GeneralizedPlant,
    directions: Directions,
) -> Iterator[_Place]:
    """Compensators whose bound covers the box: multi-model compensators for boxes of increasing width.

    The optimal compensator of a smaller box is a poor start: its bound is finite only up to the edge of that
    box, which could then grow by less than a per cent.
    """
    law, history = None, ()
    for widening in WIDENINGS:
        wide = _widened(uncertainty, widening)
        if wide is None:
            break
        places = corner_positions(wide) if len(wide.shifts) <= FEW else end_positions(wide)
        posed = pose_problem(
            plant, problem.weights, problem.authority, wide, places, problem.form, problem.shaping
        )
        arrival = carry_on(posed, approach(posed, law, 1.0), 1.0, ROUGH)
        law, history = arrival.law, (*history, *arrival.history)
        found = _covering_multipliers(model, law, directions)
        if found is not None:
            yield _Place(law=law, multipliers=found, bound=np.inf, gradient=np.inf, history=history)


def _covering_multipliers(model: GeneralizedPlant, law: Law, directions: Directions) -> Multipliers | None:
    """Multipliers of a small box, or scaled ones, if they cover this box."""
    first = first_multipliers(model, law, directions)
    assert first is not None  # the law stabilises the nominal model
    for heavier, more in itertools.product(HEAVIER, MORE):
        H = heavier * np.where(directions.stiff, 1.0, np.sqrt(more)) * first.H
        multipliers = Multipliers(H, more * first.N)
        if np.isfinite(evaluate_bound(model, law, directions, multipliers).law.cost):
            return multipliers
    return None


def _widened(uncertainty: Uncertainty, widening: float) -> Uncertainty | None:
    """Each mode independent, in a wider box; None where a frequency would come near zero."""
    apart = [(mode, s.half_width * widening) for s in uncertainty.shifts for mode in s.modes]
    if max(width for _, width in apart) > WIDEST:
        return None
    return Uncertainty(
        shifts=tuple(ModeShift((mode,), width) for mode, width in apart), finish=uncertainty.finish
    )


def _improve(
    problem: Problem, model: GeneralizedPlant, directions: Directions, place: _Place, tolerance: float
) -> _Place:
    integrals = len(model.integrals)
    arranged, free = arrange(place.law, station_ports(problem.form, problem.nominal), integrals)
    nominal = [evaluate_cost(model, arranged)]
    even = even_scale(nominal, integrals)
    law = scale_states(arranged, even)
    scale = parameter_scale(law, free, nominal, even, [model])
    modes, first = len(directions.low), place.multipliers

    def at(x: np.ndarray) -> tuple[Law, Multipliers]:
        logs = x[: 2 * modes]
        return (
            unpack(x[2 * modes :] * scale, law, free),
            Multipliers(first.H * np.exp(logs[:modes]), first.N * np.exp(logs[modes:])),
        )

    def objective(x: np.ndarray) -> tuple[float, np.ndarray]:
        if np.abs(x[: 2 * modes]).max() > FURTHEST:
            return np.inf, np.zeros(len(x))
        bound = evaluate_bound(model, at(x)[0], directions, at(x)[1])
        if not np.isfinite(bound.law.cost):
            return np.inf, np.zeros(len(x))
        return bound.law.cost, np.concatenate(
            [bound.log_H, bound.log_N, scale * gradient_row(bound.law, free)]
        )

    begun = np.concatenate([np.zeros(2 * modes), pack(law, free) / scale])
    descent = descend(objective, begun, tolerance=tolerance, patience=max(PATIENCE, len(begun)))
    leg = Attempt(size=1.0, cost=descent.value)
    law, multipliers = at(descent.x)
    return _Place(
        law=law,
        multipliers=multipliers,
        bound=descent.value,
        gradient=descent.gradient,
        history=(*place.history, leg),
    )


def _result(problem: Problem, directions: Directions, place: _Place) -> PopovCompensator:
    return PopovCompensator(
        **report_law(problem, place.law),
        cost=place.bound,
        costs=true_costs(problem, place.law),
        gradient=place.gradient,
        history=place.history,
        directions=directions,
        multipliers=place.multipliers,
    )
