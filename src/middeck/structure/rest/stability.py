"""Whether a rest state is stable, by the rule of its modes (`middeck.structure.modes.solve`)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from middeck.structure.assembly.energy import Assembly
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
from middeck.structure.rest.rest_criteria import LEAST_DAMPING, holding

# Of the stiffness of each coordinate, in an article without mass: what holds less is neutral.
SOFT = 1e-9


def is_stable(model: Model, config: Configuration, at: Assembly, loads: Loads) -> bool:
    """Whether nothing grows at a rest state with the assembly ``at``, the free joints held."""
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
    pairs = separate_rigid(model, config, loads, pairs, free)
    return bool(
        np.all(pairs.lam >= -rounding(model, config, pairs, at.gradient, free, transport(config, model.tree)))
    )
