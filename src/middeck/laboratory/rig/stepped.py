"""A simulated rig sample by sample, for a computer that is not its own."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
from jaxtyping import Float

from middeck.laboratory.rig.ageing import follow_ageing
from middeck.laboratory.rig.hybrid_plant import HybridPlant
from middeck.laboratory.rig.rig import Rig
from middeck.laboratory.rig.simulation import BLOCK, draw_errors, pair_rows, switch_on
from middeck.laboratory.rig.state import RigState
from middeck.laboratory.rig.tick import Tick
from middeck.realtime.engine.rigs.rig import EngineRig

Array = np.ndarray


class SteppedRig(EngineRig):
    """``rig`` as an engine drives it: the numbers of `simulate_rig` for the same commands, to rounding.

    Args:
        rig: Motors with their limits, sensors with their errors, the sums of gyro samples, joints, drifts.
        rng: Errors and noise, in the order in which `simulate_rig` draws them.
        rest_s: Rest, before the first sample, in which the gyros' biases are measured; see `switch_on`.
        start: Where it stands instead; a state without a compensator's.

    A state that grows beyond the numbers is read as NaN or infinite, which an engine sees.
    """

    def __init__(
        self, rig: Rig, rng: np.random.Generator, *, rest_s: float = 0.0, start: RigState | None = None
    ) -> None:
        self.rig, self.rng = rig, rng
        self.start = switch_on(rig, None, rest_s, rng) if start is None else start
        self.ticks: Generator[Array, Array] | None = None
        self.now: Array | None = None

    def read(self) -> Float[np.ndarray, " output"]:
        """The outputs as the rig's computer has them, an angle for each gyro."""
        if self.ticks is None:
            self.ticks = self._run()
            self.now = next(self.ticks)
        assert self.now is not None
        return self.now

    def write(self, u: Float[np.ndarray, " input"]) -> None:
        """Commands of the motors, held to the next sample."""
        self.read()
        assert self.ticks is not None
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is read as no number
            self.now = self.ticks.send(u)

    def _run(self) -> Generator[Array, Array]:
        state = self.start
        held_at = None if self.rig.ageing is None else follow_ageing(self.rig.ageing)
        while True:
            plant, ticks = (self.rig.plant, BLOCK) if held_at is None else held_at(state.tick)
            state = yield from self._block(plant, min(ticks, BLOCK), state)

    def _block(self, plant: HybridPlant, count: int, start: RigState) -> Generator[Array, Array, RigState]:
        """So many ticks, as `simulate_rig` takes them."""
        readout, period_s = self.rig.readout, self.rig.period_s
        noise, offset, bias = draw_errors(self.rig, plant, count, self.rng, start.bias)
        summed, sums = readout.summed, np.zeros(len(self.rig.outputs))
        sums[summed] = start.computer
        adds, half = np.where(summed, period_s, 0.0), np.where(summed, 0.5 * period_s, 1.0)
        nothing = [0.0] * len(self.rig.inputs)
        issued = np.vstack([start.issued, np.zeros((count, len(nothing)))])
        new, windows = issued[len(start.issued) :], pair_rows(issued)
        tick, reading, momentum = Tick(self.rig, plant, start), np.empty(len(sums)), start.momentum
        for k, off in enumerate((offset / readout.step).tolist()):
            tick.read(off, reading)
            rate = reading * readout.step - start.trim
            command = yield sums + half * rate
            sums = sums + adds * rate
            tick.limit(command.tolist(), nothing, new[k])
            momentum = momentum - new[k]
            tick.move(windows[k], noise[k])
        return RigState(
            x=tick.x, computer=sums[summed], issued=issued[count:], momentum=momentum,
            joints=tick.joint_states(), bias=bias, trim=start.trim, tick=start.tick + count,
        )  # fmt: skip
