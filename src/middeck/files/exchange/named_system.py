"""The exchanged value: a linear system, continuous or sampled, with the names of its ports and states."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, name_states
from middeck.systems.plants.plant_from_matrices import name_ports
from middeck.systems.state_space.statespace import LinearSystem, SampledStateSpace, StateSpace, System

Exchangeable = LinearSystem | Plant | Compensator


def matrices_of(plant: Plant) -> LinearSystem:
    """A plant's state space; raises `ConfigError` for one with delays."""
    return plant.system if plant.period_s is None else plant.sampled


def exchanged(value: Exchangeable, *, negative_feedback: bool = False) -> Plant:
    """``value`` as a plant of four matrices; a bare system's ports are u1, u2 ... and y1, y2 ...

    ``negative_feedback`` turns the sign of a compensator, for programs in which u = -K y.

    Raises `ConfigError` for a number that is not finite, ``negative_feedback`` of another kind than a
    compensator, a plant with delays, and a value of another kind.

    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> [port.name for port in exchanged(lag).outputs]
    ['y1']
    """
    found = _as_plant(value)
    system = matrices_of(found)
    require_finite(system)
    if not negative_feedback:
        return found
    if not isinstance(value, Compensator):
        raise ConfigError(
            f"negative_feedback turns the sign of a compensator; this is a {type(value).__name__}",
            hint="leave it out",
        )
    return dataclasses.replace(found, dynamics=negated(system))


def _as_plant(value: Exchangeable) -> Plant:
    match value:
        case Plant():
            return dataclasses.replace(value, dynamics=matrices_of(value), state_names=name_states(value))
        case Compensator():
            return Plant(dynamics=value.dynamics, inputs=value.inputs, outputs=value.outputs)
        case StateSpace() | SampledStateSpace():
            outputs, inputs = value.D.shape
            return Plant(dynamics=value, inputs=name_ports("u", inputs), outputs=name_ports("y", outputs))
        case _:
            raise ConfigError(
                f"a {type(value).__name__} cannot be exchanged", hint="a system, a plant or a compensator"
            )


def negated(system: System) -> System:
    """The system with negated outputs."""
    # 0.0 - x, since -0.0 would come back as another zero.
    return dataclasses.replace(system, C=0.0 - system.C, D=0.0 - system.D)


def require_finite(system: LinearSystem) -> None:
    """Raise `ConfigError` naming the matrix with a number that is not finite."""
    for name in "ABCD":
        if not np.isfinite(getattr(system, name)).all():
            raise ConfigError(f"{name} has a number that is not finite", hint="exchange finite systems only")


def known_ports(names: Sequence[str], like: Sequence[Port]) -> tuple[Port, ...]:
    """Ports of these names, with unit and transducer of their namesakes in ``like``."""
    known = {port.name: port for port in like}
    return tuple(known.get(name, Port(name, "")) for name in names)


def as_compensator(plant: Plant, *, negative_feedback: bool = False) -> Compensator:
    """The system as a compensator, added at the plant's inputs; ``negative_feedback``: made for u = -K y."""
    system = matrices_of(plant)
    return Compensator(negated(system) if negative_feedback else system, plant.inputs, plant.outputs)
