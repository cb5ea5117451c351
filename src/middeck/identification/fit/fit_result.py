"""The result of a fit: a model, and how good it is."""

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.identification.fit.mode_trust import Standing, SteadyLine
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.parameter_deviations import ParameterDeviations
from middeck.values import record


@record(kw_only=True)
class FitResult:
    """A fitted model and how good it is.

    Attributes:
        model: The measurement model.
        cost: Mean of |weight times residual|^2: one where the model leaves what its weights expect.
        error: Relative complex error of each output on the fitted lines, sqrt(sum |E - H|^2 / sum |H|^2).
        excess: Standard deviation of each output's response that the model leaves beyond the measured
            variance; zero for a model that explains its data.
        uncertainty: Standard deviations of frequencies, damping and delays.
        covariance: Joint covariance of all unknowns, for intervals (`parameters_of`), bounds of the response,
            sets of models and tests of drift.
        history: Cost of each step of the last search, in that search's weights.
        order_reason: Why the model has the order it has.
        warnings: Warnings in words, those of the estimated response first; empty for none.
        standing: Whether the numbers of each mode are reliable (`Standing`); "sound" where no warning
            concerns it; "outside" far from the band in a fit of rates is named in ``order_reason``.
        delay_standing: The same for the delay of each output; "sound" where none was fitted.
        lines: Sines in the outputs that no input makes, such as hum: they were fitted, and are none of the
            modes.
    """

    model: MeasurementModel
    cost: float
    error: Float[np.ndarray, " output"]
    excess: Float[np.ndarray, " output"]
    uncertainty: ParameterDeviations
    covariance: ModelCovariance
    history: Float[np.ndarray, " step"]
    order_reason: str
    warnings: tuple[str, ...]
    standing: tuple[Standing, ...] = ()
    lines: tuple[SteadyLine, ...] = ()
    delay_standing: tuple[Standing, ...] = ()


def marked(fit: FitResult, hold_s: float | None) -> FitResult:
    """The fit, the removed hold noted in its model."""
    model = dataclasses.replace(fit.model, hold_s=hold_s)
    return dataclasses.replace(fit, model=model, covariance=dataclasses.replace(fit.covariance, model=model))
