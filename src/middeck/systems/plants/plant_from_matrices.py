"""Plants from state-space matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace

Matrix = np.ndarray | Sequence[Sequence[float]]


@named_kinds
def make_plant(
    A: Matrix,
    B: Matrix,
    C: Matrix,
    D: Matrix | None = None,
    *,
    inputs: Sequence[Port | str] = (),
    outputs: Sequence[Port | str] = (),
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
    state_names: Sequence[str] = (),
    delay_s: float | Float[np.ndarray, "output input"] = 0.0,
    period_s: float | None = None,
) -> Plant:
    """The plant x' = A x + B u, y = C x + D u with named ports.

    Args:
        D: Zero if None.
        inputs, outputs: One for each column of B and row of C: a `Port`, or a name with its unit as ``"torque
            [N m]"``; u1, u2 ... and y1, y2 ... if left out.
        w, u, z, y, state_names: As in `Plant`.
        delay_s: Delay [s] of all paths, or of each.
        period_s: Sampling period of a sampled plant x[k+1] = A x[k] + B u[k]; None for a continuous one.

    Raises `ConfigError` for matrices, names, groups or delays that do not fit, numbers that are not finite,
    and a period that is not positive.

    >>> A, B, C = [[0, 1], [0, 0]], [[0], [2]], [[1, 0]]
    >>> body = make_plant(A, B, C, inputs=["torque [N m]"], outputs=["angle [rad]"])
    >>> body.inputs[0].unit, body.system.D.tolist()
    ('N m', [[0.0]])
    """
    real = {name: _matrix(name, value) for name, value in (("A", A), ("B", B), ("C", C))}
    shape = len(real["C"]), real["B"].shape[1]
    real["D"] = np.zeros(shape) if D is None else _matrix("D", D)
    period = None if period_s is None else _period(period_s)
    try:
        dynamics = StateSpace(**real) if period is None else SampledStateSpace(**real, period_s=period)
    except ConfigError as error:
        raise ConfigError(
            f"the matrices do not fit: {error.where}: {error.what}",
            where="make_plant",
            hint="A n x n, B n x m, C p x n, D p x m",
        ) from None
    plant = Plant(
        dynamics=dynamics,
        inputs=_ports("inputs", "u", inputs, shape[1]),
        outputs=_ports("outputs", "y", outputs, shape[0]),
        w=_names("w", w),
        u=_names("u", u),
        z=_names("z", z),
        y=_names("y", y),
        state_names=_names("state_names", state_names),
    )
    delays = _delays(delay_s, shape)
    return delay_plant(plant, delays) if np.any(delays) else plant


def _numbers(name: str, value: Any) -> np.ndarray:
    try:
        array = np.asarray(value)
    except ValueError:
        array = np.empty(0, dtype=object)
    if np.ma.isMaskedArray(value) or array.dtype.kind not in "fiu" or not np.isfinite(array).all():
        raise ConfigError(
            f"{name} is not of finite real numbers, in rows of one length", where="make_plant",
            hint=f"{name}=[[1.0, 0.0], [0.0, 1.0]] or a plain array, no text, complex or sparse numbers",
        )  # fmt: skip
    return array.astype(float)


def _matrix(name: str, value: Any) -> np.ndarray:
    matrix = _numbers(name, value)
    if matrix.ndim != 2:
        raise ConfigError(
            f"{name} has {matrix.ndim} dimensions", where="make_plant", hint=f"two: {name}=[[...], [...]]"
        )
    return matrix


def _delays(delay_s: Any, shape: tuple[int, int]) -> np.ndarray:
    delays = _numbers("delay_s", delay_s)
    if delays.ndim and delays.shape != shape:
        raise ConfigError(
            f"delay_s has shape {delays.shape}", where="make_plant",
            hint=f"one number, or {shape[0]} rows of outputs with {shape[1]} columns of inputs",
        )  # fmt: skip
    return delays


def _period(period_s: Any) -> float:
    if isinstance(period_s, bool) or not isinstance(period_s, int | float | np.floating | np.integer):
        raise ConfigError("period_s is not one number", where="make_plant", hint="seconds, or None")
    if not (np.isfinite(period_s) and period_s > 0.0):
        raise ConfigError(
            f"a sampling period of {period_s} s", where="make_plant", hint="> 0 s, or None if continuous"
        )
    return float(period_s)


def _names(what: str, names: Any) -> tuple[str, ...]:
    if (
        isinstance(names, str)
        or not isinstance(names, Sequence)
        or not all(isinstance(n, str) for n in names)
    ):
        raise ConfigError(f"{what} is not a list of names", where="make_plant", hint=f'{what}=["angle"]')
    return tuple(names)


def _ports(side: str, letter: str, given: Any, count: int) -> tuple[Port, ...]:
    if isinstance(given, str | Port) or not isinstance(given, Sequence):
        raise ConfigError(
            f"{side} is not a list of ports",
            where="make_plant",
            hint=f'{side}=["torque [N m]"], or Port(...)',
        )
    ports = tuple(_port(side, each) for each in given) or name_ports(letter, count)
    names = [port.name for port in ports]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigError(f"two {side} named {', '.join(twice)}", where="make_plant", hint="a name for each")
    return ports


def _port(side: str, given: Any) -> Port:
    if isinstance(given, Port):
        return given
    name, bracket, unit = given.partition("[") if isinstance(given, str) else ("", "", "")
    closed = unit.endswith("]") and unit.count("]") == 1 if bracket else "]" not in name
    if not name.strip() or not closed:
        raise ConfigError(
            f"{given!r} is no port",
            where=f"make_plant, {side}",
            hint="a name and its unit, as 'torque [N m]'",
        )
    return Port(name.strip(), unit.removesuffix("]").strip())


def name_ports(letter: str, count: int) -> tuple[Port, ...]:
    """``count`` ports without a unit, numbered from one.

    >>> [port.name for port in name_ports("u", 2)]
    ['u1', 'u2']
    """
    return tuple(Port(f"{letter}{i}", "") for i in range(1, count + 1))
