"""Gauges and load cases that contradict the model where all others of the static tests agree."""

import itertools
from collections.abc import Sequence

import numpy as np

from middeck.updating.refinement.refine import Refined
from middeck.updating.refinement.wrong_channels import NOISE, PART, RIGHT, STILL, TINY, WRONG, how_it_reads
from middeck.updating.residuals.static_tests import ComparedStatic, gauge_key

# What priors may leave of the other readings where what is wrong keeps the refinement from its end.
FAR_OFF = 0.3


def wrong_readings(refined: Refined) -> tuple[str, ...]:
    """A sentence for a single deviating gauge or test, beside the refined model or the one before it."""
    statics = refined.statics
    if not statics:
        return ()
    gauges = [gauge_key(g)[::2] for c in statics for g in c.test.gauges]
    tests = [c.test.name for c in statics for _ in c.test.gauges]
    scale, std = (np.concatenate([getattr(c, name) for c in statics]) for name in ("scale", "std"))
    read = np.concatenate([c.test.value for c in statics]) / scale
    whole = np.concatenate([_lengths(c) for c in statics]) / scale
    # What is far off draws the model along, so that the others no longer agree with it.
    values = [np.concatenate([c.value for c in statics]), np.concatenate(refined.before)]
    right = RIGHT if refined.converged else FAR_OFF
    warnings = (
        _off_alone(what, names, read, value / scale, whole, std, right)
        for value in values
        for what, names in (("gauge", gauges), ("test", tests))
    )
    return tuple(itertools.islice(filter(None, warnings), 1))


def _lengths(c: ComparedStatic) -> np.ndarray:
    """The change of which each gauge reads a part; where there is next to none, the most of its sort."""
    own, units = c.at.lengths(c.test.gauges), np.array([g.unit for g in c.test.gauges])
    most = np.array([own[units == unit].max() for unit in units])
    return np.where(own > STILL * most, own, most)


def _off_alone(
    what: str,
    names: Sequence[str | tuple[str, ...]],
    read: np.ndarray,
    moved: np.ndarray,
    whole: np.ndarray,
    std: np.ndarray,
    right: float,
) -> str:
    groups = list(dict.fromkeys(names))
    of = np.array([groups.index(name) for name in names])
    sized, least, left, noise = (
        np.array([float(np.linalg.norm(part[of == k])) for k in range(len(groups))])
        for part in (read, whole, read - moved, NOISE * std)
    )
    size = np.maximum(np.maximum(sized, PART * least), TINY)
    left, noise = left / size, noise / size
    left = np.where(left > noise, left, 0.0)
    worst = int(np.argmax(left))
    others = np.delete(left, worst)
    if left[worst] < WRONG or len(others) < 2 or float(np.sqrt(np.mean(others**2))) > right:
        return ""
    own = groups[worst]
    name = own if isinstance(own, str) else own[-1]
    matter = how_it_reads(read[of == worst], moved[of == worst], STILL * least[worst])
    return (
        f"static tests: {what} {name!r} {matter} other {what}s agree with the model; correct it or leave it "
        "out, for it shifts and widens all that is stated"
    )
