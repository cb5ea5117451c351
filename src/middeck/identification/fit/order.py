"""How many states a response asks for: the description length of each size, and lines kept out of the fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from middeck.values import record

# Sizes after the best that must be worse before the search ends: a mode may need two steps to pay.
PATIENCE = 3
MOST_STATES = 60


# Held-out errors within this share of each other are equal.
EQUAL = 0.1
# An order that meets lines kept out of the fit so many times worse than a smaller one fits single lines:
# distortion that differs from line to line asks for ever more poles, each narrower than lines are apart.
WORSE = 1.25


@record
class Tried:
    """An order, its description length and its relative error on lines that it was not fitted to."""

    states: int
    length: float
    held_out: float


@record
class OrderChoice:
    """A recommended order.

    Parameters
    ----------
    states:
        The order, without delays.
    reason:
        One sentence for the user.
    tried:
        The orders tried.
    """

    states: int
    reason: str
    tried: tuple[Tried, ...]


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


def choose(tried: Sequence[Tried]) -> OrderChoice:
    """One order, with its reason and what lines kept out of the fit say of it.

    That of the shortest description, of orders that do not meet the lines kept out clearly worse than smaller
    ones. Where even the largest order tried shortens it, no order is the true one
    (a real structure has no end of modes): then the smallest that meets the lines kept out of the fit as well
    as any, up to a tenth.
    """
    trusted = [
        t for k, t in enumerate(tried) if t.held_out <= WORSE * min(o.held_out for o in tried[: k + 1])
    ]
    shortest = min(trusted, key=lambda t: t.length)
    closest = min(tried, key=lambda t: t.held_out)
    enough = next(t for t in tried if t.held_out <= (1.0 + EQUAL) * closest.held_out)
    span = f"of {len(tried)} orders from {tried[0].states} to {tried[-1].states}"
    if shortest is tried[-1] and len(tried) > PATIENCE:
        reason = (
            f"{enough.states} states are the fewest that meet lines kept out of the fit as well as any, up to"
            f" a tenth ({enough.held_out:.2%}; {closest.held_out:.2%} at best {span}); still more tell more"
        )
        return OrderChoice(enough.states, reason, tuple(tried))
    rivals = [t.length - shortest.length for t in trusted if t is not shortest]
    margin = f", {min(rivals):.0f} below the next" if rivals else ""
    opinion = f"lines kept out of the fit are met to {shortest.held_out:.2%}"
    if enough.states > shortest.states:
        opinion += f" and ask for {enough.states} ({enough.held_out:.2%})"
    if min(t.length for t in tried) < shortest.length:
        opinion += ", more states clearly worse"
    reason = f"{shortest.states} states have the shortest description {span}{margin}; {opinion}"
    return OrderChoice(shortest.states, reason, tuple(tried))
