"""Placement of a plant's delays before sampling.

Input i is delayed by a_i, measurement o by b_o. White noise and mean squares are invariant under a shift of
time, so that delays of disturbances and of z drop out, and the delay common to all measurements moves to the
inputs. There remain inputs that each change at an instant within the period, and measurements delayed
relative to the earliest.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.control.law.delay_order import approximation_order
from middeck.errors import ConfigError
from middeck.systems.delay.delay_approximation import SAME_DELAY_S, approximate_delays
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.sampling.delayed_sampling import split_delays
from middeck.values import record


@record
class TimedPlant:
    """A plant with delayed inputs u and measurements y; the earliest measurement has no delay."""

    plant: Plant
    input_s: Float[np.ndarray, " u"]
    output_s: Float[np.ndarray, " y"]


def place_delays(plant: Plant, disturbed: Sequence[str], process: Float[np.ndarray, "w w"]) -> TimedPlant:
    """The plant with its delays at u and y, under white noise of intensity ``process`` on ``disturbed``.

    Exact where each path is delayed by its input's delay plus its output's; further delays of single paths
    are approximated, with the order that the fastest mode needs.

    Raises `ConfigError` for correlated disturbances with different delays.
    """
    inside = remove_delays(plant)
    u, w = inside.input_indices(inside.u), inside.input_indices(disturbed)
    y, z = inside.output_indices(inside.y), inside.output_indices(inside.z)
    inputs, outputs = list(dict.fromkeys([*u, *w])), list(dict.fromkeys([*y, *z]))
    split = split_delays(plant.delay_s[np.ix_(outputs, inputs)])
    late_in, late_out = (
        dict(zip(inputs, split.input_s, strict=True)),
        dict(zip(outputs, split.output_s, strict=True)),
    )
    _check_disturbances(process, np.array([late_in[i] for i in w]))
    if np.any(split.rest_s > SAME_DELAY_S):
        rest = np.zeros_like(plant.delay_s)
        rest[np.ix_(outputs, inputs)] = split.rest_s
        late = dataclasses.replace(plant, delay_s=rest)
        inside = approximate_delays(late, approximation_order(late))
    of_u, of_y = np.array([late_in[i] for i in u]), np.array([late_out[o] for o in y])
    common = float(of_y.min(initial=np.inf)) if len(of_y) else 0.0
    return TimedPlant(inside, of_u + common, of_y - common)


def _check_disturbances(process: np.ndarray, late: np.ndarray) -> None:
    apart = np.abs(late[:, None] - late[None]) > SAME_DELAY_S
    if np.any(apart & (process != 0.0)):
        raise ConfigError(
            "correlated disturbances have different delays",
            hint="a diagonal process intensity, or one delay for these inputs",
        )
