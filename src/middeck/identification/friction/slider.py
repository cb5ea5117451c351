"""The torque of a spring and slider in series along a periodic angle, many angles at once."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Complex, Float

from middeck.signals.record import Record
from middeck.values import record as frozen

# The first lap forgets where the slider stood.
LAPS = 2


def slider_torque(
    angle: Float[np.ndarray, "sample series"], slip_angle: Float[np.ndarray, " series"]
) -> Float[np.ndarray, "sample series"]:
    """Torque over the slip torque, in the steady state of a motion that repeats.

    As in `middeck.joints.friction.Friction`, the slider stays within ``slip_angle`` of the angle.

    >>> angle = np.array([0.0, 3.0, 0.0, -3.0])[:, None]
    >>> slider_torque(angle, np.array([2.0])).ravel().tolist()
    [0.5, 1.0, -0.5, -1.0]
    """
    return (angle - _stands(angle - slip_angle, angle + slip_angle)) / slip_angle


def _stands(
    low: Float[np.ndarray, "sample series"], high: Float[np.ndarray, "sample series"]
) -> Float[np.ndarray, "sample series"]:
    """Where the sliders stand, each moved by its bounds alone.

    What two pairs of bounds do in turn, one pair does too. So bounds are joined within blocks, all blocks at
    once, and the sliders go from block to block.
    """
    count, series = low.shape
    size = math.isqrt(count - 1) + 1
    blocks = -(-count // size)
    last = np.full((blocks * size - count, series), np.inf)
    low, high = (np.concatenate(x).reshape(blocks, size, series) for x in ((low, -last), (high, last)))
    for k in range(1, size):
        own = low[:, k].copy(), high[:, k].copy()
        low[:, k], high[:, k] = (np.clip(x[:, k - 1], *own) for x in (low, high))
    begins, stands = np.empty((blocks, 1, series)), np.zeros(series)
    for block in np.tile(np.arange(blocks), LAPS):
        begins[block] = stands
        stands = np.clip(stands, low[block, -1], high[block, -1])
    return np.clip(begins, low, high).reshape(-1, series)[:count]


@frozen(kw_only=True)
class JointAngles:
    """Mean period of each joint's angle, by its spectrum up to the highest line that counts."""

    spectrum: Complex[np.ndarray, "line experiment joint"]
    hz: Float[np.ndarray, " line"]
    samples: int

    def torques(
        self, slip_angle: Float[np.ndarray, " joint"], delay_s: float
    ) -> Float[np.ndarray, "sample experiment joint"]:
        """Friction over slip torque, as commands.

        The reading comes ``delay_s`` after the command, so that a torque which goes with the angle is, as a
        command, so much earlier.
        """
        earlier = self.spectrum * np.exp(2j * np.pi * self.hz * delay_s)[:, None, None]
        angle = np.asarray(np.fft.irfft(earlier, self.samples, axis=0))
        flat = angle.reshape(self.samples, -1)
        return slider_torque(flat, np.tile(slip_angle, angle.shape[1])).reshape(angle.shape)


def joint_angles(record: Record, outputs: list[int], top_hz: float) -> JointAngles:
    """Angles of a periodic record, low-passed at ``top_hz``: most of the noise lies above."""
    y = np.moveaxis(record.y.mean(axis=1)[..., outputs], 1, 0)
    hz = np.fft.rfftfreq(len(y), 1.0 / record.sample_hz)
    kept = hz <= top_hz * (1.0 + 1e-9)
    return JointAngles(spectrum=np.fft.rfft(y, axis=0)[kept], hz=hz[kept], samples=len(y))
