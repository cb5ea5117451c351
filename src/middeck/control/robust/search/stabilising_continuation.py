"""Continuation to a `Law` that stabilises all models: by authority, discount and size of perturbation."""

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from middeck.control.h2.closed_cost import Law, evaluate_cost, spectral_abscissa
from middeck.control.h2.generalized_plant import GeneralizedPlant
from middeck.control.h2.law_form import order_of, shifted, station_ports
from middeck.control.h2.nominal_law import lqg_law
from middeck.control.robust.problem.several_plants import Attempt, Problem, models_of
from middeck.control.robust.search.smooth_maximum import Stations, improve
from middeck.control.robust.search.starting_laws import (
    LADDER,
    find_starts,
    in_the_loop,
    spread_starts,
    stabilises,
)
from middeck.errors import ConfigError, NumericalError
from middeck.values import record

ROUGH, LOOSE, TIDY = 1e-4, 1e-5, 1e-7
"""Relative gains at which a rough descent ends, an intermediate one, and one for comparison of starts."""
STEPS_ON_THE_WAY = 200
SMALLEST_STEP = 1e-4
"""Smallest step of the size of the perturbations; below it the continuation counts as blocked."""
ROUNDS, ROUND_STEPS = 40, 20
RESTARTS, HELPS = 3, 1e-6
"""Restarts of the last descent, and the relative gain by which one helps."""
FINALISTS = 3
ENOUGH = 1.02
"""A start within two per cent of the lower bound of the cost ends the search for starts."""


@record
class Arrival:
    """A `Law`, the relative norm of its gradient, and the stages so far."""

    law: Law
    gradient: float
    history: tuple[Attempt, ...]


def approach(problem: Problem, start: Law | None, power: float) -> Arrival:
    """A `Law` that stabilises all models at full size, not yet optimal.

    At the first size (the nominal model alone for a box, all plants where listed) a start is an LQG law of
    the right order, at the authority requested or a lower one, where a weak law stabilises any stable plant;
    its cost at a higher authority is then finite and is descended. Otherwise all states are given a decay
    (discount), which is withdrawn as the law improves. The perturbations then grow as far as the law
    stabilises, the law is improved there, and so on.
    """
    stations = station_ports(problem.form, problem.nominal)
    return _grow(problem, stations, begin(problem, start, power), power)


def begin(problem: Problem, start: Law | None, power: float) -> Arrival:
    """A `Law` that stabilises the models at the first size."""
    if start is not None:
        return _given(problem, start)
    return _best_start(problem, station_ports(problem.form, problem.nominal), power)


def carry_on(problem: Problem, arrival: Arrival, power: float, tolerance: float) -> Arrival:
    """Descend at full size, restarted in fresh coordinates as long as that helps."""
    stations = station_ports(problem.form, problem.nominal)
    models = models_of(problem, 1.0, 1.0)
    arrival = _step(models, stations, arrival, power, tolerance, 1.0, to_the_end=True)
    for _ in range(RESTARTS):
        before = arrival.history[-1].cost
        arrival = _step(models, stations, arrival, power, tolerance, 1.0, to_the_end=True)
        if before - arrival.history[-1].cost < HELPS * before:
            break
    return arrival


def _given(problem: Problem, start: Law) -> Arrival:
    models = models_of(problem, 1.0, 0.0)
    model, order = models[0], order_of(problem.form, len(models[0].A))
    rows = [row for row, _ in model.integrals]
    shape = len(start.A), start.B.shape[1], len(start.C)
    fitting = order + len(rows), len(model.C2), model.B2.shape[1]
    if shape != fitting:
        raise ConfigError(
            f"start= with {shape[0]} states, {shape[1]} inputs and {shape[2]} outputs does not fit",
            hint=f"{fitting[0]} states, {fitting[1]} inputs and {fitting[2]} outputs, or leave it out",
        )
    if np.any(start.A[order:]) or not np.array_equal(start.B[order:], np.eye(shape[1])[rows]):
        raise ConfigError(
            "the last states of start= are not the required integrals",
            hint="a law designed with the same integral=, or leave start= out",
        )
    if not stabilises(models, start):
        raise ConfigError("start= does not stabilise the nominal plant", hint="leave it out")
    return Arrival(start, np.inf, ())


def _best_start(problem: Problem, stations: Stations, power: float) -> Arrival:
    def models_at(ratio: float) -> Sequence[GeneralizedPlant]:
        return models_of(problem, ratio, 0.0)

    order = order_of(problem.form, len(models_at(1.0)[0].A))
    starts = list(find_starts(models_at, order, stations))
    if len(starts) == 1 and starts[0][1] == 1.0:
        return Arrival(starts[0][0], np.inf, ())
    models = models_at(1.0)
    best = _best_of(problem, stations, starts, power)
    if not stations and (best is None or best.history[-1].cost > ENOUGH * _least_cost(models)):
        others = _best_of(problem, stations, spread_starts(models, order), power)
        found = [each for each in (best, others) if each is not None]
        best = min(found, key=lambda arrival: arrival.history[-1].cost, default=None)
    if best is not None:
        return best
    if stations:
        raise NumericalError(
            "no decentralised start was found that stabilises the nominal plant",
            hint="give a compensator as start=",
        )
    return _withdraw_discount(models, stations, in_the_loop(models[0], order))


