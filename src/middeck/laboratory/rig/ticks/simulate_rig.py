"""Simulation of a rig: an exactly sampled plant, and its nonlinear parts once a tick.

A converter rounds, a motor saturates, a rotor fills up, a joint sticks: all of it happens at ticks or at
joints, on a few channels, between which everything is one matrix. So a tick is two products with matrices and
some twenty operations on short arrays. Where nothing is switched on many ticks are one product. The record
leaves in blocks, and memory does not grow with its length.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Float

from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError, DataError, NumericalError
from middeck.laboratory.rig.linear_view import close_rig
from middeck.laboratory.rig.parts.computer import Computer, build_computer, place_law
from middeck.laboratory.rig.plant.ageing import follow_ageing
from middeck.laboratory.rig.plant.hybrid_plant import HybridPlant
from middeck.laboratory.rig.rig import Rig
from middeck.laboratory.rig.ticks.compiled import TickRows, run_compiled
from middeck.laboratory.rig.ticks.state import RigBlock, RigState, check_start, start_at_rest
from middeck.laboratory.rig.ticks.tick import Tick
from middeck.systems.sampling.simulation import simulate
from middeck.systems.state_space.statespace import SampledStateSpace

BLOCK = 2048  # ticks simulated in one go

Array = np.ndarray


class DivergedError(NumericalError):
    """The simulated state has overflowed: the loop, or the compensator in it, grows without bound."""


def simulate_rig(
    rig: Rig,
    law: Compensator | None,
    excitation: Iterable[Float[np.ndarray, "sample input"]],
    rng: np.random.Generator,
    start: RigState | None = None,
) -> Iterator[RigBlock]:
    """Run ``excitation`` block by block in constant memory; each block continues the one before.

    In each tick the outputs are sampled, the computer answers, and compensator and excitation together are
    issued to the motors. Blocks cut elsewhere change the numbers by rounding, which a chaotic loop amplifies.
    The run begins at ``start``, or where the rig is switched on without a rest; a plant that drifts is
    renewed as `Ageing` says, and blocks end there too.

    Raises `ConfigError` as `place_law`, for a start of another rig or compensator, an excitation of other
    channels, or drifts that bring a frequency to zero on the way; `DataError` for an excitation that is not
    finite; `DivergedError` where the state overflows; `NumericalError` where joints' torques do not settle.
    """
    placed = place_law(law, rig.inputs, rig.outputs, rig.period_s)
    state = switch_on(rig, law, 0.0, rng) if start is None else start
    check_start(rig, placed, state)
    computer, loop = build_computer(rig.sensors, placed), close_rig(rig, placed) if rig.linear else None
    held_at = None if rig.ageing is None else follow_ageing(rig.ageing)
    for block in excitation:
        left = check_excitation(block, len(rig.inputs))
        while len(left):
            plant, ticks = (rig.plant, len(left)) if held_at is None else held_at(state.tick)
            e, left = left[:ticks], left[ticks:]
            with np.errstate(over="ignore", invalid="ignore"):  # raised as an error below
                done = (
                    _run_ticks(rig, plant, computer, e, rng, state)
                    if loop is None
                    else _run_linear(rig, loop, e, rng, state)
                )
            state = done.state
            if not all(np.isfinite(x).all() for x in (state.x, state.computer, done.torque, done.measured)):
                raise DivergedError(
                    "the simulated state overflows",
                    hint="is the loop, or the law itself, unstable? give motors a torque_limit, or set stops",
                )
            yield done


def switch_on(rig: Rig, law: Compensator | None, rest_s: float, rng: np.random.Generator) -> RigState:
    """Switch on and rest for ``rest_s``: start of a run with ``law``, gyro biases drawn and measured.

    The compensator is off while it rests. The mean of the readings is taken for the bias and will be
    subtracted before the computer adds them up. Raises `ConfigError` for a rest that is negative or has no
    end.
    """
    if not 0.0 <= rest_s < np.inf:
        raise ConfigError(f"a rest of {rest_s} s", hint="finite, from zero")
    gyro, p = rig.readout.gyro, len(rig.outputs)
    bias = rig.readout.bias * rng.standard_normal(p) if gyro.any() else np.zeros(p)
    begin, rests = (
        start_at_rest(rig, place_law(each, rig.inputs, rig.outputs, rig.period_s), bias)
        for each in (law, None)
    )
    ticks = round(rest_s * rig.sample_hz)
    if ticks < 1 or not gyro.any():
        return dataclasses.replace(begin, tick=ticks)
    total = np.zeros(p)
    for block in simulate_rig(rig, None, cut_blocks(np.zeros((ticks, len(rig.inputs)))), rng, rests):
        total += block.readings.sum(axis=0)
        rests = block.state
    return dataclasses.replace(rests, computer=begin.computer, trim=np.where(gyro, total / ticks, 0.0))


def cut_blocks(
    excitation: Float[np.ndarray, "sample input"], size: int = BLOCK
) -> Iterator[Float[np.ndarray, "sample input"]]:
    """``excitation`` in blocks of ``size`` samples; the last may be shorter."""
    return (excitation[k : k + size] for k in range(0, len(excitation), size))


def linear_state(
    state: RigState, x: Float[np.ndarray, " state"], sums: Float[np.ndarray, " gyro"]
) -> RigState:
    """``state`` with the states of `close_rig`, and the gyros' sums."""
    states, own = len(state.x), len(state.x) + state.issued.size
    return dataclasses.replace(
        state,
        x=x[:states],
        issued=x[states:own].reshape(state.issued.shape)[::-1],
        computer=np.concatenate([sums, x[own:]]),
    )


