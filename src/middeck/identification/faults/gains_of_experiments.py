"""Gains that differ between experiments, of any record: smooth responses that all experiments share.

Over a few neighbouring lines the response is a polynomial in frequency, and so is what a run without periods
began and ended with, in each experiment its own (Pintelon and Schoukens 2012, section 7.2). The outputs of an
experiment then follow that response with the gain of the others, or with one of their own; the windows, which
share no line, estimate it together, each by what its polynomials leave. A window at a resonance that they do
not follow leaves much, and hardly counts. Periods of more experiments than inputs need no such window: each
line has a response of its own.
"""

from __future__ import annotations

import numpy as np
import scipy.ndimage
import scipy.stats
from jaxtyping import Complex, Float

from middeck.signals.record import Record
from middeck.values import record as frozen

# Powers of frequency in a window, the zeroth among them.
TERMS = 3
# Added to columns of unit size: rounding, where experiments have inputs alike.
RIDGE = 1e-13
# Rows of a window for each unknown; windows from which gains are estimated.
ROWS, FEWEST = 2.0, 6
# Lines that are looked at, evenly spread windows of them, so that long records take little memory.
MOST_LINES = 40_000
# Power of the inputs, of the strongest line's, from which a line counts.
DRIVEN = 1e-4
# Share of a window's power that rounding and polynomials leave at least.
LEAST = 1e-12
# Turns of the search for gains at most, and the step, in deviations, that ends it. Where windows leave the
# response to the inputs uncertain beside a transient, a turn finds a part of a gain only.
TURNS, SETTLED = 50, 0.05
# Lines over which noise is averaged where windows are single lines.
NEIGHBOURS = 11
# Times the median weight that a window may have.
HEAVIEST = 10.0
# Longest step in the logarithm of a gain; share below which changes of two experiments are one.
LONGEST, ALIKE = 0.5, 1e-12
# Keeps quotients of what is zero finite.
TINY = 1e-300


@frozen
class GainChanges:
    """Logarithms of gains [experiment, output] over that of experiment 0, and how sure they are.

    ``chance``: the probability that noise alone shows so much. ``median``: that of the windows, by weight.
    """

    change: Float[np.ndarray, "experiment output"]
    chance: Float[np.ndarray, "experiment output"]
    median: Float[np.ndarray, "experiment output"]


