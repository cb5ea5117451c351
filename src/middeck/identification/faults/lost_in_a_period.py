"""Samples lost or repeated within one period, which the other periods show.

What a period that lost samples shows from there on is what the others show so many samples later. Two
explanations of it are compared, sample by sample: the others as they are, and the others shifted. Before the
loss the first leaves less, from it on the second.
"""

from __future__ import annotations

import numpy as np

from middeck.identification.faults.equal_runs import Found, Signal, fault

# Samples that may be lost, parts of a period, and by how much what a period leaves of the others differs
# between two parts before shifts are tried: noise has as much in all.
MOST, PARTS, UNEVEN = 16, 16, 4.0
# Each explanation leaves no more than this share of what the other leaves, on its side of the loss.
BETTER = 0.5
# A shorter shift is as good that leaves no more than so many times what the best leaves.
AS_GOOD = 1.5
# Deviations, and fewest samples on each side, by which that is no chance.
SURE, FEWEST = 7.0, 8


def find_lost_in_period(x: Signal, period: int) -> list[Found]:
    """The period that answers later or earlier than the others from one of its samples on; of two, both.

    >>> rng = np.random.default_rng(0)
    >>> x = np.tile(rng.standard_normal(400), 3) + 0.05 * rng.standard_normal(1200)
    >>> x[550:800] = np.append(x[551:800], 0.0)
    >>> find_lost_in_period(x, 400)[0].samples
    ((549, 551),)
    """
    rows = x.reshape(-1, period)
    if len(rows) < 2 or period < 2 * PARTS:
        return []
    others = (rows.sum(axis=0) - rows) / (len(rows) - 1)
    size = period // PARTS
    parts = np.mean(((rows - others) ** 2)[:, : PARTS * size].reshape(len(rows), PARTS, size), axis=2)
    uneven = np.flatnonzero(parts.max(axis=1) > UNEVEN * parts.min(axis=1))
    steps = [(p, *step) for p in uneven for step in [_step(rows[p], others[p])] if step is not None]
    if not steps:
        return []
    p, at, shift, _ = max(steps, key=lambda step: step[-1])
    if len(rows) == 2:  # one that lost samples is like another that repeats them
        off = abs(shift)
        what = (
            f"the two periods answer {off} samples apart from near sample {at} of each on: samples were lost "
            "or repeated in one of them"
        )
        hint = "record more periods, which tell in which; check buffers and clocks"
        runs = tuple((max(near - off, 0), near + off) for near in (at, period + at))
        return [fault("shift", what, hint, samples=runs)]
    way, lost = ("earlier", "lost") if shift > 0 else ("later", "repeated")
    near = int(p) * period + at
    what = (
        f"answers {abs(shift)} samples {way} in period {p + 1} of {len(rows)} than in the others, from near "
        f"sample {near} on: samples were {lost} there"
    )
    out = "that period and those after it" if _stays(rows, p, shift) else "that period"
    hint = f"leave {out} out; check buffers and clocks"
    return [fault("shift", what, hint, samples=((max(near - 1, 0), near + 1),))]


def _stays(rows: Signal, p: int, shift: int) -> bool:
    """Whether the period after ``p`` runs ahead, too, of those before: no clock was set right between."""
    if not 0 < p < len(rows) - 1:
        return False
    before, after = rows[:p].mean(axis=0), rows[p + 1]
    return bool(np.sum((after - np.roll(before, -shift)) ** 2) < np.sum((after - before) ** 2))


def _step(y: Signal, others: Signal) -> tuple[int, int, float] | None:
    """From which sample, and by how many, ``y`` runs ahead of the others, and how much that explains.

    The motion of one mode is nearly the same a cycle later: the shortest shift that leaves hardly more.
    """
    tried = sorted((*range(-MOST, 0), *range(1, MOST + 1)), key=abs)
    found = [(shift, step) for shift in tried for step in [_split(y, others, shift)] if step is not None]
    if not found:
        return None
    least = min(left for _, (_, left, _) in found)
    return next((at, shift, gain) for shift, (at, left, gain) in found if left <= AS_GOOD * least)


def _split(y: Signal, others: Signal, shift: int) -> tuple[int, float, float] | None:
    """Where the shift begins, what is left with it and what it explains; None where that may be chance."""
    moved = np.roll(others, -shift)
    as_they_are, shifted, apart = (
        np.concatenate([[0.0], np.cumsum(part**2)]) for part in (y - others, y - moved, moved - others)
    )
    at = int(np.argmax(shifted - as_they_are))
    before = as_they_are[at], shifted[at], apart[at]
    after = shifted[-1] - shifted[at], as_they_are[-1] - as_they_are[at], apart[-1] - apart[at]
    left = float(before[0] + after[0])
    for own, other, told in (before, after):
        chance = 2.0 * SURE * np.sqrt(left / len(y) * told)
        if not (own < BETTER * other and other - own > chance):
            return None
    return (at, left, before[1] + after[1] - left) if FEWEST <= at <= len(y) - FEWEST else None
