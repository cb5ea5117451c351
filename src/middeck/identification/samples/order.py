"""Order and weights of a sampled model: the shortest description, and samples held out.

The order is that of the shortest description of the record by either kind of noise, transients counted among
its unknowns. The weights at that order are those whose model simulates samples held out best: refined on the
first two thirds of the record and judged on the last, with only its initial state fitted there, and the other
way round. Both rules were chosen among others by their error on simulated records whose truth is known
(docs/explanation/one-long-record.md).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from middeck.errors import FitError, NumericalError
from middeck.identification.fit.data import Data
from middeck.identification.fit.order import description_length, is_settled, sizes
from middeck.identification.fit.start import Options
from middeck.identification.measurement_model import MeasurementModel
from middeck.identification.samples.model import record_model
from middeck.identification.samples.race import further, leader
from middeck.identification.samples.search import RecordRun, Weighting, refine_record
from middeck.identification.samples.simulation import record_nrmse
from middeck.identification.samples.spectra import cut_samples, record_data
from middeck.identification.samples.starts import record_starts
from middeck.systems.record import Record
from middeck.values import record as frozen

# Rounds of noise and search, and steps of each, on all samples; steps on each part that is held out from.
ROUNDS, STEPS, PART_STEPS = 4, 60, 15
# Share of the part held out to which the initial state is fitted.
STATE_SHARE = 0.5
KINDS: tuple[Weighting, ...] = ("output", "motion")
WEIGHED = {
    "flat": "all lines weighed alike",
    "output": "lines weighed by the noise of sensors",
    "motion": "lines weighed by the noise of forces",
}


@frozen
class Candidate:
    """An order, the model that it gives on all samples with some weights, and its description length."""

    states: int
    run: RecordRun
    length: float


def choose_record(
    record: Record,
    options: Options,
    band_hz: tuple[float, float] | None,
    *,
    states: int | None,
    weighting: Weighting | None,
) -> tuple[RecordRun, str]:
    """The best order (of those asked for) and weighting, with the reason."""
    kinds = KINDS if weighting is None else (weighting,)
    data = record_data(record, band_hz, whole=True)
    if states is None:
        found, reason = _shortest(record, data, options, kinds)
    else:
        sized = dataclasses.replace(options, states=states)
        found, reason = _candidates(record, data, sized, kinds), f"{states} states were asked for"
    if not found:
        raise FitError("no start could be refined", hint="a longer record, or fewer states")
    if weighting is not None:
        return found[0].run, reason
    found += _candidates(record, data, dataclasses.replace(options, states=found[0].states), ("flat",))
    judged = [(_held_out(record, options, band_hz, one.run), one.length, one) for one in found]
    error, _, best = min(judged, key=lambda t: t[:2])
    return (
        best.run,
        f"{reason}; {WEIGHED[best.run.weighting]}: samples held out are simulated within {error:.2%}",
    )


def _shortest(
    record: Record, data: Data, options: Options, kinds: tuple[Weighting, ...]
) -> tuple[list[Candidate], str]:
    """The candidates of the order that has the shortest description, and why."""
    tried: list[tuple[float, list[Candidate]]] = []
    for size in sizes():
        if not enough_samples(record, size):
            break
        found = _candidates(record, data, dataclasses.replace(options, states=size), kinds)
        if found:
            tried.append((min(one.length for one in found), found))
        if tried and is_settled([length for length, _ in tried]):
            break
    if not tried:
        return [], ""
    reason = shortest_reason([(found[0].states, length) for length, found in tried])
    return min(tried, key=lambda t: t[0])[1], reason


def shortest_reason(tried: Sequence[tuple[int, float]]) -> str:
    """One sentence on the order of the shortest description, of orders tried and their lengths.

    >>> shortest_reason([(2, 30.0), (4, 10.0), (6, 15.0)])
    '4 states have the shortest description of 3 orders from 2 to 6, 5 below the next'
    """
    states, shortest = min(tried, key=lambda t: t[1])
    rivals = [length - shortest for other, length in tried if other != states]
    margin = f", {min(rivals):.0f} below the next" if rivals else ""
    span = f"of {len(tried)} orders from {tried[0][0]} to {tried[-1][0]}"
    return f"{states} states have the shortest description {span}{margin}"


def record_length(data: Data, run: RecordRun) -> float:
    """Description length of a record, the transients of all its experiments among the unknowns."""
    unknowns = run.layout.size + run.refined.step.linear.size
    return description_length(run.likelihood, unknowns, 2 * data.H.size)


def enough_samples(record: Record, states: int) -> bool:
    """Whether two thirds of the record have more numbers than the model and its transients unknowns."""
    experiments, periods, samples, inputs = record.u.shape
    outputs = record.y.shape[3]
    unknowns = states * (inputs + outputs + outputs * experiments) + inputs * outputs
    return unknowns < experiments * outputs * (2 * periods * samples // 3)


def _candidates(
    record: Record, data: Data, options: Options, weightings: tuple[Weighting, ...]
) -> list[Candidate]:
    starts = list(record_starts(record, data, options))
    found: list[Candidate] = []
    for weighting in weightings:
        run = leader(data, starts, weighting)
        if run is not None:
            run = further(data, run, rounds=ROUNDS, steps=STEPS)
            found.append(Candidate(options.states, run, record_length(data, run)))
    return found


def _held_out(record: Record, options: Options, band_hz: tuple[float, float] | None, run: RecordRun) -> float:
    """rms over both halves held out of the error of the simulation there, outputs alike."""
    count = record.u.shape[1] * record.u.shape[2]
    third = count // 3
    errors: list[float] = []
    for seen, unseen in (((0, count - third), (count - third, count)), ((third, count), (0, third))):
        data = record_data(cut_samples(record, *seen), band_hz, whole=True)
        part = refine_record(data, run.layout, run.refined.theta, run.weighting, rounds=1, steps=PART_STEPS)
        if part is None:
            return np.inf
        model: MeasurementModel = record_model(part.layout, part.refined, record)
        try:
            left = record_nrmse(model, cut_samples(record, *unseen), state_share=STATE_SHARE)
        except NumericalError:
            return np.inf
        errors += list(left**2)
    return float(np.sqrt(np.mean(errors)))
