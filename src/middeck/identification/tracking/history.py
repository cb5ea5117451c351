"""A whole record followed, block by block."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float, Int

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.identification.tracking.kalman_filter import update_tracking
from middeck.identification.tracking.tracked_state import Tracking
from middeck.signals.record import Record
from middeck.values import record


@record(kw_only=True)
class Tracked:
    """Modal parameters at the end of each block.

    Attributes:
        time_s: Time of the last sample of each block.
        natural_hz, frequency_std_hz, damping, damping_std: Values and their standard deviations.
        trusted: Whether the innovations were white and as large as stated.
        jumps: Number of detected jumps of each mode, or a neighbour, by then.
        restarts: Number of restarts after a loss by then; ``state.restarts`` has their times.
        state: State at the end, from which tracking can go on.
    """

    time_s: Float[np.ndarray, " block"]
    natural_hz: Float[np.ndarray, "block mode"]
    frequency_std_hz: Float[np.ndarray, "block mode"]
    damping: Float[np.ndarray, "block mode"]
    damping_std: Float[np.ndarray, "block mode"]
    trusted: Bool[np.ndarray, " block"]
    jumps: Int[np.ndarray, "block mode"]
    restarts: Int[np.ndarray, " block"]
    state: Tracking


@named_kinds
def track_modes(state: Tracking, measured: Record, *, block: int = 256) -> Tracked:
    """Follow the first experiment of a record, all its periods one after the other.

    Args:
        state: `start_tracking`, or the end of an earlier record that this one continues.
        block: Samples from one row of the result to the next; it changes nothing else.

    Raises `ConfigError` for a block without samples or a record of another rate; `DataError` as
    `update_tracking`.
    """
    if block < 1:
        raise ConfigError(f"blocks of {block} samples", hint="one or more")
    if abs(measured.sample_hz * state.followed.T - 1.0) > 1e-9:
        raise ConfigError(
            f"a record at {measured.sample_hz} Hz, the tracker runs at {1.0 / state.followed.T} Hz",
            hint="start at the record's rate",
        )
    u, y = (x[0].reshape(-1, x.shape[3]) for x in (measured.u, measured.y))
    states = list(_blocks(state, u, y, block))
    names = ("time_s", "natural_hz", "frequency_std_hz", "damping", "damping_std", "trusted", "jumps")
    return Tracked(
        **{name: np.array([getattr(s, name) for s in states]) for name in names},
        restarts=np.array([len(s.restarts) for s in states]),
        state=states[-1],
    )


def _blocks(state: Tracking, u: np.ndarray, y: np.ndarray, block: int) -> Iterable[Tracking]:
    for first in range(0, len(u), block):
        state = update_tracking(state, u[first : first + block], y[first : first + block])
        yield state
