"""What is exchanged: a linear system, continuous or sampled, with the names of its ports and states."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.control.law.sampled_compensator import SampledCompensator
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plant import Plant, name_states
from middeck.systems.sampled_plant import SampledPlant
from middeck.systems.statespace import SampledStateSpace, StateSpace
from middeck.values import record


@record
class NamedSystem:
    """A system with names, as other programs know it.

    Parameters
    ----------
    system:
        The matrices; a `SampledStateSpace` has its period.
    inputs, outputs:
        Ports; their unit is empty where the other side has none.
    state_names:
        What each state belongs to; empty if unknown.
    """

    system: StateSpace | SampledStateSpace
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    state_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        ports = len(self.outputs), len(self.inputs)
        if ports != self.system.D.shape:
            raise ConfigError(
                f"{ports[0]} outputs and {ports[1]} inputs named, the system has {self.system.D.shape}",
                hint="a name for each port",
            )
        if self.state_names and len(self.state_names) != len(self.system.A):
            raise ConfigError(f"{len(self.state_names)} names for {len(self.system.A)} states")


AnyCompensator = Compensator | SampledCompensator
Exchangeable = StateSpace | SampledStateSpace | Plant | SampledPlant | AnyCompensator | NamedSystem


def named_system(value: Exchangeable, *, negative_feedback: bool = False) -> NamedSystem:
    """``value`` as matrices and names; a bare system's ports are u1, u2 ... and y1, y2 ...

    ``negative_feedback`` turns the sign of a compensator, for programs in which u = -K y.

    Raises `ConfigError` for a number that is not finite, ``negative_feedback`` of what is no compensator, and
    for what is none of these at all.

    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> [port.name for port in named_system(lag).outputs]
    ['y1']
    """
    found = _named(value)
    require_finite(found.system)
    if not negative_feedback:
        return found
    if not isinstance(value, Compensator | SampledCompensator):
        raise ConfigError(
            f"negative_feedback turns the sign of a compensator; this is a {type(value).__name__}",
            hint="leave it out",
        )
    return dataclasses.replace(found, system=negated(found.system))


def _named(value: Exchangeable) -> NamedSystem:
    match value:
        case NamedSystem():
            return value
        case Plant():
            return NamedSystem(value.system, value.inputs, value.outputs, name_states(value))
        case SampledPlant():
            return NamedSystem(value.system, value.inputs, value.outputs, value.state_names)
        case Compensator() | SampledCompensator():
            return NamedSystem(value.system, value.inputs, value.outputs)
        case StateSpace() | SampledStateSpace():
            outputs, inputs = value.D.shape
            return NamedSystem(value, name_ports("u", inputs), name_ports("y", outputs))
        case _:  # pyright: ignore[reportUnnecessaryComparison]
            raise ConfigError(
                f"a {type(value).__name__} cannot be exchanged",
                hint="a system, a plant (approximate_delays for a delayed one) or a compensator",
            )


def name_ports(letter: str, count: int) -> tuple[Port, ...]:
    """``count`` ports without a unit, numbered from one.

    >>> [port.name for port in name_ports("u", 2)]
    ['u1', 'u2']
    """
    return tuple(Port(f"{letter}{i}", "") for i in range(1, count + 1))


def negated(system: StateSpace | SampledStateSpace) -> StateSpace | SampledStateSpace:
    """The system whose outputs have the other sign."""
    # 0.0 - x, since -0.0 would come back as another zero.
    return dataclasses.replace(system, C=0.0 - system.C, D=0.0 - system.D)


def require_finite(system: StateSpace | SampledStateSpace) -> None:
    """Raise `ConfigError` naming the matrix with a number that is not finite."""
    for name in "ABCD":
        if not np.isfinite(getattr(system, name)).all():
            raise ConfigError(f"{name} has a number that is not finite", hint="exchange finite systems only")


def known_ports(names: Sequence[str], like: Sequence[Port]) -> tuple[Port, ...]:
    """Ports of these names, with unit and transducer of their namesakes in ``like``."""
    known = {port.name: port for port in like}
    return tuple(known.get(name, Port(name, "")) for name in names)


def as_compensator(named: NamedSystem, *, negative_feedback: bool = False) -> AnyCompensator:
    """The system as a compensator, added at the plant's inputs; give True where it was made for u = -K y."""
    system = negated(named.system) if negative_feedback else named.system
    if isinstance(system, SampledStateSpace):
        return SampledCompensator(system, named.inputs, named.outputs, "")
    return Compensator(system, named.inputs, named.outputs)


def as_plant(
    named: NamedSystem,
    *,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> Plant | SampledPlant:
    """The system as a plant with these groups; raises `ConfigError` for ports that do not exist."""
    groups = tuple(w), tuple(u), tuple(z), tuple(y)
    system = named.system
    if isinstance(system, StateSpace):
        return Plant(system, named.inputs, named.outputs, *groups, named.state_names)
    names = named.state_names or tuple(f"state {i}" for i in range(len(system.A)))
    # The groups are checked by the plant of the same ports.
    gain = StateSpace(np.zeros((0, 0)), system.B[:0], system.C[:, :0], system.D)
    Plant(gain, named.inputs, named.outputs, *groups)
    return SampledPlant(system, named.inputs, named.outputs, *groups, names)
