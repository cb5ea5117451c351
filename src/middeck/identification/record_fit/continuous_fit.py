"""A continuous model of a record: where its fit starts, and how many states the record asks for.

A long record is first averaged to a local estimate of its response, and a fit of that is where the fit of the
samples starts. The lines of a short one lie as far apart as its resonances are wide, so that no local model
follows them; then subspaces of its samples (`record_starts`), which need no lines, race with that start.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import DataError, FitError
from middeck.identification.fit.fit_response import ModelAlone
from middeck.identification.model.fit_options import FitOptions
from middeck.identification.model.measurement_model import MeasurementModel, path_delay, rank_of
from middeck.identification.order.order_choice import is_settled, sizes
from middeck.identification.problem.data import Data, Transient
from middeck.identification.problem.unknowns_layout import Point, Start
from middeck.identification.record_fit import record_order
from middeck.identification.record_fit.record_starts import PastOfRecord, continuous_starts, past_of
from middeck.identification.record_fit.reduced_record import (
    FEW,
    has_many_outputs,
    with_few_lines,
    with_few_outputs,
)
from middeck.identification.record_fit.refine_record import (
    RecordRun,
    Weighting,
    further,
    leader,
    refine_record,
)
from middeck.identification.start.start import start_from_point
from middeck.identification.uncertainty.parameter_deviations import distinct_poles
from middeck.signals.record import Record

# Up to so many samples a record is short: subspaces cost little, and local models may not resolve it.
SHORT = 8192
# Up to so many, the record itself is asked for the order where local models leave much of the response.
MEDIUM = 4 * SHORT
# Rounds of noise and search, and steps of each, of the last refinement.
ROUNDS, STEPS = 4, 60
# Samples left free at a record's beginning, at most: a search solves for them at each step, by dense algebra.
# Longer delays are better taken out beforehand.
MOST_FREE = 512
# A fit of local models that leaves more of the response may have missed a mode.
POOR = 0.1
# Share of the error on samples held out at which other weights are taken.
CLEARLY = 0.8
# Steps after which the other kind of noise is compared.
FIRST_STEPS = 3


def fit_continuous(
    record: Record,
    data: Data,
    options: FitOptions,
    local: Callable[[], ModelAlone],
    *,
    states: int | None,
    weighting: Weighting | None,
    tell: Callable[[str], None],
) -> tuple[Data, RecordRun, str]:
    """The data with free samples at its ends, the model, and why it has its order.

    ``local`` fits an estimate of the response, for ``states`` or (None) for as many as that asks for.
    """
    samples = data.H.shape[2] * record.u.shape[1] * record.u.shape[2]
    short = samples <= SHORT
    if not short or states is not None:
        tell("a local estimate of the response, and its fit")
    first, failed = (None, None) if short and states is None else _attempt(local)
    poor = first is None or float(np.max(first.error)) > POOR
    chosen = states is None and (first is None or (poor and samples <= MEDIUM))
    starts, reason = [], ""
    if first is not None and not chosen:
        terms = first.structure
        options = dataclasses.replace(options, residuals=terms.with_lower, direct=terms.with_direct)
        reason = first.order_reason
        starts = _prompt(record, [_start_of(first, options)])
    found = _led(record, data, starts, weighting)
    if short or found is None or poor:
        past = past_of(record, data)
        if chosen:
            options, reason = _choose_order(record, data, options, past, tell)
        elif states is None and first is not None:
            options = options.sized(_start_of(first, options).layout.states)
        starts += _prompt(record, continuous_starts(past, data, options))
        tell(f"{options.moving} states, on all outputs")
        found = _led(record, data, starts, weighting)
        if chosen and found is not None and has_many_outputs(data):
            tell("modes that few outputs did not show")
            found = found[0], _with_modes_of_others(record, *found, options)
            reason = f"{found[1].layout.states} states by all outputs; by {FEW} of them {reason}"
    if found is None:
        raise failed or _no_start()
    return *_finished(record, *found, weighting), reason


def _finished(
    record: Record, data: Data, best: RecordRun, weighting: Weighting | None
) -> tuple[Data, RecordRun]:
    """Refined to the end, as many samples free as the delay found asks for.

    Where the model has no value on those (a pole that decays within them stands for the same samples), it is
    refined on those that it was found on.
    """
    edged = dataclasses.replace(data, transient=_edges(record, [best.start]))
    again = refine_record(edged, best.start, best.weighting, rounds=1, steps=FIRST_STEPS)
    if again is not None:
        data, best = edged, again
    best = _settled(data, best, weighting)
    return data, best if weighting is not None else _held_out(record, data, best)


def _attempt(local: Callable[[], ModelAlone]) -> tuple[ModelAlone | None, FitError | DataError | None]:
    """One attempt: lines that no local model can resolve are no reason to give up the samples."""
    try:
        return local(), None
    except (FitError, DataError) as error:
        return None, error


def _prompt(record: Record, starts: Iterable[Start]) -> list[Start]:
    """Starts whose delays leave no more samples free than can be solved for."""
    most = MOST_FREE / record.sample_hz
    return [s for s in starts if float(s.point.delay_s.max()) < most]


def _led(
    record: Record, data: Data, starts: Sequence[Start], weighting: Weighting | None
) -> tuple[Data, RecordRun] | None:
    """The likeliest of the starts, with the data whose free samples suit them."""
    if not starts:
        return None
    data = dataclasses.replace(data, transient=_edges(record, starts))
    best = leader(data, list(starts), weighting or "output")
    return None if best is None else (data, best)


def _no_start() -> FitError:
    return FitError(
        "no start could be refined on the record",
        hint="fewer states, a longer record, or band_hz=(low, high) of what is driven; take out a delay of "
        "many samples",
    )


def _settled(data: Data, best: RecordRun, weighting: Weighting | None) -> RecordRun:
    """Refined to the end, with the likelier kind of noise unless one is asked for."""
    best = further(data, best, rounds=ROUNDS, steps=STEPS)
    if weighting is not None:
        return best
    other = refine_record(data, best.start, "motion", rounds=1, steps=FIRST_STEPS)
    if other is None or other.likelihood >= best.likelihood:
        return best
    return further(data, other, rounds=ROUNDS, steps=STEPS)


def _held_out(record: Record, data: Data, best: RecordRun) -> RecordRun:
    """The model, or one of all lines weighed alike if that simulates samples held out clearly better.

    Only where much is left: that is more than noise, and weights that follow it may pass over strong lines.
    """
    left = best.residual(data)
    share = np.sum(np.abs(left) ** 2, axis=(1, 2)) / np.sum(np.abs(data.H) ** 2, axis=(1, 2))
    if np.max(share) <= POOR**2:
        return best
    flat = refine_record(data, best.start, "flat", rounds=ROUNDS, steps=STEPS)
    if flat is None:
        return best
    lines = data.omega / (2.0 * np.pi)
    of_best, of_flat = (
        record_order.error_held_out(record, (float(lines[0]), float(lines[-1])), run, data.transient)
        for run in (best, flat)
    )
    return flat if of_flat < CLEARLY * of_best else best


def _choose_order(
    record: Record, data: Data, options: FitOptions, past: PastOfRecord, tell: Callable[[str], None]
) -> tuple[FitOptions, str]:
    """The order of the minimum description length of the record, its transients counted, and why.

    Of many outputs, a few are judged: the poles of an article are in all, delays are each its own.
    """
    if has_many_outputs(data):
        record, data = with_few_outputs(record, data)
        past = past_of(record, data)
    tried: list[tuple[int, float]] = []
    for states in sizes():
        if not record_order.enough_samples(record, states + options.at_zero):
            break
        tell(f"{states} states")
        starts = _prompt(record, continuous_starts(past, data, options.sized(states)))
        if not starts:
            continue
        edged = dataclasses.replace(data, transient=_edges(record, starts))
        run = leader(edged, starts, "output")
        if run is None:
            continue
        tried.append((states + options.at_zero, record_order.record_length(edged, run)))
        if is_settled([length for _, length in tried]):
            break
    if not tried:
        raise FitError("no order could be fitted", hint="a longer record, or say how many states")
    best = min(tried, key=lambda t: t[1])[0]
    return dataclasses.replace(options, states=best), record_order.shortest_reason(tried)


def _with_modes_of_others(record: Record, data: Data, best: RecordRun, options: FitOptions) -> RecordRun:
    """The fit with pairs added while they shorten the description of some lines of all outputs."""
    thin = with_few_lines(data)
    run = refine_record(thin, best.start, best.weighting, rounds=1, steps=FIRST_STEPS)
    more = None if run is None else record_order.grown_while_shorter(record, thin, options, run)
    if more is None or more.layout.states == best.layout.states:
        return best
    return refine_record(data, more.start, best.weighting, rounds=1, steps=FIRST_STEPS) or best


def _edges(record: Record, starts: Sequence[Start]) -> Transient:
    """Free samples: those that respond to inputs before the record, and one at the end."""
    delay = float(np.median([s.point.delay_s.max() for s in starts]))
    late = int(np.ceil(delay * record.sample_hz)) + 1
    if late >= record.u.shape[1] * record.u.shape[2] // 2:
        raise FitError(
            f"a delay of {delay:.6g} s is no shorter than half the record",
            hint="a longer record, or shift the outputs by the delay that is known",
        )
    return Transient(1.0 / record.sample_hz, max(late, 1), 1)


def _start_of(first: ModelAlone, options: FitOptions) -> Start:
    """Layout and theta of a fitted model."""
    model = first.model
    modes = np.array(distinct_poles(model), dtype=int)
    modes = modes[np.argsort(~model.is_pair[modes], kind="stable")]
    psi = np.vstack([_rows(model, model.rigid), _rows(model, model.integral)])
    late = path_delay(model) if options.delay_of == "path" else model.delay_s[:, None]
    point = Point(model.poles[modes], model.participation[modes], late, psi)
    return start_from_point(options, model.is_pair[modes], point, len(model.outputs))


def _rows(model: MeasurementModel, residue: np.ndarray | None) -> Float[np.ndarray, "rank input"]:
    """Directions of the inputs that drive a pole at zero."""
    if residue is None:
        return np.zeros((0, len(model.inputs)))
    return np.linalg.svd(residue)[2][: rank_of(residue)]
