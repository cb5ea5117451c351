"""Runs of the engine as records: the driven outputs, held from sample to sample, and the read sensors."""

from pathlib import Path

import numpy as np

from middeck.errors import DataError
from middeck.files.records.raw import ChannelHeader, Raw, channel_fault
from middeck.realtime.engine.recording.run_file import Run, RunFault, read_run
from middeck.signals.fault import RecordFault


def read_run_file(file: Path, variable: str) -> Raw:
    """One experiment from the first sample to the last; missing samples are NaN, with a fault."""
    run = read_run(file)
    if not len(run.records):
        raise DataError("no samples: no whole block of records", where=str(file), hint="record it again")
    first = int(run.records["sequence"][0])
    place = run.records["sequence"] - first
    heads, x = [], []
    for side, ports, field in (("input", run.inputs, "u"), ("output", run.outputs, "y")):
        for k, port in enumerate(ports):
            samples = np.full(int(place[-1]) + 1, np.nan)
            samples[place] = run.records[field][:, k]
            heads.append(ChannelHeader(port.name, port.unit, "input" if side == "input" else "output"))
            x.append(samples[None, None])
    faults = tuple(fault for one in run.faults for fault in _faults(run, one, heads, first))
    return Raw(sample_hz=1.0 / run.period_s, heads=tuple(heads), x=tuple(x), faults=faults, held=True)


def _faults(run: Run, one: RunFault, heads: list[ChannelHeader], first: int) -> list[RecordFault]:
    """A gap for every channel; anything else once, at the first sensor."""
    kind, what, samples = one.kind, one.what, one.samples
    hint = "the pre-trigger records and the shared file, if they are still there"
    if kind == "gap" and samples:
        where = ((samples[0] - first, samples[1] - first),)
        return [
            channel_fault("gap", "serious", head, what, "cut the record before the gap", samples=where)
            for head in heads
        ]
    severity = "note" if kind in ("note", "no end", "head") else "serious"
    return [channel_fault("truncated", severity, heads[len(run.inputs)], what, hint)]
