"""Sampled systems in time: stepping, and the state from which a periodic input gives a periodic output."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import NumericalError
from middeck.systems.statespace import SampledStateSpace


def simulate(
    system: SampledStateSpace,
    u: Float[np.ndarray, "sample input"],
    start: Float[np.ndarray, " state"] | None = None,
) -> tuple[Float[np.ndarray, "sample output"], Float[np.ndarray, " state"]]:
    """Outputs y[k] = C x[k] + D u[k] and the state after the last sample, from ``start`` (zero if None).

    >>> import numpy as np
    >>> y, x = simulate(SampledStateSpace([[0.5]], [[1.0]], [[1.0]], [[0.0]], 1.0), np.ones((3, 1)))
    >>> y.ravel(), x
    (array([0. , 1. , 1.5]), array([1.75]))
    """
    u = np.asarray(u, dtype=float)
    A = np.ascontiguousarray(system.A)
    drive = u @ system.B.T
    states = np.empty((len(u) + 1, len(A)))
    states[0] = 0.0 if start is None else start
    for k in range(len(u)):
        np.dot(A, states[k], out=states[k + 1])
        states[k + 1] += drive[k]
    return states[:-1] @ system.C.T + u @ system.D.T, states[-1].copy()


def find_periodic_state(
    system: SampledStateSpace, u: Float[np.ndarray, "sample input"]
) -> Float[np.ndarray, " state"]:
    """The state x0 at the start of a steady period of ``u``: x0 = A^N x0 + (one period from rest).

    Raises `NumericalError` for a system with a pole that repeats itself after N samples (a rigid-body mode,
    an undamped one on a line): it has no steady state.
    """
    _, end = simulate(system, u)
    left = np.eye(len(system.A)) - np.linalg.matrix_power(system.A, len(u))
    # 1e12: a steady state good to four digits at least; a mode short of that does not settle in a lifetime.
    if len(left) and np.linalg.cond(left) > 1e12:
        raise NumericalError(
            "no periodic steady state: a pole repeats itself from period to period",
            hint="hold the rigid-body modes, or start from rest",
        )
    return np.linalg.solve(left, end)
