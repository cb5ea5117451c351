"""Many linear loops with sliders at their joints, in time and side by side.

Behind its sliders each loop is linear: what noise alone makes of its joints' angles is known beforehand, and
what the sliders' torques take from them follows from the loop's poles, exactly under held torques. A torque
is held over a step at the mean of its ends, as in `middeck.joints.attachment` for one rig: of second order.

Poles move on by a block of steps at a time. Within a block only the torques answer one another, by the loop's
held responses: the work of a step does not grow with the poles, and many loops share its calls.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError
from middeck.values import record

PASSES = 2
"""Iterations for the torque at the end of a step; each shrinks the error by `GIVEN`."""
GIVEN = 0.02
BLOCK = 16
"""Steps in a block: fewer take more calls for the poles, more take more sums within the block."""


@record(kw_only=True)
class SlidingLoops:
    """Loops from the torques of their sliders to the joints' angles; a loop with fewer poles than others ends
    with zeros in ``drives``.

    Attributes:
        poles: One of each conjugate pair [rad/s].
        drives, reads: Factors of each pole: the response of the angles to a torque is the real part of the
            sum of reads exp(poles t) drives.
        stiffness, slip_torque: Those of each slider [N m/rad], [N m]; see `middeck.joints.friction.Friction`.
        records: Number of runs of each loop, each under other noise.
    """

    poles: Complex[np.ndarray, "loop pole"]
    drives: Complex[np.ndarray, "loop joint pole"]
    reads: Complex[np.ndarray, "loop joint pole"]
    stiffness: Float[np.ndarray, "loop joint"]
    slip_torque: Float[np.ndarray, "loop joint"]
    records: int = 1


def held_gain(
    poles: Complex[np.ndarray, "*loop pole"], drives: Complex[np.ndarray, "*loop joint pole"], period_s: float
) -> Complex[np.ndarray, "*loop joint pole"]:
    """State of each pole that a unit torque held over ``period_s`` leaves."""
    return drives * (np.expm1(poles * period_s) / poles)[..., None, :]


class Sliding:
    """Groups of loops with their sliders, in time: at rest at first, with the sliders at angle zero.

    A run is one record of a loop; runs are in the order of groups, loops of a group, records of a loop.
    Raises `ConfigError` for a step in which a spring would turn its joint back noticeably.
    """

    def __init__(self, groups: Sequence[SlidingLoops], period_s: float) -> None:
        ends = np.cumsum([0, *(len(g.poles) * g.records for g in groups)]).tolist()
        self._runs = [slice(*pair) for pair in itertools.pairwise(ends)]
        self._poles = [_Poles(group, period_s) for group in groups]
        self._sliders = _Sliders(groups, [own.answer for own in self._poles], period_s)

    @property
    def states(self) -> list[Complex[np.ndarray, "loop record pole"]]:
        """States of the poles of each group at present."""
        return [own.state.copy() for own in self._poles]

    def move(
        self, free: Float[np.ndarray, "run joint step"]
    ) -> tuple[Float[np.ndarray, "run joint step"], Float[np.ndarray, "run joint step"]]:
        """Angles [rad] at the ends of the next steps, from those without sliders, and torques [N m] held over
        the steps."""
        angle, torque = np.empty_like(free), np.empty_like(free)
        for first in range(0, free.shape[2], BLOCK):
            steps = slice(first, first + BLOCK)
            made = free[:, :, steps].transpose(2, 1, 0).copy()
            for own, mine in zip(self._poles, self._runs, strict=True):
                made[:, :, mine] -= own.ahead(len(made))
            held = self._sliders.move(made)
            for own, mine in zip(self._poles, self._runs, strict=True):
                own.move(held[:, :, mine])
            angle[:, :, steps] = made.transpose(2, 1, 0)
            torque[:, :, steps] = held.transpose(2, 1, 0)
        return angle, torque


class _Poles:
    """The poles of one group of loops, by blocks of steps.

    ``answer`` has the responses of angles to a torque held over one step, at its end and those of later ones.
    """

    def __init__(self, loops: SlidingLoops, period_s: float) -> None:
        count, joints, poles = loops.drives.shape
        gain = held_gain(loops.poles, loops.drives, period_s)
        grown = np.exp(loops.poles[:, None] * period_s * np.arange(BLOCK + 1)[:, None])
        self.answer = np.real(np.einsum("lop,lsp,ljp->sjol", loops.reads, grown[:, :BLOCK], gain))
        self.answer = np.repeat(self.answer, loops.records, axis=3)
        self._grown = grown[:, 1:]
        # Re(a b) as a product of real numbers.
        reads = np.conj(self._grown[:, :, None] * loops.reads[:, None], order="C").reshape(count, -1, poles)
        self._reads = np.ascontiguousarray(reads.view(float).swapaxes(1, 2))
        pushes = np.ascontiguousarray(grown[:, BLOCK - 1 :: -1, None] * gain[:, None])
        self._pushes = pushes.reshape(count, -1, poles).view(float)
        self._joints = joints
        self.state = np.zeros((count, loops.records, poles), dtype=complex)

    def ahead(self, steps: int) -> Float[np.ndarray, "step joint run"]:
        """Angles by earlier torques."""
        found = self.state.view(float) @ self._reads[:, :, : steps * self._joints]
        return found.reshape(-1, steps, self._joints).transpose(1, 2, 0)

    def move(self, torque: Float[np.ndarray, "step joint run"]) -> None:
        """To the end of these steps."""
        steps = len(torque)
        own = np.ascontiguousarray(torque.transpose(2, 0, 1)).reshape(*self.state.shape[:2], -1)
        self.state *= self._grown[:, steps - 1, None]
        self.state.view(float)[...] += own @ self._pushes[:, (BLOCK - steps) * self._joints :]


class _Sliders:
    """The sliders of all runs, step by step."""

    def __init__(
        self,
        groups: Sequence[SlidingLoops],
        answers: Sequence[Float[np.ndarray, "step driven joint run"]],
        period_s: float,
    ) -> None:
        self._stiffness, self._limit = (
            np.concatenate([np.repeat(getattr(g, key), g.records, axis=0) for g in groups]).T.copy()
            for key in ("stiffness", "slip_torque")
        )
        answer = np.concatenate(answers, axis=3)
        self._at_once, self._pull = answer[0], self._stiffness * answer[0]
        # The springs of all joints act together, each with its own stiffness.
        given = np.sum(np.abs(answer[0]) * self._stiffness[:, None], axis=0).max(initial=0.0)
        if not given <= GIVEN:
            raise ConfigError(
                f"a joint that sticks turns back by {given:.2g} of its way within a step of {period_s:g} s",
                where="friction", hint="a shorter step",
            )  # fmt: skip
        self._later = np.ascontiguousarray(answer[:0:-1])
        self._parts = np.empty_like(self._later)
        self._end = self._both = self._angle = np.zeros(self._limit.shape)

    def move(self, made: Float[np.ndarray, "step joint run"]) -> Float[np.ndarray, "step joint run"]:
        """The torques held over steps; their angles ``made`` are without them before, and with them after."""
        held, half_pull = np.empty_like(made), 0.5 * self._pull
        joints, least = made.shape[1], -self._limit
        begun, both, angle = self._end, self._both, self._angle
        for i, now in enumerate(made):
            if i:
                parts = self._parts[:i]
                np.multiply(self._later[-i:], held[:i, :, None], out=parts)
                now -= np.add.reduce(parts.reshape(i * joints, *now.shape), axis=0)
            wound = now - angle
            wound *= self._stiffness
            wound += begun
            for _ in range(PASSES):
                end = wound - np.add.reduce(half_pull * both[:, None], axis=0)
                np.maximum(end, least, out=end)
                np.minimum(end, self._limit, out=end)
                both = begun + end
            np.multiply(0.5, both, out=held[i])
            now -= np.add.reduce(self._at_once * held[i][:, None], axis=0)
            begun, angle = end, now
        self._end, self._both, self._angle = begun, both, angle.copy()
        return held
