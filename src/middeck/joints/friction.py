"""Coulomb friction with elastic presliding: a spring and a slider in series.

The Jenkins element (Jenkins 1962; Iwan 1966, J. Appl. Mech. 33). Several side by side make any Masing
hysteresis. It has what pure Coulomb friction lacks: a definite torque at zero speed, hence no chattering and
no set-valued law, and a stiffness at small amplitude, which is what a bearing shows.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError
from middeck.joints.element import Equivalent, check_amplitudes
from middeck.values import record


@record
class Friction:
    """A bearing with Coulomb friction, presliding stiffness and viscous drag.

    Attributes:
        slip_torque: Torque T_c [N m] at which it slips; of a slide or a cable's device the force [N].
        stiffness: Presliding stiffness k_s [N m/rad] while it sticks; [N/m] along a travel.
        viscous: Viscous damping [N m s/rad] beside it; [N s/m] along a travel.

    The same law serves what turns and what travels: read m, N, N/m for rad, N m, N m/rad throughout. The
    state of its time-domain law is the angle [rad] at which the slider stands. Raises `ConfigError` for a
    slip torque or a viscous damping below zero, or a stiffness that is not positive and finite.

    >>> bearing = Friction(slip_torque=0.002, stiffness=2.0)
    >>> bearing.slip_angle
    0.001
    >>> bearing.resist(0.0005, 0.0)   # sticks
    (0.001, 0.0)
    >>> bearing.resist(0.003, 0.0)    # slips: the slider follows by 2 mrad
    (0.002, 0.002)
    """

    slip_torque: float
    stiffness: float
    viscous: float = 0.0

    def __post_init__(self) -> None:
        bounded = all(0.0 <= v < math.inf for v in (self.slip_torque, self.viscous))
        if not bounded or not 0.0 < self.stiffness < math.inf:
            raise ConfigError(
                f"friction of {self.slip_torque} N m, {self.stiffness} N m/rad before it slips and "
                f"{self.viscous} N m s/rad",
                where="Friction",
                hint="slip torque and viscous damping from zero, presliding stiffness above zero, all finite",
            )

    @property
    def slip_angle(self) -> float:
        """Presliding angle [rad] before it slips; below this amplitude it is a spring without loss."""
        return self.slip_torque / self.stiffness

    def describing_function(self, amplitude: Float[np.ndarray, " amplitude"]) -> Equivalent:
        """Equivalent and loss stiffness [N m/rad] (Caughey 1960, J. Appl. Mech. 27), without ``viscous``.

        With a = slip angle and cos psi = 1 - 2 a/A: k_s (psi - sin(2 psi)/2)/pi and 4 T_c (1 - a/A)/(pi A);
        k_s and zero below the slip angle. Raises `ConfigError` for an amplitude that is not positive.
        """
        A = check_amplitudes(amplitude)
        ratio = np.minimum(self.slip_angle / A, 1.0)
        psi = _turn(ratio)
        loss = 4.0 / np.pi * self.stiffness * ratio * (1.0 - ratio)
        return Equivalent(self.stiffness / np.pi * (psi - 0.5 * np.sin(2.0 * psi)), loss)

    def harmonic(
        self, amplitude: Float[np.ndarray, " amplitude"], order: int
    ) -> Complex[np.ndarray, " amplitude"]:
        """Torque [N m] of one harmonic, see `JointElement`; the even ones are zero."""
        A = check_amplitudes(amplitude)
        if order % 2 == 0:
            return np.zeros(len(A), dtype=complex)
        ratio = np.minimum(self.slip_angle / A, 1.0)
        psi, top, elastic = _turn(ratio), self.stiffness * A * ratio, self.stiffness * A
        # From the turning point down: T_c - k_s A (1 - cos phase) until psi, then -T_c until pi.
        falling = (top - elastic) * _fourier(order, psi)
        falling = falling + 0.5 * elastic * (_fourier(order - 1, psi) + _fourier(order + 1, psi))
        slipping = _fourier(order, np.full(len(A), np.pi)) - _fourier(order, psi)
        return 2.0 / np.pi * (falling - top * slipping)

    def resist(self, angle: float, state: float) -> tuple[float, float]:
        """Torque [N m] at ``angle``, and the place of the slider there."""
        torque = self.stiffness * (angle - state)
        if abs(torque) <= self.slip_torque:
            return torque, state
        slipped = math.copysign(self.slip_torque, torque)
        return slipped, angle - slipped / self.stiffness

    def mean_torque(self, start: float, end: float, state: float) -> tuple[float, float]:
        """Mean torque [N m] from ``start`` to ``end`` and its slope; ``state`` is the slider at ``start``."""
        way = end - start
        sign = math.copysign(1.0, way)
        begin = self.stiffness * (start - state)
        room = max((self.slip_torque - sign * begin) / self.stiffness, 0.0)
        if abs(way) <= room:
            return begin + 0.5 * self.stiffness * way, 0.5 * self.stiffness
        lost = 0.5 * self.stiffness * room**2 / abs(way)
        return sign * (self.slip_torque - lost), lost / abs(way)

    def balance(self, start: float, free: float, state: float, compliance: float) -> float:
        """The mean torque T [N m] on the way from ``start`` to ``free`` - ``compliance`` T, in closed form.

        Where it slips on the way W, T = T_c - lost/W and W = free way - compliance T: a quadratic in W.
        """
        k, slip = self.stiffness, self.slip_torque
        half, begin, way = 0.5 * k, k * (start - state), free - start
        torque = (begin + half * way) / (1.0 + half * compliance)
        gone = way - compliance * torque
        sign = 1.0 if gone > 0.0 else -1.0
        if sign * (begin + k * gone) <= slip:
            return torque
        room = (slip - sign * begin) / k
        if room <= 0.0:
            return sign * slip
        lost = half * room * room
        slack = sign * way - compliance * slip
        slipped = 0.5 * (slack + math.sqrt(slack * slack + 4.0 * compliance * lost))
        return sign * (slip - lost / slipped) if slipped > 0.0 else sign * slip


def _turn(ratio: np.ndarray) -> np.ndarray:
    """Phase psi, cos psi = 1 - 2 ratio, from the turning point to slip: sin(psi/2)^2 = ratio."""
    return 2.0 * np.arcsin(np.sqrt(ratio))


def _fourier(order: int, phase: np.ndarray) -> np.ndarray:
    """Integral of exp(-j order x) for x from zero to ``phase``."""
    return phase + 0j if order == 0 else (1.0 - np.exp(-1j * order * phase)) / (1j * order)
