"""Modes followed from one state to another by their shapes, repeated frequencies included."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from middeck.errors import NumericalError
from middeck.structure.assembly.energy import Assembly, assemble_carried
from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.freedom import Freedom
from middeck.structure.assembly.linked import dynamic_freedom
from middeck.structure.assembly.mass import carried_mass, mass_matrix
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.places import transport
from middeck.structure.eigenproblem.eigen import Eigenpairs, solve_pairs
from middeck.structure.eigenproblem.repeated import repeated
from middeck.structure.eigenproblem.rigid_or_rounding import rounding, separate_rigid
from middeck.structure.elements.frames import Configuration
from middeck.structure.elements.motion_since_drawn import uncarried
from middeck.structure.modes.solve import Modes

# A shape of which another holds more than half (this, squared) cannot be a second one's as well.
HALF_SHAPE = float(np.sqrt(0.5))
# Modes sought beyond those followed, so that one that comes down from above is found.
SPARE = 10


class Spectrum(NamedTuple):
    """omega^2 [1/s^2], negative where a mode grows; mass-normalised shapes over all coordinates; the mass."""

    lam: Float[np.ndarray, " mode"]
    shapes: Float[np.ndarray, "coordinate mode"]
    mass: sp.csr_array


class TrackedShapes(NamedTuple):
    """Tracked reference shapes: the spectrum, where each was found, and the overlap, at most one."""

    spectrum: Spectrum
    found: Int[np.ndarray, " mode"]
    match: Float[np.ndarray, " mode"]


def spectrum_of(modes: Modes) -> Spectrum:
    """The spectrum of ``modes``, for tracking."""
    return Spectrum(modes.omega**2, modes.shapes, modes.mass)


def solve_spectrum(
    model: Model, config: Configuration, K: sp.csr_array, M: sp.csr_array, count: int
) -> Spectrum:
    """The ``count`` lowest modes of a tangent and a mass in W at ``config``, ascending, unstable ones too.

    All modes of a small model. An omega^2 that is rounding alone is exactly zero. Raises `NumericalError`
    where a massless motion is held by nothing.
    """
    free = dynamic_freedom(model, config, in_world=True)
    pairs = _pairs(free, model, K, M, count, None)
    return _spectrum(free, pairs, pairs.noise, M, None)


def spectrum_at(
    model: Model, config: Configuration, loads: Loads, count: int, at: Assembly | None = None
) -> Spectrum:
    """`solve_spectrum` at a rest state, where stiff parts leave the soft modes their digits.

    ``at`` is what `assemble_carried` gives there, if it is known.
    """
    at = assemble_carried(model, config, loads) if at is None else at
    mass = carried_mass(model, config, loads)
    free = dynamic_freedom(model, config)
    soft = uncarried(config.since_drawn, model.tree.size)[free.active]
    pairs = _pairs(free, model, at.tangent, mass, count, None if np.all(soft) else soft)
    pairs = separate_rigid(model, config, loads, pairs, free, at)
    T = transport(config, model.tree)
    M = mass if np.all(soft) else mass_matrix(model, config, loads)
    return _spectrum(free, pairs, rounding(model, config, pairs, at.gradient, free, T), M, T)


def _pairs(
    free: Freedom, model: Model, K: sp.csr_array, M: sp.csr_array, count: int, soft: np.ndarray | None
) -> Eigenpairs:
    stiffness, mass = free.matrix(K), free.matrix(M)
    pairs = solve_pairs(stiffness, mass, count + SPARE, soft)
    if pairs is None:
        raise NumericalError(
            "a motion has neither mass nor stiffness",
            where=f"structure {model.structure.title!r}",
            hint="solve_modes of the same state names the frame; give it a mass and an inertia",
        )
    return pairs


def _spectrum(
    free: Freedom, pairs: Eigenpairs, noise: np.ndarray, M: sp.csr_array, T: sp.csr_array | None
) -> Spectrum:
    shapes = free.spread(pairs.shapes)
    shapes = shapes if T is None else T @ shapes
    return Spectrum(np.where(np.abs(pairs.lam) <= noise, 0.0, pairs.lam), shapes, M)


def align_repeated(spectrum: Spectrum, reference: Float[np.ndarray, "coordinate mode"]) -> Spectrum:
    """The same modes, those of one frequency turned towards the reference shapes nearest to their span.

    Within a repeated frequency, rigid-body modes included, an eigensolver's basis is arbitrary. The turn is
    the orthogonal polar factor of the overlap: of all bases the one nearest to the reference.
    """
    lam, shapes = spectrum.lam.copy(), spectrum.shapes.copy()
    overlap = reference.T @ (spectrum.mass @ shapes)
    for cluster in repeated(lam):
        nearest = np.argsort(-np.sum(overlap[:, cluster] ** 2, axis=1), kind="stable")[: len(cluster)]
        U, _, Vt = np.linalg.svd(overlap[np.ix_(np.sort(nearest), cluster)].T)
        turn = np.hstack([U[:, : len(Vt)] @ Vt, U[:, len(Vt) :]])
        lam[cluster] = np.einsum("ij,i,ij->j", turn, lam[cluster], turn)
        shapes[:, cluster] = shapes[:, cluster] @ turn
    return Spectrum(lam, shapes, spectrum.mass)


def track(reference: Spectrum, spectrum: Spectrum, weight: np.ndarray | float = 1.0) -> TrackedShapes:
    """Each mode of ``reference`` in ``spectrum``, one to one, with the largest sum of weighted overlaps.

    The overlap is |Phi_0' M_0 Phi_1| with both shapes normalised in M_0; its square is the part of the one
    shape that is the other. In a mass of its own, a shape with next to none in M_1 would overlap with all.
    """
    turned = align_repeated(spectrum, reference.shapes)
    weighted = reference.mass @ turned.shapes
    size = np.sqrt(np.einsum("im,im->m", turned.shapes, weighted))
    cross = np.abs(reference.shapes.T @ weighted) / size
    _, index = linear_sum_assignment(weight * cross, maximize=True)
    theirs = Spectrum(turned.lam[index], turned.shapes[:, index], turned.mass)
    return TrackedShapes(theirs, np.array(index, dtype=int), cross[np.arange(len(index)), index])
