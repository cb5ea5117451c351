"""Many linear loops with sliders at their joints, in time and side by side.

Behind its sliders each loop is linear: what noise alone makes of its outputs is known beforehand, and what
the sliders' torques take from them follows from the loop's poles, exactly under held torques. A torque is
held over a step at the mean of its ends, as `middeck.joints.attachment` has it of one rig: of second order.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError
from middeck.values import record

PASSES = 2
"""Of the torque at a step's end, which the way depends on; each shrinks the error by `GIVEN`."""
GIVEN = 0.02


@record(kw_only=True)
class SlidingLoops:
    """Loops from the torques of their sliders to angles and other outputs; those that have fewer poles than
    others end with zeros in ``drives``.

    Attributes:
        poles: One of each conjugate pair [rad/s].
        drives, reads: Of each pole, the response to a torque being the real part of the sum of
            reads exp(poles t) drives. The first outputs are the joints' angles, in the order of the joints.
        stiffness, slip_torque: Those of each slider [N m/rad], [N m]; see `middeck.joints.friction.Friction`.
    """

    poles: Complex[np.ndarray, "loop pole"]
    drives: Complex[np.ndarray, "loop joint pole"]
    reads: Complex[np.ndarray, "loop output pole"]
    stiffness: Float[np.ndarray, "loop joint"]
    slip_torque: Float[np.ndarray, "loop joint"]


def slide(
    loops: SlidingLoops, free: Float[np.ndarray, "step loop output"], period_s: float
) -> Float[np.ndarray, "step loop output"]:
    """The outputs with the sliders, from ``free``, which they are without; at first they stand at angle zero.

    Raises `ConfigError` for a step in which a spring would turn its joint back noticeably.
    """
    grown = np.exp(loops.poles * period_s)
    gain = loops.drives * (np.expm1(loops.poles * period_s) / loops.poles)[:, None]
    joints = loops.stiffness.shape[1]
    # Response of outputs at the end of a step to torques held in it.
    at_once = np.real(np.einsum("lop,ljp->loj", loops.reads, gain))
    given = np.abs(at_once[:, :joints] * loops.stiffness[:, None]).sum(axis=2).max(initial=0.0)
    if not given <= GIVEN:
        raise ConfigError(
            f"a joint that sticks turns back by {given:.2g} of its way within a step of {period_s:g} s",
            where="friction", hint="a shorter step",
        )  # fmt: skip
    # Re(a b) as a product of real numbers.
    reads = np.stack([np.real(loops.reads), -np.imag(loops.reads)], axis=-1)
    reads = reads.reshape(*loops.reads.shape[:2], -1)
    state = np.zeros_like(loops.poles)
    state_parts, pushed = state.view(float), np.empty_like(state)
    columns = [np.ascontiguousarray(gain[:, j]) for j in range(joints)]
    torque = mean = np.zeros(loops.slip_torque.shape)
    out, before = np.empty_like(free), np.zeros(loops.slip_torque.shape)
    k, limit = loops.stiffness, loops.slip_torque
    least, pull = -limit, k[:, :, None] * at_once[:, :joints]
    for now, made in zip(free, out, strict=True):
        state *= grown
        np.subtract(now, np.matvec(reads, state_parts), out=made)
        begun = torque
        wound = begun + k * (made[:, :joints] - before)
        for _ in range(PASSES):
            torque = np.minimum(np.maximum(wound - np.matvec(pull, mean), least), limit)
            mean = 0.5 * (begun + torque)
        for j, column in enumerate(columns):
            np.multiply(column, mean[:, j, None], out=pushed)
            state += pushed
        made -= np.matvec(at_once, mean)
        before = made[:, :joints]
    return out