def gains_of_experiments(record: Record) -> GainChanges | None:
    """Gains of each experiment and output; None where there are too few lines for a window or two."""
    U, Y = _spectra(record)
    _, experiments, inputs = U.shape
    exact = record.periodic and experiments > inputs
    terms = 1 if exact else TERMS
    unknowns = terms * (inputs + (0 if record.periodic else experiments))
    width = 1 if exact else int(np.ceil(ROWS * unknowns / experiments)) + 1
    count = len(U) // width
    if count < FEWEST:
        return None
    some = np.linspace(0, count - 1, min(count, MOST_LINES // width)).astype(int)
    U, Y = (x[: count * width].reshape(count, width, experiments, -1)[some].swapaxes(1, 2) for x in (U, Y))
    A = _columns(U, terms, transients=not record.periodic)
    each = [_changes(A, Y[..., o], terms * inputs) for o in range(Y.shape[3])]
    return GainChanges(*(np.stack(x, axis=1) for x in zip(*each, strict=True)))


def _spectra(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Spectra [line, experiment, channel] of the lines that inputs drive.

    The first of several periods may hold the start.
    """
    if record.periodic:
        later = slice(1 if record.u.shape[1] > 1 else 0, None)
        u, y = (x[:, later].mean(axis=1) for x in (record.u, record.y))
    else:
        u, y = (x.reshape(len(x), -1, x.shape[3]) for x in (record.u, record.y))
    U, Y = (np.fft.rfft(x, axis=1)[:, 1:-1].swapaxes(0, 1) for x in (u, y))
    power = np.sum(np.abs(U) ** 2 / np.maximum(np.mean(np.abs(U) ** 2, axis=0), TINY), axis=(1, 2))
    driven = np.flatnonzero(power > DRIVEN * power.max())
    use = driven if record.periodic or not len(driven) else slice(driven[0], driven[-1] + 1)
    return U[use], Y[use]


def _columns(
    U: Complex[np.ndarray, "window experiment line input"], terms: int, *, transients: bool
) -> Complex[np.ndarray, "window row column"]:
    """Regressors of the windows: powers of frequency times the inputs, and those of transients."""
    count, experiments, width, _ = U.shape
    powers = np.linspace(-1.0, 1.0, width)[:, None] ** np.arange(terms)
    forced = (U[..., None] * powers[:, None, :]).reshape(count, experiments * width, -1)
    size = np.sqrt(np.mean(np.abs(forced) ** 2, axis=1, keepdims=True))
    forced = forced / np.where(size > 0.0, size, 1.0)
    if not transients:
        return forced
    free = np.broadcast_to(
        np.kron(np.eye(experiments), powers), (count, experiments * width, experiments * TERMS)
    )
    return np.concatenate([forced, free], axis=2)


def _changes(
    A: Complex[np.ndarray, "window row column"], Y: Complex[np.ndarray, "window experiment line"], forced: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Changes of gain of one output, their probability by chance, and their median over windows."""
    experiments = Y.shape[1]
    G = A.conj().mT @ A
    solve = np.linalg.inv(G + RIDGE * A.shape[1] * np.eye(A.shape[2])) @ A.conj().mT
    change = np.zeros(experiments - 1)
    for _ in range(TURNS):
        M, v = _scores(A, solve, Y * np.exp(-np.append(0.0, change))[:, None], forced)
        inverse = np.linalg.pinv(M.sum(axis=0), rcond=ALIKE, hermitian=True)
        step = inverse @ v.sum(axis=0)
        change = change + np.clip(step, -LONGEST, LONGEST)
        scores = (v - M @ step) @ inverse
        by_windows = np.sum(scores**2, axis=0)
        sure = np.sqrt(np.maximum(np.maximum(0.5 * np.diagonal(inverse), by_windows), TINY))
        if np.all(np.abs(step) < SETTLED * sure):
            break
    degrees = np.maximum(by_windows**2 / np.maximum(np.sum(scores**4, axis=0), TINY), 1.0)
    chance = 2.0 * scipy.stats.t.sf(np.abs(change) / sure, degrees)
    known = np.diagonal(M, axis1=1, axis2=2)
    ratio = change + v / np.maximum(known, TINY)
    return change, chance, np.array([_median(*x) for x in zip(ratio.T, known.T, strict=True)])


def _scores(
    A: Complex[np.ndarray, "window row column"],
    solve: Complex[np.ndarray, "window column row"],
    Y: Complex[np.ndarray, "window experiment line"],
    forced: int,
) -> tuple[Float[np.ndarray, "window change change"], Float[np.ndarray, "window change"]]:
    """Normal matrix and right side of a step in the changes of gain, of each window by its own noise."""
    count, experiments, width = Y.shape
    own = np.repeat(np.eye(experiments)[:, 1:], width, axis=0)  # which rows are an experiment's
    y = Y.reshape(count, -1, 1)
    theta = solve @ y
    left = y - A @ theta
    X = (A[:, :, :forced] @ theta[:, :forced]) * own
    X = X - A @ (solve @ X)
    spread = np.sum(np.abs(left) ** 2, axis=1)[:, 0] / (A.shape[1] - A.shape[2])
    if width == 1:
        spread = scipy.ndimage.uniform_filter1d(spread, NEIGHBOURS, mode="mirror")
    weight = 1.0 / (spread + LEAST * np.mean(np.abs(y) ** 2, axis=1)[:, 0] + TINY)
    M = np.real(X.conj().mT @ X) * weight[:, None, None]
    v = np.real(X.conj().mT @ left)[:, :, 0] * weight[:, None]
    heavy = np.trace(M, axis1=1, axis2=2)
    less = np.minimum(1.0, HEAVIEST * np.median(heavy) / np.maximum(heavy, TINY))
    return M * less[:, None, None], v * less[:, None]


def _median(x: Float[np.ndarray, " window"], weight: Float[np.ndarray, " window"]) -> float:
    order = np.argsort(x)
    total = np.cumsum(weight[order])
    return float(x[order][np.searchsorted(total, 0.5 * total[-1])])
