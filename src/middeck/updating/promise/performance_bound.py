"""Bound for linear compensators of any order on drawn plants, at the control effort of a given one.

For every compensator K, rho > 0 and plant, rms^2 + rho effort^2 of K is at least the least that any
compensator of that plant alone reaches, which LQG does. So rms^2 of K is at least that least less
rho effort^2 of K, for every rho: weak duality, exact at the best rho because the trade of the two is convex
(Boyd and Barratt 1991, "Linear Controller Design", chapter 12). Nothing of this asks how K was designed.

One compensator has to do for all plants. Its worst is no better than the largest of their bounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import scipy.optimize as opt
from jaxtyping import Float

from middeck.control.law.compensator import Compensator, idle_compensator
from middeck.control.law.delay_order import approximation_order
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.estimator import KalmanFilter, design_filter
from middeck.control.lqg.weights import LQGWeights
from middeck.control.noise import measure_noise_rms
from middeck.control.qualification import decibels
from middeck.errors import NotStabilisableError, NumericalError
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant
from middeck.values import record

STRIDE = np.log(30.0)
"""Step in the logarithm of 1/rho, in search of the interval that holds the best."""
STRIDES = 16
CLOSE = 0.1
"""Tolerance in the logarithm of rho: the bound is flat about its best."""


@record(kw_only=True)
class RobustBound:
    """The worst of several plants for one compensator, and a bound for any other of its effort.

    Decibels count from each plant's rms without control, over all frequencies.

    Attributes:
        draws: Number of plants.
        worst_db: Largest of the compensator over the plants; ``inf`` where it is unstable on one.
        no_linear_law_below_db: Lower bound of the largest over the plants, for any linear compensator between
            the same ports, of any order, whose effort is no more on each of them; ``nan`` where no plant has
            a bound.
    """

    draws: int
    worst_db: float
    no_linear_law_below_db: float


def bound_worst(plants: Sequence[Plant], law: Compensator, weights: LQGWeights) -> RobustBound:
    """The worst of ``plants`` for ``law``, and its lower bound for any linear compensator."""
    own, least = bound_db(plants, law, weights).T
    least = least[np.isfinite(least)]
    return RobustBound(
        draws=len(plants),
        worst_db=float(own.max(initial=-np.inf)) if len(plants) else np.nan,
        no_linear_law_below_db=float(least.max()) if len(least) else np.nan,
    )


def bound_db(
    plants: Sequence[Plant], law: Compensator, weights: LQGWeights
) -> Float[np.ndarray, "plant both"]:
    """Decibels of ``law`` on each plant, and their lower bound for linear compensators of the same effort.

    Both relative to the plant without control; delays by Pade approximations that keep every mode's phase.
    The bound is ``nan`` where the compensator is unstable or its effort infinite (white noise through a
    direct term): without an effort there is no bound at it; where the plant has no rms without control; and
    on a plant that has no optimum, for a mode that hardly decays and no sensor sees.
    """
    return np.array([_one(plant, law, weights) for plant in plants]).reshape(len(plants), 2)


def _one(delayed: Plant, law: Compensator, weights: LQGWeights) -> tuple[float, float]:
    plant = approximate_delays(delayed, approximation_order(delayed, law.system))
    alone = measure_noise_rms(plant, idle_compensator(plant), weights).rms
    own = measure_noise_rms(plant, law, weights)
    db = decibels(own.rms, alone)
    if not np.all(np.isfinite([own.rms, own.control_rms, alone])):
        return db, np.nan
    if not own.control_rms > 0.0:
        return db, 0.0
    try:
        kalman = design_filter(plant, weights)
    except NotStabilisableError:
        return db, np.nan
    least = _least_square(plant, weights, kalman, own.control_rms**2, alone**2)
    return db, decibels(np.sqrt(max(least, 0.0)), alone) if np.isfinite(least) else np.nan


def _least_square(
    plant: Plant, weights: LQGWeights, kalman: KalmanFilter, effort: float, alone: float
) -> float:
    """The best bound of rms^2 over rho, ``effort`` and ``alone`` being squares too; not finite for none.

    It is concave in rho, and where rho ``effort`` is ``alone`` it is zero at most: the best is on one side.
    """

    def surplus(log_authority: float) -> float:
        level = float(np.exp(log_authority))
        try:
            return effort / level - design_lqg(plant, weights, level, kalman=kalman).cost
        except NumericalError:  # no optimum here, and no bound
            return np.inf

    best, at = np.inf, float(np.log(effort / alone))
    for _ in range(STRIDES):
        found = surplus(at + STRIDE)
        if not found < best:
            break
        best, at = found, at + STRIDE
    if not np.isfinite(best):
        return np.nan
    within = opt.minimize_scalar(
        surplus, bounds=(at - STRIDE, at + STRIDE), method="bounded", options={"xatol": CLOSE}
    )
    return -min(best, float(cast("Any", within).fun))
