"""Errors of printed digits in a reduced component: rounded stiffness, places of its grids."""

import dataclasses

import numpy as np

from middeck.errors import ConfigError
from middeck.structure.model.component import Component, require_component, rigid_vectors

# Largest distance, over the size, of a grid from its place in truth: small fields have five to seven digits.
NEAR = 5e-5
# Distance, over the size, that large fields leave.
LARGE = 1e-8
# Singular values over the largest below which the stiffness does not determine a place.
UNTOLD = 1e-6
# Share of the resistance to turns that is left where the places of the grids were its cause.
CAUSE = 0.1


def as_printed(part: Component, rounding: np.ndarray | None) -> Component:
    """The component without the resistance to rigid motion that is rounding of its printed digits.

    ``rounding`` bounds that of each entry of its stiffness, None for exact matrices. Where the places of its
    grids do not fit its matrices, those within `NEAR` that do are its positions, and their distances from
    the given ones its offsets: the frames stay where the cards put them. Raises `ConfigError` for a component
    that is faulty all the same.
    """
    free = None if rounding is None else _free(part, rounding)
    if free is not None:
        return require_component(free)
    moved, left = _moves_by_stiffness(part)
    size = np.abs(part.positions).max()
    if left < CAUSE and LARGE * size < np.abs(moved).max() <= NEAR * size:
        placed = dataclasses.replace(part, positions=part.positions + moved, offsets=moved)
        free = None if rounding is None else _free(placed, rounding)
        try:
            return require_component(free or placed)
        except ConfigError:  # its faults are others
            pass
    return require_component(part)


def _moves_by_stiffness(part: Component) -> tuple[np.ndarray, float]:
    """Shifts of grids to where the stiffness resists turns as one body least; what share of it is left."""
    n = 6 * len(part.grids)
    x = part.positions - part.positions.mean(axis=0)
    size = np.sqrt(np.abs(np.diagonal(part.stiffness)))
    K = part.stiffness / np.where(size > 0.0, size, 1.0)[:, None]
    resists = (K @ rigid_vectors(x, len(K))[:, 3:]).T.ravel()
    shifts = K[:, :n].reshape(len(K), -1, 6)[:, :, :3]
    by_shift = np.concatenate([np.cross(shifts, axis) for axis in np.eye(3)]).reshape(len(resists), -1)
    moves = np.linalg.lstsq(by_shift, -resists, rcond=UNTOLD)[0]
    left, whole = np.linalg.norm(resists + by_shift @ moves), np.linalg.norm(resists)
    return moves.reshape(-1, 3), float(left / whole) if whole > 0.0 else 1.0


def _free(part: Component, rounding: np.ndarray) -> Component | None:
    """The component with its stiffness against rigid motion removed; None if that is more than rounding.

    That stiffness may be negative as well as positive. ``rounding`` bounds the joint effect of rounded
    entries and rounded positions of the grids on each entry.
    """
    stiffness = part.stiffness
    R = rigid_vectors(part.positions, len(stiffness))
    R[: part.has.size][~part.has.ravel()] = 0.0
    if not np.all(np.abs(stiffness @ R) <= rounding @ np.abs(R)):
        return None
    size = np.sqrt(np.abs(np.diagonal(stiffness)))
    P = np.eye(len(stiffness)) - R @ np.linalg.lstsq(size[:, None] * R, np.diag(size))[0]
    return dataclasses.replace(part, stiffness=P.T @ stiffness @ P)
