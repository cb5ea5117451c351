"""Modes of a frame of bars by the textbook's matrices, without middeck (Przemieniecki 1968, 5.6 and 11.3)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

# Of (w1, L t1, w2, L t2): stiffness over EI/L^3, mass over m/420, rotary inertia over m r^2/(30 L^2).
BENT = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
CUBIC = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
TURNING = np.array([[36, 3, -36, 3], [3, 4, -3, -1], [-36, -3, 36, -3], [3, -1, -3, 4]])


def clamped_frequencies(
    frame: dict[str, np.ndarray], held: np.ndarray, bar: dict[str, float], count: int
) -> np.ndarray:
    """The lowest ``count`` frequencies [Hz] of bars alike with bodies at nodes, the nodes ``held`` clamped.

    ``bar`` has E, G, area, second (moment of area about both axes), polar and density; bars do not shear.
    """
    ends, x = frame["ends"], frame["x"]
    along = x[ends[:, 1]] - x[ends[:, 0]]
    length = np.linalg.norm(along, axis=1)
    T = _axes(along / length[:, None])
    K, M = (np.einsum("eij,eik,ekl->ejl", T, part, T) for part in _bars(length, bar))
    dofs = (6 * ends[:, :, None] + np.arange(6)).reshape(len(ends), 12)
    size = 6 * len(x)
    stiffness, mass = (_assembled(part, dofs, size) for part in (K, M))
    lump = np.zeros((len(x), 6))
    np.add.at(lump[:, :3], frame["body_node"], frame["body_mass"][:, None])
    np.add.at(lump[:, 3:], frame["body_node"], frame["body_inertia"])
    mass = mass + sp.diags_array(lump.ravel())
    free = np.setdiff1d(np.arange(size), (6 * held[:, None] + np.arange(6)).ravel())
    K, M = (sp.csc_array(part[free][:, free]) for part in (stiffness, mass))
    factor = spla.splu(K, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    inverse = spla.LinearOperator(K.shape, matvec=factor.solve, dtype=float)  # ty: ignore
    lam = spla.eigsh(K, count, M, sigma=0.0, OPinv=inverse, return_eigenvectors=False)
    return np.sort(np.sqrt(lam)) / (2.0 * np.pi)


def _axes(e: np.ndarray) -> np.ndarray:
    """Rotations of both ends from the world into own axes (bar, 12, 12); any will do for round bars."""
    other = np.where(np.abs(e[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[0.0, 1.0, 0.0]])
    y = np.cross(other, e)
    y /= np.linalg.norm(y, axis=1)[:, None]
    R = np.stack([e, y, np.cross(e, y)], axis=1)
    out = np.zeros((len(e), 12, 12))
    for k in range(0, 12, 3):
        out[:, k : k + 3, k : k + 3] = R
    return out


def _bars(length: np.ndarray, bar: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and consistent mass with rotary inertia (bar, 12, 12) in own axes."""
    n, L = len(length), length
    K, M = np.zeros((n, 12, 12)), np.zeros((n, 12, 12))
    m = bar["density"] * bar["area"] * L
    pair, share = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0
    radius = bar["second"] / bar["area"]
    for i, rigidity, inertia in (
        (0, bar["E"] * bar["area"], m),
        (3, bar["G"] * bar["polar"], m * 2.0 * radius),
    ):
        rows = np.ix_(range(n), [i, i + 6], [i, i + 6])
        K[rows] = (rigidity / L)[:, None, None] * pair
        M[rows] = inertia[:, None, None] * share
    S = np.ones((n, 4))
    S[:, 1::2] = L[:, None]
    arms = S[:, :, None] * S[:, None, :]
    k = (bar["E"] * bar["second"] / L**3)[:, None, None] * arms * BENT
    inertia = m[:, None, None] * arms * (CUBIC / 420.0 + (radius / (30.0 * L**2))[:, None, None] * TURNING)
    for where, signs in (((1, 5, 7, 11), (1, 1, 1, 1)), ((2, 4, 8, 10), (1, -1, 1, -1))):
        flip = np.outer(signs, signs)
        rows = np.ix_(range(n), where, where)
        K[rows] += k * flip
        M[rows] += inertia * flip
    return K, M


def _assembled(parts: np.ndarray, dofs: np.ndarray, size: int) -> sp.csr_array:
    rows, columns = np.repeat(dofs, 12, axis=1).ravel(), np.tile(dofs, (1, 12)).ravel()
    return sp.coo_array((parts.ravel(), (rows, columns)), shape=(size, size)).tocsr()
