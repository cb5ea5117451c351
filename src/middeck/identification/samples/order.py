"""Order and weights of a sampled model by what they are for: simulating samples they have not seen.

A record of some hundred samples is short for a description length: its noise is estimated from the very lines
that are fitted. So each candidate is refined on the first two thirds of the record and judged on the last,
and the other way round, as it will be used: simulated, with only its initial state fitted there.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from middeck.errors import FitError, NumericalError
from middeck.identification.fit.order import sizes
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
# An order must be this much better than a smaller one, and the search ends so many orders after the best.
WORTH, PATIENCE = 0.95, 2
WEIGHTINGS: tuple[Weighting, ...] = ("flat", "motion")


@frozen
class Candidate:
    """An order and a weighting, the model they give on all samples and its error on samples held out."""

    states: int
    run: RecordRun
    error: float


def race_record(
    record: Record, options: Options, weighting: Weighting, band_hz: tuple[float, float] | None
) -> RecordRun:
    """The likeliest of the starts from subspaces."""
    data = record_data(record, band_hz, whole=True)
    best = leader(data, record_starts(record, data, options), weighting)
    if best is None:
        raise FitError(
            f"no start for {options.states} states could be refined", hint="fewer states, or a longer record"
        )
    return further(data, best, rounds=ROUNDS, steps=STEPS)


def choose_record(
    record: Record,
    options: Options,
    band_hz: tuple[float, float] | None,
    *,
    states: int | None,
    weighting: Weighting | None,
) -> tuple[RecordRun, str]:
    """The best order (of those asked for) and weighting on samples held out, with the reason."""
    weightings = WEIGHTINGS if weighting is None else (weighting,)
    if states is not None and weighting is not None:
        options = dataclasses.replace(options, states=states)
        return race_record(record, options, weighting, band_hz), f"{states} states were asked for"
    tried: list[Candidate] = []
    for size in sizes() if states is None else (states,):
        if not _enough(record, size):
            break
        tried += _candidates(record, dataclasses.replace(options, states=size), band_hz, weightings)
        if tried and size > _best(tried).states + 2 * (PATIENCE - 1) and len(tried) > PATIENCE:
            break
    if not tried:
        raise FitError("no order could be fitted", hint="a longer record, or fewer states")
    best = _best(tried)
    return best.run, _reason(best, tried, asked=states is not None)


def _enough(record: Record, states: int) -> bool:
    """Whether two thirds of the record have more numbers than the model and its transients unknowns."""
    experiments, periods, samples, inputs = record.u.shape
    outputs = record.y.shape[3]
    unknowns = states * (inputs + outputs + outputs * experiments) + inputs * outputs
    return unknowns < experiments * outputs * (2 * periods * samples // 3)


def _candidates(
    record: Record,
    options: Options,
    band_hz: tuple[float, float] | None,
    weightings: tuple[Weighting, ...],
) -> list[Candidate]:
    found: list[Candidate] = []
    for weighting in weightings:
        try:
            run = race_record(record, options, weighting, band_hz)
        except FitError:
            continue
        found.append(Candidate(options.states, run, _held_out(record, options, band_hz, run)))
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
        model: MeasurementModel = record_model(part.layout, part.refined, record, 1.0 / options.period_s)
        try:
            left = record_nrmse(model, cut_samples(record, *unseen), state_share=STATE_SHARE)
        except NumericalError:
            return np.inf
        errors += list(left**2)
    return float(np.sqrt(np.mean(errors)))


def _best(tried: list[Candidate]) -> Candidate:
    """The smallest order that no larger one beats clearly."""
    best = tried[0]
    for other in tried[1:]:
        if other.error < (WORTH if other.states > best.states else 1.0) * best.error:
            best = other
    return best


def _reason(best: Candidate, tried: list[Candidate], *, asked: bool) -> str:
    weighed = (
        "all lines weighed alike"
        if best.run.weighting == "flat"
        else f"lines weighed by the noise of {best.run.weighting}"
    )
    what = f"samples held out are simulated within {best.error:.2%}, {weighed}"
    if asked:
        return f"{best.states} states were asked for; {what}"
    orders = sorted({t.states for t in tried})
    return (
        f"{best.states} states are the best of {len(orders)} orders from {orders[0]} to {orders[-1]}: {what}"
    )