def _best_of(
    problem: Problem, stations: Stations, starts: Iterable[tuple[Law, float]], power: float
) -> Arrival | None:
    """The lowest of the minima reached from the three best starts."""
    climbed = [_climb(problem, stations, law, ratio, power) for law, ratio in starts]
    climbed.sort(key=lambda arrival: arrival.history[-1].cost)
    models = models_of(problem, 1.0, 0.0)
    tidied = [_step(models, stations, each, power, TIDY, 0.0) for each in climbed[:FINALISTS]]
    return min(tidied, key=lambda arrival: arrival.history[-1].cost, default=None)


def _least_cost(models: Sequence[GeneralizedPlant]) -> float:
    """Lower bound for any order: the mean cost of the models, each under its own LQG law."""
    return float(np.mean([evaluate_cost(model, lqg_law(model)).cost for model in models]))


def _climb(problem: Problem, stations: Stations, law: Law, ratio: float, power: float) -> Arrival:
    """Raise the authority to the one requested, in half decades."""
    arrival = Arrival(law, np.inf, ())
    for level in sorted(r for r in LADDER if ratio < r < 1.0):
        models = models_of(problem, level, 0.0)
        arrival = _step(models, stations, arrival, power, LOOSE, 0.0)
    return _step(models_of(problem, 1.0, 0.0), stations, arrival, power, ROUGH, 0.0)


def _grow(problem: Problem, stations: Stations, arrival: Arrival, power: float) -> Arrival:
    size = 0.0 if problem.growing else 1.0
    while size < 1.0:
        step = 1.0 - size
        while not stabilises(models_of(problem, 1.0, size + step), arrival.law):
            step /= 2.0
            if step < SMALLEST_STEP:
                raise NumericalError(
                    f"no compensator of {len(arrival.law.A)} states was found for more than {size:.3g} of "
                    "the required uncertainty",
                    hint="a smaller uncertainty, a lower authority, or a higher order",
                    size=size,
                    law=arrival.law,
                    history=arrival.history,
                )
        # Stay short of the stability limit, where the cost is nearly infinite.
        size = 1.0 if size + step >= 1.0 else size + 0.75 * step
        models = models_of(problem, 1.0, size)
        if size < 1.0:
            arrival = _step(models, stations, arrival, power, LOOSE, size)
    return arrival


def _withdraw_discount(models: Sequence[GeneralizedPlant], stations: Stations, law: Law) -> Arrival:
    """Lend all states a decay that makes the loop stable, improve, lend less (Perdomo et al. 2021)."""
    history: list[Attempt] = []
    floor = 1e-3 * float(np.median(np.abs(np.linalg.eigvals(models[0].A))))
    for _ in range(ROUNDS):
        growth = max(spectral_abscissa(model, law) for model in models)
        if growth < 0.0:
            return Arrival(law, np.inf, tuple(history))
        rate = growth + 0.05 * max(growth, floor)
        lent = [dataclasses.replace(model, A=model.A - rate * np.eye(len(model.A))) for model in models]
        found = improve(shifted(law, rate), lent, stations, power=1.0, tolerance=LOOSE, steps=ROUND_STEPS)
        if found is None:
            break
        law = shifted(found[0], -rate)
        history.append(Attempt(size=0.0, cost=found[1].value))
    raise NumericalError(
        f"no stabilising compensator of {len(law.A)} states was found",
        hint="a higher order, or a compensator to start from: start=",
        law=law,
        history=tuple(history),
    )


def _step(
    models: Sequence[GeneralizedPlant],
    stations: Stations,
    arrival: Arrival,
    power: float,
    tolerance: float,
    size: float,
    to_the_end: bool = False,
) -> Arrival:
    steps = STEPS_ON_THE_WAY if tolerance >= LOOSE else 2000
    found = improve(
        arrival.law, models, stations, power=power, tolerance=tolerance, steps=steps, to_the_end=to_the_end
    )
    if found is None:
        raise NumericalError(
            "the compensator no longer stabilises a model: it is at the edge of stability",
            hint="less authority, a smaller uncertainty, or a higher order",
            law=arrival.law,
            history=arrival.history,
        )
    law, descent = found
    leg = Attempt(size=size, cost=descent.value)
    return Arrival(law, descent.gradient, (*arrival.history, leg))
