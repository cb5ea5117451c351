"""Eigensolution about a rest state (the paper's step 3), with kinds and names."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError, EquilibriumError, NumericalError, UnstableEquilibriumError
from middeck.structure.assembly.energy import assemble, assemble_carried
from middeck.structure.assembly.freedom import Freedom
from middeck.structure.assembly.linked import dynamic_freedom
from middeck.structure.assembly.mass import carried_mass, mass_matrix
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.places import transport
from middeck.structure.eigenproblem.eigen import NOTHING, solve_pairs
from middeck.structure.eigenproblem.rigid_or_rounding import rounding, separate_rigid
from middeck.structure.elements.motion_since_drawn import uncarried
from middeck.structure.modes.lost_loose_or_buckled import (
    buckling_member,
    gone_too_far,
    loose_motions,
    moment_warnings,
    where_lost,
)
from middeck.structure.modes.mesh_error import mesh_warnings
from middeck.structure.modes.motions.left_out_stiffness import component_warnings
from middeck.structure.modes.motions.rigid_motions import rigid_basis
from middeck.structure.modes.names.kinds import find_kinds, kind_warnings
from middeck.structure.modes.names.naming import name_modes
from middeck.structure.modes.reduction_error import reduction_warnings
from middeck.structure.rest.equilibrium import Equilibrium, rest_warnings
from middeck.values import record, require_kind

# Two entries of a shape are equally large when they differ by less: a sign rule must not hang on rounding.
EQUAL_SIZE = 1e-6
# Frequencies whose error by the mesh is reported: any mesh is too coarse for its highest ones.
JUDGED = 26


@record(kw_only=True)
class Modes:
    """Natural modes about an equilibrium, rigid ones first, then ascending; mass-normalised.

    Attributes:
        omega: Angular frequency [rad/s]; exactly zero for rigid-body modes.
        shapes: Columns in the frame-tree coordinates (dx, world rotation, relative joint angle); joints that
            do not move have zero rows. The entry of largest size in kinetic energy is positive.
        kind: "rigid", "suspension", "pendulum" or "flexible" (see `structure.modes.names.kinds`).
        rigid_name: Name of each rigid-body mode.
        rigid_share: Part of the kinetic energy in rigid-body motions of the free article, turns of free
            joints included; it decides the kind, see `structure.modes.names.kinds`.
        strain_share: Part of the restoring energy that is elastic strain of members, springs and joints: the
            rest is in devices, weight and preload. Zero for a rigid-body mode, which has no potential energy.
        residual: |K phi - omega^2 M phi| of each mode over the size of its terms; grows towards the top of
            the list.
        rigid_residual: Largest |omega^2| of a rigid mode before it was set to zero, over the lowest omega^2
            that was kept (over 1 rad^2/s^2 where none was).
        stated_warnings: Nodes that turned far from their drawn attitude; loose motions; modes of undecided
            kind.
        judged: Number of the lowest frequencies whose error by mesh and reductions is among the `warnings`.
        stated_name: Name of each mode, where it is no mode of ``equilibrium`` itself.
    """

    equilibrium: Equilibrium
    omega: Float[np.ndarray, " mode"]
    shapes: Float[np.ndarray, "coordinate mode"]
    mass: sp.csr_array
    kind: tuple[str, ...]
    rigid_name: tuple[str, ...]
    rigid_share: Float[np.ndarray, " mode"]
    strain_share: Float[np.ndarray, " mode"]
    residual: Float[np.ndarray, " mode"]
    rigid_residual: float
    stated_warnings: tuple[str, ...]
    judged: int = JUDGED
    stated_name: tuple[str, ...] = ()

    @property
    def frequency_hz(self) -> Float[np.ndarray, " mode"]:
        """Natural frequencies [Hz]."""
        return self.omega / (2.0 * np.pi)

    @functools.cached_property
    def name(self) -> tuple[str, ...]:
        """Name of each mode."""
        if self.stated_name:
            return self.stated_name
        lam = self.omega**2
        return name_modes(self.equilibrium, self.mass, lam, self.shapes, self.kind, self.rigid_name)

    @functools.cached_property
    def warnings(self) -> tuple[str, ...]:
        """The stated warnings, then those of a coarse mesh and of reductions: computed when first read."""
        judged = self.judged
        return (*self.stated_warnings, *mesh_warnings(self, judged), *reduction_warnings(self, judged))


@named_kinds
def solve_modes(equilibrium: Equilibrium, count: int | None = None, *, standstill: bool = False) -> Modes:
    """All modes of finite frequency about ``equilibrium``, or the ``count`` lowest of a large model.

    Where wheels spin, modes are complex: `solve_gyroscopic_modes` and `build_plant` find them from those
    with the wheels at rest, which only ``standstill`` gives; `ConfigError` without it.

    Raises `EquilibriumError` when the equilibrium was not reached and `UnstableEquilibriumError` when a mode
    grows. In an environment that holds the article, a mode is of kind "suspension" where half or more of its
    motion is a rigid-body motion of the free article, or as far as clamps leave it free; ``warnings`` tell
    where that is undecided.
    """
    require_kind(equilibrium, Equilibrium, "rest state", "solve_equilibrium(structure, environment)")
    if count is not None and (count != int(count) or count < 1):
        raise ConfigError(f"{count} modes", where="count", hint="a whole number from 1, or None for all")
    if equilibrium.environment.spins and not standstill:
        turning = ", ".join(name for name, speed in equilibrium.environment.wheel_speeds if speed != 0.0)
        raise ConfigError(
            f"wheels spin ({turning}): the modes are complex, and real ones leave the momentum out",
            where=f"environment {equilibrium.environment.title!r}",
            hint="modes, response, design and qualify take the momentum; for compare, budget, path, "
            "sensitivity, correlate and the rig set the speeds to zero; in Python "
            "solve_modes(rest, standstill=True), then solve_gyroscopic_modes or build_plant",
        )
    if not equilibrium.converged:
        raise _not_at_rest(equilibrium)
    K, M, lam, shapes, rigid = _solve(equilibrium, count)
    rigid_residual = float(np.abs(lam[:rigid]).max(initial=0.0) / (lam[rigid] if rigid < len(lam) else 1.0))
    lam[:rigid] = 0.0
    shapes[:, :rigid], rigid_names = rigid_basis(equilibrium, M, shapes[:, :rigid])
    found = find_kinds(equilibrium, M, lam, shapes, rigid)
    lam, kind, shapes = found.lam, found.kind, found.shapes * _signs(M, found.shapes)
    # A refinement solves for modes many times, and names none.
    names = functools.partial(name_modes, equilibrium, M, lam, shapes, kind, rigid_names)
    _check_stable(equilibrium, lam, shapes, names)
    residual = _residual(
        dynamic_freedom(equilibrium.model, equilibrium.config, in_world=True), K, M, shapes, lam
    )
    omega = np.sqrt(lam)
    warnings = (
        *rest_warnings(equilibrium),
        *loose_motions(equilibrium, rigid_names),
        *moment_warnings(equilibrium, lam, shapes),
        *component_warnings(equilibrium, lam, shapes),
        *kind_warnings(equilibrium, omega, kind, names, found.rigid_share, found.strain_share),
    )
    return Modes(
        equilibrium=equilibrium,
        omega=omega,
        shapes=shapes,
        mass=M,
        kind=kind,
        rigid_name=rigid_names,
        rigid_share=found.rigid_share,
        strain_share=found.strain_share,
        residual=residual,
        rigid_residual=rigid_residual,
        stated_warnings=warnings,
    )


def _not_at_rest(equilibrium: Equilibrium) -> EquilibriumError:
    factor, frame, left, moved = where_lost(equilibrium)
    fell = any(damping > 0.0 for _, _, damping in equilibrium.history)
    return EquilibriumError(
        f"no linearisation about a state that is not at rest (residual {equilibrium.residual:.1e}): the way "
        f"there was lost at {factor:.0%} of the load, {left} are left at frame {frame!r}, and "
        f"nodes have moved by up to {moved:.3g} m",
        where=f"frame {frame!r}",
        hint="look at the residual history; check the supports, and the stiffness of what joins that frame"
        + ("; on the way the tangent lost its stability: something buckled or toppled" if fell else "")
        + "".join(gone_too_far(equilibrium)),
        history=equilibrium.history,
        load_factor=factor,
        frame=frame,
        moved=moved,
    )


def _solve(
    equilibrium: Equilibrium, count: int | None
) -> tuple[sp.csr_array, sp.csr_array, np.ndarray, np.ndarray, int]:
    """Tangent, mass, omega^2, shapes, and how many of them, which come first, are rigid."""
    model, config, loads = equilibrium.model, equilibrium.config, equilibrium.loads
    free = dynamic_freedom(model, config)
    if not np.any(free.active):
        raise ConfigError(
            "clamps hold all that could move: there are no modes",
            where=f"environment {equilibrium.environment.title!r}",
            hint="leave something free, or mesh the members with more elements",
        )
    at, mass = assemble_carried(model, config, loads), carried_mass(model, config, loads)
    if not free.matrix(mass).data.any():
        raise ConfigError(
            "nothing that moves has mass: there are no modes",
            where="article",
            hint="give its bodies mass_kg, or its members a density",
        )
    nothing = free.cancels(at.tangent, NOTHING) & free.cancels(mass, NOTHING)
    if np.any(nothing):
        raise _massless(model, free, int(np.argmax(nothing)))
    soft = uncarried(config.since_drawn, len(free.active))[free.active]
    K, M = free.matrix(at.tangent), free.matrix(mass)
    pairs = solve_pairs(K, M, count, soft)
    if pairs is None:
        raise _massless(model, free, int(np.argmin(abs(K + M).sum(axis=0))))
    pairs = separate_rigid(model, config, loads, pairs.pick(slice(count)), free, at)
    T = transport(config, model.tree)
    rigid = np.abs(pairs.lam) <= rounding(model, config, pairs, at.gradient, free, T)
    rank = np.argsort(~rigid, kind="stable")
    shapes = free.spread(pairs.shapes[:, rank])
    if config.since_drawn is not None and config.since_drawn.carries:
        shapes = T @ shapes
        at, mass = assemble(model, config, loads), mass_matrix(model, config, loads)
    return at.tangent, mass, pairs.lam[rank], shapes, int(np.sum(rigid))


def _massless(model: Model, free: Freedom, worst: int) -> NumericalError:
    frame = model.tree.frame_of(int(np.flatnonzero(free.active)[worst]))
    return NumericalError(
        "a motion has neither mass nor stiffness",
        where=f"frame {model.frames[frame]!r}",
        hint="give the frame, or what carries it, a mass and an inertia, lock its axis, or clamp that motion "
        "in the environment",
    )


def _signs(M: sp.csr_array, shapes: np.ndarray) -> np.ndarray:
    kinetic = shapes * (M @ shapes)
    largest = np.argmax(kinetic >= (1.0 - EQUAL_SIZE) * kinetic.max(axis=0), axis=0)
    return np.where(shapes[largest, np.arange(shapes.shape[1])] < 0.0, -1.0, 1.0)


def _check_stable(
    equilibrium: Equilibrium, lam: np.ndarray, shapes: np.ndarray, names: Callable[[], tuple[str, ...]]
) -> None:
    environment = equilibrium.environment
    for m, value in enumerate(lam):
        if value < 0.0:
            name = names()[m]
            member = buckling_member(equilibrium, shapes[:, m])
            buckles = "" if member is None else f"; member {member!r} buckles"
            raise UnstableEquilibriumError(
                f"the rest state is not stable: mode {name!r} grows at {np.sqrt(-value):.4g} rad/s{buckles}",
                hint="is a payload above its axes, an attach point below the centre of mass, a member "
                "buckled? lower gravity, spring the axis or move the attach points"
                + ("; what spinning wheels alone hold, the least damping lets go" * environment.spins),
                growth=float(np.sqrt(-value)),
                mode=name,
                member=member,
            )


def _residual(
    free: Freedom, K: sp.csr_array, M: sp.csr_array, shapes: np.ndarray, lam: np.ndarray
) -> np.ndarray:
    elastic, inertial = K @ shapes, (M @ shapes) * lam
    size = free.part(abs(K) @ np.abs(shapes) + (abs(M) @ np.abs(shapes)) * lam)
    largest = size.max(axis=0, initial=0.0)
    left = np.abs(free.part(elastic - inertial)).max(axis=0, initial=0.0)
    return left / np.where(largest > 0.0, largest, 1.0)
