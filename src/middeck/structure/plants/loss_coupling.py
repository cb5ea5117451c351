"""Losses that couple modes of neighbouring frequencies, which single damping ratios leave out.

A loss factor in what strains, and another in all else that holds the article, make the stiffness complex.
In the real modes its imaginary part H has entries beside the diagonal where the two losses differ, or where
weight or preload changes a mode without loss. They matter where |H_ij| is not small beside
|omega_i^2 - omega_j^2|: a pendulum and a bending mode of nearly one frequency share their losses. The
ratios of two such modes follow from the two of them alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from middeck.structure.modes.motions.strain_shares import device_strain, member_energy, strain_energy
from middeck.structure.rest.equilibrium import Equilibrium

SHIFT = 3e-4
"""Relative change of a ratio by the coupling of two modes above which it is reported; several add up."""


class LossFactors(NamedTuple):
    """Loss factors: of all that strains, of all else that holds the article, of each member beside that."""

    strain: float
    rest: float
    member: Float[np.ndarray, " member"]


class CoupledPair(NamedTuple):
    """Two modes, and their ratios together."""

    modes: tuple[int, int]
    zeta: tuple[float, float]


def coupled_pairs(
    equilibrium: Equilibrium,
    omega: Float[np.ndarray, " mode"],
    shapes: Float[np.ndarray, "coordinate mode"],
    zeta: Float[np.ndarray, " mode"],
    losses: LossFactors,
    lossless: Bool[np.ndarray, " mode"],
) -> list[CoupledPair]:
    """Pairs of modes of which one ratio changes by more than `SHIFT` when their common losses count.

    ``zeta`` are the ratios of each alone; what weight and preload add to ``lossless`` modes, or take, has no
    loss. Modes at zero and without losses have no part in it.
    """
    if losses.strain == losses.rest and not lossless.any() and not losses.member.any():
        return []
    own = _energies(equilibrium, shapes, losses)
    most = np.abs(_weights(losses, np.array([False, lossless.any()]))).max(axis=0)
    size = np.maximum(most @ own, 0.0)  # a rigid mode's energy is rounding, of either sign
    apart = np.abs(omega[:, None] ** 2 - omega**2)
    # |H_ij| is at most the geometric mean of both diagonals; a ratio moves towards the other by the square
    # of that over the distance.
    alike = np.minimum(zeta[:, None], zeta) / np.maximum(
        np.maximum(zeta[:, None], zeta), np.finfo(float).tiny
    )
    near = np.triu(2.0 * np.sqrt(np.outer(size, size)) > np.sqrt(SHIFT * alike) * apart, 1)
    near &= np.outer(omega > 0.0, omega > 0.0)
    first, second = np.nonzero(near)
    if not len(first):
        return []
    both = _energies(equilibrium, shapes[:, first] + shapes[:, second], losses)
    weights = _weights(losses, lossless[first] | lossless[second])
    between = np.einsum("pk,kp->p", weights, both - own[:, first] - own[:, second])
    found: list[CoupledPair] = []
    for i, j, shared in zip(first.tolist(), second.tolist(), between.tolist(), strict=True):
        # The root of a complex stiffness has less than the ratio at high losses, whether coupled or not.
        alone, together = (_together(omega[[i, j]], zeta[[i, j]], h) for h in (0.0, shared))
        if np.any(np.abs(together - alone) > SHIFT * alone):
            # A mode without losses of its own has what it shares.
            ratios = np.divide(zeta[[i, j]] * together, alone, out=together.copy(), where=alone > 0.0)
            found.append(CoupledPair((i, j), (float(ratios[0]), float(ratios[1]))))
    return found


def _energies(
    equilibrium: Equilibrium, shapes: np.ndarray, losses: LossFactors
) -> Float[np.ndarray, "3 mode"]:
    """Energies of strain and of the strain of devices, and the energy lost in members."""
    strain = strain_energy(equilibrium, shapes).sum(axis=1)
    member = member_energy(equilibrium, shapes) @ losses.member
    return np.array([strain, device_strain(equilibrium, shapes), member])


def _weights(losses: LossFactors, lossless: np.ndarray) -> Float[np.ndarray, "pair 3"]:
    """Loss factors of `_energies` in H between two modes, less the multiple of omega^2 that is not between.

    What is neither strain nor a device has the loss of the rest where neither mode is ``lossless``.
    """
    alike, rest = np.ones(len(lossless)), losses.rest
    return np.array([losses.strain - rest * ~lossless, rest * lossless, alike]).T


def _together(omega: np.ndarray, zeta: np.ndarray, shared: float) -> Float[np.ndarray, "2"]:
    """Ratios of two modes with the loss ``shared`` between them, each where most of its mode is."""
    lam, V = np.linalg.eig(np.diag(omega**2 * (1.0 + 2j * zeta)) + 1j * shared * (1.0 - np.eye(2)))
    root = np.sqrt(lam)
    order = [0, 1] if abs(V[0, 0]) >= abs(V[0, 1]) else [1, 0]
    return (np.imag(root) / np.abs(root))[order]
