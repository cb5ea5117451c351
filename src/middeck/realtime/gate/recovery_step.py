"""The step of the gate that limits a law's outputs, in size and in slew, and asks whether anything grows."""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np

from middeck.control.analysis.loop.feedback_loop import FeedbackLoop, form_loop
from middeck.control.analysis.stability.stability import LoopStability, decide_loop, find_roots
from middeck.control.law.compensator import Compensator
from middeck.control.qualification import align_plant
from middeck.realtime.engine.interface.settings import Drive
from middeck.realtime.gate.linear_law import limited_law
from middeck.realtime.gate.reached_slews import reached_slews
from middeck.realtime.gate.recovery_proof import why_unproved
from middeck.realtime.gate.steps_without_rig import FADES, NOT_DECIDED, GateStep, to_step, why_unstable
from middeck.realtime.package.package import ControllerPackage
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.stability import growth_limits

SLEWS = tuple(0.5**k for k in range(1, 15))
"""Shares of a step that a limit of slew lets through: lags with half the rate, and with a 16 000th of it."""
FASTER = 2.0
"""How much faster than without the law what is not held may grow."""
PROVED, UNPROVED = "; proved for limits that come and go", "; not proved for limits that come and go"
AT_ONCE, NOR_AT_ONCE = ", of size and slew at once", ", nor for size and slew at once"
WITHIN = ", at full authority, while the sensors stay within their ranges"
BEHIND = " (the engine's effort trip stands behind)"
NOT_TRIED = "no proof is tried"
ALL_TOGETHER = 6
"""Most outputs of which all sets are tried."""


def check_recovery(
    package: ControllerPackage,
    name: str,
    plant: Plant,
    *,
    held: bool,
    alone: ControllerPackage | None,
    sums: Sequence[Drive] = (),
) -> GateStep:
    """Nothing grows on ``plant`` while some outputs are limited, from none of what they are asked for to 0.9.

    Limited are motors, u = g (p + c), in slew too where the package has such limits, and beside an inner
    loop or a hold the law's commands, u = p + g c.
    What grows at this limit without the law, at least half as fast, is not its doing, unless it is unstable
    by itself, or its own inner loop (p, where it is not ``held`` by the engine's) moves an article that rests
    without. An output whose limit of slew a growing motion within the sensors' ranges does not reach
    (`reached_slews`) has none, but in a law that is unstable by itself. These are loops that stay so, each
    with limits of one kind. For limits that come and go, of size and slew at once, a proof is tried
    (`why_unproved`) and told, of the law ``alone`` with all limits that act on it, beside a hold with those
    of the drives of ``sums`` besides; None where it is not tried. It decides of a law that is unstable by
    itself, which may run away where the proof ends: it passes with that proof only.
    """
    step, core = f"recovery {name}", package.core
    moved = np.asarray(np.hstack([core.C, core.D]).any(axis=1))
    whole, off = np.ones(len(moved)), np.zeros(len(moved))
    limits = [("", whole, drives, whole) for drives in _limits(np.ones_like(moved))]
    limits += [("the law's ", shares, whole, whole) for shares in _limits(moved) if package.paths]
    slews = _limits(np.isfinite(package.slew), SLEWS) if np.isfinite(package.slew).any() else ()
    limits += [("each step of ", whole, whole, shares) for shares in slews]
    unheld = 0
    try:
        limited, reached = limited_law(package), reached_slews(package)
        loop = form_loop(align_plant(plant, limited(whole, whole)), limited(whole, whole))
        for whose, commands, drives, steps in limits:
            found = _decide(loop, limited(commands, drives, steps))
            if found.growing and steps is not whole and not package.unstable:
                steps = _reached_part(loop, functools.partial(limited, whole, whole), reached, steps)
                found = _decide(loop, limited(commands, drives, steps))
            fault = why_unstable(found, off=True)
            excuses = [] if not fault or package.unstable else [drives] if held else [drives, off]
            without = [_decide(loop, limited(off, g, steps)) for g in excuses]
            if without and all(w.growing and found.margin >= FASTER * w.margin for w in without):
                unheld += 1
            elif fault:
                least = commands * drives * steps
                names = [port.name for port, g in zip(package.outputs, least, strict=True) if g < 1.0]
                where = f"while {least.min():g} of {whose}{', '.join(names)} is applied"
                return to_step(step, [f"{where}: {fault}"], "")
    except NOT_DECIDED as error:
        return to_step(step, [f"not decided: {getattr(error, 'what', error)}"], "")
    said = f"nothing grows at any of {len(limits)} limits of outputs"
    said += f", but at {unheld} what does so without the law too" if unheld else ""
    reason = NOT_TRIED
    if alone is not None:
        reason = why_unproved(alone, plant, drives=sums, required=package.unstable)
    if reason and package.unstable:
        unproved = f"{said}, but it is unstable by itself, and not proved to recover: {reason}"
        return to_step(step, [unproved], "")
    if not reason:
        return to_step(step, [], f"{said}{PROVED}{AT_ONCE if len(slews) else ''}{WITHIN}")
    return to_step(step, [], f"{said}{UNPROVED}{NOR_AT_ONCE if len(slews) else ''}: {reason}{BEHIND}")


def _limits(places: np.ndarray, levels: Sequence[float] = FADES[:-1]) -> np.ndarray:
    """Shares of outputs: each set of ``places`` at each; of more than `ALL_TOGETHER` each, all but each, all.

    Of 654 random laws of seven motors, stable by themselves, these few find all but three of those 654 that
    all sets find to grow.
    """
    at = np.flatnonzero(places)
    few = [np.eye(len(at)), 1.0 - np.eye(len(at)), np.ones((1, len(at)))]
    every = (np.arange(1, 1 << min(len(at), ALL_TOGETHER))[:, None] >> np.arange(len(at))) % 2
    sets = np.vstack(few) if len(at) > ALL_TOGETHER else every
    shares = np.ones((len(sets) * len(levels), len(places)))
    shares[:, at] = np.vstack([1.0 - (1.0 - share) * sets for share in levels])
    return shares


def _reached_part(
    loop: FeedbackLoop,
    limited: Callable[[np.ndarray], Compensator],
    reached: Callable[[np.ndarray, np.ndarray], np.ndarray],
    shares: np.ndarray,
) -> np.ndarray:
    """Shares with which something grows that reaches them all, else ones: what is not reached is set to 1."""
    motions = _growing(loop, limited(shares))
    hit = reached(motions, shares)
    if hit.all(axis=1).any():
        return shares
    parts = [
        _reached_part(loop, limited, reached, np.where(row, shares, 1.0)) for row in np.unique(hit, axis=0)
    ]
    return next((part for part in parts if np.any(part < 1.0)), np.ones_like(shares))


def _growing(loop: FeedbackLoop, law: Compensator) -> np.ndarray:
    """The motions z^k of the sampled loop that grow."""
    sampled = law.sampled
    roots = find_roots(dataclasses.replace(loop, law=sampled))
    return np.exp(sampled.period_s * roots[np.real(roots) > growth_limits(roots, sampled.period_s)])


def _decide(loop: FeedbackLoop, law: Compensator) -> LoopStability:
    return decide_loop(dataclasses.replace(loop, law=law.sampled))
