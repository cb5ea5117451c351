"""A continuous model of a record: where its fit starts, and how many states the record asks for.

A long record is first averaged to a local estimate of its response, and a fit of that is where the fit of the
samples starts. The lines of a short one lie as far apart as its resonances are wide, so that no local model
follows them; then subspaces of its samples (`starts`), which need no lines, race with that start.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from middeck.errors import FitError
from middeck.identification.fit.data import Data, Transient
from middeck.identification.fit.fit_response import FitResult
from middeck.identification.fit.layout import Layout, Point, pack, unpack
from middeck.identification.fit.order import is_settled, sizes
from middeck.identification.fit.start import Options, Start
from middeck.identification.samples.order import enough_samples, record_length, shortest_reason
from middeck.identification.samples.race import further, leader
from middeck.identification.samples.search import RecordRun, Weighting, refine_record
from middeck.identification.samples.starts import PastOfRecord, continuous_starts, past_of
from middeck.systems.record import Record

# Up to so many samples a record is short: subspaces cost little, and local models may not resolve it.
SHORT = 8192
# Rounds of noise and search, and steps of each, of the last refinement.
ROUNDS, STEPS = 4, 60
# Steps after which the other kind of noise is compared.
FIRST_STEPS = 3


def fit_continuous(
    record: Record,
    data: Data,
    options: Options,
    local: Callable[[], FitResult],
    *,
    states: int | None,
    weighting: Weighting | None,
) -> tuple[Data, RecordRun, str]:
    """The data with free samples at its ends, the model, and why it has its order.

    ``local`` fits an estimate of the response, for ``states`` or (None) for as many as that asks for.
    """
    short = data.H.shape[2] * record.u.shape[1] * record.u.shape[2] <= SHORT
    first: FitResult | None = None
    failed: FitError | None = None
    if states is not None or not short:
        try:
            first = local()
        except FitError as error:
            failed = error
    starts = [] if first is None else [_start_of(first)]
    reason = "" if first is None else first.order_reason
    if short or first is None:
        past = past_of(record, data)
        if states is None:
            states, reason = _choose_order(record, data, options, past)
        options = dataclasses.replace(options, states=states)
        starts += list(continuous_starts(past, data, options))
    if not starts:
        raise failed or _no_start()
    data = dataclasses.replace(data, transient=_edges(record, starts))
    best = leader(data, starts, weighting or "output")
    if best is None:
        raise _no_start()
    data = dataclasses.replace(data, transient=_edges(record, [Start(best.layout, best.refined.theta)]))
    return data, _settled(data, best, weighting), reason


def _no_start() -> FitError:
    return FitError("no start could be refined on the record", hint="fewer states, or a longer record")


def _settled(data: Data, best: RecordRun, weighting: Weighting | None) -> RecordRun:
    """Refined to the end, with the likelier kind of noise unless one is asked for."""
    best = further(data, best, rounds=ROUNDS, steps=STEPS)
    if weighting is not None:
        return best
    theta = best.refined.theta
    other = refine_record(data, best.layout, theta, "motion", rounds=1, steps=FIRST_STEPS)
    if other is None or other.likelihood >= best.likelihood:
        return best
    return further(data, other, rounds=ROUNDS, steps=STEPS)


def _choose_order(record: Record, data: Data, options: Options, past: PastOfRecord) -> tuple[int, str]:
    """The order of the shortest description of the record, its transients counted, and why."""
    tried: list[tuple[int, float]] = []
    for states in sizes():
        if not enough_samples(record, states):
            break
        starts = list(continuous_starts(past, data, dataclasses.replace(options, states=states)))
        if not starts:
            continue
        edged = dataclasses.replace(data, transient=_edges(record, starts))
        run = leader(edged, starts, "output")
        if run is None:
            continue
        tried.append((states, record_length(edged, run)))
        if is_settled([length for _, length in tried]):
            break
    if not tried:
        raise FitError("no order could be fitted", hint="a longer record, or say how many states")
    return min(tried, key=lambda t: t[1])[0], shortest_reason(tried)


def _edges(record: Record, starts: Sequence[Start]) -> Transient:
    """Free samples: those that answer to inputs before the record, and one at the end for what is between."""
    delay = float(np.median([unpack(s.layout, s.theta).delay_s.max() for s in starts]))
    late = int(np.ceil(delay * record.sample_hz)) + 1
    if late >= record.u.shape[1] * record.u.shape[2] // 2:
        raise FitError(
            f"a delay of {delay:.6g} s is no shorter than half the record",
            hint="a longer record, or shift the outputs by the delay that is known",
        )
    return Transient(1.0 / record.sample_hz, max(late, 1), 1)


def _start_of(first: FitResult) -> Start:
    """Layout and theta of a fitted model."""
    model, structure = first.model, first.covariance.structure
    order = np.argsort(~model.is_pair, kind="stable")
    poles, pair, b = model.poles[order], model.is_pair[order], model.participation[order]
    layout = Layout(
        pair,
        np.zeros(len(pair)),
        np.argmax(np.abs(b), axis=1),
        len(model.inputs),
        len(model.outputs),
        structure.real_constants,
        structure.with_delay,
        structure.with_lower,
        structure.with_direct,
        0.0,
    )
    return Start(layout, pack(layout, Point(poles, b, model.delay_s[:, None])))
