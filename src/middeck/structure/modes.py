"""Eigensolution about a rest state (the paper's step 3), with kinds and names."""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp
from jaxtyping import Float

from middeck.errors import EquilibriumError, NumericalError, UnstableEquilibriumError
from middeck.structure.assembly import assemble, mass_matrix
from middeck.structure.environment import Environment
from middeck.structure.equilibrium import Equilibrium, rest_warnings, solve_equilibrium
from middeck.structure.mesh import Model
from middeck.structure.naming import name_modes
from middeck.structure.rigid import rigid_basis
from middeck.structure.statics import dynamic_coordinates, static_coordinates
from middeck.values import record

# A mode is rigid whose energy is below this part of the sum of the absolute terms that cancel in it. Rounding
# leaves 1e-17 on the two articles; a 0.02 Hz restraint on them leaves 1e-10.
ROUNDING = 1e-14
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


def solve_modes(equilibrium: Equilibrium) -> Modes:
    """All modes of finite frequency about ``equilibrium``.

    Raises `EquilibriumError` when the equilibrium was not reached and `UnstableEquilibriumError` when a mode
    grows. In an environment that holds the article, the n lowest modes are of kind "suspension", n being the
    number of rigid-body modes in orbit.
    """
    if not equilibrium.converged:
        raise EquilibriumError(
            f"no linearisation about a state that is not at rest (residual {equilibrium.residual:.1e})",
            hint="look at the residual history; soften the load path or check the supports",
            history=equilibrium.history,
        )
    K, M, lam, shapes, rigid = _solve(equilibrium)
    rigid_residual = float(np.abs(lam[:rigid]).max(initial=0.0) / (lam[rigid] if rigid < len(lam) else 1.0))
    lam[:rigid] = 0.0
    shapes[:, :rigid], rigid_names = rigid_basis(equilibrium, M, shapes[:, :rigid])
    shapes = shapes * _signs(M, shapes)
    kind = _kinds(equilibrium, rigid, len(lam))
    names, share, warnings = name_modes(equilibrium, M, K, shapes, kind, rigid_names)
    _check_stable(lam, names)
    active = dynamic_coordinates(equilibrium.model)
    residual = _residual(K[active], M[active], shapes, lam)
    warnings = rest_warnings(equilibrium) + warnings
    return Modes(equilibrium, np.sqrt(lam), shapes, M, kind, names, share, residual, rigid_residual, warnings)


def _solve(
    equilibrium: Equilibrium,
) -> tuple[sp.csr_array, sp.csr_array, np.ndarray, np.ndarray, int]:
    """Tangent, mass, omega^2, shapes, and how many of them, which come first, are rigid."""
    model, active = equilibrium.model, dynamic_coordinates(equilibrium.model)
    at = assemble(model, equilibrium.config, equilibrium.loads)
    M = mass_matrix(model, equilibrium.config)
    K_active = at.tangent[active][:, active].toarray()
    lam, phi, noise = _eigenpairs(model, K_active, M[active][:, active].toarray())
    # A force that Newton left unbalanced adds no more than itself to the tangent when the structure turns.
    unbalanced = float(np.abs(at.gradient[static_coordinates(model)]).max(initial=0.0))
    noise = noise + unbalanced * np.abs(phi).max(axis=0) ** 2
    rigid = np.abs(lam) < noise
    order = np.argsort(~rigid, kind="stable")
    shapes = np.zeros((len(active), len(lam)))
    shapes[active] = phi[:, order]
    return at.tangent, M, lam[order], shapes, int(np.sum(rigid))


