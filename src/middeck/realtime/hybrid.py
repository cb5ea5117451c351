"""Hybrid simulation: an exactly sampled plant, and once a tick what is not linear.

A converter rounds, a motor saturates, a rotor fills up, a joint sticks: all of it happens at ticks or at
joints, on a few channels, between which everything is one matrix. So a tick is two products with matrices and
some twenty operations on short arrays. The record leaves in blocks, and memory does not grow with its length.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, DataError, NumericalError
from middeck.realtime.hybrid_state import HybridBlock, HybridState, HybridSystem
from middeck.realtime.tick import Tick

Array = np.ndarray


def simulate_hybrid(
    system: HybridSystem,
    excitation: Iterable[Float[np.ndarray, "sample input"]],
    rng: np.random.Generator,
    start: HybridState,
) -> Iterator[HybridBlock]:
    """Run ``excitation``, block by block as it comes; each block goes on where the last one ended.

    In each tick the outputs are sampled, the computer answers, and law and excitation together are issued to
    the motors; the numbers do not depend on where the blocks are cut. Raises `ConfigError` for an excitation
    of other channels and `NumericalError` where the state overflows.
    """
    for block in excitation:
        e = np.ascontiguousarray(block, dtype=float)
        if e.ndim != 2 or e.shape[1] != system.computer.commands:
            raise ConfigError(
                f"an excitation of shape {e.shape} for {system.computer.commands} motors",
                hint="samples in rows, one column for each motor",
            )
        if not np.isfinite(e).all():
            raise DataError(
                "a sample of the excitation is no finite number", hint="leave it out or record again"
            )
        done = _run_block(system, e, rng, start)
        start = done.state
        if not (np.isfinite(start.x).all() and np.isfinite(start.computer).all()):
            raise NumericalError(
                "the simulated state overflows",
                hint="is the loop, or the law itself, unstable? give motors a torque_limit, and a run stops",
            )
        yield done


def _run_block(system: HybridSystem, e: Array, rng: np.random.Generator, start: HybridState) -> HybridBlock:
    computer, count = system.computer, system.readout.step
    noise, offset, bias = _draw(system, len(e), rng, start.bias)
    states, answer = computer.states, computer.states + computer.outputs
    # The computer takes counts, and so nothing is scaled in a tick.
    step = computer.step.copy()
    step[:, states:] *= count
    shift = step[:, states:] @ (start.trim / count)
    trims, compute = bool(shift.any()), step.dot
    issued = np.vstack([start.issued, np.empty_like(e)])
    new = issued[len(start.issued) :]
    rows = np.empty((len(e), len(step)))
    digital = np.empty((len(e) + 1, step.shape[1]))
    digital[0, :states] = start.computer
    counts, commands = digital[:-1, states:], rows[:, answer:]
    tick = Tick(system, start)
    windows = _pairs(issued)[: len(e)]
    parts = zip(
        digital[:-1], counts, digital[1:, :states], rows, commands, (offset / count).tolist(), e.tolist(),
        new, windows, noise, strict=True,
    )  # fmt: skip
    for now, reading, kept, row, command, off, excitation, torque, window, white in parts:
        tick.read(off, reading)
        compute(now, row)
        if trims:
            np.subtract(row, shift, row)
        kept[:] = row[:states]
        tick.limit(command.tolist(), excitation, torque)
        tick.move(window, white)
    momentum = np.subtract.accumulate(np.vstack([start.momentum, new]))[1:]
    end = HybridState(
        x=tick.x,
        computer=digital[-1, :states].copy(),
        issued=issued[len(e) :],
        momentum=momentum[-1],
        joints=tick.joint_states(),
        bias=bias,
        trim=start.trim,
        tick=start.tick + len(e),
    )
    return HybridBlock(rows[:, states:answer], counts * count, commands, new, momentum, end)


def _draw(
    system: HybridSystem, count: int, rng: np.random.Generator, bias: Array
) -> tuple[Array, Array, Array]:
    """Noise on the states and offsets of the readings at each tick, and the bias after them.

    One stream of numbers, tick by tick: cutting it elsewhere changes nothing.
    """
    readout, outputs = system.readout, system.computer.outputs
    white = system.plant.noise.shape[1]
    drawn = rng.standard_normal((count, white + 2 * outputs))
    noise = drawn[:, :white] @ system.plant.noise.T
    walked = bias + np.cumsum(drawn[:, white : white + outputs] * readout.walk, axis=0)
    biased = np.vstack([bias, walked])
    return noise, biased[:-1] + drawn[:, white + outputs :] * readout.noise_rms, biased[-1]


def _pairs(issued: Array) -> Array:
    """Two rows in a row, each pair as one, without copying."""
    count, m = issued.shape
    row, item = issued.strides
    return np.lib.stride_tricks.as_strided(issued, (count - 1, 2 * m), (row, item), writeable=False)
