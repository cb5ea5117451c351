"""Complex modes of a structure followed as the element at one joint changes with its amplitude.

With loss, modes cannot be identified by the undamped ones: around a point of the complex stiffness where two
of them coincide (an exceptional point; Kato 1966, chapter II; Heiss 2012, J. Phys. A 45) they exchange
places. Along a real stiffness two modes veer; along the arc of friction between sticking and slipping the
same two pass each other. So the damped modes are followed, along the element's own arc from where it has
least effect, and each is then paired with the most similar undamped mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.optimize import linear_sum_assignment

from middeck.joints.element import JointElement, sum_equivalents
from middeck.structure.gimbals.stiffened_joint import JointSystem, keep_lowest

SPARE = 6
"""Undamped modes looked at above the highest pole followed."""
CLEAR = 0.9
"""Overlap of a shape with that of the step before above which it is surely the same mode."""
HALVINGS = 8
"""Halvings of a step along the arc in which a shape changes more; faster changes count as crossings."""
ARC = 10.0 ** (np.arange(-96, 49) / 8.0)
"""Amplitudes [rad or m] along the arc, independent of the requested ones."""
STRIDE = 0.2
"""Relative change of the stiffness from one stop on the arc to the next."""
FIRST = 1e-3
"""Relative change of the lowest omega^2 allowed at the first stop."""


class Damped(NamedTuple):
    """Eigenvalues s [rad/s], and unit shapes in the coordinates of the poles."""

    s: Complex[np.ndarray, " mode"]
    shapes: Complex[np.ndarray, "pole mode"]


class Pairs(NamedTuple):
    """The undamped mode of each damped one, and |phi' M phi| of their shapes."""

    mode: Int[np.ndarray, " branch"]
    likeness: Float[np.ndarray, " branch"]


def follow_damped(
    system: JointSystem,
    elements: Sequence[JointElement],
    amplitudes: Float[np.ndarray, " amplitude"],
    wanted: Int[np.ndarray, " mode"],
) -> list[Damped]:
    """The modes that begin as the poles ``wanted``, at every amplitude, all damping included.

    They are followed by their shapes, over stops that do not depend on the requested amplitudes. The basis
    reaches well beyond the highest of them; the flexibility of the poles above has a relative error of the
    square of the frequency ratio.
    """
    low = keep_lowest(system, min(len(system.pole), int(wanted.max(initial=0)) + 1 + SPARE))
    drag = sum(e.viscous for e in elements)
    bare = Damped(np.zeros(len(wanted), dtype=complex), np.eye(len(low.pole), dtype=complex)[:, wanted])
    arc = _complex_stiffness(elements, ARC)
    start = int(np.argmin(np.abs(arc)))
    here = _step(low, bare, (0j, 0.0), (0j, drag), HALVINGS)
    at = 0j
    for k in _ray(low, complex(arc[start])):
        here, at = _step(low, here, (at, drag), (k, drag), HALVINGS), k
    asked = _complex_stiffness(elements, amplitudes)
    found = [here] * len(amplitudes)
    for way in (1, -1):
        mode, k = here, at
        ahead = [int(a) for a in np.argsort(way * amplitudes) if way * (amplitudes[a] - ARC[start]) >= 0.0]
        stops = _stops(low, arc, start, way)
        for a in ahead:
            while stops and way * (ARC[stops[0]] - amplitudes[a]) <= 0.0:
                stop = complex(arc[stops.pop(0)])
                mode, k = _step(low, mode, (k, drag), (stop, drag), HALVINGS), stop
            found[a] = _step(low, mode, (k, drag), (complex(asked[a]), drag), HALVINGS)
    return found


def pair_undamped(damped: Damped, shapes: Float[np.ndarray, "pole mode"]) -> Pairs:
    """The most similar undamped mode of ``shapes`` for each damped mode, one to one."""
    alike = np.abs(shapes[: len(damped.shapes)].T @ damped.shapes)
    mode, branch = linear_sum_assignment(alike, maximize=True)
    mode = mode[np.argsort(branch)]
    return Pairs(mode, alike[mode, np.arange(len(mode))])


def _complex_stiffness(
    elements: Sequence[JointElement], amplitude: Float[np.ndarray, " amplitude"]
) -> Complex[np.ndarray, " amplitude"]:
    equal = sum_equivalents(elements, amplitude)
    return equal.stiffness + 1j * equal.loss


def _least(system: JointSystem) -> float:
    """Stiffness below which no mode has changed yet."""
    lowest = float(system.pole[system.pole > 0.0].min(initial=1.0))
    return FIRST * lowest / float(np.max(system.angle**2))


def _ray(system: JointSystem, end: complex) -> list[complex]:
    """From no stiffness straight to ``end``."""
    least = _least(system)
    if abs(end) <= least:
        return [end]
    count = int(np.ceil(np.log(abs(end) / least) / np.log1p(STRIDE)))
    return [complex(k) for k in end * np.geomspace(least / abs(end), 1.0, count + 1)]


def _stops(system: JointSystem, arc: np.ndarray, start: int, way: int) -> list[int]:
    """Places on the arc from ``start`` to one of its ends, leaving out those where little has changed."""
    least, last = _least(system), complex(arc[start])
    stops: list[int] = []
    for i in range(start + way, len(arc) if way > 0 else -1, way):
        k = complex(arc[i])
        if abs(k - last) > STRIDE * max(abs(k), abs(last), least):
            stops.append(i)
            last = k
    return stops


def _step(
    system: JointSystem, here: Damped, start: tuple[complex, float], end: tuple[complex, float], halvings: int
) -> Damped:
    """The modes ``here``, at stiffness and drag ``start``, at ``end``; by way of the middle if need be."""
    every = _solve(system, *end)
    alike = np.abs(here.shapes.conj().T @ every.shapes)
    own = linear_sum_assignment(alike, maximize=True)[1]
    if not halvings or alike[np.arange(len(own)), own].min(initial=1.0) >= CLEAR:
        return Damped(every.s[own], every.shapes[:, own])
    middle = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]))
    halfway = _step(system, here, start, middle, halvings - 1)
    return _step(system, halfway, middle, end, halvings - 1)


def _solve(system: JointSystem, stiffness: complex, viscous: float) -> Damped:
    """Every mode, the modal damping on the diagonal and the joint's where it is."""
    w, pole, n = system.angle, system.pole, len(system.pole)
    series = 1.0 + stiffness * system.flexibility
    # States (q, q'/scale): a matrix of frequencies, not of their squares, rounds to 1e-16 of the highest.
    scale = np.where(pole > 0.0, np.sqrt(pole), 1.0)
    hold = np.diag(pole / scale) + stiffness / series * np.outer(w / scale, w)
    drag = np.diag(2.0 * system.zeta * np.sqrt(pole))
    drag = drag + viscous / series**2 * np.outer(w / scale, w * scale)
    s, vectors = _eig(np.block([[np.zeros((n, n)), np.diag(scale)], [-hold, -drag]]))
    # The upper root of each pair: below the real axis a complex stiffness would feed the motion.
    upper = np.argsort(-np.imag(s), kind="stable")[:n]
    q = vectors[:n, upper]
    return Damped(s[upper], q / np.linalg.norm(q, axis=0))


def _eig(A: np.ndarray) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, "n n"]]:
    values, vectors = np.linalg.eig(A)
    return values.astype(complex), vectors.astype(complex)
