"""All faults of a record."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from middeck.arguments import named_kinds
from middeck.errors import DataError
from middeck.identification.faults.against_reference import compare_with_reference
from middeck.identification.faults.collocated_channels import find_pair_faults
from middeck.identification.faults.equal_runs import (
    FaultDraft,
    Levels,
    Runs,
    Signal,
    Spans,
    fault,
    levels_of,
)
from middeck.identification.faults.gaps_clipping_and_dropouts import (
    find_clipped_mean,
    find_clipping,
    find_dropouts,
    find_gaps,
    is_dead,
)
from middeck.identification.faults.hum import find_hum
from middeck.identification.faults.lost_in_a_period import find_lost_in_period
from middeck.identification.faults.lost_samples_and_feedback import find_relation_faults
from middeck.identification.faults.offset_drift_and_transient import (
    find_coarse_steps,
    find_drift,
    find_held,
    find_offset,
    find_transient,
    find_unsteady_input,
    held_at,
)
from middeck.identification.faults.random_drift import find_random_drift
from middeck.identification.faults.spikes import find_spikes, is_impact, moves_by_the_rest, spike_runs
from middeck.identification.faults.stuck_and_gain_drift import find_gain_drift, find_stuck
from middeck.identification.faults.unlike_experiments import find_unlike_experiments
from middeck.signals.fault import RecordFault, Side
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse

# With these a channel is compared with none; with LOCAL, what an output leaves of its inputs is no noise.
MISSING = ("gap", "dead")
LOCAL = ("clipping", "dropout", "spike", "held", "duplicate", "shift", "stuck")
# What biases an estimate as a whole.
BIASING = ("shift", "joint", "feedback", "delay", "truncated", "unlike", "stuck", "clipping")
# What spoils few samples, and thereby all lines.
BRIEF = ("spike", "dropout")
SEVERITIES = ("unusable", "serious", "note")


# Range of the largest sample of a channel: beyond it squares and their products overflow or vanish.
LEAST, MOST = 1e-100, 1e100


@named_kinds
def detect_faults(record: Record, reference: FrequencyResponse | None = None) -> tuple[RecordFault, ...]:
    """Faults of ``record``, worst first; empty for a clean one.

    Args:
        record: Samples may be NaN where they are missing.
        reference: The response that is expected, of the same ports, such as that of a model or an earlier
            record: signs, gains, swapped channels and delays are then judged by it.

    Found in each channel and experiment: gaps, dead channels, clipping, dropouts, spikes, offset, drift,
    coarse steps, channels held at a slower rate; in periodic records transients and inputs that do not
    repeat; between channels duplicates, and where node and direction are known (`Channel`) signs and delays
    of collocated channels; between experiments outputs that are swapped, turned round or of another gain;
    between inputs and outputs sines that no input makes, drift at random, channels that stick for a while,
    samples lost or repeated on one side, runs that were joined, gains that change, feedback and long delays.
    docs/explanation/records-and-faults.md says how, with rates of detection and false alarm.

    Raises `DataError` for samples so large or so small that their squares are no numbers.

    >>> rng = np.random.default_rng(0)
    >>> u, y = rng.standard_normal((1, 1, 500, 1)), rng.standard_normal((1, 1, 500, 1))
    >>> y[0, 0, 200] = 40.0
    >>> record = Record(sample_hz=100.0, u=u, y=y, inputs=(Port("force", "N"),), outputs=(Port("tip",
    ...     "m"),), periodic=False)
    >>> [(f.channel, f.kind, f.samples) for f in detect_faults(record)]
    [('tip', 'spike', ((200, 201),))]
    """
    _check_size(record)
    found: list[RecordFault] = []
    struck = _struck(record)
    driven = [] if struck else [_driven(u) for u in record.u]
    sides: tuple[tuple[Side, tuple[Port, ...], np.ndarray], ...] = (
        ("input", record.inputs, record.u), ("output", record.outputs, record.y)
    )  # fmt: skip
    for side, ports, samples in sides:
        for k, port in enumerate(ports):
            for e, x in enumerate(samples[..., k]):
                answered = None if struck else driven[e] if side == "output" else []
                faults = _channel_faults(x, port, side=side, periodic=record.periodic, driven=answered)
                found += [f.at(side, port, e) for f in faults]
    moving = _without(record, found, MISSING)
    if moving is not None:
        found += find_pair_faults(moving)
        found += [what.at("output", port, e) for what, port, e in find_hum(moving)]
        drifting = {(f.channel, f.experiment) for f in found if f.side == "output" and f.kind == "drift"}
        at_random = find_random_drift(moving)
        found += [what.at("output", port, e) for what, port, e in at_random if (port.name, e) not in drifting]
    clean = None if struck else _without(record, found, (*MISSING, *LOCAL))
    if clean is not None:
        found += find_stuck(clean)
        clean = _without(record, found, (*MISSING, *LOCAL))
    if clean is not None:
        found += find_relation_faults(clean)
        found += find_unlike_experiments(clean)
        found += find_gain_drift(clean)
    cut = {(f.channel, f.experiment) for f in found if f.side == "output" and f.kind == "clipping"}
    if cut and not struck:
        # A limit moves no response in time: samples lost on one side show beside it.
        limited = _without(record, found, (*MISSING, *(k for k in LOCAL if k != "clipping")))
        related = [] if limited is None else find_relation_faults(limited)
        found += [f for f in related if f.kind == "shift" and (f.channel, f.experiment) in cut]
    if reference is not None and not any(f.kind in MISSING for f in found):
        found += compare_with_reference(record, reference)
    return tuple(sorted(found, key=lambda f: SEVERITIES.index(f.severity)))


def biasing_faults(record: Record, wrong: Sequence[str] = ()) -> list[RecordFault]:
    """The faults that bias an estimate as a whole and show in no scatter.

    For the channels named in ``wrong`` also spikes and dropouts, which look like noise on all lines.
    """
    return [f for f in detect_faults(record) if f.kind in BIASING or (f.kind in BRIEF and f.channel in wrong)]


def clipped_channels(record: Record) -> list[RecordFault]:
    """Clipping of the channels of a record without gaps."""
    sides: tuple[tuple[Side, tuple[Port, ...], np.ndarray], ...] = (
        ("input", record.inputs, record.u), ("output", record.outputs, record.y)
    )  # fmt: skip
    return [
        f.at(side, port, e)
        for side, ports, samples in sides
        for k, port in enumerate(ports)
        for e, x in enumerate(samples[..., k])
        if not is_dead(x)
        for f in _clipping(x.ravel(), levels_of(x), period=x.shape[1] if record.periodic else None)
    ]


def _without(record: Record, found: Sequence[RecordFault], kinds: Sequence[str]) -> Record | None:
    """The record without outputs that have faults of these ``kinds``, and without dead inputs.

    None if an input that is not dead has one, since it affects all outputs, or if no input or output is left.
    """
    at = {(f.side, f.channel, f.kind) for f in found if f.kind in kinds}
    if any(side == "input" and kind != "dead" for side, _, kind in at):
        return None
    bad = {(side, name) for side, name, _ in at}
    sides: tuple[tuple[Side, tuple[Port, ...]], ...] = ("input", record.inputs), ("output", record.outputs)
    u, y = ([k for k, port in enumerate(ports) if (side, port.name) not in bad] for side, ports in sides)
    if not u or not y:
        return None
    return dataclasses.replace(
        record,
        u=record.u[..., u],
        y=record.y[..., y],
        inputs=tuple(record.inputs[k] for k in u),
        outputs=tuple(record.outputs[k] for k in y),
    )


def _driven(inputs: np.ndarray) -> Runs:
    """Spikes and steps of the inputs of one experiment."""
    channels = [_filled(x.ravel()) for x in np.moveaxis(inputs, -1, 0)]
    moving = [x for x in channels if not is_dead(x)]
    moving += [np.diff(x, prepend=x[0]) for x in moving]
    return [run for x in moving for run in spike_runs(x, levels_of(x))]


def _struck(record: Record) -> bool:
    """Whether an input is the force of a hammer, whose blows are no faults."""
    for u, y in zip(record.u, record.y, strict=True):
        sides = ([_filled(x.ravel()) for x in np.moveaxis(samples, -1, 0)] for samples in (u, y))
        inputs, outputs = (np.stack(side, axis=1) for side in sides)
        moving = inputs[:, [not is_dead(x) for x in inputs.T]]
        for i, x in enumerate(moving.T):
            if is_impact(x) and not moves_by_the_rest(x, np.delete(moving, i, axis=1), outputs):
                return True
    return False


def _filled(x: Signal) -> Signal:
    """Interpolate missing samples linearly."""
    good = np.isfinite(x)
    if good.all() or not good.any():
        return np.where(good, x, 0.0)
    return np.interp(np.arange(len(x)), np.flatnonzero(good), x[good])


def _clipping(x: Signal, levels: Levels, *, period: int | None) -> list[FaultDraft]:
    """Clipping of a channel; of a held one, the values and not the samples that repeat them crowd."""
    every, first = held_at(x)
    values = x[first::every]
    clipped = find_clipping(values, levels)
    if not clipped and period is not None and period % every == 0 and len(values) % (period // every) == 0:
        clipped = find_clipped_mean(values, period // every)
    return [dataclasses.replace(f, samples=tuple(_held(f.samples, every, first, len(x)))) for f in clipped]


def _held(runs: Spans, every: int, first: int, count: int) -> Runs:
    """Samples of runs of values; the last value may be held for fewer than the others."""
    return [(first + every * a, min(first + every * b, count)) for a, b in runs]


def _channel_faults(
    periods: np.ndarray, port: Port, *, side: Side, periodic: bool, driven: Runs | None
) -> list[FaultDraft]:
    """Faults of a channel; ``driven``: spikes of the inputs, None for impacts (no search for others)."""
    period, is_input = periods.shape[1], side == "input"
    gaps, x = find_gaps(periods.ravel()), _filled(periods.ravel())
    if is_dead(x):
        what = f"does not move: constant at {x[0]:.6g} {port.unit}".rstrip()
        hint = "check cable and gain, or leave the channel out"
        return gaps or [fault("dead", what, hint, severity="unusable", samples=((0, len(x)),))]
    levels = levels_of(x)
    found = [*gaps, *_clipping(x, levels, period=period if periodic else None)]
    found += find_dropouts(x, levels, period=period, is_input=is_input)
    found += [] if driven is None else find_spikes(x, levels, driven)
    found += find_offset(x, port.unit, is_input=is_input)
    if is_input:
        return found + (
            (find_lost_in_period(x, period) or find_unsteady_input(x, period)) if periodic else []
        )
    found += find_drift(x, port.unit, period=period if periodic else None)
    found += find_coarse_steps(x, levels) + find_held(x)
    # A period with a hole or a spike differs from the others by that.
    local = {"gap", "dropout", "spike"} & {f.kind for f in found}
    if not periodic or local:
        return found
    return found + (find_lost_in_period(x, period) or find_transient(x, period))


def _check_size(record: Record) -> None:
    for ports, x in ((record.inputs, record.u), (record.outputs, record.y)):
        for port, channel in zip(ports, np.moveaxis(x, 3, 0), strict=True):
            size = float(np.abs(channel[np.isfinite(channel)]).max(initial=0.0))
            if size != 0.0 and not LEAST < size < MOST:
                raise DataError(
                    f"samples of no more than {size:.3g}" if size < 1.0 else f"samples of up to {size:.3g}",
                    where=f"channel {port.name}",
                    hint=f"from {LEAST:.0e} to {MOST:.0e}: what is its unit?",
                )
