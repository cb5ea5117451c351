"""Detect that a tracker has lost its modes, and restart it from a good state.

A filter that follows a wrong frequency has a small covariance and corrects too slowly. Its innovations are
then large and coloured; if the model holds they are white and of the stated size (Mehra 1970). Means of their
products at lags 0 to 16 are kept with a memory of a thousand samples. If the loss lasts, the parameters
return to those of the last good state, the motion becomes unknown, and the frequencies are opened by a jump,
then by two and four: a wider opening finds a mode that is farther off, and more often its neighbour.
"""

from __future__ import annotations

import numpy as np
import scipy.special
from jaxtyping import Float, Int

from middeck.values import record

WATCHED = 16  # lags: half a cycle of a mode at a thirtieth of the rate
MEMORY = 1024  # samples
# Memory [samples] of the products that it is judged by: a fourth of that of `trusted`, to see a try succeed.
BRIEF = 256
# Recent innovations are also kept in blocks of samples, eight of them as long as the memory of `trusted`:
# unlike a mean that forgets, whole blocks hold nothing of what was before them.
BLOCK, BLOCKS = MEMORY // 8, 8
# Mean square of innovations, and sum of their squared correlations over 16 lags, beyond which the modes are
# lost. Chance has 1 +- 0.06 and 0.03 +- 0.01; a sine among noise as large as itself has 2 and 2.
TOO_LARGE, TOO_COLOURED = 1.5, 0.5
# How long [s] it is to last, and how far apart good states are kept, so that the older one is of before.
PATIENCE_S = 6.0
# Openings that are tried one after the other, in jumps.
OPENINGS = (1.0, 2.0, 4.0)
# Standard deviations by which the mean square may be off by chance, once in two million for one look, and the
# sum of squares of as many normal numbers as lags (chi-square) that is as rare.
LIMIT = 5.0
COLOURED = float(scipy.special.chdtri(WATCHED, 2.0 * scipy.special.ndtr(-LIMIT)))


@record
class Restart:
    """A restart of a tracker that had lost its modes.

    Attributes:
        time_s: When [s].
        good_s: Time of the state whose parameters it took up again.
        opening: Relative deviation by which its frequencies were opened.
    """

    time_s: float
    good_s: float
    opening: float


@record(kw_only=True)
class Recovery:
    """State from which a tracker restarts.

    Attributes:
        products, weight: The tracker's ``products`` and ``weight``, with a brief memory.
        lost: Samples for which the modes were lost, less those since.
        tries: Restarts since all was well.
        mean, variance, taken: Parameters of two good states, the older one first, and the samples after which
            each was taken.
        loudness: Mean square of recent inputs, by which unknown motion is judged.
        restarts: All restarts so far.
        blocks: Sums of the products, the block that is being filled first, then the recent ones.
        seen: Samples in all blocks since the last restart.
    """

    products: Float[np.ndarray, " lag"]
    weight: float
    lost: int
    tries: int
    mean: Float[np.ndarray, "age parameter"]
    variance: Float[np.ndarray, "age parameter"]
    taken: Int[np.ndarray, " age"]
    loudness: Float[np.ndarray, " input"]
    restarts: tuple[Restart, ...]
    blocks: Float[np.ndarray, "block lag"]
    seen: int


def first_recovery(
    mean: Float[np.ndarray, " parameter"],
    variance: Float[np.ndarray, " parameter"],
    loudness: Float[np.ndarray, " input"],
) -> Recovery:
    """The recovery before the first sample: the start is the good state."""
    blocks, seen = no_blocks()
    return Recovery(
        products=np.zeros(WATCHED + 1),
        weight=0.0,
        lost=0,
        tries=0,
        mean=np.tile(mean, (2, 1)),
        variance=np.tile(variance, (2, 1)),
        taken=np.zeros(2, dtype=int),
        loudness=loudness,
        restarts=(),
        blocks=blocks,
        seen=seen,
    )


def no_blocks() -> tuple[np.ndarray, int]:
    """Blocks and samples in them at the start, and after a restart."""
    return np.zeros((BLOCKS + 1, WATCHED + 1)), 0


def is_large(blocks: Float[np.ndarray, "block lag"], seen: int) -> bool:
    """Whether innovations are too large in the last whole block; if not, the modes are found again."""
    return seen >= BLOCK and bool(blocks[1, 0] > TOO_LARGE * BLOCK)


def healed(
    products: Float[np.ndarray, " lag"],
    weight: float,
    blocks: Float[np.ndarray, "block lag"],
    seen: int,
    outputs: int,
) -> tuple[Float[np.ndarray, " lag"], float] | None:
    """Means of the whole blocks in place of ``products`` that still hold a loss that is over; else None.

    Innovations of a loss are up to 25 times what they should be, and a mean that forgets in four seconds is
    off by more than chance for twenty. Only means that are grossly too large are replaced: what is a little
    wrong all the time is not to be judged by the shorter blocks, now and then, to be right.

    >>> after = np.zeros(WATCHED + 1), 1.0
    >>> after[0][0] = 4.0
    >>> blocks = np.zeros((BLOCKS + 1, WATCHED + 1))
    >>> blocks[1:, 0] = BLOCK
    >>> new, weight = healed(*after, blocks, BLOCK * BLOCKS, 1)
    >>> float(new[0]) / weight, is_trusted(*after, 1), is_trusted(new, weight, 1)
    (1.0, False, True)
    """
    if seen < BLOCK * BLOCKS or products[0] <= TOO_LARGE * weight:
        return None
    # A mean that forgets has the scatter of the blocks' even mean at 2 w / (2 - w) = 1 (`is_trusted`).
    as_heavy = 2.0 / 3.0
    late = as_heavy * np.sum(blocks[1:], axis=0) / (BLOCK * BLOCKS)
    return (late, as_heavy) if is_trusted(late, as_heavy, outputs) else None


def is_lost(products: Float[np.ndarray, " lag"], weight: float) -> bool:
    """Whether recent innovations are too large and too correlated.

    >>> noise = np.zeros(WATCHED + 1)
    >>> noise[0] = 9.0                                       # three times as large as stated, but white
    >>> is_lost(noise, 1.0), is_lost(2.0 * np.cos(0.2 * np.arange(WATCHED + 1)), 1.0)
    (False, True)
    """
    if weight < 0.5:
        return False
    size = products[0] / weight
    return bool(size > TOO_LARGE and np.sum((products[1:] / products[0]) ** 2) > TOO_COLOURED)


def opening(tries: int) -> float:
    """Size, in jumps, to which deviations of a lost mode are opened after so many tries."""
    return OPENINGS[tries % len(OPENINGS)]


def patience(tries: int) -> float:
    """Time [s] before the next restart, longer with each round: repeated failures are tried less often."""
    return PATIENCE_S * (1 + tries // len(OPENINGS))


def is_trusted(products: Float[np.ndarray, " lag"], weight: float, outputs: int) -> bool:
    """Whether size and whiteness of the innovations deviate only by chance; True while samples are few."""
    if weight < 0.1:
        return True
    means = products / weight
    # Samples of even weight that scatter as much, (sum w)^2 / sum w^2: 2 M in the end.
    count = 2.0 * MEMORY * outputs * weight / (2.0 - weight)
    size = (means[0] - 1.0) / np.sqrt(2.0 / count)
    white = count * np.sum((means[1:] / max(means[0], np.finfo(float).tiny)) ** 2)
    return bool(abs(size) < LIMIT and white < COLOURED)
