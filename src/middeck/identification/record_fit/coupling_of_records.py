"""Whether poles of a record's fit represent the coupling of a sensor (`fit.coupling_instead`)."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.identification.fit.coupling_instead import (
    CouplingTrial,
    coupling_instead,
    coupling_terms,
    spare_modes,
    without_coupling,
)
from middeck.identification.fit.fitted_model import model_of
from middeck.identification.fit.mode_trust import Standing
from middeck.identification.fit.unneeded_modes import without_modes
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.problem.data import Data
from middeck.identification.record_fit.record_covariance import record_covariance
from middeck.identification.record_fit.record_order import record_length
from middeck.identification.record_fit.record_terms import record_scores
from middeck.identification.record_fit.refine_record import RecordRun, refine_record
from middeck.identification.record_fit.residual_tests import Heard

ROUNDS, STEPS = 2, 20


def coupling_of_record(
    data: Data, run: RecordRun, model: MeasurementModel, standing: Sequence[Standing], heard: Heard
) -> list[str]:
    """Couplings that describe the record as shortly as the poles that may be no modes do."""
    spare = spare_modes(model, standing)
    if not run.layout.options.delay or not spare.any() or spare.all():
        return []
    start = without_modes(run.start, np.isin(run.start.point.poles, model.poles[spare]))
    if not len(start.point.poles):
        return []
    terms = coupling_terms(len(model.outputs))

    def trial(rate: Float[np.ndarray, " output"]) -> CouplingTrial | None:
        factor = without_coupling(rate, data.s)
        bare = dataclasses.replace(data, H=data.H * factor[:, :, None])
        fewer = refine_record(bare, start, run.weighting, rounds=ROUNDS, steps=STEPS)
        if fewer is None:
            return None
        covariance = record_covariance(fewer, bare, model_of(fewer, model.inputs, model.outputs))[0]
        return CouplingTrial(record_length(bare, fewer), record_scores(terms, fewer, bare, covariance, heard))

    return coupling_instead(record_length(data, run), trial, model)
