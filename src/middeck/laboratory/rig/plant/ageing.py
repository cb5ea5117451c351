"""A plant that drifts while it runs: constant for some ticks, then renewed, its motion continued.

A mode obeys q'' + 2 zeta w(t) q' + w(t)^2 q = psi u. Over a piece w is held at that of the piece's middle,
and q and q' go on into the next: the exponential midpoint rule (Magnus 1954, Comm. Pure Appl. Math. 7). Held
for several half turns it would kick a mode by its own stroboscope, hence `TURN`. The sampled matrices are
computed at knots and lie on the chord in between.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence

import numpy as np

from middeck.errors import ConfigError
from middeck.laboratory.rig.plant.drifting_modes import Drift, age_plant, drift_end, modal_part
from middeck.laboratory.rig.plant.hybrid_plant import HybridPlant, Wiring, build_hybrid_plant
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.modal_system import rate_scale
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

TURN = 1.0
"""Phase [rad] through which the fastest of the drifting modes turns in a piece, unless in a tick."""
CHORD = 1e-3
"""Relative change of a frequency from knot to knot. On the chord it is wrong by a twelfth of the
square of that, a hundred-thousandth of the half-width of a mode of 1 % damping."""

MOVES = ("step", "drive", "push", "read")
"""What of a `HybridPlant` depends on frequencies: an acceleration is read from states by their squares."""


@record(kw_only=True)
class Ageing:
    """Drift of a rig's plant from the time when it is switched on.

    Attributes:
        plant: The plant as new.
        drifts, age_s: Drifts of its modes, and its age when it is switched on.
        wiring: Elements between it and the computer.
        ticks, pieces: Ticks for which it is held, and how many such pieces lie between two knots.
    """

    plant: Plant
    drifts: tuple[Drift, ...]
    age_s: float
    wiring: Wiring
    ticks: int
    pieces: int


def plan_ageing(plant: Plant, drifts: Sequence[Drift], age_s: float, wiring: Wiring) -> Ageing | None:
    """Pieces and knots as `TURN` and `CHORD` ask at ``age_s``; None where nothing drifts."""
    if not drifts:
        return None
    modal = modal_part(age_plant(plant, drifts, age_s))
    change = np.zeros(len(modal.omega))  # relative change of a frequency in a second
    for drift in drifts:
        a_second = 0.01 * abs(drift.percent) / drift.age_s / drift.factor(age_s)
        change += a_second * np.isin(modal.names, drift.modes)
    fastest = float(modal.omega[change > 0.0].max(initial=0.0))
    if fastest == 0.0:
        return None
    ticks = max(int(TURN / fastest / wiring.period_s), 1)
    pieces = max(int(CHORD / change.max() / (ticks * wiring.period_s)), 1)
    return Ageing(plant=plant, drifts=tuple(drifts), age_s=age_s, wiring=wiring, ticks=ticks, pieces=pieces)


def follow_ageing(ageing: Ageing) -> Callable[[int], tuple[HybridPlant, int]]:
    """A function of the tick that returns the plant there, and the number of ticks for which it holds."""
    knot = functools.lru_cache(maxsize=2)(functools.partial(_build_knot, ageing))

    def held_at(tick: int) -> tuple[HybridPlant, int]:
        number = tick // ageing.ticks
        before, place = divmod(number + 0.5, ageing.pieces)
        plant = _between(knot(int(before)), knot(int(before) + 1), place / ageing.pieces)
        return plant, (number + 1) * ageing.ticks - tick

    return held_at


def _build_knot(ageing: Ageing, number: int) -> HybridPlant:
    """The plant at a knot, in the states of the one that was switched on."""
    at_s = _knot_s(ageing, number)
    old, new = (age_plant(ageing.plant, ageing.drifts, ageing.age_s + s) for s in (0.0, at_s))
    return build_hybrid_plant(_with_states_of(old, new), ageing.wiring)


def _knot_s(ageing: Ageing, number: int) -> float:
    return number * ageing.pieces * ageing.ticks * ageing.wiring.period_s


def check_life(ageing: Ageing, ticks: int) -> None:
    """Raise `ConfigError` unless every frequency stays above zero for ``ticks``, and to the knot after.

    Also where one rises so far that a piece is a turn by more than twice `TURN`.
    """
    ends_s = drift_end(modal_part(ageing.plant), ageing.drifts) - ageing.age_s
    last = math.ceil(ticks / (ageing.pieces * ageing.ticks))
    if _knot_s(ageing, last) >= ends_s:
        raise ConfigError(
            f"a run to {ticks * ageing.wiring.period_s:g} s after switching on, in which a drift brings a "
            f"frequency to zero at {ends_s:g} s",
            where="Drift",
            hint="a shorter run or rest, a younger article, or a slower drift",
        )
    first, end = (
        modal_part(age_plant(ageing.plant, ageing.drifts, ageing.age_s + _knot_s(ageing, number))).omega
        for number in (0, last)
    )
    fastest = float(end[end != first].max(initial=0.0))
    turn = fastest * ageing.ticks * ageing.wiring.period_s
    if ageing.ticks > 1 and turn > 2.0 * TURN:
        raise ConfigError(
            f"a drift raises a frequency to {fastest / (2.0 * np.pi):.3g} Hz in this run; in the pieces "
            f"planned for its beginning the mode would turn by {turn:.2g} rad",
            where="Drift",
            hint="run it in parts, each on a rig of its own age_s, so that no frequency doubles in one",
        )


def _with_states_of(old: Plant, new: Plant) -> Plant:
    """``new`` with each mode's q'/w, its second state, by the w of ``old``."""
    before, after = rate_scale(modal_part(old)), rate_scale(modal_part(new))
    scale = np.ones(2 * len(after))
    scale[1::2] = after / before
    s = new.system
    A, B, C = scale[:, None] * s.A / scale, scale[:, None] * s.B, s.C / scale
    return dataclasses.replace(new, dynamics=StateSpace(A, B, C, s.D))


def _between(first: HybridPlant, last: HybridPlant, share: float) -> HybridPlant:
    moved = {k: getattr(first, k) + share * (getattr(last, k) - getattr(first, k)) for k in MOVES}
    return dataclasses.replace(first, **moved)
