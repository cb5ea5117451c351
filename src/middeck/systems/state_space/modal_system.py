"""Modal 2x2 blocks, the first-class form of a plant.

Each mode obeys q'' + 2 zeta omega q' + omega^2 q = psi u. The states are (q, q'/omega) for a mode that
oscillates and (q, q') for a rigid one (omega = 0), interleaved mode by mode; a 2x2 block is then normal up
to its damping, so that the form is well conditioned over many decades of frequency.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np
from jaxtyping import Complex, Float

from middeck.systems.state_space.second_order import sum_second_order
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record


@record(kw_only=True)
class ModalSystem:
    """A sum of modes: y = phi q + phi_rate q' + phi_acceleration q'' + direct u.

    Attributes:
        omega, zeta: Angular frequency [rad/s], zero for a rigid mode, and damping ratio of each mode.
        psi: Modal input matrix: generalised force per unit input.
        phi, phi_rate: Output per unit modal coordinate, and per unit modal rate.
        names: Name of each mode.
        phi_acceleration: Output per unit modal acceleration; None where no output reads one. Kept apart from
            ``phi`` so that a mode taken out takes its part of the direct term along.
        direct: Output per unit input that goes through no mode; None for nothing.
    """

    period_s: ClassVar[None] = None
    rounded: ClassVar[tuple[str, ...]] = ("omega", "zeta", "psi", "phi")
    omega: Float[np.ndarray, " mode"]
    zeta: Float[np.ndarray, " mode"]
    psi: Float[np.ndarray, "mode input"]
    phi: Float[np.ndarray, "output mode"]
    phi_rate: Float[np.ndarray, "output mode"]
    names: tuple[str, ...]
    phi_acceleration: Float[np.ndarray, "output mode"] | None = None
    direct: Float[np.ndarray, "output input"] | None = None

    @property
    def order(self) -> int:
        """Number of states: two for each mode."""
        return 2 * len(self.omega)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of outputs and inputs."""
        return len(self.phi), self.psi.shape[1]

    @property
    def state_names(self) -> tuple[str, ...]:
        """The mode of each state."""
        return tuple(name for name in self.names for _ in range(2))

    def select(self, inputs: Sequence[int], outputs: Sequence[int]) -> Self:
        """The system from some of its inputs to some of its outputs, by their numbers."""
        columns, rows = list(inputs), list(outputs)
        acceleration, direct = self.phi_acceleration, self.direct
        return dataclasses.replace(
            self,
            psi=self.psi[:, columns],
            phi=self.phi[rows],
            phi_rate=self.phi_rate[rows],
            phi_acceleration=None if acceleration is None else acceleration[rows],
            direct=None if direct is None else direct[np.ix_(rows, columns)],
        )

    def scale_inputs(self, scale: Float[np.ndarray, " input"]) -> Self:
        """The system with each input multiplied by its ``scale``."""
        direct = None if self.direct is None else self.direct * scale
        return dataclasses.replace(self, psi=self.psi * scale, direct=direct)

    def as_statespace(self) -> StateSpace:
        """State space with states (q, q'/omega) or, for a rigid mode, (q, q'), interleaved."""
        n = len(self.omega)
        scale = rate_scale(self)
        even, odd = 2 * np.arange(n), 2 * np.arange(n) + 1
        A = np.zeros((2 * n, 2 * n))
        A[even, odd] = scale
        A[odd, even] = -(self.omega**2) / scale
        A[odd, odd] = -2.0 * self.zeta * self.omega
        B = np.zeros((2 * n, self.psi.shape[1]))
        B[odd] = self.psi / scale[:, None]
        C = np.zeros((len(self.phi), 2 * n))
        rows = output_rows(self)
        C[:, even] = rows.position
        C[:, odd] = rows.rate * scale
        return StateSpace(A, B, C, rows.direct)


@record
class OutputRows:
    """A modal system's outputs without q'': y = position q + rate q' + direct u."""

    position: Float[np.ndarray, "output mode"]
    rate: Float[np.ndarray, "output mode"]
    direct: Float[np.ndarray, "output input"]


