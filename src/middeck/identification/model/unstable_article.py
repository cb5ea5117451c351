"""Refuse the record of an unstable article: an output that grows while the inputs do not."""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Float

from middeck.errors import FitError
from middeck.signals.record import Record

# Parts of a record, and those at its end in each of which an unstable output has more power than before.
PARTS, RISING = 8, 6
# Least growth of the power over those parts, a hundredfold, with inputs that grow no more than fourfold.
GROWN, INPUTS_GROWN = 100.0, 4.0
# Past samples from which the next is predicted; the share of the largest singular value below which these
# are ignored; and the growth of their prediction over the rising parts from which an output grows by
# itself, in logarithms at most so many times its own. Of more samples some, evenly spread, suffice.
PAST, TELLS, BY_ITSELF, FASTER, ENOUGH = 12, 1e-6, 3.0, 2.0, 20_000
# Share of an output's power at the end below the frequency of which a period is given so many samples, by
# means over neighbours, in turn: of far more samples, noise hides what a few predict.
BELOW, PERIOD, SMOOTHINGS = 0.8, 8.0, 3


def refuse_growth(record: Record) -> None:
    """Raise `FitError` for an output that grows through an experiment while the inputs do not.

    A lightly damped article that starts at rest grows with the root of time, threefold in power over these
    parts; an unstable one grows exponentially. Under a sweep an output grows as a mode comes near, but not by
    itself: the prediction from its past and the inputs has no growing pole.
    """
    for u, y in zip(record.u, record.y, strict=True):
        u, y = (x.reshape(-1, x.shape[-1]) for x in (u, y))
        inputs, outputs = _powers(u), _powers(y)
        steady = np.all(inputs[-1] <= INPUTS_GROWN * np.maximum(inputs[-RISING], inputs.max(axis=0) / 10.0))
        rising = np.all(np.diff(outputs[-RISING:], axis=0) > 0.0, axis=0)
        ratio = outputs[-1] / np.maximum(outputs[-RISING], np.finfo(float).tiny)
        grows = np.flatnonzero(rising & (ratio > GROWN) & steady)
        o = next((o for o in grows.tolist() if _grows_by_itself(u, y[:, o], np.sqrt(ratio[o]))), None)
        if o is not None:
            raise FitError(
                f"it grows {np.sqrt(ratio[o]):.3g} times while the inputs do not: the article is unstable, "
                "and only stable models are fitted",
                where=f"output {record.outputs[o].name}",
                hint="close a loop that holds it and fit from its reference, or cut the record before that",
            )


def _grows_by_itself(
    u: Float[np.ndarray, "sample input"], y: Float[np.ndarray, " sample"], grown: float
) -> bool:
    """Whether a regression of the output has an unstable pole that explains by how much it has ``grown``."""
    size = _samples_together(y[-(len(y) // PARTS) :])
    both = _thinned(np.column_stack([y, u]), size)
    count, past = len(both), min(PAST, len(both) // (4 * both.shape[1]))
    both = both - both.mean(axis=0)
    both = both / np.maximum(both.std(axis=0), np.finfo(float).tiny)
    at = np.linspace(past, count - 1, min(count - past, ENOUGH)).astype(int)
    before = at[:, None] - np.arange(past + 1)
    known = np.hstack([both[before[:, 1:], 0], both[before, 1:].reshape(len(at), -1)])
    weights = np.linalg.lstsq(known, both[at, 0], rcond=TELLS)[0]
    poles = np.abs(np.roots(np.concatenate([[1.0], -weights[:past]])))
    rates = np.log(np.maximum(poles, np.finfo(float).tiny))
    own = count * (RISING - 1) / PARTS * rates
    return bool(np.any((own > np.log(BY_ITSELF)) & (own < FASTER * np.log(grown))))


def _thinned(x: Float[np.ndarray, "sample channel"], size: int) -> Float[np.ndarray, "few channel"]:
    """Every so many samples, each the mean over as many neighbours, taken several times."""
    for _ in range(SMOOTHINGS * (size > 1)):
        total = np.cumsum(np.vstack([np.zeros(x.shape[1]), x]), axis=0)
        x = (total[size:] - total[:-size]) / size
    return x[::size]


def _samples_together(end: Float[np.ndarray, " sample"]) -> int:
    """Samples to be averaged, so that a period of an output at its ``end`` has few of them."""
    power = np.cumsum(np.abs(np.fft.rfft(end * np.hanning(len(end)))) ** 2)
    line = 1 + int(np.searchsorted(power, BELOW * power[-1]))
    return max(1, int(len(end) / (line * PERIOD)))


def _powers(x: Float[np.ndarray, "sample channel"]) -> Float[np.ndarray, "part channel"]:
    """Mean square about the mean in each part."""
    edges = np.linspace(0, len(x), PARTS + 1).astype(int)
    level = x - x.mean(axis=0)
    return np.array([np.mean(level[a:b] ** 2, axis=0) for a, b in itertools.pairwise(edges)])
