"""Out of a local minimum: a model of a record with a pair more, or one elsewhere, where most is left.

A subspace of some hundred samples may miss a mode that the residual shows at once, and hold one that does
little.

A reduced record on which an order is searched: some of its lines and its principal outputs.

The equations of a record hold line by line, transients included, so that any of its lines will do. Of each
group of neighbours the one where the outputs are strongest is kept: resonances are among them, and the lines
of a signal that repeats within the record. Of many outputs a few combinations are kept, those that hold most
of their power: the poles of an article are in all of them.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from middeck.identification.model.fit_options import FitOptions
from middeck.identification.problem.data import Data
from middeck.identification.problem.design import residual_of
from middeck.identification.problem.layout import Start, pack
from middeck.identification.record_fit.search import RecordRun
from middeck.identification.record_fit.spectra import record_data
from middeck.identification.record_fit.starts import start_of
from middeck.identification.search.refine import weighted
from middeck.signals.ports import Port
from middeck.signals.record import Record

# A new mode's damping ratio, and lines to either side over which the residual is averaged, as a share of all.
DAMPING, WIDTH = 0.03, 0.01
# Of so many modes that are missed least each is given up in turn.
GIVEN_UP = 3


def grown(data: Data, options: FitOptions, run: RecordRun) -> Start | None:
    """``run`` with pairs at the peaks of its residual until it has ``options.moving``; None if it cannot."""
    missing = options.moving - run.layout.states
    if missing < 2 or missing % 2:
        return None
    left = run.residual(data)
    return _with_peaks(data, options, run.start, left, missing // 2)


def exchanges(data: Data, options: FitOptions, run: RecordRun) -> Iterator[Start]:
    """``run`` with one of the pairs that are missed least at the peak of what is left without it."""
    at = dataclasses.replace(data, weight=1.0 / np.sqrt(run.variance))
    point, pair = run.start.point, np.asarray(run.layout.pair)
    without: list[tuple[float, Start, np.ndarray]] = []
    for m in range(run.layout.pairs if len(pair) > 1 else 0):
        kept = np.arange(len(pair)) != m
        b = None if run.layout.options.full_rank else point.b[kept]
        start = start_of(data, options, point.poles[kept], pair[kept], b)
        step = None if start is None else weighted(start.layout, at, start.theta)
        if start is not None and step is not None:
            left = residual_of(start.layout, data, start.theta, step.linear)
            without.append((step.cost, start, left))
    for _, start, left in sorted(without, key=lambda t: t[0])[:GIVEN_UP]:
        other = _with_peaks(data, options, start, left, 1)
        if other is not None:
            yield other


def _with_peaks(
    data: Data, options: FitOptions, start: Start, left: Complex[np.ndarray, "output line column"], count: int
) -> Start | None:
    """A start with pairs more at the peaks of a residual, the input vectors of all as the record asks."""
    point, pair = start.point, np.asarray(start.layout.pair)
    new = _peaks(data, left, count) * (1j - DAMPING)
    place = int(pair.sum())
    # Residues are asked for without the delays that are known.
    early = np.exp(data.s[:, None] * point.delay_s.mean(axis=1)[:, None, None])
    found = start_of(
        dataclasses.replace(data, H=data.H * early),
        options,
        np.insert(point.poles, place, new),
        np.insert(pair, [place] * count, True),
    )
    if found is None:
        return None
    return Start(found.layout, pack(found.layout, dataclasses.replace(found.point, delay_s=point.delay_s)))


def _peaks(
    data: Data, left: Complex[np.ndarray, "output line column"], count: int
) -> Float[np.ndarray, " peak"]:
    """Angular frequencies where most is left, outputs weighed alike, each clear of those before it."""
    level = np.mean(np.abs(data.H) ** 2, axis=(1, 2), keepdims=True)
    half = max(2, int(WIDTH * len(data.s)))
    power = np.convolve(
        np.sum(np.abs(left) ** 2 / level, axis=(0, 2)), np.hanning(2 * half + 3)[1:-1], "same"
    )
    found: list[int] = []
    for _ in range(count):
        found.append(int(np.argmax(power)))
        power[max(found[-1] - half, 0) : found[-1] + half + 1] = 0.0
    return data.omega[sorted(found)]


# Lines, all experiments together, and outputs that are kept. A record of fewer numbers than so many lines of
# so many outputs is no larger than its scout is worth.
LINES, OUTPUTS = 768, 4
LARGE = 8192
# Outputs as they are, of a search that tells their delays.
FEW = 6


def is_large(data: Data) -> bool:
    """Whether a search on all numbers takes more than seconds."""
    return 2 * data.H.size > LARGE


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
    return dataclasses.replace(data, s=data.s[kept], H=H, weight=weight, drive=data.U[kept])


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
