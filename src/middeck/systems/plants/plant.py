"""Plants: linear models with named ports, grouped w u z y as in the paper's Figure 8."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.signals.ports import Port, port_indices, require_names
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from middeck.values import record, require_kind

Dynamics = ModalSystem | StateSpace | SampledStateSpace


def _none() -> np.ndarray:
    return np.zeros((0, 0))


@record(kw_only=True)
class Plant:
    """A linear time-invariant model between named inputs and outputs, continuous or sampled.

    Attributes:
        dynamics: Modal form where the model has one (from a structure), otherwise a state space; a sampled
            one has its period.
        inputs, outputs: Ports in the order of the columns and rows.
        w, u: Names of the inputs that disturb and of those that control.
        z, y: Names of the outputs to be kept small and of those fed back. A port may be in several groups.
        state_names: Mode or part of each state (a mode's two states carry its name); empty if unknown or in
            modal form.
        delay_s: Delay [s] of each path, exact and beside the states; all zero if it is left out. The delays
            of a sampled plant are among its states.

    Raises `ConfigError` for ports or state names that do not fit the dynamics, groups of unknown ports, and
    delays of another shape, negative, not finite, or of a sampled plant.
    """

    dynamics: Dynamics
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    w: tuple[str, ...] = ()
    u: tuple[str, ...] = ()
    z: tuple[str, ...] = ()
    y: tuple[str, ...] = ()
    state_names: tuple[str, ...] = ()
    delay_s: Float[np.ndarray, "output input"] = dataclasses.field(default_factory=_none)

    def __post_init__(self) -> None:
        for group in ("w", "u", "z", "y"):
            require_names(getattr(self, group), group)
        ports = len(self.outputs), len(self.inputs)
        states, sizes = self.dynamics.order, self.dynamics.shape
        if sizes != ports:
            raise ConfigError(
                f"{ports[0]} outputs and {ports[1]} inputs named, the dynamics has {sizes[0]} and {sizes[1]}",
                hint="one port for each row of C and each column of B",
            )
        if self.state_names and len(self.state_names) != states:
            raise ConfigError(
                f"{len(self.state_names)} state names for {states} states", hint="one for each, or none"
            )
        port_indices(self.inputs, (*self.w, *self.u), "input")
        port_indices(self.outputs, (*self.z, *self.y), "output")
        if not np.any(self.delay_s):
            none = np.zeros(ports)
            none.setflags(write=False)
            object.__setattr__(self, "delay_s", none)
        _check_delays(self.delay_s, ports, self.period_s)

    @property
    def period_s(self) -> float | None:
        """Time from one sample to the next [s]; None for a continuous plant."""
        return self.dynamics.period_s

    @property
    def delayed(self) -> bool:
        """Whether any path has a delay beside the states."""
        return bool(np.any(self.delay_s))

    @property
    def modal(self) -> ModalSystem | None:
        """The modal form, where the plant has one."""
        return self.dynamics if isinstance(self.dynamics, ModalSystem) else None

    @property
    def continuous(self) -> ModalSystem | StateSpace:
        """The dynamics, delays apart; raises `ConfigError` for a sampled plant."""
        if isinstance(self.dynamics, SampledStateSpace):
            raise ConfigError(
                f"a plant sampled at {1.0 / self.dynamics.period_s:g} Hz where a continuous one is asked for",
                hint="the continuous plant; sampled designs and verdicts sample it",
            )
        return self.dynamics

    @property
    def rational(self) -> ModalSystem | StateSpace:
        """The dynamics of a continuous plant without delays; raises `ConfigError` for others."""
        if self.delayed:
            raise ConfigError(
                "a plant with exact delays where one without is asked for",
                hint="approximate_delays(plant, 3) or remove_delays(plant); verdicts take it as it is",
            )
        return self.continuous

    @property
    def system(self) -> StateSpace:
        """The plant as a continuous state space (computed, not stored).

        Raises `ConfigError` for a sampled plant and for one with delays, which no finite state space has.
        """
        return self.rational.as_statespace()

    @property
    def sampled(self) -> SampledStateSpace:
        """The plant as a sampled state space; raises `ConfigError` for a continuous one."""
        if not isinstance(self.dynamics, SampledStateSpace):
            raise ConfigError(
                "a continuous plant where a sampled one is asked for", hint="sample_plant(plant, period_s)"
            )
        return self.dynamics

    def input_indices(self, names: Sequence[str]) -> list[int]:
        """Columns of the inputs ``names``."""
        return port_indices(self.inputs, names, "input")

    def output_indices(self, names: Sequence[str]) -> list[int]:
        """Rows of the outputs ``names``."""
        return port_indices(self.outputs, names, "output")


def _check_delays(delay_s: np.ndarray, ports: tuple[int, int], period_s: float | None) -> None:
    if delay_s.shape != ports or not np.all((delay_s >= 0.0) & np.isfinite(delay_s)):
        raise ConfigError(
            f"delays of shape {delay_s.shape} for {ports} outputs and inputs, or one is negative",
            hint="one delay of zero or more for each path",
        )
    if period_s is not None and np.any(delay_s):
        raise ConfigError(
            "a sampled plant with delays beside its states",
            hint="sample_plant(plant, period_s) of the continuous plant puts them among the states",
        )


def name_states(plant: Plant) -> tuple[str, ...]:
    """The mode (or other part) that each state belongs to; ``"state 3"`` where nothing is known."""
    dynamics = plant.dynamics
    return dynamics.state_names or plant.state_names or tuple(f"state {i}" for i in range(dynamics.order))


def require_modal(plant: Plant) -> ModalSystem:
    """The modal form of a plant; raises `ConfigError` where it has none."""
    if plant.modal is None:
        raise ConfigError("a plant that is not in modal form", hint="build_plant keeps modal form")
    return plant.modal


@named_kinds
def remove_delays(plant: Plant) -> Plant:
    """The plant with all delays zero."""
    return dataclasses.replace(plant, delay_s=_none())


@named_kinds
def delay_plant(plant: Plant, delay_s: float | Float[np.ndarray, "output input"]) -> Plant:
    """The plant with an additional ``delay_s`` [s], one for all paths or one for each.

    Raises `ConfigError` where a delay would be negative, and for a sampled plant.

    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> delay_plant(Plant(dynamics=lag, inputs=(Port("force", "N"),), outputs=(Port("way", "m"),)),
    ...     0.01).delay_s.tolist()
    [[0.01]]
    """
    return dataclasses.replace(plant, delay_s=plant.delay_s + delay_s)


def select_ports(plant: Plant, inputs: Sequence[str], outputs: Sequence[str]) -> Plant:
    """The plant from ``inputs`` to ``outputs``, by name, in the form of the whole; groups are dropped."""
    columns, rows = plant.input_indices(inputs), plant.output_indices(outputs)
    return Plant(
        dynamics=plant.dynamics.select(columns, rows),
        inputs=tuple(plant.inputs[i] for i in columns),
        outputs=tuple(plant.outputs[i] for i in rows),
        state_names=plant.state_names,
        delay_s=plant.delay_s[np.ix_(rows, columns)],
    )


def group_ports(
    plant: Plant,
    *,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> Plant:
    """The plant with these groups; raises `ConfigError` for ports that do not exist."""
    return dataclasses.replace(plant, w=tuple(w), u=tuple(u), z=tuple(z), y=tuple(y))


def subsystem(plant: Plant, inputs: Sequence[str], outputs: Sequence[str]) -> StateSpace:
    """The continuous state space from ``inputs`` to ``outputs``, by name."""
    return select_ports(plant, inputs, outputs).system


def require_plant(value: object) -> None:
    """Raise `ConfigError` where another kind of value stands in place of a plant."""
    require_kind(value, Plant, "plant", "the plant first; make_plant and build_plant make one")
