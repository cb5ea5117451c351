"""What no linear compensator of any order can pass on drawn plants, at the control effort of a given one.

For every compensator K, rho > 0 and plant, rms^2 + rho effort^2 of K is at least the least that any
compensator of that plant alone reaches, which LQG does. So rms^2 of K is at least that least less
rho effort^2 of K, for every rho: weak duality, exact at the best rho because the trade of the two is convex
(Boyd and Barratt 1991, "Linear Controller Design", chapter 12).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import scipy.optimize as opt
from jaxtyping import Float

from middeck.control.law.compensator import Compensator, idle_compensator
from middeck.control.law.delay_order import approximation_order
from middeck.control.lqg import LQGWeights, design_filter, design_lqg
from middeck.control.noise import measure_noise_rms
from middeck.control.qualification import decibels
from middeck.errors import NotStabilisableError
from middeck.systems.delay_approximation import approximate_delays
from middeck.systems.plant import Plant

AROUND = 100.0
"""Factor about the authority of the compensator between which the best rho is looked for."""
CLOSE = 0.1
"""Of the logarithm of rho: the bound is flat about its best."""


def bound_db(
    plants: Sequence[Plant], law: Compensator, weights: LQGWeights, authority: float
) -> Float[np.ndarray, "plant both"]:
    """Decibels of ``law`` on each plant, and those that no linear compensator of the same effort passes.

    Both relative to the plant without control; delays by Pade approximations that keep every mode's phase.
    ``authority`` is about where the trade of the law lies: it moves the bound's tightness, never its truth.
    The bound is ``nan`` where the law is unstable: without an effort there is no bound at it; and on a plant
    that has no optimum, for a mode that hardly decays and no sensor sees.
    """
    return np.array([_one(plant, law, weights, authority) for plant in plants]).reshape(len(plants), 2)


def _one(late: Plant, law: Compensator, weights: LQGWeights, authority: float) -> tuple[float, float]:
    plant = approximate_delays(late, approximation_order(late, law.system))
    alone = measure_noise_rms(plant, idle_compensator(plant), weights).rms
    own = measure_noise_rms(plant, law, weights)
    if not np.isfinite(own.rms):
        return np.inf, np.nan
    try:
        kalman = design_filter(plant, weights)
    except NotStabilisableError:
        return decibels(own.rms, alone), np.nan

    def surplus(log_authority: float) -> float:
        level = float(np.exp(log_authority))
        return own.control_rms**2 / level - design_lqg(plant, weights, level, kalman=kalman).cost

    ends = np.log(authority) + np.log(AROUND) * np.array([-1.0, 1.0])
    found = opt.minimize_scalar(surplus, bounds=tuple(ends), method="bounded", options={"xatol": CLOSE})
    least = -float(cast("Any", found).fun)
    return decibels(own.rms, alone), decibels(np.sqrt(max(least, 0.0)), alone)
