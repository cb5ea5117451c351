"""Derivatives of damping ratios in named parameters: of each mode by itself, and of complex modes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from middeck.structure.model.article import Damping, DampingTable
from middeck.structure.modes.motions.dampers import damper_matrix
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damped_modes import shared_losses
from middeck.structure.plants.damping import (
    RatiosByCause,
    base_parts,
    base_ratios,
    find_mode,
    material_ratios,
    ratios_by_cause,
)
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.sensitivity.parameters import ModelParameter
from middeck.structure.sensitivity.patches import STEP, derivative
from middeck.structure.sensitivity.shape_derivatives import ModeSensitivity, differentiate_shapes
from middeck.structure.sensitivity.stiff_member_derivatives import soften_modes


def differentiate_ratios(
    modes: Modes, at: Equilibrium, change: ModeSensitivity
) -> tuple[Float[np.ndarray, " mode"], Float[np.ndarray, " mode"]]:
    """Damping ratios as of `estimate_damping`, and their derivatives.

    ``at`` is the rest state with the derivative in its imaginary parts, ``change`` that of the modes.
    """
    damping, count = modes.equilibrium.model.structure.damping, change.d_shapes.shape[1]
    zeta = ratios_by_cause(modes, damping, count=count).zeta
    omega, shapes = _moved(modes, change)
    added = material_ratios(at, at.model.structure.damping, omega, shapes).astype(complex)
    own = np.diag(damper_matrix(at, at.model.structure.damping, shapes))
    swings = modes.omega[:count] > 0.0
    added += np.divide(own, 2.0 * omega, out=np.zeros(count, complex), where=swings)
    slope = _base(modes, at, change) + derivative(added)
    for index, d_zeta in _given(modes, at.model.structure.damping, count):
        slope[index] = d_zeta
    return zeta, slope


class PencilSlopes(NamedTuple):
    """Derivatives of s^2 + s C + L + j H in the lowest modes by parameters, and of rows of the shapes.

    See `DampedModes`; ``stiffness`` is L + j H.
    """

    losses: Float[np.ndarray, "parameter mode mode"]
    stiffness: Complex[np.ndarray, "parameter mode mode"]
    rows: Float[np.ndarray, "parameter coordinate mode"]

    def log_roots(
        self,
        s: Complex[np.ndarray, " root"],
        shapes: Complex[np.ndarray, "mode root"],
        losses: Float[np.ndarray, "mode mode"],
    ) -> Complex[np.ndarray, "parameter root"]:
        """Derivatives of ln s; zero where s is.

        Of a root with its shape v, v'(2 s + C) v ds = - v'(s dC + dL) v, all being symmetric (Lancaster 1966,
        "Lambda-matrices and vibrating systems").
        """
        at = np.where(s != 0.0, s, 1.0)
        pushed = [
            np.einsum("im,im->m", shapes, at * (dC @ shapes) + dL @ shapes)
            for dC, dL in zip(self.losses, self.stiffness, strict=True)
        ]
        found = np.array(pushed).reshape(len(pushed), len(s))
        return np.where(s != 0.0, -found / (at * steepness(at, shapes, losses)), 0.0)


def steepness(
    s: Complex[np.ndarray, " root"],
    shapes: Complex[np.ndarray, "mode root"],
    losses: Float[np.ndarray, "mode mode"],
) -> Complex[np.ndarray, " root"]:
    """v'(2 s + C) v of roots with their shapes."""
    return np.einsum("im,im->m", shapes, 2.0 * s * shapes + losses @ shapes)


def differentiate_pencil(
    modes: Modes, parameters: Sequence[ModelParameter], count: int, coordinates: Sequence[int] = ()
) -> PencilSlopes:
    """The derivatives for the lowest ``count`` modes, and for these coordinates of their shapes.

    Raises `NumericalError` where the rest state has no derivative.
    """
    softer, article = soften_modes(modes, count, "derivatives of complex modes")
    changes = differentiate_shapes(softer, article, parameters, count)
    now = ratios_by_cause(softer, count=count)
    losses = np.zeros((len(parameters), count, count))
    stiffness = losses.astype(complex)
    rows = np.zeros((len(parameters), len(coordinates), count))
    for p, ((at, change), scale) in enumerate(zip(changes, article.scales(parameters), strict=True)):
        d_losses, d_hysteresis = _losses(softer, now, at, change)
        losses[p] = scale * d_losses
        stiffness[p] = scale * (change.d_lambda + 1j * d_hysteresis)
        rows[p] = scale * change.d_shapes[list(coordinates)]
    return PencilSlopes(losses, stiffness, rows)


def _losses(
    modes: Modes, now: RatiosByCause, at: Equilibrium, change: ModeSensitivity
) -> tuple[Float[np.ndarray, "mode mode"], Float[np.ndarray, "mode mode"]]:
    """Derivatives of C and H, see `DampedModes`; ``now`` are the ratios of ``modes``."""
    damping, (omega, shapes) = at.model.structure.damping, _moved(modes, change)
    C, H = shared_losses(modes, at, damping, omega, shapes)
    slope = derivative(C.astype(complex))
    own = np.diag(slope) + 2.0 * derivative(omega * (now.base + STEP * 1j * _base(modes, at, change)))
    for index, d_zeta in _given(modes, damping, len(omega)):
        own[index] = 2.0 * derivative(omega * (now.zeta + STEP * 1j * d_zeta))[index]
    np.fill_diagonal(slope, own)
    return slope, derivative(H.astype(complex))


def _moved(modes: Modes, change: ModeSensitivity) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and shapes with their derivatives in their imaginary parts."""
    count = change.d_shapes.shape[1]
    omega = modes.omega[:count]
    d_omega = np.divide(np.diag(change.d_lambda), 2.0 * omega, out=np.zeros(count), where=omega > 0.0)
    return omega + STEP * 1j * d_omega, modes.shapes[:, :count] + STEP * 1j * change.d_shapes


def _base(modes: Modes, at: Equilibrium, change: ModeSensitivity) -> Float[np.ndarray, " mode"]:
    """Derivatives of the bases, by energy, rank or table."""
    damping, count = modes.equilibrium.model.structure.damping, change.d_shapes.shape[1]
    swings = modes.omega[:count] > 0.0
    omega, shapes = _moved(modes, change)
    parts = base_parts(modes, damping, at, omega**2, shapes)
    slope = derivative(base_ratios(at.model.structure.damping, parts, swings).astype(complex))
    if damping.table is not None:
        slope[swings] += _along_table(modes, damping.table, derivative(omega), count)
    return slope


def _given(modes: Modes, perturbed: Damping, count: int) -> list[tuple[int, float]]:
    """Modes that have a ratio of their own, and the derivative of that."""
    found = ((find_mode(modes, key), ratio) for key, ratio in perturbed.by_mode)
    return [
        (index, float(derivative(np.array(ratio))))
        for index, ratio in found
        if index is not None and index < count
    ]


def _along_table(modes: Modes, table: DampingTable, d_omega: np.ndarray, count: int) -> np.ndarray:
    """Ratios of oscillating modes: linear in the logarithm of frequency, constant beyond the table's ends."""
    swings = modes.omega[:count] > 0.0
    hz = modes.frequency_hz[:count][swings]
    rises = np.diff(table.zeta) / np.diff(np.log(table.frequency_hz))
    rise = np.concatenate([[0.0], rises, [0.0]])[np.searchsorted(table.frequency_hz, hz)]
    return rise * d_omega[swings] / modes.omega[:count][swings]
