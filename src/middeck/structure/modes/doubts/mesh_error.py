"""Discretisation error of each frequency, estimated without another mesh.

Between its nodes a member moves by the static shapes of its elements. These omit the deflection of an element
with clamped ends under its own inertia omega^2 rho w. The energy of that deflection, to first order in the
element's flexibility, is the part of omega^2 that refinement removes: the next term of the dynamic stiffness
in powers of omega^2 (Przemieniecki 1968, Theory of Matrix Structural Analysis, section 10.6). For a cubic
beam it is of the order h^4, for a bar or a shaft of the order h^2.

The estimate holds up to an element's own clamped frequency: above it a mesh lacks modes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.beam_ends import element_poses
from middeck.structure.elements.beam import BeamProperties
from middeck.structure.elements.beam_inertia import transverse_shapes
from middeck.structure.elements.frames import frame_poses, pose_jacobian
from middeck.structure.modes.solve import Modes

LIMIT = 1e-4
"""Relative error of a frequency above which `mesh_warnings` speaks; a mode damped by 1 % is 2 % wide."""
# Flexibility of a clamped bar of unit length and stiffness under a load that is linear along it, by the
# load's end values.
BAR = np.array([[1.0 / 45.0, 7.0 / 360.0], [7.0 / 360.0, 1.0 / 45.0]])
CLAMPED_BEAM = 500.5639  # 4.7300^4: omega^2 of its first vibration in EI / (rho A L^4)
CLAMPED_BAR = np.pi**2
# Of omega^2 over an element's own: beyond, the mesh has no shape like the mode.
BEYOND = 0.5
ORDER = 0.25  # errors of bending fall with the fourth power of the number of elements
POINTS = 8  # Gauss points, exact for the moments of cubic loads


def estimate_mesh_error(modes: Modes, count: int | None = None) -> Float[np.ndarray, " mode"]:
    """Relative error of each of the lowest ``count`` frequencies (all by default): too high, by the mesh.

    Infinite where elements vibrate by themselves at or below the mode's frequency. Of the static shape under
    gravity, and of the stiffness that its forces make, the error is not in it: it is smaller.
    """
    count = len(modes.omega) if count is None else min(count, len(modes.omega))
    model = modes.equilibrium.model
    beams, lam = model.beams, modes.omega[:count] ** 2
    if not len(model.element_ends) or not count:
        return np.zeros(count)
    moves = _end_moves(modes, count)
    lost = np.zeros(count)
    beyond = np.zeros(count, dtype=bool)
    for ends, flexibility, own in _parts(beams, moves):
        near = lam / own[:, None]
        energy = np.einsum("eim,eij,ejm->em", ends, flexibility, ends)
        lost += np.sum(energy / np.maximum(1.0 - near, 1.0 - BEYOND), axis=0)
        beyond |= near.max(axis=0) > BEYOND
    return np.where(beyond, np.inf, 0.5 * lam * lost)


def mesh_warnings(modes: Modes, count: int) -> tuple[str, ...]:
    """One sentence where any of the ``count`` lowest frequencies is wrong by more than `LIMIT`."""
    error = estimate_mesh_error(modes, count)
    if not len(error) or error.max() <= LIMIT:
        return ()
    off = np.flatnonzero(error > LIMIT)
    worst = int(off[np.argmax(error[off])])
    f = modes.frequency_hz[worst]
    few = (
        f"{len(off)} of the {len(error)} lowest frequencies are too high by more than {LIMIT:.2%}, because "
        "the mesh is coarse"
    )
    cure = "use more elements a member (mesh.elements_per_strut, or elements of a strut)"
    if np.isinf(error[worst]):
        return (
            f"{few}; from {f:.4g} Hz (mode {worst}) on modes are missing, since members vibrate between "
            f"their nodes there; {cure}",
        )
    off_by = f"{100.0 * error[worst]:.2g} % too high"
    mode = f"the worst is mode {worst} {modes.name[worst]!r} of {f:.4g} Hz, {off_by}"
    more = max(int(np.ceil((error[worst] / LIMIT) ** ORDER)), 2)
    return (f"{few}: {mode}; {cure}, {more} times as many",)


def _end_moves(modes: Modes, count: int) -> Float[np.ndarray, "element 2 2 3 mode"]:
    """Displacement and rotation of both ends of every element in its own axes."""
    rest = modes.equilibrium
    model = rest.model
    jacobian = pose_jacobian(model.tree, model.points, frame_poses(model.tree, rest.config))
    moves = (jacobian @ modes.shapes[:, :count]).reshape(-1, 2, 3, count)[model.element_ends]
    axes = element_poses(model, rest.config)[1][:, 0]
    return np.einsum("eij,enbim->enbjm", axes, moves)


class _Part(NamedTuple):
    """One way for elements to deform: its end moves, the flexibility to them, their own lowest omega^2."""

    ends: Float[np.ndarray, "element end mode"]
    flexibility: Float[np.ndarray, "element end end"]
    own: Float[np.ndarray, " element"]


def _parts(beams: BeamProperties, moves: np.ndarray) -> list[_Part]:
    """Stretch, twist and both bendings."""
    L = beams.length
    parts: list[_Part] = []
    for field, inertia, stiffness in (
        (0, beams.rho_A, beams.EA),
        (1, beams.rho_I_y + beams.rho_I_z, beams.GJ),
    ):
        flexibility = _over(inertia**2 * L**3, stiffness)[:, None, None] * BAR
        parts.append(_Part(moves[:, :, field, 0], flexibility, CLAMPED_BAR * _own(stiffness, inertia * L**2)))
    for across, about, sign, EI, rho_I, shear in (
        (1, 2, 1.0, beams.EI_z, beams.rho_I_z, beams.shear_y),
        (2, 1, -1.0, beams.EI_y, beams.rho_I_y, beams.shear_z),  # w' = -theta_y
    ):
        ends = np.stack(
            [m for n in (0, 1) for m in (moves[:, n, 0, across], sign * moves[:, n, 1, about])], axis=1
        )
        own = CLAMPED_BEAM * _own(EI, beams.rho_A * L**4) / (1.0 + shear)
        parts.append(_Part(ends, _bending_flexibility(L, EI, beams.rho_A, rho_I, shear), own))
    return parts


def _over(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Zero where there is nothing that could give way."""
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0.0)


