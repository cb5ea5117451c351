"""A plant from one's own matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plant import Plant, delay_plant
from middeck.systems.statespace import SampledStateSpace, StateSpace

Matrix = np.ndarray | Sequence[Sequence[float]]


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

    Parameters
    ----------
    D:
        Zero if None.
    inputs, outputs:
        One for each column of B and row of C: a `Port`, or a name with its unit as ``"torque [N m]"``; u1, u2
        ... and y1, y2 ... if left out.
    w, u, z, y, state_names:
        As in `Plant`.
    delay_s:
        Delay [s] of all paths, or of each.
    period_s:
        Of a sampled plant x[k+1] = A x[k] + B u[k]; None for a continuous one.

    Raises
    ------
    ConfigError
        For matrices, names, groups or delays that do not fit, numbers that are not finite, and a period that
        is not positive.

    Examples
    --------
    >>> A, B, C = [[0, 1], [0, 0]], [[0], [2]], [[1, 0]]
    >>> body = make_plant(A, B, C, inputs=["torque [N m]"], outputs=["angle [rad]"])
    >>> body.inputs[0].unit, body.system.D.tolist()
    ('N m', [[0.0]])
    """
    real = {name: _real(name, value) for name, value in (("A", A), ("B", B), ("C", C))}
    real["D"] = np.zeros((len(real["C"]), real["B"].shape[1])) if D is None else _real("D", D)
    if period_s is not None and not (np.isfinite(period_s) and period_s > 0.0):
        raise ConfigError(f"a sampling period of {period_s} s", hint="> 0 s, or None for a continuous plant")
    try:
        dynamics = StateSpace(**real) if period_s is None else SampledStateSpace(**real, period_s=period_s)
    except ConfigError as error:
        raise ConfigError(
            f"the matrices do not fit: {error.where}: {error.what}", hint="A n x n, B n x m, C p x n, D p x m"
        ) from None
    ports = _ports("u", inputs, real["B"].shape[1]), _ports("y", outputs, len(real["C"]))
    groups = tuple(w), tuple(u), tuple(z), tuple(y)
    plant = Plant(dynamics, *ports, *groups, tuple(state_names))
    return delay_plant(plant, delay_s) if np.any(delay_s) else plant


def _real(name: str, value: Any) -> np.ndarray:
    matrix = np.asarray(value)
    if matrix.ndim != 2 or matrix.dtype.kind not in "fiub" or not np.isfinite(matrix).all():
        raise ConfigError(
            f"{name} is no matrix of finite real numbers", hint=f"{name}=[[...]], rows within brackets"
        )
    return matrix.astype(float)


def _ports(letter: str, given: Sequence[Port | str], count: int) -> tuple[Port, ...]:
    if not given:
        return name_ports(letter, count)
    return tuple(port if isinstance(port, Port) else _port(port) for port in given)


def _port(text: str) -> Port:
    name, bracket, unit = text.partition("[")
    if bracket and not unit.endswith("]"):
        raise ConfigError(f"a port {text!r}", hint="a name and its unit, as 'torque [N m]'")
    return Port(name.strip(), unit.removesuffix("]").strip())


def name_ports(letter: str, count: int) -> tuple[Port, ...]:
    """``count`` ports without a unit, numbered from one.

    >>> [port.name for port in name_ports("u", 2)]
    ['u1', 'u2']
    """
    return tuple(Port(f"{letter}{i}", "") for i in range(1, count + 1))
