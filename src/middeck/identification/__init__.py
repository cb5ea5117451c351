"""Measurement models from records: responses, fits with exact delays, and the plants they give.

measured = estimate_response(record, band_hz=(0.1, 60.0))
fitted = fit_response(measured, states=10)
plant = measured_plant(fitted.model, pade_order=3, u=("torque",), y=("angle",))
"""

from middeck.identification.fit import FitResult, fit_response
from middeck.identification.measurement_model import (
    MeasurementModel,
    damping_ratio,
    model_response,
    natural_hz,
)
from middeck.identification.plants import measured_plant, sampled_plant, sampled_statespace
from middeck.identification.simulation import nrmse, simulate_periodic
from middeck.identification.spectra import ResponseScatter, estimate_response, response_scatter
from middeck.identification.uncertainty import Uncertainty

__all__ = [
    "FitResult",
    "MeasurementModel",
    "ResponseScatter",
    "Uncertainty",
    "damping_ratio",
    "estimate_response",
    "fit_response",
    "measured_plant",
    "model_response",
    "natural_hz",
    "nrmse",
    "response_scatter",
    "sampled_plant",
    "sampled_statespace",
    "simulate_periodic",
]
