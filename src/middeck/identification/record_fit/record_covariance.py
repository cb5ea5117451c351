"""The measurement model at the end of a record's fit, and the covariance of its unknowns."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.fit.fitted_model import structure_of
from middeck.identification.model.measurement_model import MeasurementModel, model_response
from middeck.identification.problem.data import Data
from middeck.identification.problem.residual_and_slopes import Terms
from middeck.identification.problem.transient import transient_slopes
from middeck.identification.problem.transient_projection import TransientProjection, as_real
from middeck.identification.record_fit.refine_record import RecordRun
from middeck.identification.record_fit.sensor_or_force_noise import (
    common_noise_of_residual,
    covering_variance,
)
from middeck.identification.uncertainty import orthogonal
from middeck.identification.uncertainty.covariance import MOST_LEVERAGE, ModelCovariance
from middeck.identification.uncertainty.model_unknowns import ModelStructure, places_of, ties
from middeck.identification.uncertainty.response_derivatives import entry_slopes


def record_covariance(
    run: RecordRun,
    data: Data,
    model: MeasurementModel,
    input_noise: Float[np.ndarray, "part sample input"] | None = None,
    floor: Float[np.ndarray, "*lines input"] | float = 0.0,
) -> tuple[ModelCovariance, Float[np.ndarray, " input"]]:
    """Covariance of the weighted fit, A^-1 B A^-1, with the transients among the unknowns.

    The weights W are those of the simulation, and only by chance one over the variance V of the noise.
    So B = J^H W V W J has V from the residual, whatever W is (White 1980, a spectrum in the place of single
    squares). W = 1 / V gives the Cramer-Rao value A^-1 / 2, half since V is of both parts together. Noise of
    short inputs, alike on all lines of a mode, is in nothing that is left there: where known it is added.

    Noise of measured inputs makes gains too small as well (errors in variables, Soderstrom 2018, section 2):
    the score J^H W r has the mean -dH^H W H q where q is its power; of short noise, as J and r have, without
    what transients take up. What that moves each unknown by is added as one more deviation, for
    ``input_noise`` or for as much of ``floor``, its variance in samples or its power on each line, as what is
    left has room for. Beside the covariance: the largest such move of each input, in deviations.
    """
    structure = structure_of(run.layout)
    size = places_of(model, structure).size
    each = Rows(run, data, model, structure)
    alone = np.zeros(size)
    blocks: list[np.ndarray] = []
    for o in range(run.layout.outputs):
        J, own = each.of(o)
        at = np.flatnonzero(J.any(axis=(1, 2)))  # poles, inputs and what is this output's own
        alone[at] += np.sum(as_real(J[at] / np.sqrt(run.variance[o])) ** 2, axis=1)
        R = orthogonal.triangle(own.removed(J[at]).T)
        blocks.append(np.zeros((len(R), size)))
        blocks[-1][:, at] = R
    held = ties(model, structure)
    inverse, loose = orthogonal.inverse_root(orthogonal.factor_of(blocks), held)
    inflation = np.maximum(alone * np.sum(inverse**2, axis=1), 1.0)
    W, free = np.split(inverse, [inverse.shape[1] - loose], axis=1)
    noise = np.zeros((0, 2 * data.lines[-1], data.U.shape[1])) if input_noise is None else input_noise
    power = _power(each, noise, floor)
    spread = _scores_spread(each, W, noise, power * (data.driven is not None))
    bias = each.bias_of_parts(_spectra(noise, data)) if len(noise) else each.bias(power)
    root, moved = W @ orthogonal.root_of(spread), W @ (W.T @ bias)
    known = np.linalg.norm(root, axis=1, keepdims=True)
    moves = np.max(np.abs(moved) / np.maximum(known, np.finfo(float).tiny), axis=0)
    root = np.hstack([orthogonal.canonical_root(np.hstack([root, moved])), np.sqrt(0.5) * free])
    unknowns = size - len(held) + data.H.shape[0] * data.H.shape[2] * len(each.terms.B)
    degrees = float(2 * data.H.size - unknowns)
    covariance = ModelCovariance(
        model=model,
        structure=structure,
        root=root,
        inflation=inflation,
        degrees=degrees,
        robust=run.weighting == "flat",
        loose=loose,
    )
    return covariance, moves


class Rows:
    """Derivatives of each output's spectra with the norm of its transients; made anew, for they are large."""

    def __init__(
        self, run: RecordRun, data: Data, model: MeasurementModel, structure: ModelStructure
    ) -> None:
        self.run, self.data, self.model, self.structure = run, data, model, structure
        self.terms = Terms(run.layout, data, run.refined.theta)

    def of(self, output: int) -> tuple[Complex[np.ndarray, "unknown line column"], TransientProjection]:
        """Rows of one output by the unknowns of the model, also through the transients' poles."""
        model, data, layout, point = self.model, self.data, self.run.layout, self.terms.point
        assert self.terms.motion is not None
        at = places_of(model, self.structure)
        J = np.zeros((at.size, *data.H.shape[1:]), dtype=complex)
        for i in range(layout.inputs):
            entry = entry_slopes(model, self.structure, data.s, output, i)
            J[entry.place] += entry.by[:, :, None] * data.U[:, i]
        _, t = self.terms.split(self.run.refined.step.linear[output])
        mode = np.array([int(np.argmax(model.poles == pole)) for pole in point.poles])
        place = np.concatenate([at.sigma[mode], at.omega[mode[: layout.pairs]]])
        J[place] += transient_slopes(layout, point, self.terms.motion, t)
        return J, TransientProjection(self.terms.B, 1.0 / np.sqrt(self.run.variance[output]))

    def bias(self, power: Float[np.ndarray, "line input"]) -> Float[np.ndarray, "unknown input"]:
        """Mean of the scores under steady noise of each input."""
        model, data = self.model, self.data
        found = np.zeros((places_of(model, self.structure).size, power.shape[1]))
        for o, i in np.ndindex(model.direct.shape):
            entry = entry_slopes(model, self.structure, data.s, o, i)
            weight = power[:, i] * np.sum(1.0 / self.run.variance[o], axis=1)
            found[entry.place, i] -= np.real(entry.by.conj() @ (entry.H * weight))
        return found

    def bias_of_parts(
        self, noise: Complex[np.ndarray, "part line input"]
    ) -> Float[np.ndarray, "unknown input"]:
        """Mean of the scores under ``noise`` of each input.

        Transients take up as much of short noise as of a short input: no line tells how much.
        """
        model, data = self.model, self.data
        found = np.zeros((places_of(model, self.structure).size, noise.shape[2]))
        for o, i in np.ndindex(model.direct.shape):
            entry = entry_slopes(model, self.structure, data.s, o, i)
            own = TransientProjection(self.terms.B, 1.0 / np.sqrt(self.run.variance[o]))
            rows = np.vstack([entry.by, entry.H])
            for part in noise[..., i]:
                alike = np.repeat((rows * part)[:, :, None], data.H.shape[2], axis=2)
                *slopes, heard = own.removed(alike)
                found[entry.place, i] -= np.array(slopes) @ heard / len(noise)
        return found


