"""Derivatives of a plant's matrices in named parameters: modes, damping, ports that turn with bodies."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.structure.modes.solve import Modes
from middeck.structure.plants.sensors_and_actuators import input_rows, output_rows
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.sensitivity.damping_derivatives import differentiate_ratios
from middeck.structure.sensitivity.parameters import ModelParameter
from middeck.structure.sensitivity.patches import derivative
from middeck.structure.sensitivity.shape_derivatives import ModeSensitivity, differentiate_shapes
from middeck.structure.sensitivity.stiff_member_derivatives import soften_modes
from middeck.values import record


@record(kw_only=True)
class PlantSensitivity:
    """Derivatives of the plant of `build_plant` without ``static`` in one parameter.

    ``psi`` to ``phi_acceleration`` are those of the `ModalSystem`; A, B, C and D of its state space, with the
    states of a group of equal frequencies turning as little as `ModeSensitivity` says. A then couples the
    modes of a group: the transfer function's derivative is right, whatever becomes of the group.
    """

    parameter: ModelParameter
    psi: Float[np.ndarray, "mode input"]
    phi: Float[np.ndarray, "output mode"]
    phi_rate: Float[np.ndarray, "output mode"]
    phi_acceleration: Float[np.ndarray, "output mode"]
    zeta: Float[np.ndarray, " mode"]
    A: Float[np.ndarray, "state state"]
    B: Float[np.ndarray, "state input"]
    C: Float[np.ndarray, "output state"]
    D: Float[np.ndarray, "output input"]


def differentiate_plant(
    modes: Modes,
    parameters: Sequence[ModelParameter],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    count: int = 26,
) -> tuple[PlantSensitivity, ...]:
    """Derivatives of the plant of the lowest ``count`` modes between named ports, with the article's damping.

    Beside a member too stiff for matrices in W as `differentiate_frequencies`. Raises `ConfigError` for an
    unknown port, and `NumericalError` where the rest state has no derivative.
    """
    count = min(count, len(modes.omega))
    softer, article = soften_modes(modes, count, "derivatives of a plant")
    changes = differentiate_shapes(softer, article, parameters, count)
    return tuple(
        _scaled(_of_parameter(softer, at, change, inputs, outputs, count), float(scale))
        for (at, change), scale in zip(changes, article.scales(parameters), strict=True)
    )


def _scaled(one: PlantSensitivity, scale: float) -> PlantSensitivity:
    names = [f.name for f in dataclasses.fields(one) if f.name != "parameter"]
    return dataclasses.replace(one, **{name: scale * getattr(one, name) for name in names})


def _of_parameter(
    modes: Modes,
    at: Equilibrium,
    change: ModeSensitivity,
    inputs: Sequence[str],
    outputs: Sequence[str],
    count: int,
) -> PlantSensitivity:
    shapes, omega, rest = modes.shapes[:, :count], modes.omega[:count], modes.equilibrium
    drive, read = input_rows(rest, inputs), output_rows(rest, outputs)
    d_drive, d_read = input_rows(at, inputs), output_rows(at, outputs)

    def seen(rows: np.ndarray, d_rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return rows @ shapes, derivative(d_rows) @ shapes + rows @ change.d_shapes

    force, d_force = seen(drive.force, d_drive.force)
    phi, d_phi = seen(read.position, d_read.position)
    rate, d_rate = seen(read.rate, d_read.rate)
    accel, d_accel = seen(read.acceleration, d_read.acceleration)
    psi, d_psi = force.T, d_force.T
    zeta, d_zeta = differentiate_ratios(modes, at, change)
    # K and C of the modes are diagonal; their derivatives are full within a group.
    stiff, d_stiff = np.diag(omega**2), change.d_lambda
    both = omega[:, None] + omega
    d_root = np.divide(d_stiff, both, out=np.zeros_like(d_stiff), where=both > 0.0)
    damper = np.diag(2.0 * zeta * omega)
    d_damper = (zeta[:, None] + zeta) * d_root + np.diag(2.0 * d_zeta * omega)
    s = np.where(omega > 0.0, omega, 1.0)
    d_s = np.diag(d_root)
    even, odd = 2 * np.arange(count), 2 * np.arange(count) + 1
    A, B = np.zeros((2 * count, 2 * count)), np.zeros((2 * count, len(psi[0])))
    C = np.zeros((len(phi), 2 * count))
    A[even, odd] = d_s
    A[np.ix_(odd, even)] = (stiff * (d_s / s)[:, None] - d_stiff) / s[:, None]
    A[np.ix_(odd, odd)] = -d_damper * s / s[:, None]
    B[odd] = (d_psi - psi * (d_s / s)[:, None]) / s[:, None]
    C[:, even] = d_phi - d_accel @ stiff - accel @ d_stiff
    velocity, d_velocity = rate - accel @ damper, d_rate - d_accel @ damper - accel @ d_damper
    C[:, odd] = d_velocity * s + velocity * d_s
    D = d_accel @ psi + accel @ d_psi
    return PlantSensitivity(
        parameter=change.parameter,
        psi=d_psi,
        phi=d_phi,
        phi_rate=d_rate,
        phi_acceleration=d_accel,
        zeta=d_zeta,
        A=A,
        B=B,
        C=C,
        D=D,
    )
