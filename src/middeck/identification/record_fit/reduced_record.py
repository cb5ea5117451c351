"""A reduced record on which an order is searched: some of its lines and its principal outputs.

The equations of a record hold line by line, transients included, so that any of its lines will do. The line
with the strongest outputs in each group of neighbours is kept: resonances are among them, and the lines
of a signal that repeats within the record. Many outputs are reduced to a few combinations, those that hold
most of their power: the poles of an article are in all of them.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from middeck.identification.problem.data import Data
from middeck.identification.record_fit.record_spectra import record_data
from middeck.signals.ports import Port
from middeck.signals.record import Record

# Lines, all experiments together, and outputs that are kept. A record of fewer numbers than so many lines of
# so many outputs is no larger than its scout is worth.
LINES, OUTPUTS = 768, 4
LARGE = 8192
# Outputs as they are, of a search that tells their delays, which combinations have not.
FEW = 6


def is_large(data: Data) -> bool:
    """Whether a search on all numbers takes more than seconds."""
    return 2 * data.H.size > LARGE


def has_many_outputs(data: Data) -> bool:
    """Whether a search on a few of its outputs saves time over one on all."""
    return len(data.H) > FEW and is_large(data)


def scouted(record: Record, data: Data) -> tuple[Record, Data]:
    """The record with its principal outputs, and some of their lines."""
    mixed = _principal(record)
    kept = _strongest(data, max(LINES // data.H.shape[2], 1))
    lines = data.omega / (2.0 * np.pi)
    whole = data if mixed is record else record_data(mixed, (lines[0], lines[-1]), whole=True)
    return mixed, _on_lines(whole, kept)


def with_few_outputs(record: Record, data: Data) -> tuple[Record, Data]:
    """The record and its lines with outputs that span its principal ones best (Drmac, Gugercin 2016)."""
    unit: Complex[np.ndarray, "output number"] = data.H.reshape(len(data.H), -1)
    unit = unit / np.linalg.norm(unit, axis=1, keepdims=True)
    main = np.linalg.eigh(unit @ unit.conj().T)[1][:, -FEW:]
    kept = np.sort(scipy.linalg.qr(main.T, mode="r", pivoting=True)[1][:FEW])
    few = dataclasses.replace(record, y=record.y[..., kept], outputs=tuple(record.outputs[k] for k in kept))
    return few, with_few_lines(dataclasses.replace(data, H=data.H[kept], weight=data.weight[kept]))


def with_few_lines(data: Data) -> Data:
    """The line of each group of neighbours on which the outputs are strongest."""
    return _on_lines(data, _strongest(data, max(LINES // data.H.shape[2], 1)))


def _on_lines(data: Data, kept: np.ndarray) -> Data:
    H, weight = data.H[:, kept], data.weight[:, kept]
    driven = None if data.driven is None or len(np.unique(data.driven[kept])) < 2 else data.driven[kept]
    return dataclasses.replace(data, s=data.s[kept], H=H, weight=weight, drive=data.U[kept], driven=driven)


def _principal(record: Record) -> Record:
    """Outputs, each in units of its deviation, turned to their principal directions; few as they are."""
    outputs = record.y.shape[3]
    if outputs <= OUTPUTS:
        return record
    unit = record.y / record.y.std(axis=(0, 1, 2))
    flat: Float[np.ndarray, "sample output"] = unit.reshape(-1, outputs)
    turn = np.linalg.eigh(flat.T @ flat)[1][:, : -OUTPUTS - 1 : -1]
    ports = tuple(Port(f"principal output {k + 1}", "") for k in range(OUTPUTS))
    return dataclasses.replace(record, y=unit @ turn, outputs=ports)


def _strongest(data: Data, count: int) -> np.ndarray:
    """Places of the line of each group where most of the outputs' power is; all lines where they are few."""
    lines = len(data.s)
    if lines <= count:
        return np.arange(lines)
    level = np.mean(np.abs(data.H) ** 2, axis=(1, 2), keepdims=True)
    power = np.sum(np.abs(data.H) ** 2 / level, axis=(0, 2))
    edges = np.linspace(0, lines, count + 1).astype(int)
    return np.array([a + int(np.argmax(power[a:b])) for a, b in itertools.pairwise(edges)])
