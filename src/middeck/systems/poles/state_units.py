"""State units of a system: powers of two that even out inputs and outputs of each state.

Within a strongly connected part of A its own entries decide (`balance`). Between parts A fixes no unit, or of
integrators in chain only their product; there inputs and outputs decide, closed to loops by gains of one over
the gain of each path, which no unit of a state changes.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from jaxtyping import Float

from middeck.systems.poles.strong_components import strong_components
from middeck.systems.state_space.balancing import balance
from middeck.systems.state_space.statespace import LinearSystem, System

EVEN = 2.0**16
"""Ratio of state units above which states are converted: just above it results were 1e-5 to 1e-3
off. Positions and rates of a structure stay below, unless fast actuators are beside a slow body."""
NEGLIGIBLE, LARGER, WAYS = 1e-12, 1.1, 16
"""Share of a part's largest entry below which others may be rounding: where units beyond `EVEN` rest on such,
a part is balanced only until it is so much larger than the whole in balanced units, in so many steps. A
stiffness of 1e-17 of a free body asked for units of 3e8."""
ROUNDING = 1e-13
"""Share of a part of the states in each path from input to output below which it may be rounding of no share:
its unit stays as it is, and what drives or reads it is judged in that."""
KEPT = 64
"""Systems of which `state_units` keeps what it found: a gate often asks for a plant's and each fade's."""


def balance_states(system: System) -> System:
    """The same transfer function in states of comparable size (powers of two: exact)."""
    return in_units(system, state_units(system))


def in_units(system: System, unit: Float[np.ndarray, " state"]) -> System:
    """The system in states x / ``unit``."""
    A, B, C = system.A * unit / unit[:, None], system.B / unit[:, None], system.C * unit
    return dataclasses.replace(system, A=A, B=B, C=C)


def settle_states(system: System) -> System:
    """`balance_states` of a system whose units are beyond `EVEN`; others are unchanged."""
    unit = uneven_units(system)
    return system if unit is None else in_units(system, unit)


def uneven_units(system: LinearSystem) -> Float[np.ndarray, " state"] | None:
    """`state_units` of a system whose units are beyond `EVEN`; None for others."""
    unit = state_units(system)
    return unit if len(unit) and unit.max() > EVEN * unit.min() else None


@functools.lru_cache(maxsize=KEPT)
def state_units(system: LinearSystem) -> Float[np.ndarray, " state"]:
    """Units t of the states, x = t * x_balanced; those of A alone where paths are beyond floating point.

    >>> from middeck.systems.state_space.statespace import StateSpace
    >>> body = StateSpace([[0.0, 2.0**40], [0.0, 0.0]], [[0.0], [2.0**-60]], [[2.0**20, 0.0]], [[0.0]])
    >>> balance_states(body).A[0, 1], balance_states(body).B[1, 0]
    (np.float64(1.0), np.float64(1.0))
    """
    parts = strong_components(system.A)
    own = part_units(system.A, parts)
    with np.errstate(all="ignore"):
        unit = _whole_units(system, parts, own)
    if unit is None:
        whole = balance(system.A)[1]
        unit = own if _hang_on_rounding(system.A, whole) else whole
    unit.setflags(write=False)
    return unit


def part_units(A: Float[np.ndarray, "state state"], parts: list[np.ndarray]) -> Float[np.ndarray, " state"]:
    """Balanced units of the states within their strongly connected ``parts``, as far as no entry that may be
    rounding asks for them (`NEGLIGIBLE`).

    >>> A = np.array([[0.0, 1.0, 0.0], [1e-17, 0.0, 0.0], [0.0, 0.0, -1.0]])
    >>> part_units(A, [np.arange(2), np.array([2])])
    array([1., 1., 1.])
    """
    given = [A[np.ix_(part, part)] for part in parts]
    balanced = [balance(inside) for inside in given]
    size = LARGER * max((float(np.linalg.norm(inside)) for inside, _ in balanced), default=0.0)
    unit = np.ones(len(A))
    for part, inside, (_, own) in zip(parts, given, balanced, strict=True):
        for way in range(0 if _hang_on_rounding(inside, own) else WAYS, WAYS + 1):
            unit[part] = np.exp2(np.round(np.log2(own) * way / WAYS))
            if np.linalg.norm(inside * unit[part] / unit[part, None]) <= size:
                break
    return unit


def _hang_on_rounding(A: np.ndarray, unit: np.ndarray) -> bool:
    """Whether entries that may be rounding ask for such units (`NEGLIGIBLE`)."""
    size = np.abs(A)
    negligible = (size > 0.0) & (size < NEGLIGIBLE * size.max(initial=0.0))
    return bool(unit.max(initial=1.0) > EVEN * unit.min(initial=1.0) and negligible.any())


def _whole_units(
    system: LinearSystem, parts: list[np.ndarray], own: Float[np.ndarray, " state"]
) -> Float[np.ndarray, " state"] | None:
    """`state_units` of inputs and outputs too; None where those of A alone are even or all that is known."""
    if len(parts) < 2:
        return None
    unit, inside = own, [system.A[np.ix_(part, part)] for part in parts]
    rest = 0.0 if system.period_s is None else 1.0
    paces = [
        float(np.linalg.norm(A * own[part] / own[part, None] - rest * np.eye(len(A))))
        for part, A in zip(parts, inside, strict=True)
    ]
    pace = float(np.exp(np.mean(np.log([each for each in paces if each > 0.0] or [1.0]))))
    joined = np.zeros((len(parts), len(system.A)))
    for k, part in enumerate(parts):
        joined[k, part] = 1.0
    between = joined @ (np.abs(system.A) * unit / unit[:, None] / pace) @ joined.T
    np.fill_diagonal(between, 0.0)
    into = joined @ (np.abs(system.B) / unit[:, None] / pace)
    out = (np.abs(system.C) * unit) @ joined.T
    more = _units_between(between, into, out)
    if more is None or not len(more) or more.max() <= EVEN * more.min():
        return None
    unit = unit * (more @ joined)
    return unit if np.all(np.isfinite(unit) & (unit > 0.0)) else None


def _units_between(
    between: np.ndarray, into: np.ndarray, out: np.ndarray
) -> Float[np.ndarray, " part"] | None:
    """Units of parts in triangular order (``between`` is strictly upper triangular); None beyond range."""
    n, inputs = into.shape
    passed = np.linalg.inv(np.eye(n) - between)
    driven, read = passed @ into, out @ passed
    gain = out @ driven
    share = read[:, None, :] * driven.T[None]
    share = np.divide(share, gain[:, :, None], out=np.zeros_like(share), where=gain[:, :, None] > 0.0)
    through = share.max(axis=(0, 1), initial=0.0) > ROUNDING
    reached, seen = driven.any(axis=1), read.any(axis=0)
    back = np.divide(1.0, gain, out=np.zeros_like(gain), where=gain > 0.0).T
    whole = np.block(
        [
            [between, into, np.zeros((n, len(out)))],
            [np.zeros((inputs, n + inputs)), back],
            [out, np.zeros((len(out), inputs + len(out)))],
        ]
    )
    if not (np.isfinite(whole).all() and np.isfinite(gain).all()):
        return None
    on_path = np.append(through, np.ones(inputs + len(out), dtype=bool))
    unit = np.ones(len(whole))
    unit[on_path] = balance(whole[np.ix_(on_path, on_path)])[1]
    # What is not on a path from an input to an output follows those that are.
    for k in np.flatnonzero(seen & ~reached):
        unit[k] = _power(1.0 / np.max(whole[:, k] / unit))
    for k in np.flatnonzero(~seen)[::-1]:
        unit[k] = _power(np.max(whole[k] * unit))
    ports = unit[n:]
    return unit[:n] / _power(float(np.exp(np.mean(np.log(ports))))) if len(ports) else unit[:n]


def _power(size: float) -> float:
    return float(np.exp2(np.round(np.log2(size)))) if 0.0 < size < np.inf else 1.0
