"""A gap in a gear, a key or a stop: no torque within it, a stiff flank on either side.

In orbit the joint floats in the gap. Under gravity the weight presses it on one flank, so that small motions
see no gap at all: the paper's "loading of joints that have a deadband".
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError
from middeck.joints.element import Equivalent, check_amplitudes
from middeck.values import record


@record
class Deadband:
    """A gap between two elastic flanks, with a constant torque that presses on one of them.

    Attributes:
        gap: Half the free play [rad]: to either side of the middle.
        stiffness: Stiffness of each flank [N m/rad].
        preload: Constant torque [N m] that the flank carries at rest, e.g. of a weight; zero rests in the
            middle. It is a dead load: it does not change with the angle.

    The angle counts from rest and the torque beyond ``preload``, so that both are zero there. No state.
    Raises `ConfigError` for a gap below zero, or a stiffness that is not positive and finite.

    >>> gear = Deadband(gap=0.001, stiffness=50.0)
    >>> [gear.resist(angle, 0.0)[0] for angle in (0.0005, 0.002, -0.002)]
    [0.0, 0.05, -0.05]
    """

    gap: float
    stiffness: float
    preload: float = 0.0

    def __post_init__(self) -> None:
        fine = 0.0 <= self.gap < math.inf and 0.0 < self.stiffness < math.inf and math.isfinite(self.preload)
        if not fine:
            raise ConfigError(
                f"a gap of {self.gap} rad, flanks of {self.stiffness} N m/rad, preload {self.preload} N m",
                where="Deadband",
                hint="gap from zero, stiffness above zero, preload of any sign, all finite",
            )

    @property
    def viscous(self) -> float:
        """Zero: a gap and its flanks dissipate nothing."""
        return 0.0

    @property
    def rest(self) -> float:
        """Rest angle [rad] from the middle of the gap."""
        if self.preload == 0.0:
            return 0.0
        return math.copysign(self.gap, self.preload) + self.preload / self.stiffness

    def describing_function(self, amplitude: Float[np.ndarray, " amplitude"]) -> Equivalent:
        """Equivalent stiffness [N m/rad]; the loss is zero.

        In the middle of the gap, with cos beta = gap/A, it is (2 k/pi) (beta - sin(2 beta)/2) (Gelb and
        Vander Velde 1968, appendix B), and zero inside. Under a preload the mean angle moves until the mean
        torque is the preload again, and either flank counts with its own beta. Raises `ConfigError` for an
        amplitude that is not positive.
        """
        A = check_amplitudes(amplitude)
        beta = np.arccos(np.clip(self._flanks(A) / A, -1.0, 1.0))
        stiffness = self.stiffness / np.pi * np.sum(beta - 0.5 * np.sin(2.0 * beta), axis=0)
        return Equivalent(stiffness, np.zeros(len(A)))

    def harmonic(
        self, amplitude: Float[np.ndarray, " amplitude"], order: int
    ) -> Complex[np.ndarray, " amplitude"]:
        """Torque [N m] of one harmonic, see `JointElement`; even ones come from the preload."""
        A = check_amplitudes(amplitude)
        cosine = self._flanks(A) / A
        beta = np.arccos(np.clip(cosine, -1.0, 1.0))
        around = 0.5 * (_sine(order - 1, beta) + _sine(order + 1, beta)) - cosine * _sine(order, beta)
        upper, lower = 2.0 / np.pi * self.stiffness * A * around
        return upper - (-1.0) ** order * lower + 0j

    def mean_angle(self, amplitude: float) -> float:
        """Angle [rad] from the middle of the gap about which it oscillates: the mean torque is ``preload``.

        >>> gear = Deadband(gap=0.001, stiffness=50.0, preload=0.05)
        >>> [round(gear.mean_angle(A), 6) for A in (0.0005, 1.0)]   # on the flank; right through the gap
        [0.002, 0.001001]
        """
        if self.preload == 0.0:
            return 0.0
        load = abs(self.preload)

        def excess(mean: float) -> float:
            cosine = np.array([self.gap - mean, self.gap + mean]) / amplitude
            beta = np.arccos(np.clip(cosine, -1.0, 1.0))
            upper, lower = np.sin(beta) - beta * cosine
            return float(self.stiffness * amplitude / np.pi * (upper - lower)) - load

        from scipy.optimize import brentq  # only here: who reads a study file need not load SciPy

        furthest = abs(self.rest)
        # At rest the mean torque is the preload or more (the flank is convex); a swing that keeps contact
        # leaves it there.
        if excess(furthest) <= 0.0 or amplitude <= load / self.stiffness:
            return self.rest
        mean = cast("float", brentq(excess, 0.0, furthest, xtol=1e-16 * furthest, rtol=np.float64(1e-14)))
        return math.copysign(mean, self.preload)

    def resist(self, angle: float, state: float) -> tuple[float, float]:
        """Torque [N m] beyond the preload; ``state`` is returned unchanged."""
        return self._flank(angle + self.rest) - self.preload, state

    def mean_torque(self, start: float, end: float, state: float) -> tuple[float, float]:
        """Mean torque [N m] from ``start`` to ``end`` and its slope; ``state`` is not used."""
        first, last = self._flank(start + self.rest), self._flank(end + self.rest)
        if first * last > 0.0:  # on one flank throughout: no difference of near energies
            return 0.5 * (first + last) - self.preload, 0.5 * self.stiffness
        way = end - start
        if way == 0.0:
            return first - self.preload, 0.5 * self.stiffness if first else 0.0
        mean = (last * last - first * first) / (2.0 * self.stiffness * way)
        return mean - self.preload, (last - mean) / way

    def _flank(self, angle: float) -> float:
        """Torque [N m] of the flanks, ``angle`` from the middle of the gap."""
        if abs(angle) <= self.gap:
            return 0.0
        return self.stiffness * (angle - math.copysign(self.gap, angle))

    def _flanks(self, amplitude: np.ndarray) -> np.ndarray:
        """Distance [rad] from the mean angle to the upper and lower flank, for each amplitude."""
        mean = np.array([self.mean_angle(float(a)) for a in amplitude])
        return np.array([self.gap - mean, self.gap + mean])


def _sine(order: int, phase: np.ndarray) -> np.ndarray:
    """Integral of cos(order x) for x from zero to ``phase``."""
    return phase if order == 0 else np.sin(order * phase) / order
