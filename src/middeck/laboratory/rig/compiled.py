"""The loop over a block's ticks in C, where this machine has a compiler; `Tick` in Python does the same.

Both take the same branches and sums, and give the same bits. The C is compiled once for each state of its
source, into the user's cache.
"""

from __future__ import annotations

import ctypes
import functools
from importlib import resources
from typing import NamedTuple

import numpy as np

from middeck.errors import MiddeckError, NumericalError
from middeck.joints import balance
from middeck.joints.attachment import only_friction
from middeck.laboratory.rig.hybrid_plant import HybridPlant
from middeck.laboratory.rig.motors import LimitedMotors
from middeck.laboratory.rig.rig import Rig
from middeck.laboratory.rig.state import RigState
from middeck.laboratory.rig.tick import converter_ends
from middeck.realtime.generate.compiler import compile_once

Array = np.ndarray
SIZES = "ticks states joints inputs outputs substeps feels noisy depth kept computed iterations"
GIVEN = "step drive push compliance look compute shift friction limits converters excitation offset noise"
MOVED = "x angles sliders torques stands previous momentum digital rows issued work"


class TickRows(NamedTuple):
    """What a block of ticks is given, and the rows that it fills.

    Attributes:
        compute, shift: The computer's matrix, from its states and the counts, and what it subtracts.
        kept: Number of the computer's states.
        excitation, offset, noise: At each tick: commands added, errors of the counts, noise on the states.
        digital: The computer's states and the counts of each tick; the first states are set.
        rows: What the computer makes of them: states of the next tick, measured outputs, commands.
        issued: The torques; those on their way when the block begins are set.
    """

    compute: Array
    shift: Array
    kept: int
    excitation: Array
    offset: Array
    noise: Array
    digital: Array
    rows: Array
    issued: Array


class _Run(ctypes.Structure):
    """``Run`` of ``ticks.c``."""

    _fields_ = tuple(
        (name, kind)
        for kind, names in ((ctypes.c_long, SIZES), (ctypes.c_void_p, f"{GIVEN} {MOVED}"))
        for name in names.split()
    )


def run_compiled(
    rig: Rig, plant: HybridPlant, ticks: TickRows, start: RigState
) -> tuple[Array, Array] | None:
    """Fill the rows of ``ticks``; states and joint elements at the end, None where only Python can.

    That is without a compiler, and for a joint that has not friction alone. Raises `NumericalError` where
    joints' torques do not settle.
    """
    friction = only_friction(rig.joints)
    library = None if friction is None else _library()
    if friction is None or library is None:
        return None
    x, sliders, angles = start.x.copy(), start.joints.copy(), plant.angle @ start.x
    stands = [f.resist(a, s)[0] for f, a, s in zip(friction, angles.tolist(), sliders.tolist(), strict=True)]
    feels = bool(np.any(plant.answer))
    push = np.concatenate([plant.push, plant.answer], axis=2) if feels else plant.push
    motors = LimitedMotors(rig.bank, start.issued[-1], start.momentum)
    sizes = (
        len(ticks.rows), len(x), len(friction), len(rig.inputs), len(rig.outputs), len(plant.step), feels,
        plant.noise.shape[1] > 0, plant.delay_ticks + 1, ticks.kept, len(ticks.compute),
        balance.MOST_ITERATIONS,
    )  # fmt: skip
    given = (
        plant.step.swapaxes(1, 2), plant.drive.swapaxes(1, 2), push.swapaxes(1, 2),
        [plant.angle @ p for p in plant.push], (plant.read / rig.readout.step[:, None]).T,
        ticks.compute.T, ticks.shift,
        [(f.slip_torque, f.stiffness) for f in friction], motors.limits, converter_ends(rig.readout),
        ticks.excitation, ticks.offset, ticks.noise,
    )  # fmt: skip
    work = np.empty(len(x) + 4 * len(friction) + len(rig.outputs))
    moved = (
        x, angles, sliders, np.zeros(len(friction)), stands, motors.previous, motors.momentum, ticks.digital,
        ticks.rows, ticks.issued, work,
    )  # fmt: skip
    arrays = [np.ascontiguousarray(a, dtype=float) for a in (*given, *moved)]
    if library.run_ticks(ctypes.byref(_Run(*sizes, *(a.ctypes.data for a in arrays)))):
        raise NumericalError(balance.UNSETTLED, hint="more substeps in a tick")
    return x, sliders


@functools.cache
def _library() -> ctypes.CDLL | None:
    """The compiled loop; None where it cannot be compiled, kept or loaded."""
    text = resources.files("middeck.laboratory.rig").joinpath("source", "ticks.c").read_text(encoding="utf-8")
    try:
        return ctypes.CDLL(str(compile_once("ticks", {"ticks.c": text}, flags=("-shared", "-fPIC"))))
    except (OSError, RuntimeError, MiddeckError):  # no compiler, no home, no room, another machine's code
        return None
