"""Small displacements of a rest state under further loads, without motions that nothing holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp

from middeck.errors import NumericalError
from middeck.structure.assembly.energy import Assembly
from middeck.structure.assembly.factorisation import Factor, factorise
from middeck.structure.assembly.freedom import Freedom
from middeck.structure.assembly.linked import static_freedom
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.redundant_constraints import pivots
from middeck.structure.eigenproblem.eigen import ROUNDING, solve_pairs
from middeck.structure.elements.frames import rigid_columns
from middeck.structure.model.article import JointState
from middeck.structure.rest.equilibrium import Equilibrium

# What a solution may leave of its load, over the terms that balance in it.
SOLVED = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class StaticSolver:
    """K of the coordinates that move in statics, factorised where as many are held as there are free motions.

    ``free`` is a basis of these, orthonormal in the mass: a solution has no part of them.
    """

    K: sp.csr_array
    mass: sp.csr_array
    moves: Freedom
    held: np.ndarray
    free: np.ndarray
    factor: Factor

    @staticmethod
    def at(rest: Equilibrium, at: Assembly) -> StaticSolver:
        """The solver at a rest state whose potential is ``at``."""
        moves = static_freedom(rest.model, rest.config, in_world=True)
        K = moves.matrix(at.tangent)
        M = moves.matrix(mass_matrix(rest.model, rest.config, rest.loads))
        free = _free_motions(rest, K, M, float(np.abs(moves.part(at.gradient)).max(initial=0.0)), moves)
        held = pivots(free)
        kept = np.setdiff1d(np.arange(len(free)), held)
        factor = factorise(sp.csr_array(K[kept][:, kept]))
        if factor is None:
            raise _loose()
        return StaticSolver(K=K, mass=M, moves=moves, held=held, free=free, factor=factor)

    def solve(self, *loads: np.ndarray) -> np.ndarray:
        """Displacements (coordinate, load) under the sum of ``loads``, which are all of all coordinates.

        What they leave of each other is rounding: of a dimension of an article that floats nothing is left.
        """
        load = np.sum(loads, axis=0)
        if not np.any(load):
            return np.zeros_like(load)
        force = self.moves.part(load)
        kept = np.setdiff1d(np.arange(len(force)), self.held)
        x = np.zeros_like(force)
        for _ in range(3):  # twice more for what rounding has left
            x[kept] += self.factor.solve((force - self.K @ x)[kept])
        size = (abs(self.K) @ np.abs(x)).max(axis=0)
        size += sum(np.abs(self.moves.part(part)).max(axis=0) for part in loads)
        if not np.all(np.abs(force - self.K @ x).max(axis=0) <= SOLVED * size):
            raise _loose()
        return self.moves.spread(x - self.free @ (self.free.T @ (self.mass @ x)))


def _loose() -> NumericalError:
    return NumericalError(
        "the rest state has no derivative: a load drives a motion that nothing holds",
        hint="a device, a spring or a locked joint holds it; or leave the parameter out",
    )


def _free_motions(
    rest: Equilibrium, K: sp.csr_array, M: sp.csr_array, unbalanced: float, moves: Freedom
) -> np.ndarray:
    """Motions that cost no energy but for rounding: of the whole, and of parts on hinges and links."""
    whole = rigid_columns(rest.model.tree, rest.config, rest.config.x.mean(axis=0))
    T = moves.coordinates(moves.allowed(whole))
    structure = rest.model.structure
    hinges = sum(joint.state is JointState.SPRUNG and not joint.stiffness for joint in structure.joints)
    if hinges or structure.links:
        found = solve_pairs(K, M, T.shape[1] + hinges + 5 * len(structure.links))
        if found is None:
            raise _loose()
        return _costless(found.lam, found.shapes, found.noise, unbalanced)
    stiffness, size = T.T @ (K @ T), np.abs(T).T @ (abs(K) @ np.abs(T))
    lam, turn = sla.eigh(0.5 * (stiffness + stiffness.T), T.T @ (M @ T))
    noise = ROUNDING * np.diag(np.abs(turn).T @ size @ np.abs(turn))
    return _costless(lam, T @ turn, noise, unbalanced)


def _costless(lam: np.ndarray, motions: np.ndarray, noise: np.ndarray, unbalanced: float) -> np.ndarray:
    return motions[:, np.abs(lam) <= noise + unbalanced * np.abs(motions).max(axis=0) ** 2]