def _power(
    each: Rows,
    noise: Float[np.ndarray, "part sample input"],
    floor: Float[np.ndarray, "*lines input"] | float,
) -> Float[np.ndarray, "line input"]:
    """Power of noise of inputs: given, by periods, or of a floor."""
    if len(noise):
        return np.mean(np.abs(_spectra(noise, each.data)) ** 2, axis=0)
    return known_power(each, floor)


def known_power(
    each: Rows, floor: Float[np.ndarray, "*lines input"] | float
) -> Float[np.ndarray, "line input"]:
    """Power of steady noise of inputs: as much of a floor as the residual has room for."""
    data = each.data
    most = np.broadcast_to(floor, (len(data.s), data.U.shape[1]))
    if data.driven is not None:
        return most * data.driven[:, None]
    H = model_response(each.model, data.omega / (2.0 * np.pi))
    heard = data.H.shape[2] * np.einsum("koi,ki->o", np.abs(H) ** 2, most)
    left = np.sum(np.abs(each.run.residual(data)) ** 2, axis=(1, 2))
    return most * float(np.min(np.divide(left, heard, out=np.ones_like(left), where=heard > left)))


def _spectra(
    noise: Float[np.ndarray, "part sample input"], data: Data
) -> Complex[np.ndarray, "part line input"]:
    return np.fft.rfft(noise, axis=1)[:, data.lines] / np.sqrt(noise.shape[1])


