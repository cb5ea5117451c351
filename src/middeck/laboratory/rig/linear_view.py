"""The linear part of a rig, and a loop closed over it: for simulation, eigenvalues and return ratios."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.laboratory.rig.parts.computer import integrators
from middeck.laboratory.rig.rig import Rig
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.feedback import feedback
from middeck.systems.state_space.statespace import SampledStateSpace


def linearise_rig(rig: Rig) -> Plant:
    """The sampled plant of a rig without limits, steps, joint torques and noise; not meant for designs.

    States: the continuous part's, then commands on their way, the latest first; and of a plant with
    rigid-body modes the sums of the gyros' samples, each a pole at one. Otherwise the sums are rows of the
    other states, see `gyro_sums`, and that pole, which nothing moves, is left out.
    """
    A, B, read = _without_sums(rig)
    sums = integrators(rig.sensors, rig.period_s)
    rows = gyro_sums(rig)
    D = np.zeros((len(rig.outputs), len(rig.inputs)))
    if rows is not None:
        sampled = SampledStateSpace(A, B, sums.C @ rows + sums.D @ read, D, period_s=rig.period_s)
    else:
        n = len(sums.A)
        sampled = SampledStateSpace(
            np.block([[A, np.zeros((len(A), n))], [sums.B @ read, sums.A]]),
            np.vstack([B, np.zeros((n, B.shape[1]))]),
            np.hstack([sums.D @ read, sums.C]),
            D,
            period_s=rig.period_s,
        )
    return Plant(dynamics=sampled, inputs=rig.inputs, outputs=rig.outputs)


def close_rig(rig: Rig, law: SampledStateSpace) -> SampledStateSpace:
    """The loop u = excitation + K (y + noise) of the linear part, K placed by `place_law`.

    Inputs: excitation, then noise; outputs: the measured outputs (noise included), then the compensator's.
    States: those of `linearise_rig`, then the compensator's.
    """
    p, m = len(rig.outputs), len(rig.inputs)
    closed = feedback(linearise_rig(rig).sampled, law, range(m), range(p))
    D = closed.D.copy()
    D[:p, m:] += np.eye(p)
    return dataclasses.replace(closed, D=D)


def gyro_sums(rig: Rig) -> Float[np.ndarray, "gyro state"] | None:
    """The sum of each gyro's samples as a row L of the other linear states; None with rigid-body modes.

    The sum s[k+1] = s[k] + T r[k] of a reading r = c x is L x with L (A - I) = T c, but for a constant. For
    L B = T c (A - I)^-1 B is the rate's gain at zero frequency: zero, for the angle comes to rest.
    """
    A, _, read = _without_sums(rig)
    # Rounding splits the double pole of a rigid body by up to some 1e-6; slower modes count as rigid.
    if len(A) and np.abs(np.linalg.eigvals(A) - 1.0).min() < 1e-5:
        return None
    return np.linalg.solve((A - np.eye(len(A))).T, (integrators(rig.sensors, rig.period_s).B @ read).T).T


def _without_sums(rig: Rig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B and the readings of the continuous part, followed by commands on their way."""
    plant, m = rig.plant, len(rig.inputs)
    states, depth = plant.angle.shape[1], plant.delay_ticks + 1
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