def check_excitation(block: Array, inputs: int) -> Float[np.ndarray, "sample input"]:
    """``block`` as numbers; `ConfigError` for other channels, `DataError` for one that is not finite."""
    e = np.ascontiguousarray(block, dtype=float)
    if e.ndim != 2 or e.shape[1] != inputs:
        raise ConfigError(
            f"an excitation of shape {e.shape} for {inputs} motors",
            hint="samples in rows, one column for each motor",
        )
    if not np.isfinite(e).all():
        raise DataError("a sample of the excitation is not finite", hint="leave it out or record again")
    return e


def _run_linear(
    rig: Rig, loop: SampledStateSpace, e: Array, rng: np.random.Generator, start: RigState
) -> RigBlock:
    p = len(rig.outputs)
    _, noise, _ = draw_errors(rig, rig.plant, len(e), rng, start.bias)
    x = np.concatenate([start.x, start.issued[::-1].ravel(), start.computer])
    rows, end = simulate(loop, np.hstack([e, noise]), x)
    measured, control = rows[:, :p], rows[:, p:]
    torque = e + control
    momentum = np.subtract.accumulate(np.vstack([start.momentum, torque]))[1:]
    state = dataclasses.replace(
        linear_state(start, end, np.zeros(0)), momentum=momentum[-1], tick=start.tick + len(e)
    )
    return RigBlock(
        measured=measured, readings=measured, control=control, torque=torque, momentum=momentum, state=state
    )


def _run_ticks(
    rig: Rig, plant: HybridPlant, computer: Computer, e: Array, rng: np.random.Generator, start: RigState
) -> RigBlock:
    count = rig.readout.step
    noise, offset, bias = draw_errors(rig, plant, len(e), rng, start.bias)
    states, answer = computer.states, computer.states + computer.outputs
    # The computer takes counts, and so nothing is scaled in a tick.
    step = computer.step.copy()
    step[:, states:] *= count
    shift = step[:, states:] @ (start.trim / count)
    issued = np.vstack([start.issued, np.empty_like(e)])
    new = issued[len(start.issued) :]
    rows = np.empty((len(e), len(step)))
    digital = np.empty((len(e) + 1, step.shape[1]))
    digital[0, :states] = start.computer
    ticks = TickRows(
        compute=step,
        shift=shift,
        kept=states,
        excitation=e,
        offset=offset / count,
        noise=noise,
        digital=digital,
        rows=rows,
        issued=issued,
    )
    x, joints = run_compiled(rig, plant, ticks, start) or _run_in_python(rig, plant, ticks, start)
    momentum = np.subtract.accumulate(np.vstack([start.momentum, new]))[1:]
    end = RigState(
        x=x, computer=digital[-1, :states].copy(), issued=issued[len(e) :], momentum=momentum[-1],
        joints=joints, bias=bias, trim=start.trim, tick=start.tick + len(e),
    )  # fmt: skip
    return RigBlock(
        measured=rows[:, states:answer],
        readings=digital[:-1, states:] * count,
        control=rows[:, answer:],
        torque=new,
        momentum=momentum,
        state=end,
    )


def _run_in_python(rig: Rig, plant: HybridPlant, ticks: TickRows, start: RigState) -> tuple[Array, Array]:
    """`run_compiled` without a compiler, and for elements of every kind."""
    e, digital, rows, issued, states = ticks.excitation, ticks.digital, ticks.rows, ticks.issued, ticks.kept
    tick = Tick(rig, plant, start)
    trims, compute = bool(ticks.shift.any()), tick.sums(ticks.compute)
    parts = zip(
        digital[:-1], digital[:-1, states:], digital[1:, :states], rows, rows[:, states + len(rig.outputs) :],
        ticks.offset.tolist(), e.tolist(), issued[len(start.issued) :], pair_rows(issued)[: len(e)],
        ticks.noise, strict=True,
    )  # fmt: skip
    for now, reading, kept, row, command, off, excitation, torque, window, white in parts:
        tick.read(off, reading)
        compute(0.0, now, row)
        if trims:
            np.subtract(row, ticks.shift, row)
        kept[:] = row[:states]
        tick.limit(command.tolist(), excitation, torque)
        tick.move(window, white)
    return tick.x, tick.joint_states()


def draw_errors(
    rig: Rig, plant: HybridPlant, count: int, rng: np.random.Generator, bias: Array
) -> tuple[Array, Array, Array]:
    """Noise on the states and offsets of the readings at each tick, and the bias after them.

    One stream of numbers, tick by tick: blocks cut elsewhere draw the same. A rig on which nothing is
    switched on has noise of its samples alone.
    """
    readout, outputs = rig.readout, len(rig.outputs)
    if rig.linear:
        noise = rng.standard_normal((count, outputs)) * readout.noise_rms
        return np.zeros((count, len(plant.noise))), noise, bias
    white = plant.noise.shape[1]
    drawn = rng.standard_normal((count, white + 2 * outputs))
    noise = drawn[:, :white] @ plant.noise.T
    walked = bias + np.cumsum(drawn[:, white : white + outputs] * readout.walk, axis=0)
    biased = np.vstack([bias, walked])
    return noise, biased[:-1] + drawn[:, white + outputs :] * readout.noise_rms, biased[-1]


def pair_rows(issued: Array) -> Array:
    """Two rows in a row, each pair as one, without copying."""
    count, m = issued.shape
    row, item = issued.strides
    return np.lib.stride_tricks.as_strided(issued, (count - 1, 2 * m), (row, item), writeable=False)
