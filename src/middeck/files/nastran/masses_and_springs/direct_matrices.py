"""A matrix by direct input that stands alone: a stiffness (K2GG) as bushings, a mass (M2GG) as bodies.

A stiffness between grids is a sum of bushings where each pair of them has one: the block between two grids
says which, and what is left of each grid's own block goes to the ground, but for what the printed digits
leave of nothing; so between grids, where a direction is loose. A mass is bodies where its blocks
between grids are zero.
"""

from collections.abc import Iterator

import numpy as np

from middeck.files.nastran.components.direct_input import Lone
from middeck.files.nastran.deck.coordinates import GridPlaces
from middeck.files.nastran.deck.entries import Entry
from middeck.files.nastran.deck.nastran_numbers import rounding_of
from middeck.files.nastran.masses_and_springs.bodies import Mass, mass_of_matrix
from middeck.files.nastran.masses_and_springs.spring_elements import Tie
from middeck.files.toml.faults import DocumentFault

# Largest asymmetry over the roots of two diagonals: the printed digits of assembled matrices.
UNEQUAL = 1e-6
# The same for what digits leave and may be zero: a larger spring must be distinguished from it.
LEFT = 1e-7
# What is left below zero comes of digits too, as those of the grids' places: so many times that is noise.
NOISE = 10.0


def direct_ties(lone: Lone, places: GridPlaces, faults: list[DocumentFault]) -> list[Tie]:
    """Bushings equivalent to a stiffness that stands alone; appends to ``faults`` one without such."""
    grids, count = lone.grids, len(lone.grids)
    own = [lone.block(k, k).copy() for k in range(count)]
    half = rounding_of(lone.digits)
    doubt = [half * _sizes(lone, places, k, k) for k in range(count)]
    found: list[Tie] = []
    for i, a in enumerate(grids):
        for j, b in enumerate(grids[i + 1 :], i + 1):
            coupling = lone.block(i, j)
            if not np.any(coupling):
                continue
            carried = carried_motion(places.grids[b] - places.grids[a])
            K = -np.linalg.solve(carried.T, coupling)
            known = half * _sizes(lone, places, i, j)
            about = np.abs(np.linalg.inv(carried)).T @ known
            if not _is_stiffness(K, lone.size(j)):
                refusal = _few if _is_noise(K, about) else _no_sum
                faults.append(refusal(lone, f"what grids {a} and {b} do to each other"))
                return []
            certain = _certain_part(K, about)[0]
            if np.any(np.abs(0.5 * (K + K.T) - certain) > LEFT * np.outer(lone.size(j), lone.size(j))):
                faults.append(_few(lone, f"what grids {a} and {b} do to each other"))
                return []
            own[i] -= carried.T @ K @ carried
            own[j] -= K
            doubt[i] += known @ np.abs(carried)
            doubt[j] += about
            if np.any(certain):
                found.append(_tie(lone, (a, b), (places.grids[b],) * 2, certain))
    for k, grid in enumerate(grids):
        ground, lowest = _certain_part(own[k], doubt[k])
        size = np.outer(lone.size(k), lone.size(k))
        if np.any(np.abs(own[k] - ground) > LEFT * size):
            few = lowest >= -1.0 or _is_stiffness(own[k], lone.size(k))
            faults.append((_few if few else _no_sum)(lone, f"what holds grid {grid}"))
            return []
        if np.any(ground):
            found.append(_tie(lone, (grid,), (places.grids[grid],), ground))
    return found


def _sizes(lone: Lone, places: GridPlaces, row: int, column: int) -> np.ndarray:
    """Magnitudes of the printed entries of a block, transformed to the basic axes without cancellation."""
    left, right = (np.kron(np.eye(2), places.displacement_axes(lone.grids[k])) for k in (row, column))
    return np.abs(left) @ np.abs(left.T @ lone.block(row, column) @ right) @ np.abs(right.T)


