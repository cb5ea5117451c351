"""scipy.signal: `lti` and `dlti` systems, which know no names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.files.exchange.named_system import Exchangeable, exchanged, matrices_of
from middeck.files.exchange.transfer_functions import (
    build_foreign,
    real_matrix,
    realise_ratio,
    realise_roots,
    settle_period,
    with_delay,
)
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.plants.plant_from_matrices import name_ports
from middeck.systems.state_space.statespace import LinearSystem, SampledStateSpace


def to_scipy(value: Exchangeable, *, negative_feedback: bool = False) -> Any:
    """``value`` as a `scipy.signal.StateSpace`, of ``dt`` if it is sampled; names are lost.

    The sign of a compensator is that of this house, u = K y added; ``negative_feedback=True`` gives -K.

    >>> from middeck.systems.state_space.statespace import StateSpace
    >>> to_scipy(StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])).A
    array([[-1.]])
    """
    import scipy.signal

    system = matrices_of(exchanged(value, negative_feedback=negative_feedback))
    matrices = system.A, system.B, system.C, system.D
    if isinstance(system, SampledStateSpace):
        return scipy.signal.StateSpace(*matrices, dt=system.period_s)
    return scipy.signal.StateSpace(*matrices)


def from_scipy(
    system: Any,
    *,
    inputs: Sequence[Port] = (),
    outputs: Sequence[Port] = (),
    state_names: Sequence[str] = (),
    period_s: float | None = None,
    delay_s: float | Float[np.ndarray, "output input"] = 0.0,
) -> Plant:
    """A `StateSpace`, `TransferFunction` or `ZerosPolesGain` of scipy.signal, continuous or sampled.

    Ports without a name are u1, u2 ... and y1, y2 ... Poles and zeros become a chain of sections of second
    order, not coefficients of high order. ``period_s`` is for a ``dlti`` whose dt is True;
    ``delay_s`` [s] is that of all paths of a continuous system, or of each, and is kept exact.

    Raises `ConfigError` for a complex or improper system, an open sampling period, a delay that is negative
    or of a sampled system, names that are not as many as the ports, or an object that is none of these.
    """
    import scipy.signal

    what = type(system).__name__.removesuffix("Continuous").removesuffix("Discrete")
    if not isinstance(system, scipy.signal.lti | scipy.signal.dlti):
        raise ConfigError(f"{what} is no system of scipy.signal", hint="scipy.signal.lti or dlti")
    # A continuous system has dt None there.
    continuous = isinstance(system, scipy.signal.lti)
    period = settle_period(0 if continuous else system.dt, period_s, what)
    found = _matrices(system, period, what)
    rows, columns = found.D.shape
    ports = tuple(inputs) or name_ports("u", columns), tuple(outputs) or name_ports("y", rows)
    plant = Plant(dynamics=found, inputs=ports[0], outputs=ports[1], state_names=tuple(state_names))
    return with_delay(plant, delay_s)


def _matrices(system: Any, period: float | None, what: str) -> LinearSystem:
    import scipy.signal

    match system:
        case scipy.signal.TransferFunction():
            if np.ndim(cast("Any", system).num) > 1:
                raise ConfigError("one input to several outputs", where=what, hint="system.to_ss() first")
            found = realise_ratio(system.num, system.den, what)
        case scipy.signal.ZerosPolesGain():
            form = cast("Any", system)
            gain = float(real_matrix(form.gain, f"{what}, gain"))
            found = realise_roots(np.atleast_1d(form.zeros), np.atleast_1d(form.poles), gain, what)
        case _:
            found = system
    return build_foreign({name: getattr(found, name) for name in "ABCD"}, period, what)
