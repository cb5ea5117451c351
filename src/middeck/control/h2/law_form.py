"""LawForm of a compensator: order, ports of each station, fixed filters, and its free entries."""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.linalg as sla
from jaxtyping import Bool, Float

from middeck.control.h2.closed_cost import Law
from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

WORST_BASIS = 1e8
"""Condition number of a law's eigenvectors beyond which its modal form is not used."""
OPPOSED = 1e-6
"""Sum of the phases of a mode's inputs and outputs, of length up to two, below which it has no direction."""


@record
class Station:
    """A part of a decentralised law: it reads ``inputs`` and drives ``outputs`` with ``order`` states."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    order: int


@record
class LawForm:
    """The form of a compensator u = after K before y; K is strictly proper.

    Attributes:
        order: States of K; None for as many as the design model has.
        stations: Decentralised parts whose orders add up to that of K; empty for a centralised law.
        before, after: Fixed filters, e.g. notches or leads, of the measurements and of the commands, square.

    >>> LawForm(order=8).stations
    ()
    """

    order: int | None = None
    stations: tuple[Station, ...] = ()
    before: StateSpace | None = None
    after: StateSpace | None = None

    def __post_init__(self) -> None:
        total = sum(station.order for station in self.stations)
        if self.order is not None and (self.order < 1 or (self.stations and total != self.order)):
            raise ConfigError(
                f"order = {self.order}, but the stations have {total} states together",
                hint="order >= 1, the sum of the stations' orders; or leave order out",
            )
        if any(station.order < 1 for station in self.stations):
            raise ConfigError(
                "a station without states", hint="order >= 1 for each station; leave a static one out"
            )


@record
class Free:
    """Free entries of a `Law`."""

    A: Bool[np.ndarray, "law law"]
    B: Bool[np.ndarray, "law y"]
    C: Bool[np.ndarray, "u law"]


def order_of(form: LawForm, default: int) -> int:
    """Number of states of the free `Law`."""
    if form.stations:
        return sum(station.order for station in form.stations)
    return default if form.order is None else form.order


def station_ports(form: LawForm, plant: Plant) -> list[tuple[list[int], list[int], int]]:
    """Rows of y, rows of u and number of states of each station."""
    return [
        (_positions(plant.y, s.inputs, "y"), _positions(plant.u, s.outputs, "u"), s.order)
        for s in form.stations
    ]


def _positions(group: tuple[str, ...], names: tuple[str, ...], which: str) -> list[int]:
    unknown = [name for name in names if name not in group]
    if unknown:
        raise ConfigError(
            f"a station names {', '.join(map(repr, unknown))}, not in the plant's group {which}",
            hint=f"one of {', '.join(group)}",
        )
    return [group.index(name) for name in names]


def arrange(
    law: Law, stations: list[tuple[list[int], list[int], int]], integrals: int = 0
) -> tuple[Law, Free]:
    """The law in real modal coordinates, station by station, and its free entries.

    A is tridiagonal within each station: every real matrix is similar to such a matrix, it stays
    differentiable where modes meet, and its 3 k - 2 numbers leave few directions that only change
    coordinates. They do not depend on those of ``law``; but where eigenvectors are nearly dependent these
    stay and all of A is free. Of the last states, the ``integrals``, only C is free.
    """
    law = decouple(law, integrals)
    ny, nu = law.B.shape[1], len(law.C)
    parts = stations or [(list(range(ny)), list(range(nu)), len(law.A) - integrals)]
    free = Free(*(np.zeros(M.shape, dtype=bool) for M in (law.A, law.B, law.C)))
    A, B, C = (M.copy() for M in (free.A, free.B, free.C))
    turn = np.eye(len(law.A))
    first = 0
    for inputs, outputs, order in parts:
        own = slice(first, first + order)
        basis = _modal_basis(Law(law.A[own, own], law.B[own], law.C[:, own]))
        near = np.abs(np.subtract.outer(np.arange(order), np.arange(order))) <= 1
        A[own, own] = near if basis is not None else True
        B[own, inputs] = True
        C[np.array(outputs)[:, None], np.arange(first, first + order)] = True
        turn[own, own] = np.eye(order) if basis is None else basis
        first += order
    back = np.linalg.inv(turn)
    turned = Law(back @ law.A @ turn, back @ law.B, law.C @ turn)
    C[:, first:] = True
    # Drop rounding outside the free pattern; keep the integrators.
    fixed = np.zeros(len(law.A), dtype=bool)
    fixed[first:] = True
    kept = Law(
        np.where(A | np.diag(fixed), turned.A, 0.0),
        np.where(B | fixed[:, None], turned.B, 0.0),
        np.where(C, turned.C, 0.0),
    )
    return kept, Free(A, B, C)


def decouple(law: Law, integrals: int) -> Law:
    """The law in coordinates in which its last states, the integrals, drive no other state.

    >>> law = Law(np.array([[-2.0, 1.0], [0.0, 0.0]]), np.ones((2, 1)), np.ones((1, 2)))
    >>> decouple(law, 1).A.tolist()
    [[-2.0, 0.0], [0.0, 0.0]]
    """
    if not integrals:
        return law
    n = len(law.A) - integrals
    # x = x' + M i with (A + r) M = -G, where r is a decay added to all states.
    M = -np.linalg.solve(law.A[:n, :n] - law.A[-1, -1] * np.eye(n), law.A[:n, n:])
    A, B, C = law.A.copy(), law.B.copy(), law.C.copy()
    A[:n, n:] = 0.0
    B[:n] -= M @ law.B[n:]
    C[:, n:] += law.C[:, :n] @ M
    return Law(A, B, C)


def split_law(law: Law, integrals: int) -> tuple[Law, Law]:
    """The `Law` without its integrals, and the integrals alone."""
    n = len(law.A) - integrals
    parts = slice(None, n), slice(n, None)
    first, second = (Law(law.A[s, s], law.B[s], law.C[:, s]) for s in parts)
    return first, second


def add_laws(first: Law, second: Law) -> Law:
    """Both side by side: the sum of their commands."""
    return Law(
        np.asarray(sla.block_diag(first.A, second.A)),
        np.vstack([first.B, second.B]),
        np.hstack([first.C, second.C]),
    )


def _modal_basis(law: Law) -> Float[np.ndarray, "state state"] | None:
    """Real and imaginary parts of the eigenvectors, slow modes first; None where ill-conditioned.

    The phase of an eigenvector decides how a descent couples modes and in which minimum it ends. So each is
    turned to where the inputs b and the outputs c of its mode have the most real part in common; where these
    are opposed, as of k/(s^2 + 2 z w s + w^2), to where its inputs are real.
    """
    values, vectors = np.linalg.eig(law.A)
    if len(values) and not np.linalg.cond(vectors) < WORST_BASIS:
        return None
    into, out = np.linalg.solve(vectors.astype(complex), law.B), law.C @ vectors
    rate, turn = np.real(values), np.imag(values)
    columns: list[np.ndarray] = []
    for i in np.lexsort((turn, np.hypot(rate, turn))):
        vector = vectors[:, i]
        if turn[i] > 0.0:
            both = _square(into[i]) + _square(out[:, i].conj())
            turned = both if abs(both) > OPPOSED else _square(into[i])
            vector = vector * np.exp(0.5j * np.angle(turned))
            columns += [np.real(vector), np.imag(vector)]
        elif turn[i] == 0.0:
            columns.append(np.real(vector))
    return np.array(columns).T


def _square(row: np.ndarray) -> complex:
    """Sum of squares over sum of absolute squares: one for a real row, minus one for an imaginary one."""
    return np.sum(row**2) / max(np.sum(np.abs(row) ** 2), np.finfo(float).tiny)


def scale_states(law: Law, scale: Float[np.ndarray, " law"]) -> Law:
    """The law in states divided by ``scale``."""
    return Law(law.A * scale / scale[:, None], law.B / scale[:, None], law.C * scale)


def pack(law: Law, free: Free) -> Float[np.ndarray, " parameter"]:
    """The free entries in a row."""
    return np.concatenate([law.A[free.A], law.B[free.B], law.C[free.C]])


def unpack(x: Float[np.ndarray, " parameter"], law: Law, free: Free) -> Law:
    """The law with its free entries replaced."""
    first = np.count_nonzero(free.A)
    last = first + np.count_nonzero(free.B)
    A, B, C = law.A.copy(), law.B.copy(), law.C.copy()
    A[free.A], B[free.B], C[free.C] = x[:first], x[first:last], x[last:]
    return Law(A, B, C)


def shifted(law: Law, rate: float) -> Law:
    """The `Law` with the decay of its states faster by ``rate``."""
    return dataclasses.replace(law, A=law.A - rate * np.eye(len(law.A)))


def join_stations(laws: list[Law], stations: list[tuple[list[int], list[int], int]], ny: int, nu: int) -> Law:
    """One `Law` of those of the stations, side by side."""
    order = sum(len(law.A) for law in laws)
    B, C = np.zeros((order, ny)), np.zeros((nu, order))
    first = 0
    for law, (inputs, outputs, _) in zip(laws, stations, strict=True):
        rows = np.arange(first, first + len(law.A))[:, None]
        B[rows, np.array(inputs)], C[np.array(outputs)[:, None], rows[:, 0]] = law.B, law.C
        first += len(law.A)
    return Law(np.asarray(sla.block_diag(*(law.A for law in laws))), B, C)
