"""Frequency-weighted balanced reduction (Enns 1984, 23rd IEEE CDC).

The Gramians are those blocks of the weighted system's that belong to the system's own states. With a weight
on one side what is left is stable; with two it need not be. Then the right-hand sides of the two Lyapunov
equations, which Enns leaves indefinite, are made definite (Wang, Sreeram and Liu 1999, IEEE TAC 44, "A new
frequency-weighted balanced truncation method and an error bound"), and what is left is stable.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.reduction.gramian import GramianFactors, factor_gramians, restrict
from middeck.control.reduction.projection import balance, check_order, project, settle_order
from middeck.control.reduction.result import Reduction, Rest
from middeck.control.reduction.separation import separate_unstable, subtract
from middeck.errors import ConfigError
from middeck.systems.norms.peak_gain import peak_gain
from middeck.systems.poles.stability import decays
from middeck.systems.state_space.statespace import StateSpace, add, series


def reduce_weighted(
    system: StateSpace,
    order: int,
    *,
    before: StateSpace | None = None,
    after: StateSpace | None = None,
    rest: Rest = "truncate",
) -> Reduction:
    """The system with fewer states, its error small in ``after`` (G - G_r) ``before``.

    Poles that do not decay are kept as they are and count in the order. ``error`` is the largest gain of the
    weighted difference; no a priori bound exists. Where two weights would leave an unstable remainder, the
    definite Gramians are used, as ``method`` states.

    Raises `ConfigError` for weights that are not stable or do not fit, or an order below the number of poles
    that do not decay.

    >>> two = StateSpace(np.diag([-1.0, -30.0]), np.ones((2, 1)), np.array([[1.0, 20.0]]), np.zeros((1, 1)))
    >>> slow = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> low = reduce_weighted(two, 1, before=slow, rest="residualise")
    >>> low.order, low.error < 0.1
    (1, True)
    """
    _check_weight(before, system.D.shape[1], "before", into=True)
    _check_weight(after, system.D.shape[0], "after", into=False)
    parts = separate_unstable(system)
    stable, kept = parts.rest, len(parts.kept.A)
    count = check_order(order, kept, len(system.A))
    factors, method = _weighted_factors(stable, before, after), "frequency-weighted (Enns)"
    hankel, reduced = _cut(stable, factors, count, rest)
    if not decays(reduced):
        factors = factor_gramians(_definite(stable, factors))
        hankel, reduced = _cut(stable, factors, count, rest)
        method = "frequency-weighted (Wang, Sreeram and Liu): Enns' would not be stable"
    difference = subtract(stable, reduced)
    difference = difference if before is None else series(before, difference)
    difference = difference if after is None else series(difference, after)
    peak = peak_gain(difference)
    whole = add(parts.kept, reduced)
    return Reduction(
        system=whole,
        order=len(whole.A),
        method=method,
        kept=kept,
        hankel=hankel,
        bound=None,
        error=peak.gain,
        error_omega=peak.omega,
    )


def _cut(
    system: StateSpace, factors: GramianFactors, count: int | None, rest: Rest
) -> tuple[Float[np.ndarray, " value"], StateSpace]:
    coordinates = balance(factors)
    return coordinates.hankel, project(
        system, coordinates, settle_order(coordinates.hankel, count, None), rest
    )


def _weighted_factors(
    system: StateSpace, before: StateSpace | None, after: StateSpace | None
) -> GramianFactors:
    own = slice(0, len(system.A))
    alone = factor_gramians(system) if before is None or after is None else None
    if before is None:
        assert alone is not None
        reach = alone.reach
    else:
        driven = series(before, system)
        reach = restrict(factor_gramians(driven).reach, slice(len(before.A), None))
    if after is None:
        assert alone is not None
        see = alone.see
    else:
        see = restrict(factor_gramians(series(system, after)).see, own)
    return GramianFactors(reach, see)


def _definite(system: StateSpace, factors: GramianFactors) -> StateSpace:
    """Inputs and outputs whose Gramians bound the weighted ones from above."""
    P, Q = factors.reach @ factors.reach.T, factors.see @ factors.see.T
    B = _absolute_root(-(system.A @ P + P @ system.A.T))
    C = _absolute_root(-(system.A.T @ Q + Q @ system.A)).T
    return StateSpace(system.A, B, C, np.zeros((len(C), B.shape[1])))


def _absolute_root(X: np.ndarray) -> Float[np.ndarray, "state column"]:
    values, vectors = np.linalg.eigh((X + X.T) / 2.0)
    return vectors * np.sqrt(np.abs(values))


def _check_weight(weight: StateSpace | None, ports: int, name: str, *, into: bool) -> None:
    if weight is None:
        return
    joint = weight.D.shape[0] if into else weight.D.shape[1]
    if joint != ports:
        side = "outputs" if into else "inputs"
        raise ConfigError(f"the weight {name} has {joint} {side} for {ports} ports of the system")
    if not decays(weight):
        raise ConfigError(
            f"the weight {name} is not stable", hint="reflect its unstable poles: the gain stays the same"
        )