def select_modes(modal: ModalSystem, keep: np.ndarray) -> ModalSystem:
    """The sub-model of the modes ``keep`` (indices or mask); damping stays with its mode.

    What a mode gives to an accelerometer's direct term goes with it; ``direct`` stays as it is.
    """
    index = np.arange(len(modal.omega))[keep]
    return ModalSystem(
        omega=modal.omega[index],
        zeta=modal.zeta[index],
        psi=modal.psi[index],
        phi=modal.phi[:, index],
        phi_rate=modal.phi_rate[:, index],
        names=tuple(modal.names[i] for i in index),
        phi_acceleration=None if modal.phi_acceleration is None else modal.phi_acceleration[:, index],
        direct=modal.direct,
    )


def output_rows(modal: ModalSystem) -> OutputRows:
    """The outputs with q'' replaced by the equation of motion; its part from u is direct.

    >>> spring = ModalSystem(omega=[2.0], zeta=[0.0], psi=[[3.0]], phi=[[0.0]], phi_rate=[[0.0]],
    ...     names=("bounce",), phi_acceleration=[[1.0]])
    >>> rows = output_rows(spring)                                      # y = q'' = 3 u - 4 q
    >>> rows.position.tolist(), rows.direct.tolist()
    ([[-4.0]], [[3.0]])
    """
    shape = len(modal.phi), modal.psi.shape[1]
    direct = np.zeros(shape) if modal.direct is None else modal.direct
    a = modal.phi_acceleration
    if a is None:
        return OutputRows(modal.phi, modal.phi_rate, direct)
    damping = 2.0 * modal.zeta * modal.omega
    return OutputRows(modal.phi - a * modal.omega**2, modal.phi_rate - a * damping, direct + a @ modal.psi)


def couple_rates(modal: ModalSystem, coupling: Float[np.ndarray, "mode mode"]) -> StateSpace:
    """The state space of modes with the forces -coupling q' between them, skew if wheels make them.

    >>> free = ModalSystem(omega=[0.0, 0.0], zeta=[0.0, 0.0], psi=np.eye(2), phi=np.eye(2),
    ...     phi_rate=np.zeros((2, 2)), names=("x", "y"))
    >>> A = couple_rates(free, np.array([[0.0, 3.0], [-3.0, 0.0]])).A           # a nutation at 3 rad/s
    >>> np.abs(np.linalg.eigvals(A)).max().round(9)
    np.float64(3.0)
    """
    plain, scale = modal.as_statespace(), rate_scale(modal)
    A, C = plain.A.copy(), plain.C.copy()
    A[1::2, 1::2] -= coupling * scale / scale[:, None]
    if modal.phi_acceleration is not None:
        C[:, 1::2] -= modal.phi_acceleration @ coupling * scale
    return StateSpace(A, plain.B, C, plain.D)


def rate_scale(modal: ModalSystem) -> Float[np.ndarray, " mode"]:
    """The factor s in the second state q'/s: omega, or one for a rigid mode."""
    return np.where(modal.omega > 0.0, modal.omega, 1.0)


def modal_response(
    modal: ModalSystem, omega: Float[np.ndarray, " line"]
) -> Complex[np.ndarray, "line output input"]:
    """Frequency response at ``omega`` [rad/s]: O(modes) per line and one matrix product each."""
    omega = np.asarray(omega, dtype=float)
    shapes = [modal.phi, modal.phi_rate]
    if modal.phi_acceleration is not None:
        shapes.append(modal.phi_acceleration)
    outputs, inputs = len(modal.phi), modal.psi.shape[1]
    residues = tuple(
        (shape.T[:, :, None] * modal.psi[:, None, :]).reshape(-1, outputs * inputs) for shape in shapes
    )
    damping, stiffness = 2.0 * modal.zeta * modal.omega, modal.omega**2
    through_modes = sum_second_order(omega, damping, stiffness, residues).reshape(-1, outputs, inputs)
    return through_modes if modal.direct is None else through_modes + modal.direct
