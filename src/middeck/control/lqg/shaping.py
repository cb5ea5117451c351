"""Shaping of designs: filters at ports, integral action, correlated noise."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.systems.poles.stability import growth_rates
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

PortFilters = tuple[tuple[str, StateSpace], ...]
"""Port name and the filter at it."""


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
