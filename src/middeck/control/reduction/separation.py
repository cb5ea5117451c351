"""Separation of a system into the sum of two: chosen poles, and the others.

Ordered real Schur form and one Sylvester equation (Bavely and Stewart 1979, SIAM J. Numer. Anal. 16, "An
algorithm for computing reducing subspaces by block diagonalization"). The sum is the system to rounding,
whatever its poles do: unstable and integrating parts pass a reduction untouched.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Bool, Complex, Float
from scipy.linalg import lapack

from middeck.errors import NumericalError
from middeck.systems.poles.state_units import balance_states
from middeck.systems.state_space.statespace import StateSpace, add
from middeck.values import record

AXIS = float(np.sqrt(np.finfo(float).eps))
"""Distance left of the axis, relative to A, beyond which a pole near the origin counts as decaying: a double
pole there is accurate to the square root of rounding."""
APART, SINGLE = 10.0, 1e-11
"""Multiple of that distance from the origin beyond which a light mode is accurate to rounding."""


@record
class Separation:
    """``kept`` (no direct term) plus ``rest`` is the system."""

    kept: StateSpace
    rest: StateSpace


def separate_unstable(system: StateSpace) -> Separation:
    """Separate the poles that do not decay."""
    balanced = balance_states(system)
    size = float(np.linalg.norm(balanced.A, 2)) if len(balanced.A) else 0.0
    form = _schur(balanced)
    return _separate(balanced, *form, np.real(form[2]) > -_known_to(form[2], size))


def does_not_decay(system: StateSpace, values: Complex[np.ndarray, " pole"]) -> Bool[np.ndarray, " pole"]:
    """Whether each of a system's poles ``values`` is not known to decay."""
    size = float(np.linalg.norm(balance_states(system).A, 2)) if len(system.A) else 0.0
    return np.real(values) > -_known_to(values, size)


def separate_axis(system: StateSpace) -> Separation:
    """Separate the poles on the axis, integrators included."""
    balanced = balance_states(system)
    size = float(np.linalg.norm(balanced.A, 2)) if len(balanced.A) else 0.0
    form = _schur(balanced)
    return _separate(balanced, *form, np.abs(np.real(form[2])) <= _known_to(form[2], size))


def _known_to(values: Complex[np.ndarray, " pole"], size: float) -> Float[np.ndarray, " pole"]:
    """Distance from the axis within which a pole of a matrix of norm ``size`` counts as on it."""
    return np.where(np.abs(values) > APART * AXIS * size, SINGLE, AXIS) * size


def separate_poles(system: StateSpace, wanted: Complex[np.ndarray, " wanted"]) -> Separation:
    """Separate the poles ``wanted`` (both of a pair)."""
    balanced = balance_states(system)
    form = _schur(balanced)
    values = form[2]
    which = np.zeros(len(values), dtype=bool)
    for pole in wanted:
        # Take the nearest pole not yet taken, so that multiple poles are kept as often as wanted.
        which[int(np.argmin(np.where(which, np.inf, np.abs(values - pole))))] = True
    return _separate(balanced, *form, which)


def _schur(system: StateSpace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if not len(system.A):
        return np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0, dtype=complex)
    T, Q = cast("tuple[np.ndarray, np.ndarray]", sla.schur(system.A))
    values = np.diag(T).astype(complex)
    # A standard block has equal diagonal entries and off-diagonal ones of opposite sign.
    for i in np.flatnonzero(np.diag(T, -1)):
        turn = np.sqrt(abs(T[i, i + 1])) * np.sqrt(abs(T[i + 1, i]))
        values[i] += 1j * turn
        values[i + 1] -= 1j * turn
    return T, Q, values


def _separate(
    system: StateSpace, T: np.ndarray, Q: np.ndarray, values: np.ndarray, which: Bool[np.ndarray, " state"]
) -> Separation:
    k, D = int(which.sum()), system.D
    if not 0 < k < len(which):
        none = _part(system, slice(0, 0), np.zeros(D.shape))
        whole = _part(system, slice(None), np.zeros(D.shape) if k else D)
        return Separation(whole, _part(system, slice(0, 0), D)) if k else Separation(none, whole)
    ordered, vectors, *_, info = cast("Any", lapack).dtrsen(which.astype(np.int32), T, Q, job="N")
    if info:
        raise NumericalError(
            "the poles to keep and the poles to reduce are too close to separate",
            hint="choose another order",
            poles=values,
        )
    X = sla.solve_sylvester(ordered[:k, :k], -ordered[k:, k:], -ordered[:k, k:])
    turn = np.block([[np.eye(k), X], [np.zeros((len(T) - k, k)), np.eye(len(T) - k)]])
    back = np.block([[np.eye(k), -X], [np.zeros((len(T) - k, k)), np.eye(len(T) - k)]])
    apart = StateSpace(ordered, back @ vectors.T @ system.B, system.C @ vectors @ turn, D)
    return Separation(_part(apart, slice(0, k), np.zeros(D.shape)), _part(apart, slice(k, None), D))


def _part(system: StateSpace, which: slice, D: np.ndarray) -> StateSpace:
    return StateSpace(system.A[which, which], system.B[which], system.C[:, which], D)


def subtract(first: StateSpace, second: StateSpace) -> StateSpace:
    """The difference of two systems."""
    return add(first, StateSpace(second.A, second.B, -second.C, -second.D))
