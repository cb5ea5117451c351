"""Uncertain modes as feedback of unknown gain: A + sum of B0_i delta_i C0_i, one scalar for each mode.

A mode's frequency moves by its stiffness, omega^2 (1 + delta), which enters where the mode is pushed: B0 is
that direction of its two states and C0 reads the one that is perpendicular to it, so that C0 B0 = 0.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.partition import partition_modes
from middeck.control.uncertainty import Uncertainty
from middeck.errors import ConfigError
from middeck.systems.delayed_plant import DelayedPlant
from middeck.systems.mode_shift import mode_states
from middeck.systems.plant import Plant, name_states
from middeck.values import record


@record
class Directions:
    """Where the stiffness of uncertain modes enters, one column and row for each mode.

    Parameters
    ----------
    into, out:
        B0 and C0 on the states of the finished plant, without its inert modes.
    low, high:
        Bounds of each delta: (1 -+ half-width)^2 - 1.
    group:
        Which shift of the `Uncertainty` each mode belongs to.
    """

    into: Float[np.ndarray, "state mode"]
    out: Float[np.ndarray, "mode state"]
    low: Float[np.ndarray, " mode"]
    high: Float[np.ndarray, " mode"]
    group: tuple[int, ...]


def stiffness_directions(
    plant: Plant | DelayedPlant, finished: Plant, uncertainty: Uncertainty
) -> Directions:
    """Of the modes in ``uncertainty.shifts``; ``finished`` is the nominal plant as it is controlled.

    Raises `ConfigError` where a mode has not its two states in both, or nothing but these is uncertain.
    """
    if not uncertainty.shifts:
        raise ConfigError("no mode is uncertain: this method needs shifts", hint="Uncertainty(shifts=...)")
    bare = partition_modes(plant.plant if isinstance(plant, DelayedPlant) else plant).active
    active = partition_modes(finished).active
    before, after = name_states(bare), name_states(active)
    modes = [(g, s.half_width, mode) for g, s in enumerate(uncertainty.shifts) for mode in s.modes]
    into, out = np.zeros((len(after), len(modes))), np.zeros((len(modes), len(after)))
    for i, (_, _, mode) in enumerate(modes):
        b, c = _direction(bare.system.A, bare.system.B, mode_states(before, mode), mode)
        index = mode_states(after, mode)
        into[index, i], out[i, index] = b, c
    width = np.array([half for _, half, _ in modes])
    return Directions(
        into, out, (1.0 - width) ** 2 - 1.0, (1.0 + width) ** 2 - 1.0, tuple(g for g, _, _ in modes)
    )


def _direction(A: np.ndarray, B: np.ndarray, index: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """b of unit length and c perpendicular to it, with det(A + delta b c') = (1 + delta) det A."""
    block = A[np.ix_(index, index)]
    others = np.setdiff1d(np.arange(len(A)), index)
    push = np.hstack([B[index], A[np.ix_(index, others)]])
    # Where nothing pushes, the second state is a rate.
    b = np.linalg.svd(push)[0][:, 0] if np.any(push) else np.array([0.0, 1.0])
    squared, aside = float(np.linalg.det(block)), np.array([-b[1], b[0]])
    if squared <= (np.trace(block) / 2.0) ** 2:
        raise ConfigError(f"{name!r} does not oscillate: it has no stiffness to vary")
    adjugate = np.trace(block) * np.eye(2) - block
    return b, aside * (squared / float(aside @ adjugate @ b))
