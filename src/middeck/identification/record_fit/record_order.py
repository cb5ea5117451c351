"""Order and weights of a sampled model: minimum description length, and held-out samples.

The order has the least description length by either kind of noise, transients counted. The weights at that
order are the likeliest of those whose models simulate held-out samples about as well as the best: the
residual of a real article is more than noise, so the likeliest weights need not simulate best. How both rules
were chosen: docs/explanation/one-long-record.md.

A large record is scouted first (`reduced_record`): the order is searched on some of its lines and principal
outputs; that model is refined on all data, and grown as long as its description length falls.

For the held-out error a model is fitted to two thirds and simulates the last third, and the other way round.
Its initial state is fitted to half of the third, so that poles too slow to be observed do not pass.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from middeck.errors import DataError, FitError, NumericalError
from middeck.identification.fit.fitted_model import model_of
from middeck.identification.model.fit_options import FitOptions
from middeck.identification.order.order_choice import description_length, is_settled, sizes
from middeck.identification.problem.data import Data, Transient
from middeck.identification.problem.unknowns_layout import Start
from middeck.identification.record_fit.missed_modes import exchanges, grown
from middeck.identification.record_fit.record_spectra import cut_samples, record_data
from middeck.identification.record_fit.record_starts import Pasts, pasts_of, record_starts
from middeck.identification.record_fit.reduced_record import is_large, scouted
from middeck.identification.record_fit.refine_record import (
    WEIGHTINGS,
    RecordRun,
    Weighting,
    further,
    leader,
    refine_record,
)
from middeck.identification.record_fit.simulate_record import record_nrmse
from middeck.signals.record import Record

# Rounds of noise and search of each model, and steps of each.
ROUNDS, STEPS = 4, 60
# An exchange counts when it gains more likelihood than an unsettled search may.
WORTH = 1.0
# An order that is asked for is grown from so many states less.
BELOW = 4
NOISES: tuple[Weighting, ...] = ("output", "motion")
WEIGHED = {
    "flat": "all lines weighed alike",
    "output": "lines weighed by the noise of sensors",
    "motion": "lines weighed by the noise of forces",
}
# Steps from the model of all samples to that of a part.
STEPS_HELD_OUT = 15
# Errors of samples held out, over the least, that are no sign for either weights: where a model leaves noise
# alone, the three differ by 3 %, and the likeliest weights estimate best.
ALIKE = 1.05
# Share of the part held out to which the initial state is fitted.
STATE_SHARE = 0.5


def choose_record(
    record: Record,
    options: FitOptions,
    band_hz: tuple[float, float] | None,
    *,
    states: int | None,
    weighting: Weighting | None,
    tell: Callable[[str], None],
) -> tuple[RecordRun, str]:
    """The best order (of those asked for) and weighting, with the reason."""
    data = record_data(record, band_hz, whole=True)
    kinds = NOISES if weighting is None else (weighting,)
    find = _from_scout if is_large(data) else _searched
    found, reason = find(record, data, options, kinds, states, tell)
    if not found:
        raise FitError("no start could be refined", hint="a longer record, or fewer states")
    if weighting is not None:
        return found[0], reason
    tell(f"{found[0].layout.states} states, samples held out")
    judged = [(error_held_out(record, band_hz, run), run) for run in found]
    least = min(error for error, _ in judged)
    alike = [(error, run) for error, run in judged if error <= ALIKE * least]
    error, best = min(alike, key=lambda t: record_length(data, t[1]))
    return best, f"{reason}; {WEIGHED[best.weighting]}: samples held out are simulated within {error:.2%}"


def _searched(
    record: Record,
    data: Data,
    options: FitOptions,
    kinds: tuple[Weighting, ...],
    states: int | None,
    tell: Callable[[str], None],
) -> tuple[list[RecordRun], str]:
    """A model with each weighting, of the order asked for or that of the minimum description length."""
    pasts = pasts_of(record)
    if states is None:
        found, reason = _shortest(record, pasts, data, options, kinds, tell)
    else:
        options = options.sized(states)
        found, reason = _grown_to(pasts, data, options, kinds, []), f"{states} states were asked for"
    if not found:
        return [], ""
    options = options.sized(found[0].layout.states)
    if kinds == NOISES:
        tell(f"{options.moving} states, all lines weighed alike")
        found += _grown_to(pasts, data, options, ("flat",), found)
    return [_exchanged(data, options, run) for run in found], reason


def _from_scout(
    record: Record,
    data: Data,
    options: FitOptions,
    kinds: tuple[Weighting, ...],
    states: int | None,
    tell: Callable[[str], None],
) -> tuple[list[RecordRun], str]:
    """The models of a scout, refined with each weighting on all there is."""
    small, thin = scouted(record, data)
    first, reason = _searched(small, thin, options, kinds[:1], states, tell)
    if not first:
        return [], ""
    # The layout of a model of the same poles and inputs: outputs share nothing else.
    start = Start(dataclasses.replace(first[0].layout, outputs=len(data.H)), first[0].refined.theta)
    run = refine_record(data, start, first[0].weighting, rounds=ROUNDS, steps=STEPS)
    if run is None:
        return [], ""
    if states is None:
        tell(f"{run.layout.states} states, on all lines")
        run = grown_while_shorter(record, data, options, run)
        if run.layout.states > first[0].layout.states:
            shortest = f"{run.layout.states} states have the minimum description length (MDL)"
            reason = f"{shortest}; on the lines of a first search {reason}"
    tried: tuple[Weighting, ...] = WEIGHTINGS if kinds == NOISES else ()
    others: list[Weighting] = [w for w in tried if w != run.weighting]
    more = (refine_record(data, run.start, w, rounds=ROUNDS, steps=STEPS) for w in others)
    return [run, *(other for other in more if other is not None)], reason


def grown_while_shorter(record: Record, data: Data, options: FitOptions, run: RecordRun) -> RecordRun:
    """The fit with pairs added where the residual is largest, while the description gets shorter."""
    while enough_samples(record, run.layout.states + 2):
        start = grown(data, options.sized(run.layout.states + 2), run)
        more = None if start is None else refine_record(data, start, run.weighting, rounds=2, steps=STEPS)
        if more is None or record_length(data, more) >= record_length(data, run):
            break
        run = more
    return run


def _shortest(
    record: Record,
    pasts: Pasts,
    data: Data,
    options: FitOptions,
    kinds: tuple[Weighting, ...],
    tell: Callable[[str], None],
) -> tuple[list[RecordRun], str]:
    """The models of the order that has the minimum description length, and why.

    Once an order has not shortened it, the next ones have few starts beside the order before, grown.
    """
    tried: list[tuple[int, float, list[RecordRun]]] = []
    runs: list[RecordRun] = []
    for states in sizes():
        if not enough_samples(record, states):
            break
        tell(f"{states} states")
        few = bool(tried) and tried[-1] is not min(tried, key=lambda t: t[1])
        runs = _models(pasts, data, options.sized(states), kinds, runs, few=few)
        if runs:
            tried.append((states, min(record_length(data, run) for run in runs), runs))
        if tried and is_settled([length for _, length, _ in tried]):
            break
    if not tried:
        return [], ""
    return min(tried, key=lambda t: t[1])[2], shortest_reason([t[:2] for t in tried])


def _grown_to(
    pasts: Pasts, data: Data, options: FitOptions, kinds: tuple[Weighting, ...], others: list[RecordRun]
) -> list[RecordRun]:
    """Models of ``options.moving`` states with each weighting, grown from orders just below."""
    runs: list[RecordRun] = []
    for less in range(BELOW, 0, -2):
        if options.moving > less:
            below = options.sized(options.moving - less)
            runs = _models(pasts, data, below, kinds, runs)
    return _models(pasts, data, options, kinds, [*runs, *others])


def _exchanged(data: Data, options: FitOptions, run: RecordRun) -> RecordRun:
    """The fit with modes exchanged as long as that pays."""
    while (other := leader(data, exchanges(data, options, run), run.weighting)) is not None:
        other = further(data, other, rounds=ROUNDS, steps=STEPS)
        if other.likelihood > run.likelihood - WORTH:
            break
        run = other
    return run


def _models(
    pasts: Pasts,
    data: Data,
    options: FitOptions,
    kinds: tuple[Weighting, ...],
    known: list[RecordRun],
    *,
    few: bool = False,
) -> list[RecordRun]:
    """The likeliest model with each weighting, from subspaces, from the order before and from each other."""
    starts = list(record_starts(pasts, data, options, few=few))
    same = [run for run in known if run.layout.states == options.moving]
    found: list[RecordRun] = []
    for weighting in kinds:
        before = [grown(data, options, run) for run in known if run.weighting == weighting]
        other = [run.start for run in (*same, *found)]
        run = leader(data, [*starts, *other, *(start for start in before if start is not None)], weighting)
        if run is not None:
            found.append(further(data, run, rounds=ROUNDS, steps=STEPS))
    return found


def shortest_reason(tried: Sequence[tuple[int, float]]) -> str:
    """One sentence on the order of the minimum description length, of orders tried and their lengths.

    >>> shortest_reason([(2, 30.0), (4, 10.0), (6, 15.0)])
    '4 states have the minimum description length (MDL) of 3 orders from 2 to 6, 5 below the next'
    """
    states, shortest = min(tried, key=lambda t: t[1])
    rivals = [length - shortest for other, length in tried if other != states]
    margin = f", {min(rivals):.0f} below the next" if rivals else ""
    span = f"of {len(tried)} orders from {tried[0][0]} to {tried[-1][0]}"
    return f"{states} states have the minimum description length (MDL) {span}{margin}"


def record_length(data: Data, run: RecordRun) -> float:
    """Description length of a record, the transients of all its experiments among the unknowns."""
    return description_length(run.likelihood, record_unknowns(run), 2 * data.H.size)


def record_unknowns(run: RecordRun) -> int:
    """Unknowns of a model of a record, those of transients among them."""
    return run.layout.size + run.refined.step.linear.size


def enough_samples(record: Record, states: int) -> bool:
    """Whether two thirds of the record have more numbers than the model and its transients unknowns."""
    experiments, periods, samples, inputs = record.u.shape
    outputs = record.y.shape[3]
    unknowns = states * (inputs + outputs + outputs * experiments) + inputs * outputs
    return unknowns < experiments * outputs * (2 * periods * samples // 3)


def error_held_out(
    record: Record, band_hz: tuple[float, float] | None, run: RecordRun, transient: Transient | None = None
) -> float:
    """rms over both parts of the error of the simulation, over that of the outputs, outputs alike.

    ``transient`` has the free samples of a continuous model. Infinite where the model cannot be refined or
    simulated.
    """
    count = record.u.shape[1] * record.u.shape[2]
    third = count // 3
    errors: list[float] = []
    for seen, unseen in (((0, count - third), (count - third, count)), ((third, count), (0, third))):
        data = record_data(cut_samples(record, *seen), band_hz, whole=True)
        data = dataclasses.replace(data, transient=transient or data.transient)
        part = refine_record(data, run.start, run.weighting, rounds=1, steps=STEPS_HELD_OUT)
        if part is None:
            return np.inf
        model = model_of(part, record.inputs, record.outputs)
        try:
            left = record_nrmse(model, cut_samples(record, *unseen), state_share=STATE_SHARE)
        except (NumericalError, DataError):
            return np.inf
        errors += list(left**2)
    return float(np.sqrt(np.mean(errors)))
