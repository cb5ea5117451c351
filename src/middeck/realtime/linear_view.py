"""A hardware rig as a linear one: for eigenvalues and return ratios, not for designs."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.realtime.computer import integrators
from middeck.realtime.hardware_rig import HardwareRig
from middeck.realtime.rig import LinearRig
from middeck.systems.statespace import SampledStateSpace


def linearise_rig(rig: HardwareRig) -> LinearRig:
    """The same rig without limits, steps, joints' torques and noise: for eigenvalues, not for a design.

    States: the continuous part's, then commands on their way, the latest first; and of a plant with
    rigid-body modes the sums of the gyros' samples, each a pole at one. Otherwise the sums are rows of the
    other states, see `gyro_sums`, and that pole, which nothing moves, is left out.
    """
    m, period_s = len(rig.inputs), 1.0 / rig.sample_hz
    A, B, read = _without_sums(rig)
    sums = integrators(rig.sensors, period_s)
    rows = gyro_sums(rig)
    p, n = len(rig.outputs), len(sums.A)
    if rows is not None:
        sampled = SampledStateSpace(A, B, sums.C @ rows + sums.D @ read, np.zeros((p, m)), period_s=period_s)
    else:
        sampled = SampledStateSpace(
            np.block([[A, np.zeros((len(A), n))], [sums.B @ read, sums.A]]),
            np.vstack([B, np.zeros((n, m))]),
            np.hstack([sums.D @ read, sums.C]),
            np.zeros((p, m)),
            period_s=period_s,
        )
    return LinearRig(
        sampled=sampled,
        sample_hz=rig.sample_hz,
        noise_rms=np.zeros(p),
        inputs=rig.inputs,
        outputs=rig.outputs,
    )


def gyro_sums(rig: HardwareRig) -> Float[np.ndarray, "gyro state"] | None:
    """The sum of each gyro's samples as a row L of the other linear states; None with rigid-body modes.

    The sum s[k+1] = s[k] + T r[k] of a reading r = c x is L x with L (A - I) = T c, but for a constant. For
    L B = T c (A - I)^-1 B is the rate's gain at zero frequency: zero, for the angle comes to rest.
    """
    A, _, read = _without_sums(rig)
    left = A - np.eye(len(A))
    # 1e12: the frequency of the slowest mode in cycles a sample, squared, far above rounding.
    if len(A) and np.linalg.cond(left) > 1e12:
        return None
    return np.linalg.solve(left.T, (integrators(rig.sensors, 1.0 / rig.sample_hz).B @ read).T).T


def _without_sums(rig: HardwareRig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B and the readings of the continuous part, followed by commands on their way."""
    plant, m = rig.plant, len(rig.inputs)
    states, depth = plant.angle.shape[1], plant.late + 1
    transition, window = np.eye(states), np.zeros((states, 2 * m))
    for step, drive in zip(plant.step, plant.drive, strict=True):
        transition, window = step[:states] @ transition, step[:states] @ window + drive[:states]
    size = states + depth * m
    A, B = np.zeros((size, size)), np.zeros((size, m))
    A[:states, :states] = transition
    for age, gain in ((depth, window[:, :m]), (depth - 1, window[:, m:])):
        if age:
            A[:states, states + (age - 1) * m : states + age * m] = gain
        else:
            B[:states] = gain
    B[states : states + m] = np.eye(m)
    for age in range(1, depth):
        here = states + age * m
        A[here : here + m, here - m : here] = np.eye(m)
    return A, B, np.hstack([plant.read, np.zeros((len(plant.read), depth * m))])
