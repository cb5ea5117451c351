"""Eigensolution about a rest state (the paper's step 3), with kinds and names."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from middeck.errors import ConfigError, EquilibriumError, NumericalError, UnstableEquilibriumError
from middeck.structure.article import JointState
from middeck.structure.assembly import assemble, mass_matrix, no_loads
from middeck.structure.checks.trouble import beyond_travel, buckling_member, loose_motions, where_lost
from middeck.structure.eigen import Eigenpairs, count_zero, solve_all, solve_lowest
from middeck.structure.equilibrium import Equilibrium, rest_warnings
from middeck.structure.factorisation import order
from middeck.structure.mesh import Model
from middeck.structure.naming import name_modes
from middeck.structure.rigid import rigid_basis
from middeck.structure.rounding import rounding
from middeck.structure.statics import dynamic_coordinates, restrict
from middeck.values import record

# Below this many coordinates all modes cost less than a few.
SMALL = 600
# Two entries of a shape are equally large when they differ by less: a sign rule must not hang on rounding.
EQUAL_SIZE = 1e-6


@record
class Modes:
    """Natural modes about an equilibrium, rigid ones first, then ascending; mass-normalised.

    Parameters
    ----------
    omega:
        Angular frequency [rad/s]; exactly zero for rigid-body modes.
    shapes:
        Columns in the frame-tree coordinates (dx, world rotation, relative joint angle); joints that do not
        move have zero rows. The entry of largest size in kinetic energy is positive.
    kind, name:
        "rigid", "suspension" or "flexible", and what the mode is.
    strain_share:
        Part of the potential energy that is elastic strain of members, springs and joints;
        zero for a rigid-body mode, which has no potential energy.
    residual:
        Of each mode, |K phi - omega^2 M phi| over the size of its terms; grows towards the top of the list.
    rigid_residual:
        Largest |omega^2| of a rigid mode before it was set to zero, over the lowest omega^2 that was kept
        (over 1 rad^2/s^2 where none was).
    warnings:
        Nodes that turned far on the way to rest; modes whose strain energy disagrees with their kind.
    """

    equilibrium: Equilibrium
    omega: Float[np.ndarray, " mode"]
    shapes: Float[np.ndarray, "coordinate mode"]
    mass: sp.csr_array
    kind: tuple[str, ...]
    name: tuple[str, ...]
    strain_share: Float[np.ndarray, " mode"]
    residual: Float[np.ndarray, " mode"]
    rigid_residual: float
    warnings: tuple[str, ...]

    @property
    def frequency_hz(self) -> Float[np.ndarray, " mode"]:
        """Natural frequencies [Hz]."""
        return self.omega / (2.0 * np.pi)


def solve_modes(equilibrium: Equilibrium, count: int | None = None) -> Modes:
    """All modes of finite frequency about ``equilibrium``, or the ``count`` lowest of a large model.

    Raises `EquilibriumError` when the equilibrium was not reached and `UnstableEquilibriumError` when a mode
    grows. In an environment that holds the article, the n lowest modes are of kind "suspension", n being the
    number of rigid-body modes in orbit.
    """
    if count is not None and (count != int(count) or count < 1):
        raise ConfigError(f"{count} modes", where="count", hint="a whole number from 1, or None for all")
    if not equilibrium.converged:
        raise _not_at_rest(equilibrium)
    K, M, lam, shapes, rigid = _solve(equilibrium, count)
    rigid_residual = float(np.abs(lam[:rigid]).max(initial=0.0) / (lam[rigid] if rigid < len(lam) else 1.0))
    lam[:rigid] = 0.0
    shapes[:, :rigid], rigid_names = rigid_basis(equilibrium, M, shapes[:, :rigid])
    shapes = shapes * _signs(M, shapes)
    kind = _kinds(equilibrium, M, rigid, len(lam))
    names, share, warnings = name_modes(equilibrium, M, K, shapes, kind, rigid_names)
    _check_stable(equilibrium, lam, shapes, names)
    active = dynamic_coordinates(equilibrium.model)
    residual = _residual(K[active], M[active], shapes, lam)
    warnings = rest_warnings(equilibrium) + loose_motions(equilibrium, rigid_names) + warnings
    return Modes(equilibrium, np.sqrt(lam), shapes, M, kind, names, share, residual, rigid_residual, warnings)


def _not_at_rest(equilibrium: Equilibrium) -> EquilibriumError:
    factor, frame, left, moved = where_lost(equilibrium)
    fell = any(damping > 0.0 for _, _, damping in equilibrium.history)
    return EquilibriumError(
        f"no linearisation about a state that is not at rest (residual {equilibrium.residual:.1e}): the way "
        f"there was lost at {factor:.0%} of the load, {left:.3g} N are left at frame {frame!r}, and "
        f"nodes have moved by up to {moved:.3g} m",
        where=f"frame {frame!r}",
        hint="look at the residual history; check the supports, and the stiffness of what joins that frame"
        + ("; on the way the tangent lost its stability: something buckled or toppled" if fell else "")
        + "".join(f"; joint {name!r} went beyond its travel" for name in beyond_travel(equilibrium)),
        history=equilibrium.history,
        load_factor=factor,
        frame=frame,
        moved=moved,
    )


def _solve(
    equilibrium: Equilibrium, count: int | None
) -> tuple[sp.csr_array, sp.csr_array, np.ndarray, np.ndarray, int]:
    """Tangent, mass, omega^2, shapes, and how many of them, which come first, are rigid."""
    model, active = equilibrium.model, dynamic_coordinates(equilibrium.model)
    at = assemble(model, equilibrium.config, equilibrium.loads)
    M = mass_matrix(model, equilibrium.config, equilibrium.loads)
    pairs = _eigenpairs(model, restrict(at.tangent, active), restrict(M, active), count)
    rigid = np.abs(pairs.lam) < rounding(model, pairs, at.gradient)
    rank = np.argsort(~rigid, kind="stable")
    shapes = np.zeros((len(active), len(rigid)))
    shapes[active] = pairs.shapes[:, rank]
    return at.tangent, M, pairs.lam[rank], shapes, int(np.sum(rigid))


def _eigenpairs(model: Model, K: sp.csr_array, M: sp.csr_array, count: int | None) -> Eigenpairs:
    if count is None or order(K) <= max(SMALL, 4 * count):
        pairs = solve_all(K, M)
        pairs = pairs and Eigenpairs(pairs.lam[:count], pairs.shapes[:, :count], pairs.noise[:count])
    else:
        pairs = solve_lowest(K, M, count)
    if pairs is None:
        raise _massless(model, K + M)
    return pairs


def _massless(model: Model, shifted: sp.csr_array) -> NumericalError:
    worst = int(np.argmin(abs(shifted).sum(axis=0)))
    coordinate = int(np.flatnonzero(dynamic_coordinates(model))[worst])
    roots = model.tree.roots
    frame = coordinate // 6 if coordinate < 6 * roots else coordinate - 5 * roots
    return NumericalError(
        "a motion that has no mass is held by no stiffness",
        where=f"frame {model.frames[frame]!r}",
        hint="give the frame a mass and an inertia, or lock its axis",
    )


def _kinds(equilibrium: Equilibrium, M: sp.csr_array, rigid: int, count: int) -> tuple[str, ...]:
    """By rank: rigid ones, then as many held ones as orbit has more rigid ones, then flexible ones."""
    free = not np.any(equilibrium.environment.gravity) and not len(equilibrium.loads.attach_point)
    held = 0 if free else _rigid_in_orbit(equilibrium, M) - rigid
    kinds = ("rigid",) * rigid + ("suspension",) * held
    return (kinds + ("flexible",) * (count - len(kinds)))[:count]


def _rigid_in_orbit(equilibrium: Equilibrium, M: sp.csr_array) -> int:
    """Number of rigid-body modes of the same structure, free and undeformed: any mass counts them alike.

    What members join to one piece has six, and one for each free joint; springs can add mechanisms or take
    joints away, and then the modes of no stiffness are counted.
    """
    model, active = equilibrium.model, dynamic_coordinates(equilibrium.model)
    structure = model.structure
    stiff = all(
        min(m.section.EA, m.section.GJ, m.section.EI_y, m.section.EI_z) > 0.0 for m in structure.members
    )
    if stiff and not structure.springs:
        return 6 + sum(joint.state is JointState.FREE for joint in structure.joints)
    K = assemble(model, model.rest, no_loads()).tangent
    return count_zero(restrict(K, active), restrict(M, active))


def _signs(M: sp.csr_array, shapes: np.ndarray) -> np.ndarray:
    kinetic = shapes * (M @ shapes)
    largest = np.argmax(kinetic >= (1.0 - EQUAL_SIZE) * kinetic.max(axis=0), axis=0)
    return np.where(shapes[largest, np.arange(shapes.shape[1])] < 0.0, -1.0, 1.0)


def _check_stable(
    equilibrium: Equilibrium, lam: np.ndarray, shapes: np.ndarray, names: tuple[str, ...]
) -> None:
    for m, (value, name) in enumerate(zip(lam, names, strict=True)):
        if value < 0.0:
            member = buckling_member(equilibrium, shapes[:, m])
            buckles = "" if member is None else f"; member {member!r} buckles"
            raise UnstableEquilibriumError(
                f"the rest state is not stable: mode {name!r} grows at {np.sqrt(-value):.4g} rad/s{buckles}",
                hint="is a payload above its axes, an attach point below the centre of mass, a member "
                "buckled? lower gravity, spring the axis or move the attach points",
                growth=float(np.sqrt(-value)),
                mode=name,
                member=member,
            )


def _residual(K: sp.csr_array, M: sp.csr_array, shapes: np.ndarray, lam: np.ndarray) -> np.ndarray:
    elastic, inertial = K @ shapes, (M @ shapes) * lam
    size = abs(K) @ np.abs(shapes) + (abs(M) @ np.abs(shapes)) * lam
    largest = size.max(axis=0)
    return np.abs(elastic - inertial).max(axis=0) / np.where(largest > 0.0, largest, 1.0)
