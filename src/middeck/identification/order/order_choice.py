"""Number of states for a response: the description length of each size, and lines kept out of the fit."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from middeck.values import record

# Sizes after the best that must be worse before the search ends: a mode may need two steps to pay.
PATIENCE = 3
# Sizes after one that must not meet lines kept out better: several modes may be found only together.
FURTHER = 5
MOST_STATES = 60
# Held-out errors within this share of each other are equal: searches that rounding sends other ways end a
# tenth apart.
EQUAL = 0.2
# A few lines at peaks, narrower than lines are apart, may be most of a held-out error, and how a larger order
# meets those is chance. It is better by so many deviations of the ratio of both errors, or if what lines gain
# is so many times what others lose: modes that lack gain on all of their lines and lose on none.
CLEAR, ONE_SIDED = 4.0, 25.0
# Lengths that differ by less say little of which order is right (2 ln of a Bayes factor, Kass and Raftery
# 1995).
ALIKE = 6.0
# An order that meets lines kept out of the fit so many times worse than a smaller one fits single lines:
# distortion that differs from line to line asks for ever more poles, each narrower than lines are apart.
WORSE = 1.25


@record
class TriedOrder:
    """An order, its description length and its relative error on lines that it was not fitted to.

    ``noise``: what it leaves may be noise alone. Only where some order does so do lengths decide: elsewhere
    (distortion, modes without end) each order shortens the description, and by how much is chance.
    ``lines``: the square of ``held_out`` shared out among the lines, if known.
    """

    states: int
    length: float
    held_out: float
    noise: bool = True
    lines: Float[np.ndarray, " line"] | None = dataclasses.field(default=None, kw_only=True)


@record
class OrderChoice:
    """A recommended order.

    Attributes:
        states: The order, without delays.
        reason: One sentence for the user.
        tried: The orders tried.
    """

    states: int
    reason: str
    tried: tuple[TriedOrder, ...]


def sizes() -> Iterator[int]:
    """Orders to try: every even one up to 20, then in steps of a fifth."""
    states = 2
    while states <= MOST_STATES:
        yield states
        states += 2 * max(1, round(states / 10 if states >= 20 else 0))


def description_length(likelihood: float, unknowns: int, numbers: int, alike: float = 1.0) -> float:
    """2 L + k ln n with L the negative log likelihood (Rissanen 1978; Schwarz 1978).

    ``alike``: How many numbers share their noise, as neighbouring lines under a window do. They count as one,
    or the shared noise would be fitted with poles.

    >>> description_length(10.0, 2, 1), description_length(10.0, 2, 4, alike=4.0)
    (20.0, 5.0)
    """
    return 2.0 * likelihood / alike + unknowns * float(np.log(numbers / alike))


def is_settled(length: Sequence[float]) -> bool:
    """Whether the last `PATIENCE` sizes or more did not shorten the description.

    >>> is_settled([5.0, 3.0, 4.0, 4.5, 6.0]), is_settled([5.0, 3.0, 4.0])
    (True, False)
    """
    return len(length) - 1 - int(np.argmin(length)) >= PATIENCE


def has_met(tried: Sequence[TriedOrder]) -> bool:
    """Whether `FURTHER` larger orders met the held-out lines no better, while no order leaves noise alone.

    >>> rows = [(2, 0.5), (4, 0.1), (6, 0.09), (8, 0.11), (10, 0.1), (12, 0.2), (14, 0.1)]
    >>> has_met([TriedOrder(n, -n, e, False) for n, e in rows]), has_met([TriedOrder(2, 0.0, 0.5, False)])
    (True, False)
    """
    if any(t.noise for t in tried):
        return False
    return len(tried) - 1 - tried.index(_first_to_meet(tried)) >= FURTHER


def choose(tried: Sequence[TriedOrder]) -> OrderChoice:
    """The recommended order with its reason and its error on held-out lines.

    If some order leaves noise alone, it is the order of minimum description length (MDL), or the smallest
    that is nearly as short, among orders that meet the held-out lines no worse than smaller ones do.
    Otherwise, or if the largest order tried is the shortest, no order is the true one (a real structure has
    modes without end): it is the smallest that the next few larger ones do not better beyond chance.
    """
    trusted = [
        t for k, t in enumerate(tried) if t.held_out <= WORSE * min(o.held_out for o in tried[: k + 1])
    ]
    shortest = min(trusted, key=lambda t: t.length)
    endless = shortest is tried[-1] and len(tried) > PATIENCE
    if endless or not any(t.noise for t in tried):
        return _by_lines_kept_out(tried)
    alike = [t for t in trusted if t.length < shortest.length + ALIKE]
    found, *others = alike
    rivals = [t.length - found.length for t in trusted if t not in alike]
    margin = f", {min(rivals):.0f} below the next" if rivals else ""
    opinion = f"lines kept out of the fit are met to {found.held_out:.2%}"
    enough = _first_to_meet(tried)
    if enough.states > found.states:
        opinion += f" and ask for {enough.states} ({enough.held_out:.2%})"
    if min(t.length for t in tried) < shortest.length:
        opinion += ", more states clearly worse"
    length = f"minimum description length (MDL) {_span(tried)}{margin}"
    reason = f"{found.states} states have the {length}{_as_well(others)}"
    return OrderChoice(found.states, f"{reason}; {opinion}", tuple(tried))


def _by_lines_kept_out(tried: Sequence[TriedOrder]) -> OrderChoice:
    found = _first_to_meet(tried)
    others = [t for t in tried if t.states > found.states and t.held_out <= (1.0 + EQUAL) * found.held_out]
    reason = (
        f"{found.states} states are the fewest {_span(tried)} that meet lines kept out of the fit as well as "
        f"the next larger ones, up to a fifth (they are met to {found.held_out:.2%}){_as_well(others)}"
    )
    return OrderChoice(found.states, reason, tuple(tried))


def _first_to_meet(tried: Sequence[TriedOrder]) -> TriedOrder:
    """The smallest order that none of the `FURTHER` next ones betters."""
    return next(
        t for k, t in enumerate(tried) if not any(_betters(o, t) for o in tried[k + 1 : k + 1 + FURTHER])
    )


def _betters(larger: TriedOrder, smaller: TriedOrder) -> bool:
    """Whether the held-out error is lower by more than `EQUAL`, and not by the chance of a few lines.

    A sum of squares counts as one of sum(d)^2 / sum(d^2) equal lines (Kish 1965); its logarithm has the
    variance of one over that.
    """
    if smaller.held_out <= (1.0 + EQUAL) * larger.held_out:
        return False
    if smaller.lines is None or larger.lines is None:
        return True
    gain = smaller.lines - larger.lines
    if np.sum(np.maximum(gain, 0.0)) >= ONE_SIDED * np.sum(np.maximum(-gain, 0.0)):
        return True
    by_chance = np.sqrt(sum(d @ d / np.sum(d) ** 2 for d in (smaller.lines, larger.lines)))
    return bool(2.0 * np.log(smaller.held_out / larger.held_out) > CLEAR * by_chance)


def _span(tried: Sequence[TriedOrder]) -> str:
    return f"of {len(tried)} orders from {tried[0].states} to {tried[-1].states}"


def _as_well(others: Sequence[TriedOrder]) -> str:
    """Larger orders that the data do not distinguish from the one taken."""
    return f"; {', '.join(str(t.states) for t in others)} do as well" if others else ""
