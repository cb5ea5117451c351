"""Change of the stiffness and mass of beam elements, seen by modes, as the elements move.

The third derivative of an element's energy has 12 x 12 x 12 entries; nine complex steps give it, since an
element that is shifted as a whole is unchanged. Contracted with pairs of modes it is a gradient: one for
all parameters, whatever they do to the rest state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.beam_ends import CHUNK
from middeck.structure.assembly.mesh import select_beams
from middeck.structure.elements.beam import BeamProperties, beam_state, beam_weight
from middeck.structure.elements.beam_inertia import beam_mass
from middeck.structure.elements.rotations import rotation_exp, skew, symmetric_double_cross
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.sensitivity.patches import STEP, derivative

DIRECTIONS = 9  # the first root's turn, the second one's shift and turn
FIRST, SHIFT, SECOND = slice(3, 6), slice(6, 9), slice(9, 12)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Elements:
    """Elements on two roots each: positions and rotations of these, and how the ends sit on them."""

    beams: BeamProperties
    x: np.ndarray
    R: np.ndarray
    offset: np.ndarray
    triad: np.ndarray


def element_gradients(
    rest: Equilibrium, shapes: np.ndarray, left: np.ndarray, right: np.ndarray, lam: np.ndarray
) -> Float[np.ndarray, "coordinate pair"]:
    """Gradient of phi_i'(K - lambda M) phi_j of all elements, for pairs of columns of ``shapes``.

    ``left`` and ``right`` are the columns, ``lam`` the lambda of each pair.
    """
    model = rest.model
    roots = model.points.frame[model.element_ends]
    coordinates = (6 * roots[:, :, None] + np.arange(6)).reshape(len(roots), 12)
    gradient = np.zeros((len(roots), 12, len(left)))
    for start in range(0, len(roots), CHUNK // DIRECTIONS):
        rows = slice(start, start + CHUNK // DIRECTIONS)
        elements = _Elements(
            beams=select_beams(model.beams, rows),
            x=rest.config.x[roots[rows]],
            R=rest.config.R[roots[rows]],
            offset=model.points.offset[model.element_ends[rows]],
            triad=model.element_triad[rows, None],
        )
        u = shapes[coordinates[rows]]
        K, M = (
            derivative(m).reshape(DIRECTIONS, -1, 12, 12)
            for m in _matrices(_turned(elements), rest.loads.gravity)
        )
        v = u[:, :, right]
        change = np.sum(u[:, :, left] * (K @ v - lam * (M @ v)), axis=2)
        gradient[rows, 3:] = np.swapaxes(change, 0, 1)
        gradient[rows, :3] = -gradient[rows, SHIFT]
    out = np.zeros((model.tree.size, len(left)))
    np.add.at(out, coordinates, gradient)
    return out


def _turned(at: _Elements) -> _Elements:
    """The elements once for each direction, one root perturbed along that coordinate."""
    n = len(at.x)
    every = np.tile(np.arange(n), DIRECTIONS)
    x, R = at.x[every].astype(complex), at.R[every].astype(complex)
    turn = rotation_exp(STEP * 1j * np.eye(3))
    for axis in range(3):
        first, shift, second = (slice(n * (3 * k + axis), n * (3 * k + axis + 1)) for k in range(3))
        R[first, 0] = turn[axis] @ R[first, 0]
        x[shift, 1, axis] += STEP * 1j
        R[second, 1] = turn[axis] @ R[second, 1]
    return _Elements(
        beams=select_beams(at.beams, every), x=x, R=R, offset=at.offset[every], triad=at.triad[every]
    )


def _matrices(at: _Elements, gravity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tangent and mass (element, 12, 12) in the coordinates of the two roots."""
    lever = np.matvec(at.R, at.offset)
    x, T = at.x + lever, at.R @ at.triad
    strain, weight = beam_state(at.beams, x, T), beam_weight(at.beams, x, T, gravity)
    stiffness, mass = strain.hessian + weight.hessian, beam_mass(at.beams, x, T)
    if not np.any(at.offset):
        return stiffness, mass
    A = np.zeros(stiffness.shape, dtype=stiffness.dtype)
    A[:] = np.eye(12)
    A[:, 0:3, FIRST], A[:, SHIFT, SECOND] = -skew(lever[:, 0]), -skew(lever[:, 1])
    stiffness = np.swapaxes(A, 1, 2) @ stiffness @ A
    load = (strain.gradient + weight.gradient).reshape(-1, 2, 6)
    for end, turn in ((0, FIRST), (1, SECOND)):
        stiffness[:, turn, turn] += symmetric_double_cross(load[:, end, :3], lever[:, end])
    return stiffness, np.swapaxes(A, 1, 2) @ mass @ A
