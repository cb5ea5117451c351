"""Complex modes: frequencies and damping ratios with losses that couple the real modes.

In the lowest real modes dampers are a matrix C, with the base of `estimate_damping` on its diagonal, and loss
factors an imaginary stiffness j H. Roots of s^2 + s C + diag(omega^2) + j H above the real axis are exact in
that space. Modes whose distance is of the size of their damping share it, by any amount: ratios of each by
itself, (phi' C phi / omega + phi' H phi / omega^2) / 2, are then wrong.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Inexact
from scipy.optimize import linear_sum_assignment

from middeck.errors import NumericalError
from middeck.structure.model.article import Damping
from middeck.structure.modes.motions.dampers import damper_matrix
from middeck.structure.modes.motions.strain_shares import member_deformations
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import find_mode, member_losses, ratios_by_cause
from middeck.structure.rest.equilibrium import Equilibrium


class DampedModes(NamedTuple):
    """Complex modes, each at the number of the real mode that it resembles most.

    Attributes:
        s: Root above the real axis [rad/s]; zero for a rigid mode, which has no damping ratio.
        shapes: Shapes in the real modes, a column each.
        losses, hysteresis: The matrices C [1/s] and H [1/s^2].
    """

    s: Complex[np.ndarray, " mode"]
    shapes: Complex[np.ndarray, "mode mode"]
    losses: Float[np.ndarray, "mode mode"]
    hysteresis: Float[np.ndarray, "mode mode"]

    @property
    def zeta(self) -> Float[np.ndarray, " mode"]:
        """Damping ratios -Re s / |s|; zero for a rigid mode."""
        return damping_ratios(self.s)

    @property
    def likeness(self) -> Float[np.ndarray, " mode"]:
        """Share of its real mode in each complex mode."""
        return np.abs(np.diag(self.shapes)) ** 2


def damping_ratios(s: Complex[np.ndarray, " root"]) -> Float[np.ndarray, " root"]:
    """-Re s / |s|; zero where s is zero."""
    size = np.abs(s)
    return -np.real(s) / np.where(size > 0.0, size, 1.0)


def solve_damped(modes: Modes, damping: Damping | None = None, *, count: int | None = None) -> DampedModes:
    """The complex modes of the lowest ``count`` modes (all by default) under ``damping`` (the article's).

    Raises `ConfigError` as `estimate_damping`, and `NumericalError` where a mode does not oscillate any more.
    """
    damping = modes.equilibrium.model.structure.damping if damping is None else damping
    base = ratios_by_cause(modes, damping, count=count).base
    omega, shapes = modes.omega[: len(base)], modes.shapes[:, : len(base)]
    C, H = shared_losses(modes, modes.equilibrium, damping, omega, shapes)
    C = C + np.diag(2.0 * base * omega)
    return DampedModes(*damped_roots(omega, C, H), C, H)


def damped_roots(
    omega: Float[np.ndarray, " mode"], C: Float[np.ndarray, "mode mode"], H: Float[np.ndarray, "mode mode"]
) -> tuple[Complex[np.ndarray, " mode"], Complex[np.ndarray, "mode mode"]]:
    """Roots and unit shapes, each at the place of the most similar real mode; zero for a rigid one.

    Raises `NumericalError` where a mode does not oscillate any more.
    """
    moving = np.flatnonzero(omega > 0.0)
    both = np.ix_(moving, moving)
    s, V = np.zeros(len(omega), complex), np.eye(len(omega), dtype=complex)
    s[moving], V[both] = _moving_roots(omega[moving], C[both], H[both])
    return s, V


def _moving_roots(omega: np.ndarray, C: np.ndarray, H: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # States (q, q'/omega): frequencies round to 1e-16 of the highest, not their squares.
    n = len(omega)
    hold = np.diag(omega) + (1j * H if np.any(H) else 0.0) / omega[:, None]
    drag = C * (omega / omega[:, None])
    lam, vectors = np.linalg.eig(np.block([[np.zeros((n, n)), np.diag(omega)], [-hold, -drag]]))
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


def shared_losses(
    modes: Modes,
    equilibrium: Equilibrium,
    damping: Damping,
    omega: Inexact[np.ndarray, " mode"],
    shapes: Inexact[np.ndarray, "coordinate mode"],
) -> tuple[Inexact[np.ndarray, "mode mode"], Inexact[np.ndarray, "mode mode"]]:
    """C of dampers, without the base, and H of loss factors: zero for modes that are rigid or given a ratio.

    ``equilibrium``, ``omega`` and ``shapes`` are those of ``modes``, or perturbed; analytic.
    """
    C = damper_matrix(equilibrium, damping, shapes)
    H = np.zeros_like(C)
    if damping.loss_factor:
        model = equilibrium.model
        eta = member_losses(equilibrium, damping)[model.element_member]
        bent = member_deformations(equilibrium, shapes)
        H = np.einsum("eim,ein->mn", bent, eta[:, None, None] * (model.beams.stiffness @ bent))
    alone = np.real(omega) <= 0.0
    for key, _ in damping.by_mode:
        index = find_mode(modes, key)
        if index is not None and index < len(omega):
            alone[index] = True
    none = alone[:, None] | alone
    return np.where(none, 0.0, C), np.where(none, 0.0, H)
