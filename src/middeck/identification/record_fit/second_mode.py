"""Score of a second mode in the place of one, from the residual of a record's fit.

Two modes, sum phi_k / (s - p_k), leave of one with their mean pole p and the sum of their residues the sum of
phi_k (p_k - p)^2 / (s - p)^3; and their free motions, each from a state of its own, leave the derivative of
the mode's free motion by its pole. Forces that shake the article leave as much at the peak, but of no such
form: the score distinguishes them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import scipy.stats
from jaxtyping import Complex, Float

from middeck.identification.fit.second_modes import PARTS, second_mode_terms
from middeck.identification.fit.unneeded_modes import pairs_of
from middeck.identification.model.measurement_model import model_response
from middeck.identification.problem.data import Data
from middeck.identification.problem.residual_and_slopes import Terms
from middeck.identification.record_fit.record_covariance import Rows, known_power
from middeck.identification.record_fit.record_terms import parts_of_noise
from middeck.identification.record_fit.refine_record import RecordRun
from middeck.identification.record_fit.residual_tests import Heard
from middeck.identification.record_fit.sensor_or_force_noise import noise_variance
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.lacking_terms import TermRows, joint_score

# Step of the logarithm of a decay rate for the derivative of its free motion.
SHIFT = 1e-6


def chance_of_no_second(
    run: RecordRun,
    data: Data,
    covariance: ModelCovariance,
    m: int,
    heard: Heard,
    floor: Float[np.ndarray, " input"] | float = 0.0,
) -> float:
    """Probability of a residual that is as much of the form of a second mode beside pair ``m``.

    Unknowns are two of each output for the driven motion, and two for the free motion of each of its
    experiments. The noise is taken as that of sensors and of inputs that is ``heard``: what one mode leaves
    of two would pass for noise of forces.
    """
    residual, model = run.residual(data), covariance.model
    each = Rows(run, data, model, covariance.structure)
    variance = noise_variance(residual, driven=data.driven)
    if not heard.size:
        H = model_response(model, data.omega / (2.0 * np.pi))
        power = np.sum(np.abs(H) ** 2 * known_power(each, floor)[:, None], axis=2)
        variance = variance + power.T[:, :, None]
    each.run = dataclasses.replace(run, variance=variance)
    mode = int(np.argmin(np.abs(model.poles - pairs_of(run)[m])))
    driven = np.einsum("tloi,lie->tole", second_mode_terms(model, data.s, mode), data.U)
    outputs, lines, columns = residual.shape
    free = _free(run, data, m)
    free = np.einsum("tl,ef->etlf", free, np.eye(columns)).reshape(-1, lines, columns)
    count, line = len(PARTS) + len(free), np.tile(np.repeat(np.arange(lines), 2), columns)

    def rows() -> Iterator[TermRows]:
        for o, left in enumerate(residual):
            J, own = each.of(o)
            place = np.flatnonzero(J.any(axis=(1, 2)))
            lacking = np.zeros((count * outputs, *left.shape), complex)
            lacking[count * o : count * (o + 1)] = np.concatenate([driven[:, o], free])
            slopes, terms, (rest,) = (own.removed(part) for part in (J[place], lacking, left[None]))
            noise = parts_of_noise(heard[o], own, columns)
            yield TermRows(place=place, slopes=slopes, terms=terms, left=rest, line=line, heard=noise)

    return float(scipy.stats.chi2.sf(joint_score(rows, covariance), count * outputs))


def _free(run: RecordRun, data: Data, m: int) -> Complex[np.ndarray, "part line"]:
    """Derivatives of the free motions of pair ``m`` by its decay rate; those by its frequency add nothing."""
    theta = run.refined.theta
    moved = theta + SHIFT * (np.arange(len(theta)) == m)
    change = (Terms(run.layout, data, moved).B - Terms(run.layout, data, theta).B) / SHIFT
    return change[change.any(axis=1)]
