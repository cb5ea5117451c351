"""Static completeness: the low-frequency response of truncated modes (MacNeal 1971, Rubin 1975).

A mode far above the band responds to a force at once, by 1/omega^2. The sum over all that are left out is the
flexibility of the whole less that of the kept ones. Where the structure is free, its flexibility is that of
its elastic part: forces balanced by the inertia of the rigid motion they cause, displacements without any
rigid motion (both in the metric of the mass: "inertia relief"). No singular matrix is inverted: as many
coordinates as there are rigid modes are held, which costs the balanced forces nothing.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from middeck.errors import ConfigError, NumericalError
from middeck.signals.ports import Port
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.factorisation import Factor, factorise, order, positive_factor
from middeck.structure.assembly.freedom import Freedom
from middeck.structure.assembly.linked import dynamic_freedom
from middeck.structure.assembly.redundant_constraints import pivots
from middeck.structure.modes.solve import Modes
from middeck.structure.modes.stiff_members import check_beside_modes
from middeck.structure.plants.sensors_and_actuators import input_rows, output_rows
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

# Residual of a solution, over the size of its terms, above which it is not one.
WORTHLESS = 1e-8
# A gain below this part of the most that it could be is that of an uncoupled pair.
COUPLED = 1e-10
# Relative distance from a mode's frequency below which the gain is nothing but that mode.
RESONANT = 1e-6


@record(kw_only=True)
class StaticGainComparison:
    """Low-frequency gains, undamped, of everything and of the kept modes without and with the residual.

    Attributes:
        frequency_hz: Frequency of the gains: zero, or with rigid modes one far below the first flexible mode.
        full: Gain of the whole structure, every mode included, by a direct solution for what the kept ones
            leave; a rate's without its factor j.
        truncated, completed: Gain of the kept modes alone, and with the residual flexibility.
        truncated_error, completed_error: Their relative errors; not a number for a pair that is not coupled.
    """

    frequency_hz: float
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    full: Float[np.ndarray, "output input"]
    truncated: Float[np.ndarray, "output input"]
    completed: Float[np.ndarray, "output input"]
    truncated_error: Float[np.ndarray, "output input"]
    completed_error: Float[np.ndarray, "output input"]


def residual_flexibility(
    modes: Modes,
    force: Float[np.ndarray, "input coordinate"],
    reading: Float[np.ndarray, "output coordinate"],
    count: int,
) -> Float[np.ndarray, "output input"]:
    """``reading`` (K^-1 - sum phi phi' / omega^2) ``force`` over the lowest ``count`` modes.

    Symmetric where both rows are the same (Maxwell). With rigid modes K^-1 is the flexibility of the elastic
    part. Raises `ConfigError` where ``count`` leaves rigid modes out: their response is not static.
    """
    rigid = int(np.sum(modes.omega == 0.0))
    if count < rigid:
        raise ConfigError(
            f"{count} modes kept of {rigid} rigid ones: the omitted rigid modes have no static response",
            hint=f"keep {rigid} modes or more, or static=False",
        )
    K, M, free = moving_matrices(modes, "the static residual")
    held = np.zeros(order(K), dtype=bool)
    held[pivots(free.coordinates(modes.shapes[:, :rigid]))] = True
    factor = positive_factor(sp.csr_array(K[~held][:, ~held]))
    if factor is None:
        raise NumericalError(
            "with its rigid modes held, the structure still moves without stiffness",
            hint="is there a rigid mode among those that are not zero? look at modes.rigid_residual",
        )
    kept = _Kept(free.coordinates(modes.shapes[:, :count]), M, modes.omega[:count] ** 2)
    x = _answer_of_the_rest(K, factor, kept, free.part(force.T), ~held)
    return reading @ free.spread(x)


def compare_static_gain(
    modes: Modes,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    count: int = 26,
    frequency_hz: float | None = None,
) -> StaticGainComparison:
    """Error of low-frequency gains without the modes beyond ``count``, without and with the residual.

    At 0 Hz; where there are rigid modes, or rates and accelerations are read, at a tenth of the lowest
    frequency that is not zero, or at ``frequency_hz``. Raises `ConfigError` for 0 Hz with rigid modes, for
    wheels that spin and where `residual_flexibility` does, `NumericalError` at a resonance.
    """
    if modes.equilibrium.environment.spins:
        raise ConfigError(
            "wheels spin, whose momentum the comparison of static gains leaves out",
            hint="leave the comparison out, or set the speeds to zero",
        )
    drive, read = input_rows(modes.equilibrium, inputs), output_rows(modes.equilibrium, outputs)
    if frequency_hz is None:
        frequency_hz = _low_frequency(modes, moving=bool(np.any(read.rate) or np.any(read.acceleration)))
    if modes.kind[:1] == ("rigid",) and not frequency_hz > 0.0:
        raise ConfigError("a free structure has no gain at 0 Hz", hint="a frequency_hz above zero")
    omega, count = 2.0 * np.pi * frequency_hz, min(count, len(modes.omega))
    K, M, free = moving_matrices(modes, "the static residual")
    B = free.part(drive.force.T)
    C = free.part((read.position + omega * read.rate - omega**2 * read.acceleration).T).T
    D = sp.csr_array(K - omega**2 * M)
    kept = _Kept(free.coordinates(modes.shapes[:, :count]), M, modes.omega[:count] ** 2 - omega**2)
    near = np.abs(modes.omega - omega) <= RESONANT * omega
    if omega > 0.0 and np.any(near):
        raise NumericalError(
            f"the gain at the frequency of mode {modes.name[int(np.argmax(near))]!r} depends on its damping",
            hint="another frequency_hz, below the first flexible mode",
        )
    x, y = (kept.answer(F) + _dynamic_rest(D, kept, F) for F in (B, C.T))
    full, truncated = C @ x, C @ kept.answer(B)
    completed = truncated + residual_flexibility(modes, drive.force, read.position, count)
    scale = np.where(np.abs(full) > COUPLED * _most(B, x, C, y), np.abs(full), np.nan)
    return StaticGainComparison(
        frequency_hz=frequency_hz,
        inputs=drive.ports,
        outputs=read.ports,
        full=full,
        truncated=truncated,
        completed=completed,
        truncated_error=np.abs(truncated - full) / scale,
        completed_error=np.abs(completed - full) / scale,
    )


def left_out_gain(
    modes: Modes,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    count: int,
    frequency_hz: Float[np.ndarray, " line"],
    static: bool = False,
) -> Float[np.ndarray, "line output input"]:
    """Undamped gain of the modes beyond ``count``, wheels at rest; with ``static`` less their residual.

    A rate's is without its factor j. Zero for a pair that is not coupled, and not a number where a line is a
    mode's frequency, to rounding.
    """
    drive, read = input_rows(modes.equilibrium, inputs), output_rows(modes.equilibrium, outputs)
    K, M, free = moving_matrices(modes, "the gain of the modes left out")
    shapes, B = free.coordinates(modes.shapes[:, :count]), free.part(drive.force.T)
    gain = np.full((len(frequency_hz), len(read.ports), len(drive.ports)), np.nan)
    for k, omega in enumerate(2.0 * np.pi * frequency_hz):
        rows = read.position + omega * read.rate - omega**2 * read.acceleration
        kept = _Kept(shapes, M, modes.omega[:count] ** 2 - omega**2)
        C, D = free.part(rows.T).T, sp.csr_array(K - omega**2 * M)
        with contextlib.suppress(NumericalError):
            rest, of_outputs = (_dynamic_rest(D, kept, F) for F in (B, C.T))
            gain[k] = C @ rest
            x, y = kept.answer(B) + rest, kept.answer(C.T) + of_outputs
            gain[k][np.abs(C @ x) <= COUPLED * _most(B, x, C, y)] = 0.0
        if static:
            gain[k] -= residual_flexibility(modes, drive.force, rows, min(count, len(modes.omega)))
    return gain


def complete_response(
    modes: Modes,
    response: FrequencyResponse,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    count: int = 26,
) -> FrequencyResponse:
    """Contribution of the modes beyond ``count`` to rates and accelerations in a static plant's ``response``.

    Theirs is j omega and -omega^2 times the residual flexibility, which no state space can hold. Raises
    `ConfigError` where `residual_flexibility` does.
    """
    drive, read = input_rows(modes.equilibrium, inputs), output_rows(modes.equilibrium, outputs)
    jw = 2j * np.pi * response.frequency_hz[:, None, None]
    rate, acceleration = (
        residual_flexibility(modes, drive.force, rows, min(count, len(modes.omega)))
        for rows in (read.rate, read.acceleration)
    )
    return dataclasses.replace(response, H=response.H + jw * rate + jw**2 * acceleration)


def _most(B: np.ndarray, x: np.ndarray, C: np.ndarray, y: np.ndarray) -> Float[np.ndarray, "output input"]:
    """Cauchy and Schwarz: a gain is at most the mean of what each port does to itself."""
    return np.sqrt(np.outer(np.abs(np.sum(C.T * y, axis=0)), np.abs(np.sum(B * x, axis=0))))


class _Kept(NamedTuple):
    """Modes, the mass matrix, and their stiffness omega_k^2 - omega^2: zero for one without a response."""

    shapes: np.ndarray
    mass: sp.csr_array
    stiffness: np.ndarray

    def answer(self, force: np.ndarray) -> np.ndarray:
        """Their displacement."""
        compliance = np.zeros(len(self.stiffness))
        np.divide(1.0, self.stiffness, out=compliance, where=self.stiffness != 0.0)
        return self.shapes @ (compliance[:, None] * (self.shapes.T @ force))

    def without(self, force: np.ndarray) -> np.ndarray:
        """``force`` without its part on these modes."""
        return force - self.mass @ (self.shapes @ (self.shapes.T @ force))

    def apart(self, x: np.ndarray) -> np.ndarray:
        """``x`` without its part along these modes."""
        return x - self.shapes @ (self.shapes.T @ (self.mass @ x))


def _answer_of_the_rest(
    D: sp.csr_array, factor: Factor, kept: _Kept, force: np.ndarray, free: np.ndarray
) -> Float[np.ndarray, "coordinate input"]:
    """D^-1 ``force`` less the response of the kept modes, itself without any part along them.

    The soft kept modes respond a million times more than the stiff rest: a difference would be rounding.
    """
    by_modes = kept.answer(force)
    x = np.zeros_like(force)
    for _ in range(2):  # once more for what rounding has left
        x[free] += factor.solve(kept.without(force - D @ (by_modes + x))[free])
        x = kept.apart(x)
    return x


def _dynamic_rest(D: sp.csr_array, kept: _Kept, force: np.ndarray) -> Float[np.ndarray, "coordinate input"]:
    """The same for a dynamic stiffness, factored without pivoting: its residual is looked at."""
    factor = factorise(D)
    if factor is not None:
        x = _answer_of_the_rest(D, factor, kept, force, np.ones(len(force), dtype=bool))
        wanted = kept.without(force - D @ kept.answer(force))
        size = (abs(D) @ np.abs(x) + np.abs(wanted)).max(initial=0.0)
        if np.abs(kept.without(wanted - D @ x)).max(initial=0.0) <= WORTHLESS * size:
            return x
    raise NumericalError(
        "no gain could be computed at this frequency: is it that of a mode?",
        hint="another frequency_hz, below the first flexible mode",
    )


def _low_frequency(modes: Modes, moving: bool) -> float:
    """Zero, where neither rigid modes nor the outputs (rates, accelerations) make gains there meaningless."""
    swings = modes.frequency_hz[modes.omega > 0.0]
    free = len(swings) < len(modes.omega)
    return float(0.1 * swings.min()) if (free or moving) and len(swings) else 0.0


def moving_matrices(modes: Modes, what: str) -> tuple[sp.csr_array, sp.csr_array, Freedom]:
    """Stiffness and mass of the free coordinates, and these coordinates.

    Raises `NumericalError` where a member is too stiff beside the modes for ``what`` (`check_beside_modes`).
    """
    equilibrium = modes.equilibrium
    check_beside_modes(modes, what)
    free = dynamic_freedom(equilibrium.model, equilibrium.config, in_world=True)
    K = assemble(equilibrium.model, equilibrium.config, equilibrium.loads).tangent
    return free.matrix(K), free.matrix(modes.mass), free
