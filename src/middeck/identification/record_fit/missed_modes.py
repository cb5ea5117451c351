"""Out of a local minimum: a model of a record with a pair more, or one elsewhere, where most is left.

A subspace of some hundred samples may miss a mode that the residual shows at once, and hold one that does
little.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.model.fit_options import FitOptions
from middeck.identification.problem.data import Data
from middeck.identification.problem.residual_and_slopes import residual_of
from middeck.identification.problem.unknowns_layout import Start, pack
from middeck.identification.record_fit.record_starts import start_of
from middeck.identification.record_fit.refine_record import RecordRun
from middeck.identification.search.least_squares_costs import least_cost

# A new mode's damping ratio, and lines to either side over which the residual is averaged, as a share of all.
DAMPING, WIDTH = 0.03, 0.01
# Number of least needed modes that are given up in turn.
GIVEN_UP = 3


def grown(data: Data, options: FitOptions, run: RecordRun) -> Start | None:
    """``run`` with pairs at the peaks of its residual until it has ``options.moving``; None if it cannot."""
    missing = options.moving - run.layout.states
    if missing < 2 or missing % 2:
        return None
    left = run.residual(data)
    return _with_peaks(data, options, run.start, left, missing // 2)


def exchanges(data: Data, options: FitOptions, run: RecordRun) -> Iterator[Start]:
    """``run`` with one of its least needed pairs moved to the peak of the residual without it."""
    at = data.reweighted(1.0 / np.sqrt(run.variance))
    point, pair = run.start.point, np.asarray(run.layout.pair)
    without: list[tuple[float, Start, np.ndarray]] = []
    for m in range(run.layout.pairs if len(pair) > 1 else 0):
        kept = np.arange(len(pair)) != m
        b = None if run.layout.options.full_rank else point.b[kept]
        start = start_of(data, options, point.poles[kept], pair[kept], b)
        found = None if start is None else least_cost(start.layout, at, start.theta)
        if start is not None and found is not None:
            left = residual_of(start.layout, data, start.theta, found[1])
            without.append((found[0], start, left))
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
