"""Samples lost or repeated within one period, which the other periods show.

A period that lost samples shows from there on the samples that the others show so many samples later. Two
explanations of it are compared, sample by sample: the others as they are, and the others shifted. Before the
loss the first leaves less, from it on the second. A recorder that starts each period anew is right again in
the next; of one that runs on, all later periods are shifted, and are shifted back before they are compared.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from middeck.identification.faults.equal_runs import FaultDraft, Signal, fault

# Samples that may be lost, parts of a period, and by how much what a period leaves of the others differs
# between two parts before shifts are tried: noise has as much in all.
MOST, PARTS, UNEVEN = 16, 16, 4.0
# Each explanation leaves no more than this share of what the other leaves, on its side of the loss.
BETTER = 0.5
# What one leaves of a sample on its side, over what both leave on average; of the other, what is rounding.
EVEN, ROUNDING = 3.0, 1e-18
# Free motion predicts itself, so many samples being known: to less than this share of the power that a shift
# leaves, and to hardly more than that predicts itself. What forces do in so many more samples does not.
KNOWN, FREE, HARDLY = 12, 0.6, 1.4
# Largest error of prediction near the loss, over the rms.
LEAP = 4.5
# A shorter shift is as good that leaves no more than so many times what the best leaves.
AS_GOOD = 1.5
# Deviations, and fewest samples on each side, by which that is no chance.
SURE, FEWEST = 7.0, 8


def find_lost_in_period(x: Signal, period: int) -> list[FaultDraft]:
    """The period whose response is shifted from one of its samples on; both, if there are only two."""
    rows = x.reshape(-1, period)
    if len(rows) < 2 or period < 2 * PARTS:
        return []
    size = period // PARTS
    change = np.diff(rows, axis=0)[:, : PARTS * size].reshape(len(rows) - 1, PARTS, size)
    parts = np.mean(change**2, axis=2)
    near = np.flatnonzero(parts.max(axis=1) > UNEVEN * parts.min(axis=1))
    tried = [_Loss(rows, int(p), lasts) for p in np.union1d(near, near + 1) for lasts in (False, True)]
    losses = [loss for loss in tried if loss.step is not None]
    if not losses:
        return []
    loss = min(losses, key=_Loss.left)
    assert loss.step is not None
    at, shift, _ = loss.step
    if len(rows) == 2 and not loss.lasts:  # one that lost samples is like another that repeats them
        off = abs(shift)
        what = (
            f"the two periods come {off} samples apart from near sample {at} of each on: samples were lost "
            "or repeated in one of them"
        )
        hint = "record more periods, which tell in which; check buffers and clocks"
        runs = tuple((max(near - off, 0), near + off) for near in (at, period + at))
        return [fault("shift", what, hint, samples=runs)]
    way, lost = ("earlier", "lost") if shift > 0 else ("later", "repeated")
    place = loss.period * period + at
    whom = ", as all periods after it" if loss.lasts else " than in the others"
    what = (
        f"comes {abs(shift)} samples {way} in period {loss.period + 1} of {len(rows)}{whom}, from near "
        f"sample {place} on: samples were {lost} there"
    )
    out = "that period and those after it" if loss.lasts else "that period"
    hint = f"leave {out} out; check buffers and clocks"
    if loss.lasts and loss.period == 0:
        hint = "shift what follows back by that, or record again; check buffers and clocks"
    return [fault("shift", what, hint, samples=((max(place - 1, 0), place + 1),))]


class _Loss:
    """A loss of samples in one period; the later periods are in step again, or (``lasts``) are not.

    ``step``: Sample of the period at which the shift begins, its size in samples, and the residual with it;
    None if it may be chance.
    """

    def __init__(self, rows: Float[np.ndarray, "period sample"], period: int, lasts: bool) -> None:
        self.rows, self.period, self.lasts = rows, period, lasts
        # In the last period a loss that lasts and one that does not are the same.
        possible = not lasts or period < len(rows) - 1
        self.step = _step(rows[period], lambda m: self.others(m).mean(axis=0)) if possible else None
        if self.step is not None and self._is_free_motion(*self.step):
            self.step = None

    def _is_free_motion(self, at: int, shift: int, left: float) -> bool:
        """Whether the difference from the next period (from the one before the last) is free motion."""
        y, others = self.rows[self.period], self.others(shift).mean(axis=0)
        then = self.rows[self.period + (1 if self.period + 1 < len(self.rows) else -1)]
        shifted = np.where(np.arange(len(y)) < at, others, np.roll(others, -shift))
        own = _innovation(y - then)
        free, near = np.mean(own**2), own[max(at - 2 * KNOWN, 0) : at + KNOWN]
        leaps = np.max(np.abs(near), initial=0.0) > LEAP * np.sqrt(free)
        return bool(
            free < FREE * left / len(y)
            and free < HARDLY * np.mean(_innovation(y - shifted) ** 2)
            and not leaps
        )

    def others(self, shift: int) -> Float[np.ndarray, "period sample"]:
        """The other periods, by the clock of the first."""
        rows = self.rows.copy()
        if self.lasts:
            rows[self.period + 1 :] = np.roll(rows[self.period + 1 :], shift, axis=1)
        return np.delete(rows, self.period, axis=0)

    def left(self) -> float:
        """The residual of all periods after the loss."""
        assert self.step is not None
        _, shift, own = self.step
        others = self.others(shift)
        return own + float(np.sum((others - others.mean(axis=0)) ** 2))


def _innovation(x: Signal) -> Signal:
    """Innovation of each sample of a signal after the first ``KNOWN``, given as many before it."""
    past = np.lib.stride_tricks.sliding_window_view(x[:-1], KNOWN)
    return x[KNOWN:] - past @ np.linalg.lstsq(past, x[KNOWN:], rcond=None)[0]


def _step(y: Signal, others: Callable[[int], Signal]) -> tuple[int, int, float] | None:
    """First sample from which ``y`` leads the others, the lead in samples, and the residual.

    The motion of one mode is nearly the same a cycle later: the shortest shift that leaves hardly more.
    """
    tried = sorted((*range(-MOST, 0), *range(1, MOST + 1)), key=abs)
    found = [
        (shift, step) for shift in tried for step in [_split(y, others(shift), shift)] if step is not None
    ]
    if not found:
        return None
    least = min(left for _, (_, left) in found)
    return next((at, shift, left) for shift, (at, left) in found if left <= AS_GOOD * least)


def _split(y: Signal, others: Signal, shift: int) -> tuple[int, float] | None:
    """Sample at which the shift begins, and the residual with it; None if it may be chance."""
    moved = np.roll(others, -shift)
    as_they_are, shifted, apart = (
        np.concatenate([[0.0], np.cumsum(part**2)]) for part in (y - others, y - moved, moved - others)
    )
    at = int(np.argmax(shifted - as_they_are))
    before = as_they_are[at], shifted[at], apart[at]
    after = shifted[-1] - shifted[at], as_they_are[-1] - as_they_are[at], apart[-1] - apart[at]
    left = float(before[0] + after[0])
    for (own, other, told), size in ((before, at), (after, len(y) - at)):
        chance = 2.0 * SURE * np.sqrt(left / len(y) * told)
        # Free motion at the start of a period, which a shift explains in part, leaves more there than later.
        if not (
            own < BETTER * other
            and other - own > chance
            and own <= EVEN * size * left / len(y) + ROUNDING * other
        ):
            return None
    return (at, left) if FEWEST <= at <= len(y) - FEWEST else None
