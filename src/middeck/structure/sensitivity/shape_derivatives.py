"""Derivatives of mode shapes, and of the space of those that share a frequency.

The shape of mode i moves by x_i outside of its group of equal frequencies Phi and by what keeps the mass at
one inside of it:

    [ K - lambda_i M   M Phi ] [x_i]   [ -(dK - lambda_i dM) phi_i ]
    [ Phi' M           0     ] [ . ] = [ 0                         ],

    dphi_i = x_i - Phi (Phi' dM phi_i) / 2

(Nelson 1976, AIAA J. 14, with a border in the place of his struck coordinate: no choice to make, symmetric,
and as well conditioned for a group). No mode is left out of x_i. Within a group any rotation of the shapes is
as good as none: none is given, so that the space that they span is differentiated, group by group.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from jaxtyping import Float

from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.freedom import Freedom
from middeck.structure.assembly.linked import dynamic_coordinates, dynamic_freedom
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import lay_out
from middeck.structure.eigenproblem.repeated import by_frequency
from middeck.structure.modes.solve import Modes
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.rest.suspension_tuning import environment_loads
from middeck.structure.sensitivity.frequency_derivatives import mode_multipliers
from middeck.structure.sensitivity.links_and_components import TieChange, Tied
from middeck.structure.sensitivity.parameters import ModelParameter
from middeck.structure.sensitivity.patches import columns, derivative, follow
from middeck.structure.sensitivity.rest import MovedRest, move_rest
from middeck.structure.sensitivity.stiff_member_derivatives import Softened, soften_modes
from middeck.values import record


@record
class ModeSensitivity:
    """Derivatives of the lowest modes in one parameter.

    Attributes:
        d_lambda: Phi'(dK - lambda dM) Phi [rad^2/s^2 per unit] within each group of equal frequencies, zero
            between groups: on its diagonal the derivatives of omega^2 of modes that are alone.
        d_shapes: Derivatives of mass-normalised shapes, in tree coordinates of the moving rest state.
    """

    parameter: ModelParameter
    d_lambda: Float[np.ndarray, "mode mode"]
    d_shapes: Float[np.ndarray, "coordinate mode"]


def differentiate_modes(
    modes: Modes, parameters: Sequence[ModelParameter], count: int | None = None
) -> tuple[ModeSensitivity, ...]:
    """Derivatives of the lowest ``count`` modes (all by default) in every parameter; exact to rounding.

    One factorisation a mode, and one assembly of everything a parameter; beside a member too stiff for that
    as `differentiate_frequencies`. Raises `NumericalError` where the rest state has no derivative.
    """
    count = len(modes.omega) if count is None else min(count, len(modes.omega))
    softer, article = soften_modes(modes, count, "derivatives of modes")
    found = differentiate_shapes(softer, article, parameters, count)
    return tuple(
        dataclasses.replace(one, d_lambda=scale * one.d_lambda, d_shapes=scale * one.d_shapes)
        for (_, one), scale in zip(found, article.scales(parameters), strict=True)
    )


def _perturbed(rest: Equilibrium, moved: MovedRest, number: int) -> Equilibrium:
    """The rest state with the derivatives in one parameter in its imaginary parts.

    Its residual, holding torques and tensions are not perturbed.
    """
    patch, tree = moved.patches[number], rest.model.tree
    patch = dataclasses.replace(
        patch,
        model=lay_out(dataclasses.replace(patch.structure, links=())),  # those are in `ties`
        roots=np.arange(tree.roots),
        joints=np.arange(len(tree.parent)),
        coordinates=np.arange(tree.size),
    )
    return dataclasses.replace(
        rest,
        model=patch.model,
        environment=patch.environment,
        config=follow(patch, rest.config, moved.motion[:, number]),
        loads=environment_loads(patch.model, patch.environment, moved.tuned[number]),
        suspension=moved.tuned[number],
    )


def differentiate_shapes(
    modes: Modes, article: Softened, parameters: Sequence[ModelParameter], count: int
) -> Iterator[tuple[Equilibrium, ModeSensitivity]]:
    """The perturbed rest state and the derivatives of modes of a softened article, by each parameter."""
    rest = modes.equilibrium
    moved = move_rest(rest, article.parameters(parameters))
    perturbed = [_perturbed(rest, moved, p) for p in range(len(parameters))]
    pencil = _Pencil.of(modes)
    links = Tied.at(rest.model, rest.config, dynamic_coordinates(rest.model))
    held = mode_multipliers(modes, count)
    lam, shapes = modes.omega**2, modes.shapes
    changes = [_changes(at, tie) for at, tie in zip(perturbed, moved.ties, strict=True)]
    size = len(shapes)
    d_lambda = np.zeros((len(parameters), count, count))
    d_shapes = np.zeros((len(parameters), size, count))
    for own in by_frequency(lam[:count]):
        for i in own.tolist():
            load = columns([dK @ shapes[:, i] - lam[i] * (dM @ shapes[:, i]) for dK, dM in changes], size)
            load = load + columns([tie.slope.T @ held[:, i] for tie in moved.ties], size)
            slip = columns([tie.slope @ shapes[:, i] for tie in moved.ties], len(held))
            turn = columns([shapes[:, own].T @ (dM @ shapes[:, i]) for _, dM in changes], len(own))
            x = pencil.solve(lam[i], shapes[:, own], -load, links.follow(slip))
            d_shapes[:, :, i] = (x - 0.5 * shapes[:, own] @ turn).T
            d_lambda[:, own, i] = (shapes[:, own].T @ load + held[:, own].T @ slip).T
    for at, parameter, small, change in zip(perturbed, parameters, d_lambda, d_shapes, strict=True):
        yield at, ModeSensitivity(parameter, 0.5 * (small + small.T), change)


def _changes(rest: Equilibrium, tie: TieChange) -> tuple[sp.csr_array, sp.csr_array]:
    """dK and dM."""
    K = assemble(rest.model, rest.config, rest.loads).tangent
    M = mass_matrix(rest.model, rest.config, rest.loads)
    for matrix in (K, M):
        matrix.data = derivative(matrix.data)
    return sp.csr_array(K + tie.bent), M


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pencil:
    """K and M in W, and ``own_K`` and ``own_M`` on the coordinates that move."""

    K: sp.csr_array
    M: sp.csr_array
    own_K: sp.csr_array
    own_M: sp.csr_array
    free: Freedom

    @staticmethod
    def of(modes: Modes) -> _Pencil:
        rest = modes.equilibrium
        free = dynamic_freedom(rest.model, rest.config, in_world=True)
        K, M = assemble(rest.model, rest.config, rest.loads).tangent, modes.mass
        return _Pencil(K=K, M=M, own_K=free.matrix(K), own_M=free.matrix(M), free=free)

    def solve(self, lam: float, group: np.ndarray, load: np.ndarray, start: np.ndarray) -> np.ndarray:
        """x of (K - lam M) x = load but for forces of the group and of links, orthogonal to it in the mass.

        It differs from ``start`` by what links allow.
        """
        A, own = sp.csr_array(self.own_K - lam * self.own_M), self.free.coordinates(group)
        inside = self.free.part(load - self.K @ start + lam * (self.M @ start))
        diagonal = np.abs(A.diagonal())
        S = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        A.data *= np.repeat(S, np.diff(A.indptr)) * S[A.indices]
        border = S[:, None] * (self.own_M @ own)
        border = border / np.sqrt(np.einsum("im,im->m", border, border))
        bordered = sp.csc_array(sp.block_array([[A, border], [border.T, None]]))
        factor: Any = spla.splu(bordered)
        force = np.vstack([S[:, None] * inside, np.zeros((own.shape[1], load.shape[1]))])
        z = factor.solve(force)
        z += factor.solve(force - bordered @ z)
        x = start + self.free.spread(S[:, None] * z[: len(inside)])
        return x - group @ (group.T @ (self.M @ start))
