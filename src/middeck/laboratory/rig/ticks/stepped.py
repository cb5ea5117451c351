"""A simulated rig sample by sample, for a computer that is not its own."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
from jaxtyping import Float

from middeck.laboratory.rig.plant.ageing import follow_ageing
from middeck.laboratory.rig.plant.hybrid_plant import HybridPlant
from middeck.laboratory.rig.rig import Rig
from middeck.laboratory.rig.ticks.compiled import TickRows, compile_ticks
from middeck.laboratory.rig.ticks.simulate_rig import BLOCK, draw_errors, pair_rows, switch_on
from middeck.laboratory.rig.ticks.state import RigState
from middeck.laboratory.rig.ticks.tick import Tick
from middeck.realtime.engine.rigs.engine_rig import EngineRig

Array = np.ndarray


class SteppedRig(EngineRig):
    """``rig`` as an engine drives it: the numbers of `simulate_rig` for the same commands, to rounding.

    Args:
        rig: Motors with their limits, sensors with their errors, the sums of gyro samples, joints, drifts.
        rng: Errors and noise, in the order in which `simulate_rig` draws them.
        rest_s: Rest, before the first sample, in which the gyros' biases are measured; see `switch_on`.
        start: Another state to start from, without a compensator's.

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
        readout, period_s, p = self.rig.readout, self.rig.period_s, len(self.rig.outputs)
        noise, offset, bias = draw_errors(self.rig, plant, count, self.rng, start.bias)
        summed, sums = readout.summed, np.zeros(p)
        sums[summed] = start.computer
        adds, half = np.where(summed, period_s, 0.0), np.where(summed, 0.5 * period_s, 1.0)
        nothing = np.zeros((count, len(self.rig.inputs)))
        issued = np.vstack([start.issued, nothing])
        new, momentum = issued[len(start.issued) :], start.momentum
        commands = np.zeros((count, p + len(self.rig.inputs)))
        rows = TickRows(
            compute=np.zeros((commands.shape[1], p)), shift=np.zeros(commands.shape[1]), kept=0,
            excitation=nothing, offset=offset / readout.step, noise=noise,
            digital=np.empty((count + 1, p)), rows=commands, issued=issued,
        )  # fmt: skip
        ticks = compile_ticks(self.rig, plant, rows, start) or _PythonTicks(self.rig, plant, rows, start)
        for k, (reading, row, given) in enumerate(zip(rows.digital, commands[:, p:], new, strict=False)):
            ticks.read(k)
            rate = reading * readout.step - start.trim
            row[:] = yield sums + half * rate
            sums = sums + adds * rate
            ticks.move(k)
            momentum = momentum - given
        return RigState(
            x=ticks.x, computer=sums[summed], issued=issued[count:], momentum=momentum,
            joints=ticks.joint_states(), bias=bias, trim=start.trim, tick=start.tick + count,
        )  # fmt: skip


class _PythonTicks:
    """`CompiledTicks` where only Python can."""

    def __init__(self, rig: Rig, plant: HybridPlant, rows: TickRows, start: RigState) -> None:
        self.tick, self.rows, self.first = Tick(rig, plant, start), rows, len(start.issued)
        self.offset, self.nothing = rows.offset.tolist(), [0.0] * len(rig.inputs)
        self.commands, self.windows = rows.rows[:, len(rig.outputs) :], pair_rows(rows.issued)

    def read(self, k: int) -> None:
        self.tick.read(self.offset[k], self.rows.digital[k])

    def move(self, k: int) -> None:
        self.tick.limit(self.commands[k].tolist(), self.nothing, self.rows.issued[self.first + k])
        self.tick.move(self.windows[k], self.rows.noise[k])

    @property
    def x(self) -> Array:
        return self.tick.x

    def joint_states(self) -> Array:
        return self.tick.joint_states()
