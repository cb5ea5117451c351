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


def refuse_growth(record: Record) -> None:
    """Raise `FitError` for an output that grows through an experiment while the inputs do not.

    A lightly damped article that starts at rest grows with the root of time, threefold in power over these
    parts; an unstable one grows exponentially.
    """
    for u, y in zip(record.u, record.y, strict=True):
        inputs, outputs = (_powers(x.reshape(-1, x.shape[-1])) for x in (u, y))
        steady = np.all(inputs[-1] <= INPUTS_GROWN * np.maximum(inputs[-RISING], inputs.max(axis=0) / 10.0))
        rising = np.all(np.diff(outputs[-RISING:], axis=0) > 0.0, axis=0)
        ratio = outputs[-1] / np.maximum(outputs[-RISING], np.finfo(float).tiny)
        grows = rising & (ratio > GROWN) & steady
        if grows.any():
            o = int(np.argmax(grows))
            raise FitError(
                f"it grows {np.sqrt(ratio[o]):.3g} times while the inputs do not: the article is unstable, "
                "and only stable models are fitted",
                where=f"output {record.outputs[o].name}",
                hint="close a loop that holds it and fit from its reference, or cut the record before that",
            )


def _powers(x: Float[np.ndarray, "sample channel"]) -> Float[np.ndarray, "part channel"]:
    """Mean square about the mean in each part."""
    edges = np.linspace(0, len(x), PARTS + 1).astype(int)
    level = x - x.mean(axis=0)
    return np.array([np.mean(level[a:b] ** 2, axis=0) for a, b in itertools.pairwise(edges)])