def _certain_part(rest: np.ndarray, doubt: np.ndarray) -> tuple[np.ndarray, float]:
    """The part of ``rest`` that is a stiffness beyond ``doubt``, and its lowest value over that."""
    values, vectors, noise = _over(rest, doubt)
    kept = np.where(values > max(1.0, -NOISE * values[0]), values, 0.0)
    return (noise * vectors * kept) @ (noise * vectors).T, float(values[0])


def _is_noise(K: np.ndarray, doubt: np.ndarray) -> bool:
    """Whether ``K`` is symmetric and positive semidefinite within the ``doubt`` of its entries."""
    return bool(np.all(np.abs(K - K.T) <= doubt + doubt.T)) and _over(K, doubt)[0][0] >= -1.0


def _over(K: np.ndarray, doubt: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eigenvalues and vectors of ``K`` in units of the ``doubt`` of its entries, and that unit by row."""
    doubt = 0.5 * (doubt + doubt.T)
    unit = np.sqrt(np.diagonal(doubt))
    over = np.divide(1.0, unit, out=np.zeros(6), where=unit > 0.0)
    most = np.linalg.norm(over[:, None] * doubt * over, 2)
    noise = np.sqrt(most) * unit[:, None]
    values, vectors = np.linalg.eigh(0.5 * (K + K.T) * np.outer(over, over) / (most or 1.0))
    return values, vectors, noise


def direct_masses(
    lone: Lone, places: GridPlaces, weight: float, faults: list[DocumentFault]
) -> Iterator[Mass]:
    """Bodies of a mass that stands alone, over the factor ``weight`` of other masses (WTMASS)."""
    for i, a in enumerate(lone.grids):
        for j, b in enumerate(lone.grids[:i]):
            if np.any(lone.block(i, j)):
                what = f"a mass between grids {b} and {a} without a stiffness is not converted"
                faults.append(lone.entry.fault(what, hint="K2GG beside it"))
                return
        try:
            yield mass_of_matrix(lone.block(i, i) / weight, a, places.grids[a], np.eye(3))
        except ValueError as error:
            faults.append(lone.entry.fault(f"grid {a}: {error}"))


def carried_motion(arm: np.ndarray) -> np.ndarray:
    """Motion of a point at ``arm`` from one that moves as a rigid body."""
    x, y, z = arm
    out = np.eye(6)
    out[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return out


def _is_stiffness(K: np.ndarray, size: np.ndarray) -> bool:
    scaled = np.divide(K, np.outer(size, size), out=np.zeros((6, 6)), where=np.outer(size, size) > 0.0)
    whole = np.abs(K[scaled == 0.0]).max(initial=0.0) <= UNEQUAL * np.abs(K).max()
    return bool(
        whole
        and np.abs(scaled - scaled.T).max() <= UNEQUAL
        and np.linalg.eigvalsh(0.5 * (scaled + scaled.T))[0] >= -UNEQUAL
    )


def _tie(lone: Lone, grids: tuple[int, ...], points: tuple[np.ndarray, ...], K: np.ndarray) -> Tie:
    entry = lone.entry
    named = Entry(entry.name, (f"{entry.id}_{'_'.join(map(str, grids))}", *entry.values[1:]), entry.card)
    return Tie(entry=named, grids=grids, points=points, axes=np.eye(3), stiffness=K)


def _no_sum(lone: Lone, what: str) -> DocumentFault:
    hint = "M2GG beside it, or the matrix of a part that is no reduction"
    message = f"a stiffness without a mass is converted as bushings, and {what} is no stiffness"
    return lone.entry.fault(message, hint=hint)


def _few(lone: Lone, what: str) -> DocumentFault:
    """The fault for an entry that could be rounding or a spring."""
    hint = "print it as 16.9E or more, and it and the grids in large fields"
    message = f"too few digits, {lone.digits} here, or those of the grids' places, to determine {what}"
    return lone.entry.fault(message, hint=hint)
