"""How many states a response asks for: the description length of each size."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from middeck.values import record

# Sizes after the best that must be worse before the search ends: a mode may need two steps to pay.
PATIENCE = 3
MOST_STATES = 60


@record
class OrderChoice:
    """A recommended order.

    Parameters
    ----------
    states:
        The order, without delays.
    reason:
        One sentence for the user.
    tried, length:
        The orders tried and the description length of each.
    """

    states: int
    reason: str
    tried: tuple[int, ...]
    length: tuple[float, ...]


def sizes() -> Iterator[int]:
    """Orders to try: every even one up to 20, then in steps of a fifth."""
    states = 2
    while states <= MOST_STATES:
        yield states
        states += 2 * max(1, round(states / 10 if states >= 20 else 0))


def description_length(likelihood: float, unknowns: int, numbers: int) -> float:
    """2 L + k ln n with L the negative log likelihood (Rissanen 1978; Schwarz 1978).

    >>> description_length(10.0, 2, 1)
    20.0
    """
    return 2.0 * likelihood + unknowns * float(np.log(numbers))


def is_settled(length: Sequence[float]) -> bool:
    """Whether the shortest length lies `PATIENCE` sizes back.

    >>> is_settled([5.0, 3.0, 4.0, 4.5, 6.0]), is_settled([5.0, 3.0, 4.0])
    (True, False)
    """
    return len(length) - 1 - int(np.argmin(length)) >= PATIENCE


def choose(tried: Sequence[int], length: Sequence[float]) -> OrderChoice:
    """The order of the shortest description, with its reason."""
    best = int(np.argmin(length))
    rivals = [v - length[best] for k, v in enumerate(length) if k != best]
    margin = f", {min(rivals):.0f} below the next" if rivals else ""
    where = "" if best < len(tried) - 1 else "; the largest tried, more may be asked for"
    reason = (
        f"{tried[best]} states have the shortest description of {len(tried)} orders"
        f" from {tried[0]} to {tried[-1]}{margin}{where}"
    )
    return OrderChoice(tried[best], reason, tuple(tried), tuple(length))
