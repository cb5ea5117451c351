"""Modal effective mass: how much of the article each mode carries along when its supports move."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.structure.modes.motions.rigid_motions import rigid_motions
from middeck.structure.modes.solve import Modes
from middeck.values import record


@record
class EffectiveMass:
    """Effective mass of each mode, for translations along (kg) and rotations about (kg m^2) the world axes.

    Attributes:
        effective: (r' M phi)^2 with r the rigid motion, joints held, and phi of unit modal mass.
        rigid: r' M r: the mass, and the moments of inertia about the centre of mass at rest.
    """

    effective: Float[np.ndarray, "mode 6"]
    rigid: Float[np.ndarray, "6"]

    @property
    def fraction(self) -> Float[np.ndarray, "mode 6"]:
        """Fraction of the rigid value; 0 in a direction without mass."""
        return self.effective / np.where(self.rigid > 0.0, self.rigid, np.inf)

    @property
    def completeness(self) -> Float[np.ndarray, "6"]:
        """Sum of the fractions over the modes; 1 in a direction without any.

        Over all modes it is 1 where nothing is held. Where an environment clamps nodes it is less by the mass
        that belongs to no mode, see `measure_effective_mass`.
        """
        return np.where(self.rigid > 0.0, self.fraction.sum(axis=0), 1.0)


def measure_effective_mass(modes: Modes) -> EffectiveMass:
    """Effective masses of all ``modes`` (Wada, Bamford and Garba 1972).

    Over all modes, the rigid ones included, they add up to the rigid mass where no coordinates are held. In a
    free article the rigid-body modes have all of it and the flexible ones none; in a hung one the suspension
    modes have most. The mass at held coordinates belongs to no mode (that of a clamped node, and of the half
    elements beside it), yet fractions are of the whole mass, as standards count it.
    """
    r = rigid_motions(modes.equilibrium, modes.mass)[0][:, :6]
    Mr = modes.mass @ r
    return EffectiveMass((modes.shapes.T @ Mr) ** 2, np.einsum("im,im->m", r, Mr))
