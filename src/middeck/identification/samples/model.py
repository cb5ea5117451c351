"""The measurement model at the end of a record's fit, and the covariance of its unknowns."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.fit.data import Data
from middeck.identification.fit.design import Terms, split_linear
from middeck.identification.fit.fitted_model import model_of, structure_of
from middeck.identification.fit.layout import Layout, unpack
from middeck.identification.fit.own_transients import OwnTransients, as_real
from middeck.identification.fit.refine import Refined
from middeck.identification.fit.transient import transient_slopes
from middeck.identification.measurement_model import MeasurementModel
from middeck.identification.uncertainty.covariance import ModelCovariance, inverse_root
from middeck.identification.uncertainty.entry_factors import entry_slopes
from middeck.identification.uncertainty.unknowns import Structure, places_of, ties
from middeck.systems.record import Record


def record_model(layout: Layout, found: Refined, record: Record) -> MeasurementModel:
    """Poles, modal vectors, constant terms and delays of a search's end; transients are no part of it."""
    return model_of(layout, found, record.inputs, record.outputs)


def record_covariance(
    layout: Layout,
    found: Refined,
    data: Data,
    variance: Float[np.ndarray, "output line column"],
    model: MeasurementModel,
) -> ModelCovariance:
    """The Cramer-Rao value with the transients among the unknowns.

    ``variance`` is of real and imaginary part together, so that the covariance is half the inverse of the
    information.
    """
    structure = structure_of(layout)
    size = places_of(model, structure).size
    terms = Terms(layout, data, found.theta)
    alone, information = np.zeros(size), np.zeros((size, size))
    for o in range(layout.outputs):
        J = _slopes(layout, data, found, model, structure, o)
        weight = 1.0 / np.sqrt(variance[o])
        alone += np.sum(as_real(J * weight) ** 2, axis=1)
        rows = OwnTransients(terms.B, weight).removed(J)
        information += rows @ rows.T
    held = ties(model, structure)
    inverse = inverse_root(information, held)[1]
    inflation = np.maximum(alone * np.diag(inverse), 1.0)
    unknowns = size - len(held) + data.H.shape[0] * data.H.shape[2] * len(terms.B)
    return ModelCovariance(
        model, structure, 0.5 * inverse, inflation, float(2 * data.H.size - unknowns), False
    )


def _slopes(
    layout: Layout, data: Data, found: Refined, model: MeasurementModel, structure: Structure, output: int
) -> Complex[np.ndarray, "unknown line column"]:
    """Derivative of an output's spectra by the unknowns of the model, through the transients' poles also."""
    assert data.drive is not None
    assert data.transient is not None
    at = places_of(model, structure)
    J = np.zeros((at.size, *data.H.shape[1:]), dtype=complex)
    for i in range(layout.inputs):
        entry = entry_slopes(model, structure, data.s, output, i)
        J[entry.place] += entry.by[:, :, None] * data.drive[:, i]
    _, t = split_linear(layout, data, found.step.linear[output])
    point = unpack(layout, found.theta)
    mode = np.array([int(np.argmax(model.poles == pole)) for pole in point.poles])
    place = np.concatenate([at.sigma[mode], at.omega[mode[: layout.pairs]]])
    J[place] += transient_slopes(layout, point, data.transient, data.s, t)
    return J
