"""A real fine steering mirror through the same data arm: fit on one record, judged on another."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.files.records import load_record
from middeck.files.studies.documents import Study
from middeck.identification.fit.fit_response import FitResult, fit_response
from middeck.identification.model.measurement_model import evaluate_model
from middeck.identification.model.steady_simulation import nrmse
from middeck.identification.spectra.estimate import estimate_response
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

BAND_HZ = (1.0, 3000.0)  # the data set's own lines
PUBLISHED_NRMSE = (0.0454, 0.0702, 0.0535)  # its linear baseline of 28 states, 300 mV, held-out record


@record
class MirrorFit:
    """The measured response, the sampled model fitted to it, and its error on the held-out record."""

    measured: FrequencyResponse
    fit: FitResult
    fitted: FrequencyResponse
    held_out_nrmse: Float[np.ndarray, " output"]


def compute(study: Study, rng: np.random.Generator) -> MirrorFit:
    """Fit one record; NRMSE of the simulated outputs of the other. Nothing is drawn from ``rng``."""
    train, test = (load_record(study.folder / file) for file in (study.mirror.train, study.mirror.test))
    measured = estimate_response(train, band_hz=BAND_HZ)
    fit = fit_response(measured, states=study.mirror.states, sample_hz=train.sample_hz)
    fitted = evaluate_model(fit.model, measured.frequency_hz)
    return MirrorFit(measured, fit, fitted, nrmse(fit.model, test))
