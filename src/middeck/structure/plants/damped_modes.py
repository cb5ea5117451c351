"""Complex modes: frequencies and damping ratios with what losses do between the real modes.

In the lowest real modes the losses are a matrix C: on its diagonal what `estimate_damping` has, beside it
what dampers and loss factors do between two modes. Roots of s^2 + s C + diag(omega^2) are exact in that
space; a loss factor is taken as a damper of the same loss at the two frequencies. Modes whose distance is of
the size of their damping share it, by any amount: first-order ratios (phi' C phi / 2 omega) are then wrong.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Inexact
from scipy.optimize import linear_sum_assignment

from middeck.errors import NumericalError
from middeck.structure.model.article import Damping
from middeck.structure.modes.motions.strain_shares import member_deformations
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import damper_matrix, estimate_damping, find_mode, member_losses
from middeck.structure.rest.equilibrium import Equilibrium


class DampedModes(NamedTuple):
    """Complex modes, each at the number of the real mode that it has most of.

    Attributes:
        s: Root above the real axis [rad/s]; zero for a rigid mode, which has no damping ratio.
        shapes: In the real modes, a column each.
        losses: The matrix C [1/s].
    """

    s: Complex[np.ndarray, " mode"]
    shapes: Complex[np.ndarray, "mode mode"]
    losses: Float[np.ndarray, "mode mode"]

    @property
    def zeta(self) -> Float[np.ndarray, " mode"]:
        """Damping ratios -Re s / |s|; zero for a rigid mode."""
        size = np.abs(self.s)
        return -np.real(self.s) / np.where(size > 0.0, size, 1.0)

    @property
    def likeness(self) -> Float[np.ndarray, " mode"]:
        """Part of each that is its real mode."""
        return np.abs(np.diag(self.shapes)) ** 2


def solve_damped(modes: Modes, damping: Damping | None = None, *, count: int | None = None) -> DampedModes:
    """The complex modes of the lowest ``count`` modes (all by default) under ``damping`` (the article's).

    Raises `ConfigError` as `estimate_damping`, and `NumericalError` where a mode does not oscillate any more.
    """
    damping = modes.equilibrium.model.structure.damping if damping is None else damping
    zeta = estimate_damping(modes, damping, count=count).zeta
    omega, shapes = modes.omega[: len(zeta)], modes.shapes[:, : len(zeta)]
    C = shared_losses(modes, modes.equilibrium, damping, omega, shapes)
    np.fill_diagonal(C, 2.0 * zeta * omega)
    moving = np.flatnonzero(omega > 0.0)
    s, V = np.zeros(len(omega), complex), np.eye(len(omega), dtype=complex)
    s[moving], V[np.ix_(moving, moving)] = _roots(omega[moving], C[np.ix_(moving, moving)])
    return DampedModes(s, V, C)


def shared_losses(
    modes: Modes,
    equilibrium: Equilibrium,
    damping: Damping,
    omega: Inexact[np.ndarray, " mode"],
    shapes: Inexact[np.ndarray, "coordinate mode"],
) -> Inexact[np.ndarray, "mode mode"]:
    """C by dampers and loss factors, without the base: zero for modes that are rigid or given a ratio.

    ``equilibrium``, ``omega`` and ``shapes`` are those of ``modes``, or perturbed; analytic.
    """
    C = damper_matrix(equilibrium, damping, shapes)
    swings = np.real(omega) > 0.0
    if damping.loss_factor:
        model = equilibrium.model
        eta = member_losses(equilibrium, damping)[model.element_member]
        bent = member_deformations(equilibrium, shapes)
        lost = np.einsum("eim,ein->mn", bent, eta[:, None, None] * (model.beams.stiffness @ bent))
        root = np.sqrt(np.where(swings, omega, 1.0))
        C = C + lost / np.outer(root, root)
    alone = ~swings
    for key, _ in damping.by_mode:
        index = find_mode(modes, key)
        if index is not None and index < len(omega):
            alone[index] = True
    return np.where(alone[:, None] | alone, 0.0, C)


def _roots(omega: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Roots, and unit shapes, each at the place of the real mode that it has most of."""
    # States (q, q'/omega): frequencies round to 1e-16 of the highest, not their squares.
    n = len(omega)
    lam, vectors = np.linalg.eig(
        np.block([[np.zeros((n, n)), np.diag(omega)], [-np.diag(omega), -C * (omega / omega[:, None])]])
    )
    upper = np.flatnonzero(np.imag(lam) > 0.0)
    if len(upper) != n:
        raise NumericalError(
            "a mode is damped so much that it does not oscillate",
            where="damped modes",
            hint="smaller loss factors or dampers",
        )
    V = vectors[:n, upper] / np.linalg.norm(vectors[:n, upper], axis=0)
    _, at = linear_sum_assignment(np.abs(V), maximize=True)
    return lam[upper][at], V[:, at]