def _scores_spread(
    each: Rows,
    W: Float[np.ndarray, "unknown direction"],
    noise: Float[np.ndarray, "part sample input"],
    least: Float[np.ndarray, "line input"],
) -> Float[np.ndarray, "direction direction"]:
    """Covariance of the scores in the directions W under the residual, and ``noise`` of the inputs.

    Degrees of freedom are counted on each line. Noise of the inputs is alike for all outputs, and each
    experiment has its own. What is left is no less than inputs' noise of the power ``least`` makes: a fit
    follows it on the few driven lines of a peak. What outputs leave in common counts as such: noise of a
    measured input, or a disturbance, is in all of them.
    """
    run, data = each.run, each.data
    shape = run.denominator(data)
    residual = run.residual(data)
    _, lines, columns = residual.shape
    spread = np.zeros((W.shape[1], W.shape[1]))
    scores = np.zeros((columns, W.shape[1], len(noise)))
    H = model_response(each.model, data.omega / (2.0 * np.pi))
    N = _spectra(noise, data) / np.sqrt(max(len(noise), 1))
    common = common_noise_of_residual(residual, data.driven)
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    for o in range(run.layout.outputs):
        J, own = each.of(o)
        at = np.flatnonzero(J.any(axis=(1, 2)))
        Q, R = np.linalg.qr(W[at].T)  # W^T J over all directions has no more than these nonzero rows
        rows = R @ own.removed(J[at])
        followed = own.leverage() + np.sum(rows**2, axis=0).reshape(columns, -1)
        left = 1.0 - np.minimum(followed.reshape(columns, lines, 2).mean(axis=2), MOST_LEVERAGE)
        v = covering_variance(residual[o, None], shape, left.T[None], data.driven)[0]
        v = np.maximum(v, np.sum(np.abs(H[:, o]) ** 2 * least, axis=1)[:, None])
        scaled = rows * np.repeat(np.sqrt(0.5 * (v / run.variance[o]).T), 2)
        if common is None:
            spread += Q @ (scaled @ scaled.T) @ Q.T
        else:
            parts.append((Q, scaled.view(complex)))
        heard = np.sum(H[:, o] * N, axis=2) / np.sqrt(run.variance[o].T[:, None])
        scores += (
            Q
            @ rows.reshape(len(rows), columns, -1).swapaxes(0, 1)
            @ np.ascontiguousarray(heard).view(float).mT
        )
    if common is not None:
        spread = _spread_of_common(parts, common)
    return spread + np.einsum("edp,efp->df", scores, scores)


def _spread_of_common(
    parts: Sequence[tuple[Float[np.ndarray, "direction row"], Complex[np.ndarray, "row number"]]],
    common: Complex[np.ndarray, "output output line"],
) -> Float[np.ndarray, "direction direction"]:
    """Covariance of scores of all outputs, whose noise is correlated on each line.

    Pairs of outputs by their own few rows: rows in all directions of many outputs would fill the memory.
    """
    at = np.cumsum([0, *(Q.shape[1] for Q, _ in parts)])
    joint = np.zeros((at[-1], at[-1]))
    for (o, (_, one)), (p, (_, other)) in itertools.combinations_with_replacement(enumerate(parts), 2):
        alike = np.tile(common[o, p], one.shape[1] // common.shape[2])  # in each experiment
        both = np.real((one.conj() * alike) @ other.T)
        joint[at[o] : at[o + 1], at[p] : at[p + 1]] = both
        joint[at[p] : at[p + 1], at[o] : at[o + 1]] = both.T
    Q = np.hstack([Q for Q, _ in parts])
    return Q @ joint @ Q.T
