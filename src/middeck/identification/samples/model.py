"""The measurement model at the end of a record's fit, and the covariance of its unknowns."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from middeck.identification.fit.data import Data
from middeck.identification.fit.design import jacobian
from middeck.identification.fit.layout import Layout, unpack
from middeck.identification.fit.refine import Refined
from middeck.identification.fit.terms import constant_terms, shapes
from middeck.identification.measurement_model import MeasurementModel
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.unknowns import Places, Structure, places_of
from middeck.systems.record import Record


def record_model(layout: Layout, found: Refined, record: Record, sample_hz: float | None) -> MeasurementModel:
    """Poles, modal vectors, constant terms and delays of a search's end; transients are no part of it."""
    point = unpack(layout, found.theta)
    c = np.array([shapes(layout, point, x[: layout.columns]) for x in found.step.linear])
    _, lower, direct = constant_terms(layout, point, found.step.linear)
    delay = point.delay_s[:, 0]
    return MeasurementModel(
        point.poles, c, point.b, direct, lower, delay, record.inputs, record.outputs, sample_hz
    )


def record_covariance(
    layout: Layout,
    found: Refined,
    data: Data,
    variance: Float[np.ndarray, "output line column"],
    model: MeasurementModel,
) -> ModelCovariance:
    """The Cramer-Rao value with the transients among the unknowns.

    ``variance`` is of real and imaginary part together, so that the covariance is half the inverse of the
    information. The input vectors of ``layout`` must be scaled to their largest entry.
    """
    structure = Structure(layout.real_constants, layout.with_delay, layout.with_lower, layout.with_direct)
    J = jacobian(layout, data, found.theta, found.step.linear) / np.sqrt(variance)
    rows = np.ascontiguousarray(J).reshape(len(J), -1).view(float)
    size = np.linalg.norm(rows, axis=1)
    size = np.where(size > 0.0, size, 1.0)
    inverse = np.linalg.pinv((rows / size[:, None]) @ (rows / size[:, None]).T, hermitian=True)
    inverse = inverse / size[:, None] / size
    here, place = _order(layout, found, places_of(model, structure))
    total = int(place.max()) + 1
    matrix, known = np.zeros((total, total)), np.zeros(total)
    matrix[np.ix_(place, place)] = 0.5 * inverse[np.ix_(here, here)]
    known[place] = size[here] ** 2
    inflation = np.maximum(2.0 * known * np.diag(matrix), 1.0)
    return ModelCovariance(model, structure, matrix, inflation, float(rows.shape[1] - len(rows)), False)


def _order(
    layout: Layout, found: Refined, at: Places
) -> tuple[Int[np.ndarray, " unknown"], Int[np.ndarray, " unknown"]]:
    """Places in the search's own vector, and the same unknowns' places among those of the model."""
    pairs, outputs, inputs = layout.pairs, layout.outputs, layout.inputs
    place = [*at.sigma, *at.omega[:pairs], *(at.b[m, i, int(part)] for m, i, part in layout.free_b)]
    place += list(at.delay) if layout.with_delay else []
    here = list(range(layout.size))
    each = found.step.linear.shape[1]
    for o in range(outputs):
        own = [at.c[o, m, part] for m in range(pairs) for part in range(1 if layout.real_constants else 2)]
        own += [at.c[o, m, 0] for m in range(pairs, len(layout.pair))]
        own += [at.lower[o, i] for i in range(inputs)] if layout.with_lower else []
        own += [at.direct[o, i] for i in range(inputs)] if layout.with_direct else []
        place += own
        first = layout.size + o * each
        here += list(range(first, first + len(own)))
    return np.array(here), np.array(place)
