"""One sampling period of all modes, exactly, with derivatives by log frequency and log damping.

z' = lambda z + b u with u held and delayed by part of a period: the old input acts for the first part, the
new one for the rest (Franklin, Powell and Workman 1998, section 4.3).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

Modal = Complex[np.ndarray, "delay mode"]
# A damping ratio of one has no oscillation to follow.
MOST_DAMPING = 0.9


def poles_at(
    log_omega: Float[np.ndarray, " mode"], log_zeta: Float[np.ndarray, " mode"]
) -> tuple[Complex[np.ndarray, " mode"], Complex[np.ndarray, "2 mode"]]:
    """Poles, and their derivatives by log frequency and log damping."""
    omega, zeta = np.exp(log_omega), np.minimum(np.exp(log_zeta), MOST_DAMPING)
    root = np.sqrt(1.0 - zeta * zeta)
    poles = omega * (-zeta + 1j * root)
    return poles, np.array([poles, omega * (-zeta - 1j * zeta * zeta / root)])


def step_modes(
    z: Modal,
    poles: Complex[np.ndarray, " mode"],
    new: Modal,
    old: Modal,
    times: tuple[float, Float[np.ndarray, "delay 1"], Float[np.ndarray, "delay 1"]],
) -> tuple[
    Complex[np.ndarray, " mode"], Complex[np.ndarray, "delay mode"], Complex[np.ndarray, "delay mode"]
]:
    """exp(lambda T), z after a period, and its derivative by lambda.

    ``new`` and ``old`` are b u of the later and the earlier input; ``times`` the period, and what of it the
    new and the old input act.
    """
    T, late, early = times
    decay, over = np.exp(poles * T), 1.0 / poles
    by_late = np.exp(poles * late)
    gain_late = (by_late - 1.0) * over
    by_early = np.exp(poles * early)
    gain_early = (by_early - 1.0) * over
    after = decay * z + gain_late * new + by_late * gain_early * old
    slope = T * decay * z + (late * by_late - gain_late) * over * new
    slope += by_late * (late * gain_early + (early * by_early - gain_early) * over) * old
    return decay, after, slope
