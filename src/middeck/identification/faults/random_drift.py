"""A sensor that drifts at random: the part no input causes falls with the square of the frequency.

Around each of the lowest lines response, transient and one mode are smooth (local rational models, McKelvey
and Guerin 2012); a random walk is not. Its power falls by four from each octave to the next.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.identification.faults.equal_runs import FaultDraft, fault
from middeck.signals.ports import Port
from middeck.signals.record import Record

# Lines that are looked at, those on each side of one that its model is taken from, and as many more for each
# input; degree of the models.
LINES, BESIDE, FOR_EACH, DEGREE = 96, 10, 2, 2
# Ends of the octaves whose medians are compared: logarithms of the falls within which those of a random walk
# lie (1.39 each), of the first one with its four lines, of the others, and of these together.
OCTAVES = (3, 6, 12, 24, 48)
FIRST_FALL, FALL, ALL_FALLS = (-1.0, 4.0), (0.0, 2.9), (2.5, 5.8)
# Lines for the size of the walk; its shares of the rms from which it is reported, and serious.
TOLD_FROM, TOLD, SERIOUS = slice(5, 23), 0.03, 0.1
# The mean of the logarithm of an exponential variate is below that of its mean by Euler's constant.
EULER = 0.5772
# Share of the largest singular value below which a column is ignored.
RANK = 1e-8


def find_random_drift(record: Record) -> list[tuple[FaultDraft, Port, int]]:
    """Outputs of each experiment that drift at random, beside their response to the inputs."""
    found: list[tuple[FaultDraft, Port, int]] = []
    for e in range(len(record.u)):
        u, y = (x[e].reshape(-1, x.shape[3]) for x in (record.u, record.y))
        half = BESIDE + FOR_EACH * u.shape[1]
        if len(u) // 2 < LINES + 2 * half:
            continue
        lines = np.arange(1, LINES + 1)
        rows = np.maximum(lines - half, 1)[:, None] + np.arange(2 * half + 1)
        x = (rows - lines[:, None]) / half
        powers = x[:, :, None] ** np.arange(DEGREE + 1)
        U = np.fft.rfft(_scaled(u), axis=0)
        known = np.concatenate([powers, *(powers * each[rows][:, :, None] for each in U.T)], axis=2)
        for o, port in enumerate(record.outputs):
            share = _share(_left(known, x, np.fft.rfft(_scaled(y[:, o])) / len(y), rows, lines))
            if share is not None:
                found.append((_wanders(share), port, e))
    return found


def _scaled(x: np.ndarray) -> np.ndarray:
    x = x - x.mean(axis=0)
    return x / np.maximum(x.std(axis=0), np.finfo(float).tiny)


def _left(
    known: Complex[np.ndarray, "line row column"],
    x: Float[np.ndarray, "line row"],
    Y: Complex[np.ndarray, " any"],
    rows: Int[np.ndarray, "line row"],
    lines: Int[np.ndarray, " line"],
) -> Float[np.ndarray, " line"]:
    """Power of each line that the model around it leaves, had its other lines alone decided."""
    Z = Y[rows]
    basis = np.concatenate([known, (x * Z)[:, :, None], (x * x * Z)[:, :, None]], axis=2)
    basis = basis / np.maximum(np.linalg.norm(basis, axis=1, keepdims=True), np.finfo(float).tiny)
    Q, size, _ = np.linalg.svd(basis, full_matrices=False)
    Q = Q * (size > RANK * size[:, :1])[:, None, :]
    at = np.arange(len(lines)), lines - rows[:, 0]
    rest = (Z - np.einsum("kwc,kvc,kv->kw", Q, Q.conj(), Z, optimize=True))[at]
    leverage = np.sum(np.abs(Q[at]) ** 2, axis=1)
    return np.abs(rest) ** 2 / np.maximum(1.0 - leverage, 1e-3) + np.finfo(float).tiny


def _share(power: Float[np.ndarray, " line"]) -> float | None:
    """Rms of the random walk with these lines, over the channel's; None if they are not those of a walk."""
    levels = [np.median(np.log(power[a - 1 : 2 * a - 1])) for a in OCTAVES]
    first, *others = falls = -np.diff(levels)
    lines = np.arange(1, len(power) + 1)
    size = np.exp(np.mean(np.log(power * lines**2)[TOLD_FROM]) + EULER)  # power of line k: size / k^2
    share = float(np.sqrt(2.0 * size * np.pi**2 / 6.0))
    walks = (
        FIRST_FALL[0] < first < FIRST_FALL[1]
        and all(FALL[0] < fall < FALL[1] for fall in others)
        and ALL_FALLS[0] < sum(falls[1:]) < ALL_FALLS[1]
    )
    return share if walks and share > TOLD else None


def _wanders(share: float) -> FaultDraft:
    what = f"drifts at random, about {min(share, 1.0):.0%} of its rms: no input makes its slow motion"
    hint = "let sensors warm up, or check what else moves the article slowly; fit a band above it"
    return fault("drift", what, hint, severity="serious" if share > SERIOUS else "note")
