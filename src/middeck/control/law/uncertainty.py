"""Uncertainty of a plant: shifts of modes (together or apart), damping, gain and delay."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.signals.ports import require_names
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.mode_shift import scale_inputs, shift_modes
from middeck.systems.plants.plant import Plant
from middeck.values import record

PADE_ORDER = 3
MOST_CORNERS = 4096


def without_delays(plant: Plant) -> Plant:
    """The plant for a design, its delays replaced by Pade approximations of order 3."""
    return approximate_delays(plant, PADE_ORDER)


@record
class ModeShift:
    """Modes that move together, by at most ``half_width`` of their frequency.

    >>> ModeShift(("8.8 Hz", "9.4 Hz"), 0.02).half_width
    0.02
    """

    modes: tuple[str, ...]
    half_width: float

    def __post_init__(self) -> None:
        require_names(self.modes, "modes")
        if not self.modes:
            raise ConfigError(
                "a shift names no modes", hint="name at least one mode of the plant, or leave the shift out"
            )
        if not 0.0 < self.half_width < 1.0:
            raise ConfigError(
                f"half-width of a shift is {self.half_width:g} of the frequency", hint="between 0 and 1"
            )


@record(kw_only=True)
class Uncertainty:
    """A box of plants around a nominal one.

    Attributes:
        shifts: Groups of modes, each shifted by one parameter.
        damping: Damping ratios of the modes in ``shifts`` are multiplied by exp(+-damping), each by its own
            number.
        gain: Relative half-width of one factor on all inputs in the plant's group u.
        delay: Relative half-width of one factor on all delays; the plant must have some.
        finish: Function from the perturbed plant to the plant controlled, e.g. closing an inner loop; None:
            identity.

    >>> apart = Uncertainty(shifts=(ModeShift(("a",), 0.02), ModeShift(("b",), 0.02)), gain=0.1)
    >>> parameter_names(apart)
    ('frequency of a', 'frequency of b', 'gain')
    """

    shifts: tuple[ModeShift, ...]
    damping: float = 0.0
    gain: float = 0.0
    delay: float = 0.0
    finish: Callable[[Plant], Plant] | None = None

    def __post_init__(self) -> None:
        if self.damping < 0.0 or not 0.0 <= self.gain < 1.0 or not 0.0 <= self.delay <= 1.0:
            raise ConfigError(
                f"half-widths: damping {self.damping:g}, gain {self.gain:g}, delay {self.delay:g}",
                hint="damping >= 0, gain from 0 to below 1, delay from 0 to 1",
            )
        named = [mode for shift in self.shifts for mode in shift.modes]
        twice = sorted({mode for mode in named if named.count(mode) > 1})
        if twice:
            raise ConfigError(f"two shifts name {', '.join(twice)}", hint="one group for each mode")


def parameter_names(uncertainty: Uncertainty) -> tuple[str, ...]:
    """Names of the numbers of a position."""
    modes = [mode for shift in uncertainty.shifts for mode in shift.modes]
    return (
        *(f"frequency of {' and '.join(shift.modes)}" for shift in uncertainty.shifts),
        *(f"damping of {mode}" for mode in modes if uncertainty.damping),
        *(["gain"] if uncertainty.gain else []),
        *(["delay"] if uncertainty.delay else []),
    )


def perturb_plant(plant: Plant, uncertainty: Uncertainty, position: Sequence[float] | np.ndarray) -> Plant:
    """The plant at a position of the box, each number from -1 to 1 (`parameter_names`), before ``finish``.

    Raises `ConfigError` for modes that do not exist, a position of another length, or an uncertain delay of a
    plant that has none.
    """
    names = parameter_names(uncertainty)
    if len(position) != len(names):
        raise ConfigError(
            f"{len(position)} numbers for {len(names)} parameters: {', '.join(names)}",
            hint="one number from -1 to 1 for each parameter",
        )
    if uncertainty.delay and not plant.delayed:
        raise ConfigError(
            "the delay is uncertain, but the plant has none", hint="delay_plant(plant, delay_s)"
        )
    at = iter(float(p) for p in position)
    frequency = {
        mode: factor
        for shift, factor in [(s, 1.0 + s.half_width * next(at)) for s in uncertainty.shifts]
        for mode in shift.modes
    }
    spread = uncertainty.damping
    damping = {mode: float(np.exp(spread * next(at))) for mode in frequency} if spread else {}
    gain = 1.0 + uncertainty.gain * next(at) if uncertainty.gain else 1.0
    moved = scale_inputs(shift_modes(plant, frequency, damping), plant.u, gain)
    factor = 1.0 + uncertainty.delay * next(at) if uncertainty.delay else 1.0
    return dataclasses.replace(moved, delay_s=plant.delay_s * factor)


def finished_plants(
    plant: Plant, uncertainty: Uncertainty, positions: Float[np.ndarray, "plant parameter"]
) -> tuple[Plant, ...]:
    """The plants at ``positions``, with ``finish`` applied."""
    moved = (perturb_plant(plant, uncertainty, position) for position in positions)
    return tuple(p if uncertainty.finish is None else uncertainty.finish(p) for p in moved)


def end_positions(uncertainty: Uncertainty) -> Float[np.ndarray, "plant parameter"]:
    """The centre, and both ends of each parameter alone: 1 + 2 n plants.

    >>> end_positions(Uncertainty(shifts=(ModeShift(("a", "b"), 0.02),))).ravel().tolist()
    [0.0, -1.0, 1.0]
    """
    n = len(parameter_names(uncertainty))
    return np.vstack([np.zeros((1, n)), np.kron(np.eye(n), [[-1.0], [1.0]])])


def corner_positions(
    uncertainty: Uncertainty, count: int | None = None, rng: np.random.Generator | None = None
) -> Float[np.ndarray, "plant parameter"]:
    """The centre and all 2^n corners of the box, or ``count`` of them drawn with ``rng``."""
    n = len(parameter_names(uncertainty))
    if count is not None:
        if rng is None:
            raise ConfigError("drawing corners needs a random generator", hint="rng=")
        drawn = rng.choice([-1.0, 1.0], size=(count, n))
        return np.vstack([np.zeros((1, n)), drawn])
    if 2**n > MOST_CORNERS:
        raise ConfigError(
            f"{n} parameters have {2**n} corners, more than {MOST_CORNERS}",
            hint="draw some with count= and rng=",
        )
    return np.vstack([np.zeros((1, n)), np.array(list(itertools.product([-1.0, 1.0], repeat=n)))])


def draw_positions(
    uncertainty: Uncertainty, count: int, rng: np.random.Generator
) -> Float[np.ndarray, "plant parameter"]:
    """Positions drawn uniformly from the box."""
    return rng.uniform(-1.0, 1.0, (count, len(parameter_names(uncertainty))))
