"""Contributions of links and reduced components to derivatives of rest states and modes.

Links hold c(q, p) = 0. With their multipliers m the rest state is one of L = E + m'c, and

    K dq + C'dm = -dL_q,    C dq = -dc,

K the second derivative of L by q, C the slope of c. A mode has multipliers n of its own,

    (K - lambda M) phi + C'n = 0,  C phi = 0,  dlambda = phi'(dK - lambda dM) phi + 2 n'dC phi

(Fox and Kapoor's derivative, with phi held to C phi = 0 as C changes). Perturbed links and components are
laid out on frames without anything else, as `patches`: one complex step along the way of the rest state.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float

from middeck.errors import ConfigError, NumericalError
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.environment_loads import no_loads
from middeck.structure.assembly.link_rows import LinkState
from middeck.structure.assembly.linked import bent_links, close_links
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import Model, lay_out
from middeck.structure.assembly.redundant_constraints import Closing
from middeck.structure.elements.frames import Configuration, move, points_in_world
from middeck.structure.model.article import Structure
from middeck.structure.sensitivity.parameters import ModelParameter
from middeck.structure.sensitivity.patches import NOTHING, STEP, Patch, derivative

# Part of the terms in it by which a row that repeats others may leave them as a parameter changes.
REPEATS = 1e-6
# Shift of a grid of a component from its others, per unit of a parameter, that is not rounding.
STANDS = 1e-12


class Tied(NamedTuple):
    """Links of the whole at a configuration in W, and the dependent coordinates; None for no links."""

    model: Model
    links: tuple[LinkState, Closing] | None

    @staticmethod
    def at(model: Model, config: Configuration, moving: Bool[np.ndarray, " coordinate"]) -> Tied:
        """The tied structure with the coordinates that are ``moving``."""
        return Tied(model, None if model.links is None else close_links(model, config, moving))

    @property
    def slope(self) -> sp.csr_array:
        """C: one row for each number that is held."""
        return sp.csr_array((0, self.model.tree.size)) if self.links is None else self.links[0].jacobian

    def follow(self, value: Float[np.ndarray, "row parameter"]) -> Float[np.ndarray, "coordinate parameter"]:
        """Moves of dependent coordinates that take ``value`` from the rows."""
        if self.links is None:
            return np.zeros((self.model.tree.size, value.shape[1]))
        return self.links[1].follow(value)

    def multipliers(self, gradient: Float[np.ndarray, "coordinate ..."]) -> Float[np.ndarray, "row ..."]:
        """Multipliers that leave nothing of ``gradient`` at the dependent coordinates."""
        if self.links is None:
            return np.zeros((0, *gradient.shape[1:]))
        return self.links[1].multipliers(gradient)

    def check_repeated(self, parameter: ModelParameter, change: TieChange) -> None:
        """Raise `NumericalError` where a row that repeats others no longer does as ``parameter`` changes."""
        if self.links is None:
            return
        state, close = self.links
        Z = close.basis if close.axes is None else sp.csr_array(close.axes @ close.basis)
        for row, others in close.spare:
            kept = list(others)
            own, of_others = (state.jacobian[rows].toarray() for rows in ([row], kept))
            parts = np.linalg.lstsq(of_others.T, own[0], rcond=None)[0] if kept else np.zeros(0)
            terms = np.array([-1.0, *parts])[:, None] * change.slope[[row, *kept]].toarray()
            left, scale = np.abs(terms.sum(axis=0) @ Z), np.abs(terms).sum(axis=0) @ abs(Z)
            if np.any(left > REPEATS * max(1.0, float(np.abs(scale).max(initial=0.0)))):
                assert self.model.links is not None
                raise NumericalError(
                    f"no derivative by {parameter.name}: {self.model.links.label[row]} repeats others as it "
                    "is, and no longer does beside it, so that the article moves in another way there",
                    where=f"link {self.model.structure.links[int(self.model.links.link[row])].name!r}",
                    hint="release what the others hold already, or leave the parameter out",
                )


@dataclass(frozen=True, kw_only=True, eq=False)
class TieChange:
    """Derivatives of links and components in the coordinates of the whole.

    ``value`` and ``slope`` are of the rows of links, ``gradient`` and ``stiffness`` of multipliers times
    links and of the energy of components, whose ``mass`` follows; ``bent`` is the part of links in stiffness.
    """

    value: np.ndarray
    slope: sp.csr_array
    gradient: np.ndarray
    stiffness: sp.csr_array
    mass: sp.csr_array
    bent: sp.csr_array


class TieModel(NamedTuple):
    """A perturbed structure's links and components on its frames, with the coordinates that these are."""

    links: Model | None
    components: Model | None
    coordinates: np.ndarray
    size: int

    @staticmethod
    def of(model: Model, patch: Patch) -> TieModel:
        """The tie model of the perturbed structure of ``patch``; ``model`` is the whole."""
        if not patch.structure.links and not patch.structure.components:
            return TieModel(None, None, np.zeros(0, dtype=int), model.tree.size)
        bare = _bare(patch.structure)
        joints, roots = len(model.tree.parent), len(bare.nodes)
        here = np.concatenate([np.arange(6 * roots), 6 * model.tree.roots + np.arange(joints)])
        return TieModel(
            lay_out(dataclasses.replace(bare, components=())) if bare.links else None,
            lay_out(dataclasses.replace(bare, links=())) if bare.components else None,
            here,
            model.tree.size,
        )

    def check_placed(self, parameter: ModelParameter) -> None:
        """Raise `ConfigError` where ``parameter`` moves grids of a component against each other."""
        if self.components is None:
            return
        model = self.components
        places = points_in_world(model.points, model.drawn)
        for part, element in zip(model.structure.components, model.components, strict=True):
            moved = derivative((places[element.point] - places[element.point[0]]).astype(complex))
            if np.any(np.abs(moved) > STANDS):
                raise ConfigError(
                    f"no derivative by {parameter.name}: it moves grids of component {part.name!r} apart, "
                    "whose matrices stay",
                    where=f"component {part.name!r}",
                    hint="leave the parameter out, reduce the part anew, or take it as members",
                )

    def change(
        self,
        config: Configuration,
        motion: Float[np.ndarray, " coordinate"],
        gravity: np.ndarray,
        multiplier: np.ndarray,
    ) -> TieChange:
        """Derivatives as the whole's ``config`` moves by ``motion`` and ``multiplier`` is perturbed."""
        none = _untied(self.size)
        if self.links is None and self.components is None:
            return none
        value, slope, stiffness, mass, bent = none.value, none.slope, none.stiffness, none.mass, none.bent
        gradient = none.gradient.copy()
        if self.links is not None:
            state, curved = bent_links(self.links, self._moved(self.links, config, motion), multiplier)
            value, slope = derivative(state.value), self._columns(_derivative(state.jacobian))
            gradient[self.coordinates] += derivative(state.jacobian.T @ multiplier)
            bent = stiffness = self._whole(_derivative(curved))
        if self.components is not None:
            at, loads = self._moved(self.components, config, motion), no_loads()
            loads = dataclasses.replace(loads, gravity=gravity)
            total = assemble(self.components, at, loads)
            gradient[self.coordinates] += derivative(total.gradient)
            stiffness = sp.csr_array(stiffness + self._whole(_derivative(total.tangent)))
            mass = self._whole(_derivative(mass_matrix(self.components, at)))
        return TieChange(
            value=value, slope=slope, gradient=gradient, stiffness=stiffness, mass=mass, bent=bent
        )

    def _moved(self, model: Model, config: Configuration, motion: np.ndarray) -> Configuration:
        roots = model.tree.roots
        own = Configuration(config.x[:roots].astype(complex), config.R[:roots], config.angle)
        return move(model.tree, own, STEP * 1j * motion[self.coordinates])

    def _columns(self, rows: sp.csr_array) -> sp.csr_array:
        shape = (len(rows.indptr) - 1, self.size)
        return sp.csr_array((rows.data, self.coordinates[rows.indices], rows.indptr), shape=shape)

    def _whole(self, matrix: sp.csr_array) -> sp.csr_array:
        return sp.csr_array(self._columns(sp.csr_array(self._columns(matrix).T)).T)


@functools.lru_cache(maxsize=1)
def _untied(size: int) -> TieChange:
    none = sp.csr_array((size, size))
    return TieChange(
        value=np.zeros(0),
        slope=sp.csr_array((0, size)),
        gradient=np.zeros(size),
        stiffness=none,
        mass=none,
        bent=none,
    )


def _derivative(matrix: sp.csr_array) -> sp.csr_array:
    return sp.csr_array((derivative(matrix.data), matrix.indices, matrix.indptr), shape=matrix.shape)


def _bare(structure: Structure) -> Structure:
    """Frames, links and components without all else that has energy or mass."""
    return dataclasses.replace(
        structure,
        nodes=tuple(dataclasses.replace(n, body=NOTHING) for n in structure.nodes),
        joints=tuple(dataclasses.replace(j, body=NOTHING, stiffness=0.0) for j in structure.joints),
        members=(),
        springs=(),
        bushings=(),
        attach_points=(),
        loads=(),
        masses=(),
        actuators=(),
        sensors=(),
    )
