"""The loop over a block's ticks in C, where this machine has a compiler; `Tick` in Python does the same.

Both take the same branches and sums, and give the same bits. The C is compiled once for each state of its
source, into the user's cache.
"""

import ctypes
import functools
import warnings
from dataclasses import dataclass
from importlib import resources

import numpy as np

from middeck.errors import MiddeckError, NumericalError
from middeck.joints import balance
from middeck.joints.attachment import only_friction
from middeck.laboratory.rig.parts.converters import converter_ends
from middeck.laboratory.rig.parts.motors import LimitedMotors
from middeck.laboratory.rig.plant.hybrid_plant import HybridPlant
from middeck.laboratory.rig.rig import Rig
from middeck.laboratory.rig.ticks.state import RigState
from middeck.realtime.generate.compiler import NoCompilerError, compile_once

Array = np.ndarray
SIZES = "ticks states joints inputs outputs substeps feels noisy depth kept computed iterations"
GIVEN = "step drive push compliance look compute shift friction limits converters excitation offset noise"
MOVED = "x angles sliders torques stands previous momentum digital rows issued work"


@dataclass(frozen=True, kw_only=True, eq=False)
class TickRows:
    """Inputs of a block of ticks, and the rows that it fills.

    Attributes:
        compute, shift: The computer's matrix, from its states and the counts, and the offset it subtracts.
        kept: Number of the computer's states.
        excitation, offset, noise: At each tick: commands added, errors of the counts, noise on the states.
        digital: The computer's states and the counts of each tick; the first states are set.
        rows: Results of the computer: states of the next tick, measured outputs, commands.
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


class CompiledTicks:
    """A block of ticks in C: all of them, or one by one for a computer of one's own.

    Raises `NumericalError` where joints' torques do not settle.
    """

    def __init__(
        self, library: ctypes.CDLL, rig: Rig, plant: HybridPlant, ticks: TickRows, start: RigState
    ) -> None:
        friction = only_friction(rig.joints)
        assert friction is not None
        x, sliders, angles = start.x.copy(), start.joints.copy(), plant.angle @ start.x
        parts = zip(friction, angles.tolist(), sliders.tolist(), strict=True)
        stands = [f.resist(a, s)[0] for f, a, s in parts]
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
            x, angles, sliders, np.zeros(len(friction)), stands, motors.previous, motors.momentum,
            ticks.digital, ticks.rows, ticks.issued, work,
        )  # fmt: skip
        self.x, self.sliders, self._library = x, sliders, library
        self._arrays = [np.ascontiguousarray(a, dtype=float) for a in (*given, *moved)]
        self._run = ctypes.byref(_Run(*sizes, *(a.ctypes.data for a in self._arrays)))

    def run(self) -> None:
        """Fill the rows."""
        self._require_settled(self._library.run_ticks(self._run))

    def read(self, k: int) -> None:
        """Fill the counts of tick ``k``."""
        self._library.read_tick(self._run, ctypes.c_long(k))

    def move(self, k: int) -> None:
        """To the next tick, by the commands in row ``k``."""
        self._require_settled(self._library.move_tick(self._run, ctypes.c_long(k)))

    def joint_states(self) -> Array:
        """State of every joint element in order."""
        return self.sliders

    def _require_settled(self, failed: int) -> None:
        if failed:
            raise NumericalError(balance.UNSETTLED, hint="more substeps in a tick")


def compile_ticks(rig: Rig, plant: HybridPlant, ticks: TickRows, start: RigState) -> CompiledTicks | None:
    """The block in C; None where only Python can: no compiler, or a joint with more than friction."""
    library = None if only_friction(rig.joints) is None else _library()
    return None if library is None else CompiledTicks(library, rig, plant, ticks, start)


def run_compiled(
    rig: Rig, plant: HybridPlant, ticks: TickRows, start: RigState
) -> tuple[Array, Array] | None:
    """Fill the rows of ``ticks``; states and joint elements at the end, None where only Python can."""
    block = compile_ticks(rig, plant, ticks, start)
    if block is None:
        return None
    block.run()
    return block.x, block.sliders


@functools.cache
def _library() -> ctypes.CDLL | None:
    """The compiled loop; None without a compiler, and where compiling fails, with one warning."""
    text = (
        resources.files("middeck.laboratory.rig.ticks")
        .joinpath("source", "ticks.c")
        .read_text(encoding="utf-8")
    )
    try:
        return ctypes.CDLL(str(compile_once("ticks", {"ticks.c": text}, flags=("-shared", "-fPIC"))))
    except NoCompilerError:
        return None
    except (OSError, RuntimeError, MiddeckError) as error:  # it does not compile, no home, no room
        what = error.what if isinstance(error, MiddeckError) else str(error)
        warnings.warn(
            f"the ticks of rigs run in Python, about ten times slower, to the same bits: {what}",
            UserWarning, stacklevel=2,
        )  # fmt: skip
        return None
