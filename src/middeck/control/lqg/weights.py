"""Weights and noise intensities of LQG designs, and their shaping: filters, integral action, correlation."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from middeck.control.loop.performance import require_intensity, require_one_each
from middeck.errors import ConfigError
from middeck.signals.ports import require_names
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.stability import growth_rates
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

PortFilters = tuple[tuple[str, StateSpace], ...]
"""Port name and the filter at it."""


@record(kw_only=True)
class LQGWeights:
    """Weights of the cost E[z' W^2 z + rho u' diag(input) u], and noise intensities.

    Attributes:
        output: Weight W of each performance output, in the order of the plant's group z (z is multiplied by
            it).
        input: Weight of each squared control input, in the order of the group u.
        disturbed: Names of the inputs on which white process noise acts.
        process: Its two-sided intensity matrix [unit^2/Hz], in that order.
        sensor: Two-sided intensity [unit^2/Hz] of each measurement's white noise, in the order of the group
            y. Process and sensor noise are independent.
    """

    output: Float[np.ndarray, " z"]
    input: Float[np.ndarray, " u"]
    disturbed: tuple[str, ...]
    process: Float[np.ndarray, "w w"]
    sensor: Float[np.ndarray, " y"]

    def __post_init__(self) -> None:
        require_names(self.disturbed, "disturbed")
        if len(self.disturbed) != len(self.process):
            raise ConfigError(
                f"{len(self.disturbed)} disturbed inputs for {len(self.process)} intensities",
                hint="one row and column of the process intensity for each name in disturbed",
            )
        if not all(np.all(np.isfinite(a)) for a in (self.output, self.input, self.process, self.sensor)):
            raise ConfigError(
                "a weight or an intensity is not a finite number",
                hint="finite ones; 0 for an output left alone",
            )
        if not np.all(self.input > 0.0):
            raise ConfigError(
                "an input weight is not positive: the control would be unbounded",
                hint="give every input a positive weight, or remove it from u",
            )
        if not np.all(self.sensor > 0.0):
            raise ConfigError(
                "a sensor noise intensity is not positive: the filter would be singular",
                hint="give every measurement some noise, or remove it from y",
            )
        require_intensity("the process intensity", self.process)


def require_sizes(weights: LQGWeights, plant: Plant) -> None:
    """Raise `ConfigError` unless there is one weight, or intensity, for each port of its group."""
    for what, given, group in (
        ("output weights", weights.output, plant.z),
        ("input weights", weights.input, plant.u),
        ("sensor intensities", weights.sensor, plant.y),
    ):
        if not group:
            raise ConfigError(
                f"{len(given)} {what}, but that group of the plant is empty",
                hint="name its groups: w=, u=, z=, y=",
            )
        require_one_each(what, len(given), group)


@record(kw_only=True)
class Shaping:
    """Dynamic weights, coloured disturbances, integral action and correlated noise of one design.

    Attributes:
        outputs: Filters by name of a performance output: the filtered z is weighted (Gupta 1980, J. Guidance
            and Control 3, "Frequency-shaped cost functionals"). One input and one output each.
        inputs: Filters by name of a control input: the filtered u is weighted. A direct term is required, or
            u would have no cost at high frequency.
        colours: Filters by name of a disturbed input, through which its white noise passes. One output;
            several inputs are independent noises, each of the port's intensity, as `sum_spectra` returns
            them.
        integral: Measured outputs whose integral is weighted too, by this weight [1/s]; each gives the
            compensator a pole at exactly zero.
        cross: Two-sided intensity of process noise with sensor noise, E[w v'], in the order of ``disturbed``
            and y.
    """

    outputs: PortFilters = ()
    inputs: PortFilters = ()
    colours: PortFilters = ()
    integral: tuple[tuple[str, float], ...] = ()
    cross: Float[np.ndarray, "w y"] | None = None

    def __post_init__(self) -> None:
        for group in (self.outputs, self.inputs, self.colours, self.integral):
            names = [name for name, _ in group]
            if len(set(names)) < len(names):
                raise ConfigError(
                    f"a port is shaped twice: {', '.join(names)}", hint="put the filters in series"
                )
        for name, system in (*self.outputs, *self.inputs):
            _require_stable(name, system)
            if system.D.shape != (1, 1):
                raise ConfigError(
                    f"the weight on {name} has {system.D.shape} outputs and inputs, not one of each",
                    hint="one filter with one input and one output for each port",
                )
        for name, system in self.inputs:
            if system.D[0, 0] == 0.0:
                raise ConfigError(
                    f"the weight on {name} has no direct term: fast control would cost nothing",
                    hint="as many zeros as poles, e.g. (s + a)/(s + b)",
                )
        for name, system in self.colours:
            _require_stable(name, system)
            if len(system.D) != 1:
                raise ConfigError(
                    f"the colour of {name} has {len(system.D)} outputs, not one",
                    hint="a filter with one output, driven by white noise",
                )
        if any(not weight > 0.0 for _, weight in self.integral):
            raise ConfigError(
                "the weight of an integral is not positive", hint="give it a positive weight, or leave it out"
            )


def _require_stable(name: str, system: StateSpace) -> None:
    if np.any(np.real(growth_rates(system)) >= 0.0):
        raise ConfigError(
            f"the filter at {name} is not stable",
            hint="poles left of the axis; for zero steady-state error use integral action",
        )


def pick(filters: PortFilters, names: Iterable[str]) -> list[StateSpace | None]:
    """The filter of each port of ``names``, None where it has none.

    Raises `ConfigError` for a filter at a port that is not there.
    """
    known, ports = dict(filters), list(names)
    missing = [name for name in known if name not in ports]
    if missing:
        raise ConfigError(f"no port {missing[0]!r} to shape", hint=f"one of {', '.join(ports)}")
    return [known.get(name) for name in ports]


def require_states(states: int) -> None:
    """Raise `ConfigError` for a model without states."""
    if not states:
        raise ConfigError(
            "nothing to design for: no state of the plant is moved by an input or seen by an output",
            hint="a plant with dynamics, other inputs or outputs, or colours of the noise",
        )
