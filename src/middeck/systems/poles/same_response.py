"""Whether a system in other states, or with fewer, has the response of the original.

Rounding of mixed states may hide a body: its modes then come out at other frequencies, or its integrators
count as moved by nothing.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import NumericalError
from middeck.systems.poles.integrators import PartedSystem, part_integrators
from middeck.systems.poles.resolvent import Resolvent, by_solving
from middeck.systems.poles.rounding import EPS, ROUNDINGS
from middeck.systems.poles.state_units import balance_states
from middeck.systems.poles.verdict import CURE
from middeck.systems.state_space.statespace import LinearSystem, StateSpace, System, poles

SAME = 1e-3
"""Change of a path from which on its response is another, relative to the path about that line."""
ABOUT = np.array([0.9, 1.0, 1.1])
"""Lines about each one between two poles, which may lie on a zero."""
AT_REST = 1e-5
"""Poles slower than this part of the fastest count as at rest: their rounding does not count."""
DRAWS, BEYOND = 2, 3.0
"""How often entries are moved by `ROUNDINGS`; and by how much more a path must change to be another."""
KEPT = 32
"""Systems whose parts are kept: many results are asked of one loop."""


def responds_otherwise(found: LinearSystem, given: LinearSystem) -> bool:
    """Whether any path responds otherwise between the poles of ``found`` by more than rounding of
    ``given`` can.

    Each path is compared with itself: one of 1e-6 of the others counts as much, unless rounding of ``given``
    may be all of it.

    >>> from middeck.systems.state_space.statespace import StateSpace
    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> responds_otherwise(lag, StateSpace([[-1.0]], [[1.0]], [[2.0]], [[0.0]]))
    True
    """
    return len(found.A) + len(given.A) > 0 and _differs(by_solving(found), given, _lines(found, given))


@functools.lru_cache(maxsize=KEPT)
def part_known(system: StateSpace) -> PartedSystem:
    """`part_integrators` whose parts respond as the system does.

    Raises `NumericalError` where they do not: rounding of mixed states then hides what an integrator drives.
    """
    parted = part_integrators(system)
    if len(parted.residues) and _differs(resolve_parts(parted), system, _lines(parted.moving, system)):
        raise NumericalError(
            "rounding of the matrices hides what is driven or seen of integrators", hint=CURE
        )
    return parted


def resolve_parts(parted: PartedSystem) -> Resolvent:
    """The transfer function over s, integrators apart."""
    moving = by_solving(parted.moving)

    def evaluate(points: np.ndarray) -> np.ndarray:
        total = np.array(moving(points))
        for k, residue in enumerate(parted.residues, start=1):
            total += residue / points[:, None, None] ** k
        return total

    return evaluate


def _lines(found: LinearSystem, given: LinearSystem) -> Complex[np.ndarray, "centre line"]:
    """Points about a line between each two poles, below and above them all."""
    period_s = found.period_s
    most = np.inf if period_s is None else np.pi / period_s
    rates = np.abs(np.asarray(poles(found)))
    rates = rates[rates < most]
    size = np.unique(rates[rates > AT_REST * rates.max(initial=0.0)])
    if not len(size):
        size = np.array([min(float(np.linalg.norm(balance_states(given).A)) or 1.0, most)])
    between = np.sqrt(size[1:] * size[:-1])
    centre = np.concatenate([[0.5 * size[0]], between, [min(2.0 * size[-1], 0.9 * most)]])
    lines = 1j * centre[:, None] * ABOUT
    return lines if period_s is None else np.exp(lines * period_s)


def _differs(found: Resolvent, given: LinearSystem, points: Complex[np.ndarray, "centre line"]) -> bool:
    shape = (*points.shape, *given.D.shape)
    G = by_solving(given)(points.ravel()).reshape(shape)
    gap = np.abs(found(points.ravel()).reshape(shape) - G)
    if not np.any(other := gap > SAME * np.abs(G).max(axis=1, keepdims=True)):
        return False
    even = balance_states(given)
    unit = _sensitivity(even, points.ravel()).reshape(shape)
    other &= gap > SAME * unit * _least_share(np.abs(G), unit)
    if not np.any(other):
        return False
    rng, rounding = np.random.default_rng(0), np.zeros(shape)
    for _ in range(DRAWS):
        moved = by_solving(_moved_as_a_whole(even, rng))(points.ravel()).reshape(shape)
        rounding = np.maximum(rounding, np.abs(moved - G))
    return bool(np.any(other & (gap > BEYOND * rounding.max(axis=1, keepdims=True))))


def _sensitivity(
    system: System, points: Complex[np.ndarray, " line"]
) -> Float[np.ndarray, "line output input"]:
    """|C_i R| |A| |R B_j| with R = (s I - A)^-1: most by which a path moves where A does by its norm."""
    n, m = system.B.shape
    into = np.hstack([system.B, np.eye(n)])
    R = by_solving(dataclasses.replace(system, B=into, C=np.eye(n), D=np.zeros((n, n + m))))(points)
    seen, driven = np.linalg.norm(system.C @ R[:, :, m:], axis=2), np.linalg.norm(R[:, :, :m], axis=1)
    return np.asarray(seen[:, :, None] * np.linalg.norm(system.A, 2) * driven[:, None, :])


def _least_share(size: np.ndarray, unit: np.ndarray) -> Float[np.ndarray, "centre one output input"]:
    """The share of ``unit`` with which a path is compared that rounding may be all of: the largest of its row
    and its column. Zero for all others, which are compared with themselves.

    In states mixed by an orthogonal matrix a path that is truly zero responds by rounding of the others.
    """
    share = np.divide(size, unit, out=np.zeros_like(size), where=unit > 0.0).max(axis=1, keepdims=True)
    beside = np.maximum(share.max(axis=2, keepdims=True), share.max(axis=3, keepdims=True))
    return np.where(share > ROUNDINGS * EPS, 0.0, beside)


def _moved_as_a_whole(system: System, rng: np.random.Generator) -> System:
    """The system with every entry of A moved by `ROUNDINGS` roundings of the norm of A: orthogonal
    transformations and solutions know no better. Entries of B by those of its column, of C of its row."""
    sizes = (
        np.linalg.norm(system.A, 2),
        np.linalg.norm(system.B, axis=0),
        np.linalg.norm(system.C, axis=1)[:, None],
    )
    A, B, C = (
        M + ROUNDINGS * EPS * size * rng.choice([-1.0, 1.0], M.shape)
        for M, size in zip((system.A, system.B, system.C), sizes, strict=True)
    )
    return dataclasses.replace(system, A=A, B=B, C=C)
