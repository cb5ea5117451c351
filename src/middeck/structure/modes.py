"""Eigensolution about a rest state (the paper's step 3), with kinds and names."""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp
from jaxtyping import Float

from middeck.errors import EquilibriumError, UnstableEquilibriumError
from middeck.structure.assembly import assemble, mass_matrix
from middeck.structure.environment import Environment
from middeck.structure.equilibrium import Equilibrium, solve_equilibrium
from middeck.structure.naming import name_modes, rigid_basis
from middeck.structure.statics import dynamic_coordinates
from middeck.values import record

# omega^2 below this fraction of the first flexible one is zero. Rounding leaves 1e-12 on the two articles;
# the softest real restraint that should count (0.02 Hz against 1.7 Hz) leaves 1e-4.
RIGID_FRACTION = 1e-8


@record
class Modes:
    """Natural modes about an equilibrium, ascending, mass-normalised.

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
        Part of the potential energy that is elastic strain of members, springs and joints.
    residual:
        Of each mode, |K phi - omega^2 M phi| over the size of its terms; grows towards the top of the list.
    rigid_residual:
        Largest |omega^2| of a rigid mode before it was set to zero, over the first flexible omega^2.
    warnings:
        Modes whose strain energy disagrees with their kind.
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
    """All modes about ``equilibrium``.

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
    model, active = equilibrium.model, dynamic_coordinates(equilibrium.model)
    K = assemble(model, equilibrium.config, equilibrium.loads).tangent
    M = mass_matrix(model, equilibrium.config)
    lam, phi = _eigenpairs(K[active][:, active].toarray(), M[active][:, active].toarray())
    rigid = _count_rigid(lam)
    free = not np.any(equilibrium.environment.gravity) and not len(equilibrium.loads.attach_point)
    held = 0 if free else _rigid_in_orbit(equilibrium)
    shapes = np.zeros((len(active), len(lam)))
    shapes[active] = phi
    rigid_residual = float(np.abs(lam[:rigid]).max(initial=0.0) / lam[rigid])
    if rigid:
        shapes[:, :rigid], rigid_names = rigid_basis(equilibrium, M, shapes[:, :rigid])
    else:
        rigid_names = ()
    shapes = shapes * _signs(M, shapes)
    kind = ("rigid",) * rigid + ("suspension",) * (held - rigid)
    kind = kind + ("flexible",) * (len(lam) - len(kind))
    names, share, warnings = name_modes(equilibrium, M, K, shapes, kind, rigid_names)
    lam[:rigid] = 0.0
    _check_stable(lam, names)
    return Modes(
        equilibrium,
        np.sqrt(lam),
        shapes,
        M,
        kind,
        names,
        share,
        _residual(K[active], M[active], shapes, lam),
        rigid_residual,
        warnings,
    )


def _eigenpairs(K: np.ndarray, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ascending lambda = omega^2 through the inverse problem M phi = mu (K + sigma M) phi.

    The direct problem leaves rounding of 1e-16 times the largest omega^2 (1e13 here) on the smallest; its
    inverse is accurate where the interest lies (Parlett 1980, section 15).
    """
    largest = np.abs(np.diag(K)).max()
    sigma = 1e-9 * largest / np.abs(np.diag(M)).max() + 1.0
    for _ in range(20):
        try:
            mu, phi = sla.eigh(M, K + sigma * M)
        except sla.LinAlgError:  # an unstable state: shift beyond its growth rate
            sigma *= 10.0
            continue
        lam = 1.0 / mu[::-1] - sigma
        phi = phi[:, ::-1]
        return lam, phi / np.sqrt(np.einsum("im,ij,jm->m", phi, M, phi, optimize=True))
    raise UnstableEquilibriumError("the tangent stiffness is not bounded below", hint="check masses: all positive?")


def _count_rigid(lam: np.ndarray) -> int:
    """Number of zeros: where everything below is RIGID_FRACTION of everything above; 0 without such a gap."""
    size = np.abs(lam)
    below = np.maximum.accumulate(size)[:-1]
    above = np.minimum.accumulate(size[::-1])[::-1][1:]
    gaps = np.flatnonzero(below < RIGID_FRACTION * above)
    return int(gaps[-1]) + 1 if len(gaps) else 0


def _rigid_in_orbit(equilibrium: Equilibrium) -> int:
    """Number of rigid-body modes of the same structure, free and undeformed."""
    rest = solve_equilibrium(equilibrium.model.structure, Environment.orbit())
    active = dynamic_coordinates(rest.model)
    K = assemble(rest.model, rest.config, rest.loads).tangent[active][:, active].toarray()
    M = mass_matrix(rest.model, rest.config)[active][:, active].toarray()
    return _count_rigid(_eigenpairs(K, M)[0])


def _signs(M: sp.csr_array, shapes: np.ndarray) -> np.ndarray:
    kinetic = shapes * (M @ shapes)
    largest = np.argmax(kinetic, axis=0)
    return np.where(shapes[largest, np.arange(shapes.shape[1])] < 0.0, -1.0, 1.0)


def _check_stable(lam: np.ndarray, names: tuple[str, ...]) -> None:
    for value, name in zip(lam, names, strict=True):
        if value < 0.0:
            raise UnstableEquilibriumError(
                f"the rest state is not stable: mode {name!r} grows at {np.sqrt(-value):.4g} rad/s",
                hint="is a payload above its axes, or a member buckled? lower gravity or spring the axis",
                growth=float(np.sqrt(-value)),
                mode=name,
            )


def _residual(K: sp.csr_array, M: sp.csr_array, shapes: np.ndarray, lam: np.ndarray) -> np.ndarray:
    elastic, inertial = K @ shapes, (M @ shapes) * lam
    size = abs(K) @ np.abs(shapes) + (abs(M) @ np.abs(shapes)) * lam
    return np.abs(elastic - inertial).max(axis=0) / size.max(axis=0)
