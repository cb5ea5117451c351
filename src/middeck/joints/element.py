"""Elements at a joint beside its motor: the interface that friction and deadband share.

An element resists: its torque is positive against a positive angle and acts on the joint with the opposite
sign. The angle is counted from the joint's rest position. The same object serves simulation in time and the
describing function.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError
from middeck.values import record


@record
class Equivalent:
    """First harmonic of the torque per amplitude of angle, stiffness + j loss [N m/rad].

    The loss stiffness dissipates pi A^2 loss in a cycle, at whatever frequency; over omega it is the
    equivalent viscous damping.
    """

    stiffness: Float[np.ndarray, " amplitude"]
    loss: Float[np.ndarray, " amplitude"]


class JointElement(Protocol):
    """A resisting torque that depends on the path of the angle but not on its rate, and a viscous part."""

    @property
    def viscous(self) -> float:
        """Viscous damping [N m s/rad], linear and therefore part of the plant wherever there is one."""
        ...

    def describing_function(self, amplitude: Float[np.ndarray, " amplitude"]) -> Equivalent:
        """Equivalent stiffness and loss stiffness for an angle A cos(phase), ``viscous`` left out."""
        ...

    def harmonic(
        self, amplitude: Float[np.ndarray, " amplitude"], order: int
    ) -> Complex[np.ndarray, " amplitude"]:
        """Torque c [N m] of one harmonic: Re c exp(j order phase) for an angle A cos(phase)."""
        ...

    def resist(self, angle: float, state: float) -> tuple[float, float]:
        """Torque [N m] at ``angle`` and the new state, after any monotone motion to it; starts at state 0."""
        ...

    def mean_torque(self, start: float, end: float, state: float) -> tuple[float, float]:
        """Mean torque [N m] on the straight path from ``start`` to ``end``, and its slope by ``end``.

        Times the path it is the work done on the element: stored and dissipated energy.
        """
        ...


def sum_equivalents(
    elements: Sequence[JointElement], amplitude: Float[np.ndarray, " amplitude"]
) -> Equivalent:
    """The sum of elements side by side at one joint, which turn by the same angle."""
    parts = [element.describing_function(amplitude) for element in elements]
    none = np.zeros(len(amplitude))
    return Equivalent(sum((p.stiffness for p in parts), none), sum((p.loss for p in parts), none))


def check_amplitudes(amplitude: Float[np.ndarray, " amplitude"]) -> Float[np.ndarray, " amplitude"]:
    """``amplitude`` as an array; raises `ConfigError` for one that is not positive and finite."""
    given = np.asarray(amplitude, dtype=float)
    if given.ndim != 1 or not np.all((given > 0.0) & np.isfinite(given)):
        raise ConfigError(
            f"amplitudes must be a row of positive numbers, not {given.tolist()}",
            hint="angles in rad, zero to peak; a very small one gives the limit at rest",
        )
    return given
