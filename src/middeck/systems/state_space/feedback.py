"""Closing a loop with positive feedback, added at the inputs."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.systems.state_space.statespace import System, same_period

AMPLIFIED = 1e12
"""Componentwise condition number beyond which an algebraic loop is refused: rounding would reach 1e-3."""


def close_static(system: System, gain: Float[np.ndarray, "input output"]) -> System:
    """The system under u = r + gain y, from r to y.

    Raises `ConfigError` where the loop through the direct terms has no solution.
    """
    through = _solve_direct(gain @ system.D)
    B = system.B @ through
    feedback = through @ gain @ system.C
    return dataclasses.replace(
        system, A=system.A + system.B @ feedback, B=B, C=system.C + system.D @ feedback, D=system.D @ through
    )


def _solve_direct(loop: Float[np.ndarray, "input input"]) -> Float[np.ndarray, "input input"]:
    """(1 - loop)^-1; refused where ill-conditioned in every scaling of the channels.

    The spectral radius of |(1 - L)^-1| (1 + |L|): the componentwise condition (Skeel 1979, Journal of the ACM
    26), least over all scalings of the channels (Bauer 1963, Numerische Mathematik 5).
    """
    one = np.eye(len(loop))
    if not np.any(loop):
        return one
    try:
        through = np.linalg.inv(one - loop)
        amplified = np.abs(np.linalg.eigvals(np.abs(through) @ (one + np.abs(loop)))).max()
    except np.linalg.LinAlgError:
        amplified, through = np.inf, one
    if not amplified < AMPLIFIED:
        raise ConfigError(
            "algebraic loop: the loop through the direct terms has no solution",
            hint="add a delay or a lag to one of the two systems",
        )
    return through


def feedback(plant: System, law: System, drives: Sequence[int], reads: Sequence[int]) -> System:
    """``plant`` with the compensator ``law`` from its outputs ``reads``, added at its inputs ``drives``.

    Inputs: the plant's, and what is added to the readings of the compensator; outputs: the plant's, then the
    compensator's. States: the plant's, then the compensator's. Raises `ConfigError` where the loop through
    the direct terms has no solution.

    >>> from middeck.systems.state_space.statespace import StateSpace, gain_system
    >>> integrator = StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> closed = feedback(integrator, gain_system(np.array([[-2.0]])), [0], [0])
    >>> closed.A.tolist(), closed.B.tolist()                      # x' = -2 (x + v) + r
    ([[-2.0]], [[1.0, -2.0]])
    """
    both = beside(plant, law)
    outputs, inputs = plant.D.shape
    gain = np.zeros(both.D.T.shape)
    gain[drives, outputs + np.arange(len(law.D))] = 1.0
    gain[inputs + np.arange(law.B.shape[1]), reads] = 1.0
    return close_static(both, gain)


def beside(*systems: System) -> System:
    """Unconnected systems as one.

    Raises `ConfigError` for a continuous system beside a sampled one, and for two periods.
    """
    one, *others = (each.period_s or 0.0 for each in systems)
    for other in others:
        if not same_period(one, other):
            raise ConfigError(
                f"systems of periods {one:g} and {other:g} s in one loop (0: continuous)",
                hint="sample both alike",
            )
    A, B, C, D = (functools.reduce(_diagonal, (getattr(each, k) for each in systems)) for k in "ABCD")
    return dataclasses.replace(systems[0], A=A, B=B, C=C, D=D)


def _diagonal(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """``first`` above ``second``, zeros beside them; searches close thousands of loops of a few states."""
    rows, columns = first.shape
    both = np.zeros((rows + len(second), columns + second.shape[1]))
    both[:rows, :columns], both[rows:, columns:] = first, second
    return both
