"""Starts of the fit of a record: poles of time-domain subspaces, and their input vectors."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator
from typing import get_args

import numpy as np
from jaxtyping import Bool, Complex, Float

from middeck.identification.model.fit_options import FitOptions
from middeck.identification.problem.data import Data
from middeck.identification.problem.terms import columns, fractions, shapes
from middeck.identification.problem.unknowns_layout import Layout, Point, Start, pack
from middeck.identification.record_fit.time_subspace import PastFuture, Weighting, compress_past, record_poles
from middeck.identification.search.least_squares_costs import least_cost
from middeck.identification.start.frequency_subspace import reflected
from middeck.identification.start.start import starts_from, upper_half
from middeck.signals.record import Record
from middeck.values import record as frozen

# Block rows, as multiples of the least that hold so many states, and a few more whatever the states.
ROWS = (1.5, 2.5, 4.0)
LONG = 20
# A pole is kept this far inside the unit circle, and off its centre, where it has no finite decay.
INSIDE, CENTRE = 1e-4, 1e-3
# Sizes of the subspace of a continuous model, as multiples of the states kept. Rows are as many as the record
# and the count of operations allow, and a third of that: a slow mode has to turn in them.
SIZES = (1.0, 2.0)
CONTINUOUS: tuple[Weighting, ...] = ("moesp", "cva")
OPERATIONS = 1e9
COLUMNS_PER_ROW = 3
# Samples for each period of the highest frequency fitted that are left before rows are made.
DENSE = 2.5


# The triangle of a record at a number of block rows; None where it is too short for them.
Pasts = Callable[[int], PastFuture | None]


def pasts_of(record: Record) -> Pasts:
    """The triangles of a record, each made once."""
    u, y = _in_deviations(record.u), _in_deviations(record.y)

    @functools.cache
    def compressed(rows: int) -> PastFuture | None:
        return compress_past(list(u), list(y), rows)

    return compressed


def record_starts(pasts: Pasts, data: Data, options: FitOptions, *, few: bool = False) -> Iterator[Start]:
    """Sampled models of ``options.moving`` states from several horizons, or the longest, and weightings."""
    outputs = len(data.H)
    least = -(-options.moving // outputs) + 1
    horizons = sorted({int(np.ceil(factor * least)) for factor in ROWS} | {max(LONG, least)})
    for rows in horizons[-1:] if few else horizons:
        past = pasts(rows)
        if past is None:
            continue
        for weighting in get_args(Weighting):
            z = record_poles(past, weighting, options.moving)
            start = None if z is None else start_of(data, options, *inside_circle(z, options.period_s))
            if start is not None:
                yield start


def _in_deviations(x: np.ndarray) -> Float[np.ndarray, "experiment sample channel"]:
    """Periods as one run of samples, each channel in units of its deviation."""
    experiments, periods, samples, channels = x.shape
    return x.reshape(experiments, periods * samples, channels) / x.std(axis=(0, 1, 2))


@frozen
class PastOfRecord:
    """Triangles of a record at several rows, and the period [s] of the samples that they are made of."""

    triangles: tuple[PastFuture, ...]
    period_s: float


def past_of(record: Record, data: Data) -> PastOfRecord:
    """The triangles for `continuous_starts`, of samples no denser than the highest line of ``data`` needs."""
    highest_hz = float(data.omega[-1]) / (2.0 * np.pi)
    thin = max(1, int(record.sample_hz / (DENSE * highest_hz)))
    u, y = _in_deviations(record.u), _in_deviations(record.y)
    if thin > 1:
        import scipy.signal  # takes a second, which dense samples alone need

        # One filter for all channels leaves what is between them.
        u, y = (scipy.signal.resample_poly(x, 1, thin, axis=1) for x in (u, y))
    numbers = u.shape[0] * u.shape[1]
    height = min(numbers / (COLUMNS_PER_ROW + 1), np.sqrt(OPERATIONS / numbers))
    most = int(height / (2 * (u.shape[2] + y.shape[2])))
    found = [compress_past(list(u), list(y), rows) for rows in (most, most // 3) if rows > 1]
    return PastOfRecord(tuple(past for past in found if past is not None), thin / record.sample_hz)


def continuous_starts(past: PastOfRecord, data: Data, options: FitOptions) -> Iterator[Start]:
    """Continuous models of ``options.moving`` states, out of larger subspaces.

    Delays need a response: that of the subspace's poles with the residues that the spectra ask for, of any
    rank and phase, so that they take up the delay at each resonance.
    """
    for triangle in past.triangles:
        for weighting in CONTINUOUS:
            for size in SIZES:
                order = 2 * round(0.5 * size * options.moving) + options.at_zero
                z = record_poles(triangle, weighting, order)
                if z is None:
                    continue
                poles, pair = inside_circle(z, past.period_s)
                seen = _response_of(data, options, poles, pair)
                if seen is not None:
                    yield from starts_from(seen, options, np.concatenate([poles, poles[pair].conj()]))


def _response_of(data: Data, wanted: FitOptions, poles: np.ndarray, pair: np.ndarray) -> Data | None:
    """The response with given poles, and those at zero that are wanted, that the spectra ask for.

    Weighed as the data are, by how strong each input is on each line.
    """
    inputs, outputs = data.U.shape[1], len(data.H)
    options = FitOptions(
        constants="complex", direct=True, residuals=wanted.residuals or wanted.rigid > 0, full_rank=True
    )
    layout = _layout(data, options, poles, pair, np.zeros(len(poles), dtype=int))
    integral = tuple(range(inputs)) if wanted.integrators else ()
    layout = dataclasses.replace(layout, integral_pivot=integral)
    b, psi = np.tile(np.eye(inputs), (len(poles), 1)), np.eye(inputs)[: len(integral)]
    point = Point(poles, b, np.zeros((outputs, 1)), psi)
    found = least_cost(layout, data, pack(layout, point))
    if found is None:
        return None
    X = columns(layout, point, fractions(layout, poles, data.s), data.s)
    H = np.tensordot(found[1][:, : layout.columns], X, axes=1)
    strength = np.sqrt(np.mean(np.abs(data.U) ** 2, axis=2))
    weight = data.weight.mean(axis=2)[:, :, None] * strength
    return Data(s=data.s, H=H, weight=weight)


def inside_circle(
    z: Complex[np.ndarray, " state"], period_s: float
) -> tuple[Complex[np.ndarray, " mode"], Bool[np.ndarray, " mode"]]:
    """Poles [rad/s], one of each pair, pairs first, and which are pairs; those outside are reflected.

    >>> poles, pair = inside_circle(np.array([2.0j, -2.0j, 0.5]), 1.0)
    >>> np.round(np.exp(poles), 6).tolist(), pair.tolist()
    ([0.5j, (0.5+0j)], [True, False])
    """
    p = np.log(reflected(z, CENTRE, INSIDE))
    poles, pair = upper_half(np.where(np.abs(np.imag(p)) < 1e-9, np.real(p), p), 1.0)
    return poles / period_s, pair


def start_of(
    data: Data, options: FitOptions, poles: np.ndarray, pair: np.ndarray, b: np.ndarray | None = None
) -> Start | None:
    """A start at given poles; without input vectors, those of the residues that the data ask for."""
    outputs = len(data.H)
    if b is None:
        b = _input_vectors(data, options, poles, pair)
    if b is None:
        return None
    layout = _layout(data, options, poles, pair, np.argmax(np.abs(b), axis=1))
    return Start(layout, pack(layout, Point(poles, b, np.zeros((outputs, 1)))))


def _layout(
    data: Data, options: FitOptions, poles: np.ndarray, pair: np.ndarray, pivot: np.ndarray
) -> Layout:
    return Layout(
        pair=pair,
        fixed_imag=np.where(pair, 0.0, np.imag(poles)),
        pivot=pivot,
        inputs=data.U.shape[1],
        outputs=len(data.H),
        options=options,
    )


def _input_vectors(
    data: Data, options: FitOptions, poles: np.ndarray, pair: np.ndarray
) -> Complex[np.ndarray, "mode input"] | None:
    """The dominant right singular vector of each full residue, outputs weighed alike."""
    inputs, outputs = data.U.shape[1], len(data.H)
    if inputs == 1:
        return np.ones((len(poles), 1), dtype=complex)
    options = dataclasses.replace(options, full_rank=True)
    layout = _layout(data, options, poles, pair, np.zeros(len(poles), dtype=int))
    point = Point(poles, np.tile(np.eye(inputs), (len(poles), 1)), np.zeros((outputs, 1)))
    found = least_cost(layout, data, pack(layout, point))
    if found is None:
        return None
    residues: Float[np.ndarray, "output mode input"] = np.array(
        [shapes(layout, point, x[: layout.columns]) for x in found[1]]
    ).reshape(outputs, len(poles), inputs)
    level = data.weight.mean(axis=(1, 2))[:, None, None]
    b = np.linalg.svd(np.moveaxis(residues * level, 0, 1))[2][:, 0]
    b = b / np.take_along_axis(b, np.argmax(np.abs(b), axis=1)[:, None], axis=1)
    return np.where(pair[:, None], b, b.real)
