"""End of a search for a rest state, and the criteria of rest."""

import numpy as np
import scipy.sparse as sp

from middeck.structure.assembly.energy import Assembly, is_unstrained
from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.factorisation import factorise, positive_factor
from middeck.structure.assembly.linked import static_freedom
from middeck.structure.assembly.mass import carried_mass
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.places import transport
from middeck.structure.eigenproblem.eigen import solve_pairs
from middeck.structure.eigenproblem.rigid_or_rounding import rounding, separate_rigid
from middeck.structure.elements.frames import Configuration
from middeck.structure.elements.motion_since_drawn import uncarried
from middeck.values import record

# Largest imbalance that counts as rest, over `imbalance_scale`.
TOLERANCE = 1e-9
# And where Newton's undamped step moves nothing by more than `UNMOVED` of what has moved since drawn:
# rounding is what is left, in a support of 1e12 N/m 1e-7 of a weight.
ROUNDED = 1e-6
UNMOVED = 1e-12
# Least damping [1/s^2]: a thousandth of a slow pendulum's omega^2 neither holds nor hurries anything.
LEAST_DAMPING = 1e-3
# And of the largest omega^2, whose rounding is 1e-16 of it.
NEUTRAL = 1e-12
DAMPING_STEP = 4.0
# Beyond any omega^2 of a structure: what is still indefinite has no mass.
MOST_DAMPING = 1e20
# Largest `deformation` in one step: what the second-order chart follows well.
LONGEST_STEP = 0.5


@record(kw_only=True)
class NewtonResult:
    """End of Newton's method, and (load factor, residual, damping) of every iteration.

    The residual counts as rest below ``enough``. ``followed`` says that it is the branch of the drawn state.
    """

    config: Configuration
    assembly: Assembly
    residual: float
    enough: float
    history: tuple[tuple[float, float, float], ...]
    stable: bool
    followed: bool = False


def holding(K: sp.csr_array, M: sp.csr_array) -> sp.csr_array:
    """K with so much more stiffness that rounding drives no motion that nothing holds.

    It is `LEAST_DAMPING` of the mass, or less in an article so large and soft that this would hold it.
    """
    k, m = np.abs(K.diagonal()), M.diagonal()
    fastest = float((k[m > 0.0] / m[m > 0.0]).max(initial=0.0))
    return sp.csr_array(K + min(LEAST_DAMPING, NEUTRAL * fastest or LEAST_DAMPING) * M)


# Part of the stiffness of each coordinate, in an article without mass, below which a motion is neutral.
SOFT = 1e-9


def is_stable(model: Model, config: Configuration, at: Assembly, loads: Loads) -> bool:
    """Whether no motion grows at a rest state with the assembly ``at``, the free joints held."""
    if is_unstrained(model, config, at, loads):
        return True
    free, mass = static_freedom(model, config), carried_mass(model, config, loads)
    K, M = free.matrix(at.tangent), free.matrix(mass)
    if not M.data.any():  # nothing has a speed: what does not yield to a push
        k = np.abs(K.diagonal())
        lift = SOFT * np.where(k > 0.0, k, k.max(initial=1.0))
        return positive_factor(sp.csr_array(K + sp.diags_array(lift))) is not None
    # What is slower, or grows slowly, is decided by its modes; most articles have nothing of the sort.
    slow = factorise(sp.csr_array(K - LEAST_DAMPING * M))
    if slow is not None and slow.negative == 0:
        return True
    count = None if slow is None or slow.negative < 0 else slow.negative
    soft = uncarried(config.since_drawn, len(free.active))[free.active]
    pairs = solve_pairs(K, M, count, soft)
    if pairs is None:
        return positive_factor(holding(K, M)) is not None
    pairs = separate_rigid(model, config, loads, pairs, free, at)
    return bool(
        np.all(pairs.lam >= -rounding(model, config, pairs, at.gradient, free, transport(config, model.tree)))
    )