def _eigenpairs(model: Model, K: np.ndarray, M: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ascending lambda = omega^2, shapes and the rounding of lambda, from M phi = mu (K + sigma M) phi.

    The direct problem leaves rounding of 1e-16 times the largest omega^2 (1e13 here) on the smallest; its
    inverse is accurate where the interest lies (Parlett 1980, section 15). Motions without mass have mu = 0
    and are left out.
    """
    sigma = 1e-9 * np.abs(np.diag(K)).max() / np.abs(np.diag(M)).max() + 1.0
    for _ in range(20):
        try:
            mu, phi = sla.eigh(M, K + sigma * M)
        except sla.LinAlgError:  # an unstable state: shift beyond its growth rate
            sigma *= 10.0
            continue
        moved = mu > len(mu) * np.finfo(float).eps * mu[-1]
        mu, phi = mu[moved][::-1], phi[:, moved][:, ::-1]
        phi = phi / np.sqrt(np.einsum("im,ij,jm->m", phi, M, phi, optimize=True))
        size = np.einsum("im,im->m", np.abs(phi), np.abs(K) @ np.abs(phi))
        lam = 1.0 / mu - sigma
        # The inverse rounds to eps lam^2 / sigma, the Rayleigh quotient to eps size: take the finer.
        high = lam**2 > sigma * size
        lam[high] = np.einsum("im,ij,jm->m", phi[:, high], K, phi[:, high], optimize=True)
        return lam, phi, ROUNDING * (size + sigma)
    raise _massless(model, K + sigma * M)


def _massless(model: Model, shifted: np.ndarray) -> NumericalError:
    worst = int(np.argmax(np.abs(np.linalg.eigh(shifted)[1][:, 0])))
    coordinate = int(np.flatnonzero(dynamic_coordinates(model))[worst])
    roots = model.tree.roots
    frame = coordinate // 6 if coordinate < 6 * roots else coordinate - 5 * roots
    return NumericalError(
        "a motion that has no mass is held by no stiffness",
        where=f"frame {model.frames[frame]!r}",
        hint="give the frame a mass and an inertia, or lock its axis",
    )


def _kinds(equilibrium: Equilibrium, rigid: int, count: int) -> tuple[str, ...]:
    """By rank: rigid ones, then as many held ones as orbit has more rigid ones, then flexible ones."""
    free = not np.any(equilibrium.environment.gravity) and not len(equilibrium.loads.attach_point)
    held = 0 if free else _rigid_in_orbit(equilibrium) - rigid
    kinds = ("rigid",) * rigid + ("suspension",) * held
    return kinds + ("flexible",) * (count - len(kinds))


def _rigid_in_orbit(equilibrium: Equilibrium) -> int:
    """Number of rigid-body modes of the same structure, free and undeformed."""
    return _solve(solve_equilibrium(equilibrium.model.structure, Environment.orbit()))[-1]


def _signs(M: sp.csr_array, shapes: np.ndarray) -> np.ndarray:
    kinetic = shapes * (M @ shapes)
    largest = np.argmax(kinetic >= (1.0 - EQUAL_SIZE) * kinetic.max(axis=0), axis=0)
    return np.where(shapes[largest, np.arange(shapes.shape[1])] < 0.0, -1.0, 1.0)


def _check_stable(lam: np.ndarray, names: tuple[str, ...]) -> None:
    for value, name in zip(lam, names, strict=True):
        if value < 0.0:
            raise UnstableEquilibriumError(
                f"the rest state is not stable: mode {name!r} grows at {np.sqrt(-value):.4g} rad/s",
                hint="is a payload above its axes, an attach point below the centre of mass, a member "
                "buckled? lower gravity, spring the axis or move the attach points",
                growth=float(np.sqrt(-value)),
                mode=name,
            )


def _residual(K: sp.csr_array, M: sp.csr_array, shapes: np.ndarray, lam: np.ndarray) -> np.ndarray:
    elastic, inertial = K @ shapes, (M @ shapes) * lam
    size = abs(K) @ np.abs(shapes) + (abs(M) @ np.abs(shapes)) * lam
    largest = size.max(axis=0)
    return np.abs(elastic - inertial).max(axis=0) / np.where(largest > 0.0, largest, 1.0)
