"""Compensators: dynamic feedback from named measurements to named inputs."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, require_plant
from middeck.systems.plants.response import FrequencyResponse, statespace_response
from middeck.systems.state_space.statespace import LinearSystem, SampledStateSpace, StateSpace, gain_system
from middeck.values import record, require_kind


@record
class Compensator:
    """u = K y, added at the plant's inputs; a sampled one's u[k] is held until u[k+1].

    Attributes:
        dynamics: The compensator, from ``inputs`` to ``outputs``; a sampled one has its period.
        inputs: Plant outputs that are measured, in the order of the columns.
        outputs: Plant inputs that are driven, in the order of the rows.
        method: Name of the design method; empty if unknown.
        applied: Input matrix of the applied command, less the one asked for, in the states' equation: that of
            the plant for an observer, which then estimates from the commands of a limited actuator.
            None for a compensator that does not know of limits.

    Raises `ConfigError` where the ports do not fit the compensator, for a port named twice, and for a gain
    that is not finite.
    """

    dynamics: LinearSystem
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    method: str = dataclasses.field(default="", kw_only=True)
    applied: Float[np.ndarray, "state output"] | None = dataclasses.field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        hint = "Compensator(StateSpace(A, B, C, D), inputs, outputs), inputs and outputs of Port(name, unit)"
        require_kind(self.dynamics, LinearSystem, "law's dynamics", hint)
        for port in (*self.inputs, *self.outputs):
            require_kind(port, Port, "port", hint)
        if self.dynamics.D.shape != (len(self.outputs), len(self.inputs)):
            raise ConfigError(
                f"a compensator with {len(self.outputs)} outputs and {len(self.inputs)} inputs named; "
                f"its dynamics has {self.dynamics.D.shape}",
                hint="one output for each row of D, one input for each column",
            )
        for verb, ports in (("reads", self.inputs), ("drives", self.outputs)):
            names = [port.name for port in ports]
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise ConfigError(
                    f"the compensator {verb} {twice[0]!r} twice", hint="sum its columns (or rows) into one"
                )
        paths = () if self.applied is None else (self.applied,)
        for path in paths:
            if path.shape != (len(self.dynamics.A), len(self.outputs)):
                raise ConfigError(
                    f"a path of applied commands of {path.shape} for {len(self.dynamics.A)} states and "
                    f"{len(self.outputs)} outputs",
                    hint="one row for each state, one column for each output",
                )
        matrices = [*(getattr(self.dynamics, name) for name in "ABCD"), *paths]
        if not all(np.isfinite(matrix).all() for matrix in matrices):
            raise ConfigError(
                "the compensator has a gain that is not finite", hint="look for NaN or inf in A, B, C and D"
            )

    @property
    def period_s(self) -> float | None:
        """Time from one sample to the next [s]; None for a continuous compensator."""
        return self.dynamics.period_s

    @property
    def system(self) -> StateSpace:
        """The continuous system; raises `ConfigError` for a sampled compensator."""
        if isinstance(self.dynamics, SampledStateSpace):
            rate = 1.0 / self.dynamics.period_s
            raise ConfigError(
                f"a compensator sampled at {rate:g} Hz where a continuous one is asked for",
                hint="the continuous design; measure_margins and qualify_compensator take both",
            )
        return self.dynamics

    @property
    def sampled(self) -> SampledStateSpace:
        """The sampled system; raises `ConfigError` for a continuous compensator."""
        if not isinstance(self.dynamics, SampledStateSpace):
            raise ConfigError(
                "a continuous compensator where a sampled one is asked for",
                hint="emulate(compensator, period_s)",
            )
        return self.dynamics


def locate_ports(
    compensator: Compensator | FrequencyResponse,
    inputs: Sequence[Port],
    outputs: Sequence[Port],
    owner: str = "plant",
) -> tuple[list[int], list[int]]:
    """Positions of the compensator's outputs among ``inputs``, and of its inputs among ``outputs``.

    Raises `ConfigError` for a port that ``owner`` does not have, or has in another unit; a port without a
    unit fits any.
    """
    return (
        _locate(compensator.outputs, inputs, "drives", "input", owner),
        _locate(compensator.inputs, outputs, "reads", "output", owner),
    )


def _locate(wanted: Sequence[Port], there: Sequence[Port], verb: str, side: str, owner: str) -> list[int]:
    units, names = {port.name: port.unit for port in there}, [port.name for port in there]
    missing = [port.name for port in wanted if port.name not in units]
    if missing:
        raise ConfigError(
            f"the compensator {verb} {', '.join(missing)}; the {owner} has no such {side}",
            hint=f"a {owner} with it; this one has {', '.join(names)}",
        )
    for port in wanted:
        unit = units[port.name]
        if port.unit and unit and port.unit != unit:
            raise ConfigError(
                f"the compensator {verb} {port.name} in {port.unit}, the {owner} has it in {unit}",
                hint="scale one of them",
            )
    return [names.index(port.name) for port in wanted]


def arrange_ports(compensator: Compensator, y: Sequence[Port], u: Sequence[Port]) -> Compensator:
    """The same compensator with its ports in the order of a plant's groups ``y`` and ``u``.

    Raises `ConfigError` where they are not the same ports, or in other units.
    """
    names = [[p.name for p in side] for side in (compensator.inputs, compensator.outputs, y, u)]
    reads, drives, measured, driven = names
    if sorted(reads) != sorted(measured) or sorted(drives) != sorted(driven):
        raise ConfigError(
            f"the compensator reads {', '.join(reads)} and drives {', '.join(drives)}; the plant's groups y "
            f"and u are {', '.join(measured)} and {', '.join(driven)}",
            hint="group_ports(plant, u=, y=) with the compensator's ports; weights go by these groups",
        )
    locate_ports(compensator, u, y)
    columns, rows = [reads.index(name) for name in measured], [drives.index(name) for name in driven]
    return dataclasses.replace(
        compensator,
        dynamics=compensator.dynamics.select(columns, rows),
        applied=None if compensator.applied is None else compensator.applied[:, rows],
        inputs=tuple(compensator.inputs[i] for i in columns),
        outputs=tuple(compensator.outputs[i] for i in rows),
    )


def measured_ports(plant: Plant) -> tuple[Port, ...]:
    """The ports a compensator of ``plant`` reads: its group y."""
    return tuple(plant.outputs[i] for i in plant.output_indices(plant.y))


def driven_ports(plant: Plant) -> tuple[Port, ...]:
    """The ports a compensator of ``plant`` drives: its group u."""
    return tuple(plant.inputs[i] for i in plant.input_indices(plant.u))


def idle_compensator(plant: Plant) -> Compensator:
    """A compensator of zero gain: the loop stays open."""
    inputs, outputs = measured_ports(plant), driven_ports(plant)
    return Compensator(gain_system(np.zeros((len(outputs), len(inputs)))), inputs, outputs)


def evaluate_compensator(
    compensator: Compensator, frequency_hz: Float[np.ndarray, " line"]
) -> FrequencyResponse:
    """The compensator's frequency response at ``frequency_hz``."""
    frequency_hz = np.asarray(frequency_hz, dtype=float)
    H = statespace_response(compensator.dynamics, 2.0 * np.pi * frequency_hz)
    held = compensator.period_s or 0.0
    return FrequencyResponse(
        frequency_hz=frequency_hz, H=H, inputs=compensator.inputs, outputs=compensator.outputs, hold_s=held
    )


def require_loop(plant: object, compensator: object) -> None:
    """Raise `ConfigError` for values other than a plant and its compensator."""
    require_plant(plant)
    hint = "the compensator behind the plant; Compensator(system, inputs, outputs)"
    require_kind(compensator, Compensator, "compensator", hint)
