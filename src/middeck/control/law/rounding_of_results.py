"""Rounding of the matrices of plant or compensator: whether it changes the results of their loop.

States mixed by a matrix of condition k multiply the rounding of each entry by up to k^2 at the poles. What
the matrices lost when they were stored no algorithm finds again. So each number is computed again from
entries moved by rounding.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError, NumericalError
from middeck.systems.plants.plant import Dynamics, Plant
from middeck.systems.poles.rounding import EPS, ROUNDINGS, VAGUE, is_vague
from middeck.systems.poles.verdict import CURE
from middeck.systems.state_space.modal_system import ModalSystem

DRAWS = 3
"""How often every entry is moved by `ROUNDINGS` roundings of random sign."""
UNCERTAIN = 1e-4
"""Change of a number by such a move that gives a warning, relative or of an angle [rad]: a tenth of what is
not silent, since three draws may miss the largest (of sampled loops by a factor of three)."""


DOUBTFUL = 1e-8
"""Share of a pole's decay from which its rounding may move a number by `UNCERTAIN`: ten roundings, through a
loop that multiplies what a pole does by a thousand."""


Half = TypeVar("Half", bound=Plant | Compensator)
Moved = TypeVar("Moved", bound=Dynamics)


def moved_entries(system: Moved, rng: np.random.Generator) -> Moved:
    """The system with every entry that is ``rounded`` moved by `ROUNDINGS` roundings of random sign."""
    each = [(name, getattr(system, name)) for name in system.rounded]
    moved = {name: M * (1.0 + ROUNDINGS * EPS * rng.choice([-1.0, 1.0], M.shape)) for name, M in each}
    return dataclasses.replace(system, **moved)


def is_vague_half(half: Plant | Compensator, share: float = VAGUE) -> bool:
    """Whether rounding moves poles of a plant or compensator (`is_vague`): never those of modal form."""
    dynamics = half.dynamics
    return not isinstance(dynamics, ModalSystem) and is_vague(dynamics, share)


def is_doubtful(half: Plant | Compensator) -> bool:
    """Whether rounding may change results of the loop: where it moves a pole by `DOUBTFUL` of its decay."""
    return is_vague_half(half, DOUBTFUL)


def move_half(half: Half, rng: np.random.Generator) -> Half:
    """The plant or compensator with its entries moved (`moved_entries`)."""
    return dataclasses.replace(half, dynamics=moved_entries(half.dynamics, rng))


Found = TypeVar("Found")


def measure_known(
    what: str,
    measure: Callable[..., Found],
    numbers: Callable[[Found], Float[np.ndarray, " number"]],
    *halves: Plant | Compensator,
    vague: Callable[[Plant | Compensator], bool] = is_doubtful,
    least: float = 0.0,
    cure: str = CURE,
    stacklevel: int = 4,
) -> Found:
    """The result of ``measure``; warns (`UserWarning`) where rounding of vague halves changes it.

    Halves that are not ``vague`` cost nothing more (`is_doubtful`).

    Args:
        what: Names the numbers in the warning.
        numbers: Values whose differences count, logarithms or angles [rad]; none finite of an unstable loop.
        least: Largest change by the first move up to which no more are tried.
        cure: End of the warning: the remedy.
        stacklevel: Stack level of the warning: 4 blames the line that called the caller of this, past the
            frame of `named_kinds`; 3 where the caller has none.
    """
    found = measure(*halves)
    moves = [vague(half) for half in halves]
    if not any(moves):
        return found

    def of(found: Found) -> np.ndarray:
        with np.errstate(divide="ignore"):
            return numbers(found)

    here = of(found)
    if np.isfinite(here).any():
        movable = list(zip(halves, moves, strict=True))
        most = _farthest(here, lambda *moved: of(measure(*moved)), movable, least)
        if most > UNCERTAIN:
            warnings.warn(
                f"{what} are uncertain: rounding of the matrices alone moves them by {most:.1g} (relative, "
                f"or rad) or more; {cure}, would decide",
                stacklevel=stacklevel,
            )
    return found


def _farthest(
    here: np.ndarray,
    numbers: Callable[..., np.ndarray],
    halves: list[tuple[Plant | Compensator, bool]],
    least: float,
) -> float:
    """Largest change of a number as vague halves move; infinite where one has no value, or stability is open.
    That of the first moves where it is at most ``least``, or already beyond `UNCERTAIN`.
    """
    rng, most = np.random.default_rng(0), 0.0
    for _ in range(DRAWS):
        moved = [move_half(half, rng) if vague else half for half, vague in halves]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                there = numbers(*moved)
            except (ConfigError, NumericalError):
                return np.inf
        if there.shape != here.shape or np.any(np.isnan(there) != np.isnan(here)):
            return np.inf
        same = (there == here) | np.isnan(here)
        apart = np.subtract(there, here, out=np.zeros_like(here), where=~same)
        most = max(most, float(np.abs(apart).max()))
        if most <= least or most > UNCERTAIN:
            break
    return most
