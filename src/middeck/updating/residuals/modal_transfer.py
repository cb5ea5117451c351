"""Transfer functions of modes whose poles a survey measured and whose shapes are the model's.

    G_oi(s) = g_o h_i exp(-s tau) sum_m (phi + s phi' + s^2 phi'')_om psi_mi / D_m(s)
    D_m(s) = s^2 + 2 zeta_m omega_m s + omega_m^2

with the rows phi of angles, phi' of rates and phi'' of accelerations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import ratios_by_cause
from middeck.structure.plants.sensors_and_actuators import input_rows, output_rows
from middeck.structure.sensitivity.parameters import read_parameter
from middeck.structure.sensitivity.plant_derivatives import differentiate_plant
from middeck.updating.unknowns.unknowns import Bound
from middeck.values import record


@record(kw_only=True)
class ModalTransfer:
    """Modes between ports, without gains and delays."""

    omega: Float[np.ndarray, " mode"]
    zeta: Float[np.ndarray, " mode"]
    psi: Float[np.ndarray, "mode input"]
    phi: Float[np.ndarray, "output mode"]
    phi_rate: Float[np.ndarray, "output mode"]
    phi_acceleration: Float[np.ndarray, "output mode"]

    def denominator(self, s: Complex[np.ndarray, " line"]) -> Complex[np.ndarray, "line mode"]:
        """s^2 + 2 zeta omega s + omega^2."""
        return s[:, None] ** 2 + 2.0 * self.zeta * self.omega * s[:, None] + self.omega**2

    def read(self, s: Complex[np.ndarray, " line"], output: int) -> Complex[np.ndarray, "line mode"]:
        """Reading of an output, per unit of each mode."""
        at = s[:, None]
        return self.phi[output] + at * self.phi_rate[output] + at**2 * self.phi_acceleration[output]

    def parts(
        self, s: Complex[np.ndarray, " line"], output: int, input: int
    ) -> Complex[np.ndarray, "line mode"]:
        """Contribution of each mode to one path."""
        return self.read(s, output) * self.psi[:, input] / self.denominator(s)

    def pole_slopes(
        self, s: Complex[np.ndarray, " line"], parts: Complex[np.ndarray, "line mode"]
    ) -> tuple[Complex[np.ndarray, "line mode"], Complex[np.ndarray, "line mode"]]:
        """Derivatives of ``parts`` by the logarithms of omega and of zeta."""
        over, turn = parts / self.denominator(s), 2.0 * self.zeta * self.omega * s[:, None]
        return -over * (turn + 2.0 * self.omega**2), -over * turn

    def slope(self, s: Complex[np.ndarray, " line"], path: tuple[int, int]) -> Complex[np.ndarray, " line"]:
        """dG/ds of one path."""
        output, input = path
        rise = self.phi_rate[output] + 2.0 * s[:, None] * self.phi_acceleration[output]
        steep = 2.0 * s[:, None] + 2.0 * self.zeta * self.omega
        own = rise * self.psi[:, input] - self.parts(s, output, input) * steep
        return np.sum(own / self.denominator(s), axis=1)


@record(kw_only=True)
class TransferSlopes:
    """Derivatives of a `ModalTransfer` by unknowns, which are the first axis."""

    log_omega: Float[np.ndarray, "unknown mode"]
    zeta: Float[np.ndarray, "unknown mode"]
    psi: Float[np.ndarray, "unknown mode input"]
    phi: Float[np.ndarray, "unknown output mode"]
    phi_rate: Float[np.ndarray, "unknown output mode"]
    phi_acceleration: Float[np.ndarray, "unknown output mode"]

    def of(
        self, transfer: ModalTransfer, s: Complex[np.ndarray, " line"], path: tuple[int, int]
    ) -> Complex[np.ndarray, "line unknown"]:
        """dG of one path by each unknown."""
        output, input = path
        under, at = transfer.denominator(s), s[:, None]
        parts = transfer.parts(s, output, input)
        by_log_omega, by_log_zeta = transfer.pole_slopes(s, parts)
        powers = (self.phi, self.phi_rate, self.phi_acceleration)
        of_reading = [(transfer.psi[:, input] / under * at**k) @ p[:, output].T for k, p in enumerate(powers)]
        zeta = np.where(transfer.zeta > 0.0, transfer.zeta, 1.0)
        return (
            sum(of_reading)
            + (transfer.read(s, output) / under) @ self.psi[:, :, input].T
            + by_log_omega @ self.log_omega.T
            + (by_log_zeta / zeta) @ self.zeta.T
        )


def transfer_of(modes: Modes, inputs: Sequence[str], outputs: Sequence[str], count: int) -> ModalTransfer:
    """The transfer functions of the lowest ``count`` modes, with the article's damping."""
    rest, shapes = modes.equilibrium, modes.shapes[:, :count]
    drive, read = input_rows(rest, inputs), output_rows(rest, outputs)
    return ModalTransfer(
        omega=modes.omega[:count],
        zeta=ratios_by_cause(modes, count=count).zeta,
        psi=(drive.force @ shapes).T,
        phi=read.position @ shapes,
        phi_rate=read.rate @ shapes,
        phi_acceleration=read.acceleration @ shapes,
    )


def transfer_slopes(
    modes: Modes,
    bound: Sequence[Bound],
    inputs: Sequence[str],
    outputs: Sequence[str],
    held: Sequence[int],
    count: int,
) -> TransferSlopes:
    """Derivatives by the unknowns; the poles of modes ``held`` are fixed, those of the others move."""
    rest = modes.equilibrium
    now = [[read_parameter(rest.model.structure, rest.environment, p) for p in b.parameters] for b in bound]
    found = iter(
        differentiate_plant(
            modes, [p for own in now for p in own], inputs=inputs, outputs=outputs, count=count
        )
    )
    shapes = {
        "psi": (count, len(inputs)),
        "phi": (len(outputs), count),
        "phi_rate": (len(outputs), count),
        "phi_acceleration": (len(outputs), count),
        "zeta": (count,),
    }
    total = {name: np.zeros((len(bound), *shape)) for name, shape in shapes.items()}
    d_omega = np.zeros((len(bound), count))
    for k, own in enumerate(now):
        for parameter in own:
            one, scale = next(found), 1.0 if bound[k].unknown.added else parameter.value
            for name, sums in total.items():
                sums[k] += scale * getattr(one, name)
            d_omega[k] += scale * np.diag(one.A, 1)[::2]
    total["zeta"][:, list(held)] = 0.0
    free = np.setdiff1d(np.flatnonzero(modes.omega[:count] > 0.0), held)
    log_omega = np.zeros((len(bound), count))
    log_omega[:, free] = d_omega[:, free] / modes.omega[free]
    return TransferSlopes(log_omega=log_omega, **total)
