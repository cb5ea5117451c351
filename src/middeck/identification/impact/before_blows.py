"""What the outputs did before each blow: it tells free motion from the response to the blow.

A fit of samples gives each block a free motion of its own. In a band B, modes of free motion follow a
response of any form up to a blow that comes soon after the block begins: a time t holds 2 B t numbers, and
each mode has two. Residues were then known to several times their size. Longer blocks decide: what was
recorded before, or rest, where the record begins at rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.identification.impact.blows import BEFORE, Blow

# Share of a block that is put before it; and the share of the longest lead below which a blow has none.
LEAD, LED = 0.25, 0.5
# Samples that tell rest; their variance over that of their differences, which are noise, up to which it is
# rest; and their deviation over the rms of the response at which it is rest whatever noise there is.
FEWEST, NOISE, NOTHING = 16, 4.0, 1e-4


def before_blows(
    y: Float[np.ndarray, "experiment sample output"], good: Sequence[Blow], blows: Sequence[Blow], size: int
) -> tuple[Float[np.ndarray, "led lead output"], tuple[int, ...]]:
    """The outputs ``y`` before the blocks of the ``good`` blows, as long for each, and which of them have it.

    A lead ends where the blow before pushed; a level goes before an experiment that begins at rest. A blow
    with far less than others has none: theirs would be as short.
    """
    most = [_most(y[b.experiment], b, blows, int(LEAD * size)) for b in good]
    led = tuple(k for k, lead in enumerate(most) if lead >= LED * max(most))
    lead = min(most[k] for k in led)
    return np.stack([_led(y[good[k].experiment], good[k], lead) for k in led]), led


def _led(y: Float[np.ndarray, "sample output"], blow: Blow, lead: int) -> Float[np.ndarray, "lead output"]:
    missing = max(lead - blow.first, 0)
    rest = np.tile(_early(y, blow).mean(axis=0), (missing, 1))
    return np.concatenate([rest, y[blow.first - lead + missing : blow.first]])


def _most(y: Float[np.ndarray, "sample output"], blow: Blow, blows: Sequence[Blow], most: int) -> int:
    ends = [b.force_end for b in blows if b.experiment == blow.experiment and b.last <= blow.first]
    if ends:
        return min(most, max(blow.first - max(ends), 0))
    return most if blow.first >= most or _rests(y, blow) else blow.first


def _early(y: Float[np.ndarray, "sample output"], blow: Blow) -> Float[np.ndarray, "some output"]:
    return y[: blow.first + BEFORE // 2]


def _rests(y: Float[np.ndarray, "sample output"], blow: Blow) -> bool:
    """Whether all outputs are noise alone from the beginning to the blow."""
    early = _early(y, blow)
    if len(early) < FEWEST:
        return False
    noise = 0.5 * np.mean(np.diff(early, axis=0) ** 2, axis=0)
    least = NOTHING**2 * np.mean(y[blow.struck : blow.last] ** 2, axis=0)
    return bool(np.all(early.var(axis=0) <= np.maximum(NOISE * noise, least)))
