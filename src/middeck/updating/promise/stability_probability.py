"""One compensator on many plants: probability of stability, levels of its decibels, leading risk."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import factorial, stdtrit

from middeck.campaign.confidence_of_draws import CONFIDENCE, level, probability_interval
from middeck.control.law.compensator import Compensator
from middeck.control.law.delay_order import approximation_order
from middeck.control.loop.authority import find_participation
from middeck.control.loop.closed_loop import close_loop
from middeck.control.qualification import decibels
from middeck.errors import NumericalError
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant
from middeck.updating.promise.draws import DrawnPlants
from middeck.updating.promise.slip import DrawnSlips
from middeck.updating.promise.slip_run import Slipped
from middeck.values import record

LEVELS = (0.01, 0.025, 0.25, 0.5, 0.75, 0.975, 0.99)
"""Levels of the distribution of decibels, from the best to the worst."""
COMPARED = 12
"""Unstable draws whose leading mode is looked for."""


class LoopNoise(NamedTuple):
    """The results of `noise_on` for a compensator on drawn plants, over all frequencies or in a band."""

    decays: Bool[np.ndarray, " draw"]
    rms: Float[np.ndarray, " draw"]
    effort: Float[np.ndarray, " draw"]


@record(kw_only=True)
class FrictionOutlook:
    """The effect of dry friction of the joints on a compensator, at the disturbance that the plan states.

    Attributes:
        without_db: Decibels of each draw without it, drag included.
        sticks: Whether each draw's loop, with its joints held by their presliding springs, does not grow.
            Where it grows it hunts: it moves until joints slip, and a loop that is stable then stays bounded.
        travel: Rms of each joint's angle over its slip angle, median of the draws.
        error_db: Standard error of a draw's decibels by the length of its simulation.
    """

    without_db: Float[np.ndarray, " draw"]
    sticks: Bool[np.ndarray, " draw"]
    travel: Float[np.ndarray, " joint"]
    error_db: float


@record(kw_only=True)
class Outlook:
    """One compensator on all drawn plants.

    Attributes:
        stable: Whether each draw is stable; a pole on the axis is not.
        db: 20 log10 of the rms over the same plant's without the compensator: less is better; ``inf`` where
            unstable. With the friction of the joints where the plan states any.
        control_rms: Rms of the commands in each draw, without friction.
        unstable_mode: Mode that grows in most unstable draws; empty if none is unstable.
        risk: The drawn quantity of largest rank correlation with worse outcomes, and that correlation.
    """

    name: str
    stable: Bool[np.ndarray, " draw"]
    db: Float[np.ndarray, " draw"]
    control_rms: Float[np.ndarray, " draw"]
    unstable_mode: str
    risk: tuple[str, float]
    friction: FrictionOutlook | None = None

    @property
    def probability_stable(self) -> float:
        """The share of stable draws."""
        return float(np.mean(self.stable))

    @property
    def probability_interval(self) -> tuple[float, float]:
        """95 % interval of the probability of stability (Clopper and Pearson 1934, Biometrika 26)."""
        return probability_interval(int(np.count_nonzero(self.stable)), len(self.stable))

    @property
    def promised_probability(self) -> float:
        """Lower bound of the probability of stability, with 95 % confidence."""
        return probability_interval(int(np.count_nonzero(self.stable)), len(self.stable), 0.9)[0]

    def level_db(self, share: float) -> float:
        """Decibels that one more draw does not exceed with this probability; ``inf`` for unstable."""
        return level(self.db, share)


def highest_promised(outlooks: Sequence[Outlook], probability: float = 0.99) -> Outlook | None:
    """The last of a ladder of rising authority up to which all are stable with ``probability``.

    With 95 % confidence: 299 draws, all stable, promise 99 %. None where the first is not.
    """
    last = None
    for outlook in outlooks:
        if outlook.promised_probability < probability:
            break
        last = outlook
    return last


def look_ahead(
    name: str, law: Compensator, drawn: DrawnPlants, noise: LoopNoise, alone: Float[np.ndarray, " draw"]
) -> Outlook:
    """``law`` on plants whose groups y and u are its ports; ``alone`` is each plant's rms without it."""
    stable = noise.decays & np.isfinite(noise.rms)
    unstable = [p for p, held in zip(drawn.plants, stable, strict=True) if not held]
    both = zip(np.where(stable, noise.rms, np.inf), alone, strict=True)
    db = np.array([decibels(*each) for each in both])
    return Outlook(
        name=name,
        stable=stable,
        db=db,
        control_rms=np.where(stable, noise.effort, np.inf),
        unstable_mode=_growing(unstable[:COMPARED], law),
        risk=risk_of(drawn, db),
    )


def with_friction(
    outlook: Outlook, law: Slipped, alone: Slipped, slips: DrawnSlips, drawn: DrawnPlants
) -> Outlook:
    """``outlook`` of linear loops, with the effect of friction on them and on the plants by themselves."""
    stable = outlook.stable & np.isfinite(law.db)
    db = np.where(stable, outlook.db + np.where(stable, law.db, 0.0) - alone.db, np.inf)
    every = dataclasses.replace(
        drawn, names=(*drawn.names, *slips.names), drawn=np.concatenate([drawn.drawn, slips.drawn], axis=1)
    )
    angles = law.travel / slips.slip_angle
    return dataclasses.replace(
        outlook,
        stable=stable,
        db=db,
        risk=risk_of(every, db),
        friction=FrictionOutlook(
            without_db=outlook.db,
            sticks=law.sticks,
            travel=np.median(angles, axis=0),
            error_db=float(np.sqrt(np.mean(law.variance + alone.variance))),
        ),
    )


def _growing(plants: Sequence[Plant], law: Compensator) -> str:
    """Mode with the largest share in the pole that grows, of most plants."""
    modes: list[str] = []
    for plant in plants:
        try:
            near = approximate_delays(plant, approximation_order(plant, law.system))
            found = find_participation(close_loop(near, law))
        except NumericalError:  # shares do not exist
            continue
        modes.append(found.names[int(np.argmax(found.shares))])
    return max(modes, key=modes.count, default="")


def risk_of(drawn: DrawnPlants, db: np.ndarray) -> tuple[str, float]:
    """The drawn quantity with the largest Spearman rank correlation; none where that may be chance.

    Chance of so many names together is 5 % (Bonferroni), by Student's distribution of r sqrt((n-2)/(1-r^2)).
    So few draws that one of the names has their very order more often decide nothing: 2 of n! orders.
    """
    ranks = _ranks(db)
    spread = float(np.std(ranks))
    n = len(ranks)
    if not spread > 0.0 or not drawn.names or (1.0 - CONFIDENCE) * factorial(n) < 2 * len(drawn.names):
        return "", 0.0
    others = np.apply_along_axis(_ranks, 0, drawn.drawn)
    others = others - others.mean(axis=0)
    size = np.linalg.norm(others, axis=0) * np.linalg.norm(ranks - ranks.mean())
    found = (ranks - ranks.mean()) @ others / np.where(size > 0.0, size, 1.0)
    k = int(np.argmax(np.abs(found)))
    beyond = stdtrit(n - 2, 1.0 - 0.5 * (1.0 - CONFIDENCE) / len(drawn.names))
    chance = float(beyond / np.sqrt(n - 2 + beyond**2))
    return (drawn.names[k], float(found[k])) if abs(found[k]) > chance else ("", 0.0)


def _ranks(values: Float[np.ndarray, " draw"]) -> Float[np.ndarray, " draw"]:
    """Ranks from one up; equal values share their mean."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(count) - 0.5 * (count - 1))[place]
