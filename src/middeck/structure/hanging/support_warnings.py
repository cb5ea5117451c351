"""Warnings about the supports of an article and about its attitude."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from middeck.structure.hanging.attitude import Attitude
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment

# A suspension is levelled to some tenths of a degree; beyond this the article hangs otherwise than drawn.
LARGE_TILT = np.radians(1.0)
OVER = np.radians(90.0)
SAGS = 0.5  # part of the nodes' tilt: more bending than this is most of it
ASIDE = 0.1  # part of the larger tilt: a smaller one is not reported
AXES = "xyz"


class SupportWarning(NamedTuple):
    """A warning: where, what, and what to try."""

    where: str
    what: str
    hint: str


def warnings_on_devices(structure: Structure, environment: Environment) -> Iterator[SupportWarning]:
    """Attach points without load, and directions that nothing holds while devices are tuned."""
    if not environment.hung:
        return
    ties = (*environment.hung, *environment.springs)
    used = {tie.attach for tie in ties} | {n for s in structure.springs for n in (s.start, s.end)}
    for point in structure.attach_points:
        if point.name not in used:
            yield SupportWarning(
                f"attach point {point.name!r}",
                f"no device or spring of {environment.title!r} holds it",
                "name it in the environment's [suspension.held], give it a [[device]], or leave it out",
            )
    tuned = [device.held for device in environment.hung if device.force is None]
    for axis in AXES:
        if tuned and not environment.springs and not any(axis in held for held in tuned):
            yield SupportWarning(
                "suspension",
                f"no attach point is held along {axis} while the loads of its devices are found",
                f"add {axis} to what one of the points holds, in [suspension.held] or the [[device]]",
            )


def warnings_on_attitude(attitude: Attitude, environment: Environment) -> Iterator[SupportWarning]:
    """A tilt beyond `LARGE_TILT`, with offsets that would level it; or parts that have turned over."""
    tilt = float(np.linalg.norm(attitude.tilt))
    if tilt <= LARGE_TILT:
        return
    if tilt > OVER:
        yield SupportWarning(
            "", f"the article has turned over: it hangs tilted by {np.degrees(tilt):.0f} deg", OVER_HINT
        )
        return
    if doubt := sag(attitude):
        yield SupportWarning("", doubt, SAG_HINT)
        return
    yield SupportWarning(
        "",
        f"the article hangs tilted by {np.degrees(tilt):.1f} deg; it was drawn level",
        f"{_levelling(attitude, environment)}see docs/how-to/level-an-article.md",
    )


OVER_HINT = (
    "its weight was drawn above what it hangs from: attach it above its centre of mass ([suspension] of the "
    "article), or draw it as it hangs"
)
SAG_HINT = (
    "hang it at more points, near what sags most, or measure it as it hangs: moving the attach points turns "
    "all of it alike and leaves its bending"
)


def sag(attitude: Attitude) -> str:
    """Words for nodes that tilt by bending rather than with the whole; empty for none."""
    whole, tilts = np.linalg.norm(attitude.tilt), np.linalg.norm(attitude.node_tilt, axis=1)
    if not attitude.node_bending.max(initial=0.0) > SAGS * whole:
        return ""
    least, most = int(np.argmin(tilts)), int(np.argmax(tilts))
    return (
        f"the article sags: its nodes tilt by {np.degrees(tilts[least]):.1f} ({attitude.node[least]}) to "
        f"{np.degrees(tilts[most]):.1f} deg ({attitude.node[most]}), and the mean of "
        f"{np.degrees(whole):.1f} deg is its bending more than the way it hangs"
    )


def _levelling(attitude: Attitude, environment: Environment) -> str:
    """A tilt about one level axis is taken away by moving an attach point along the other."""
    if not environment.hung:
        return ""
    vertical = int(np.argmax(np.abs(environment.gravity)))
    size = np.abs(attitude.tilt)
    about = [i for i in range(3) if i != vertical and size[i] > ASIDE * size.max()]
    along = [AXES[3 - vertical - i] for i in about]
    free = " ".join(f"--free {environment.hung[0].attach}.{axis}" for axis in along)
    return f"middeck level with {free} --about {''.join(AXES[i] for i in about)}; "
