"""Measurement models from records: responses, fits with exact delays, and the plants they give.

measured = estimate_response(record, band_hz=(0.1, 60.0))
fitted = fit_response(measured, states=10)
plant = measured_plant(fitted.model, u=("torque",), y=("angle",))
"""

from middeck.identification.fit.fit_response import FitResult, fit_response
from middeck.identification.model.measurement_model import (
    MeasurementModel,
    damping_ratio,
    model_response,
    natural_hz,
)
from middeck.identification.model.selection import scale_channels, select_channels
from middeck.identification.model.simulation import nrmse, simulate_periodic
from middeck.identification.plants.measured_plant import measured_plant, sampled_statespace
from middeck.identification.plants.pole_zero_gain import PoleZeroGain, from_pole_zero_gain, pole_zero_gain
from middeck.identification.plants.zeros import Zeros, matrix_zeros, name_zeros, path_zeros
from middeck.identification.spectra import ResponseScatter, estimate_response, response_scatter
from middeck.identification.uncertainty.parameters import Uncertainty

__all__ = [
    "FitResult",
    "MeasurementModel",
    "PoleZeroGain",
    "ResponseScatter",
    "Uncertainty",
    "Zeros",
    "damping_ratio",
    "estimate_response",
    "fit_response",
    "from_pole_zero_gain",
    "matrix_zeros",
    "measured_plant",
    "model_response",
    "name_zeros",
    "natural_hz",
    "nrmse",
    "path_zeros",
    "pole_zero_gain",
    "response_scatter",
    "sampled_statespace",
    "scale_channels",
    "select_channels",
    "simulate_periodic",
]