def _own(stiffness: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Infinite for a deformation without inertia, or without elastic stiffness."""
    return np.divide(
        stiffness, inertia, out=np.full(len(stiffness), np.inf), where=(inertia > 0.0) & (stiffness > 0.0)
    )


def _bending_flexibility(
    L: np.ndarray, EI: np.ndarray, rho_A: np.ndarray, rho_I: np.ndarray, shear: np.ndarray
) -> Float[np.ndarray, "element 4 4"]:
    """Compliance of a clamped element under the inertia of its four static shapes, at omega = 1.

    The stress resultants of each load are those of a cantilever less the end forces that make the
    complementary energy least: exact for Bernoulli and Timoshenko beams.
    """
    x, weight, integral = _gauss()
    shapes = [transverse_shapes(at, L, shear) for at in x]
    v, slope = (np.stack([s[k] for s in shapes], axis=1) for k in (0, 1))
    long = L[:, None, None]
    force = -long * (integral @ (rho_A[:, None, None] * v))
    moment = -long * (integral @ (force + rho_I[:, None, None] * slope))
    bend = np.sqrt(weight[None, :, None] * _over(L, EI)[:, None, None])
    across = bend * np.sqrt(shear / 12.0)[:, None, None] * long
    loads = np.concatenate([moment * bend, force * across], axis=1)
    ends = np.concatenate(
        [
            np.concatenate([-long * x[None, :, None] * bend, bend], axis=2),
            np.concatenate([across, 0.0 * across], axis=2),
        ],
        axis=1,
    )
    Q = np.linalg.qr(ends)[0]
    loads = loads - Q @ (np.swapaxes(Q, 1, 2) @ loads)
    return np.swapaxes(loads, 1, 2) @ loads


def _gauss() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and weights on (0, 1), and the matrix that integrates from 0 to each of the points."""
    points, weights = np.polynomial.legendre.leggauss(POINTS)
    legendre = np.polynomial.legendre
    values = legendre.legvander(points, POINTS - 1)
    sums = [legendre.legval(points, legendre.legint(c, lbnd=-1)) for c in np.eye(POINTS)]
    integral = 0.5 * np.stack(sums, axis=1) @ np.linalg.inv(values)
    return 0.5 * (points + 1.0), 0.5 * weights, integral
