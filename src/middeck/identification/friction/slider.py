"""The torque of a spring and slider in series along a periodic angle, many angles at once."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.signals.record import Record

# The first lap forgets where the slider stood.
LAPS = 2


def slider_torque(
    angle: Float[np.ndarray, "sample series"], slip_angle: Float[np.ndarray, " series"]
) -> Float[np.ndarray, "sample series"]:
    """Torque over the slip torque, in the steady state of a motion that repeats.

    That of `middeck.joints.friction.Friction`: the slider stays within ``slip_angle`` of the angle.

    >>> angle = np.array([0.0, 3.0, 0.0, -3.0])[:, None]
    >>> slider_torque(angle, np.array([2.0])).ravel().tolist()
    [-0.5, 1.0, -0.5, -1.0]
    """
    low, high = angle - slip_angle, angle + slip_angle
    stands, out = np.zeros(angle.shape[1]), np.empty_like(angle)
    for _ in range(LAPS):
        for a, b, kept in zip(low, high, out, strict=True):
            np.maximum(stands, a, stands)
            np.minimum(stands, b, stands)
            kept[:] = stands
    return (angle - out) / slip_angle


def joint_angles(
    record: Record, outputs: list[int], delay_s: float, top_hz: float
) -> Float[np.ndarray, "sample experiment joint"]:
    """Mean period of each joint's angle when a command now acts, without what is above ``top_hz``.

    The reading comes ``delay_s`` after the command, so that a torque which goes with the angle is, as a
    command, so much earlier.
    """
    y = np.moveaxis(record.y.mean(axis=1)[..., outputs], 1, 0)
    hz = np.fft.rfftfreq(len(y), 1.0 / record.sample_hz)
    turn = np.where(hz <= top_hz, np.exp(2j * np.pi * hz * delay_s), 0.0)
    return np.asarray(np.fft.irfft(turn[:, None, None] * np.fft.rfft(y, axis=0), len(y), axis=0))
