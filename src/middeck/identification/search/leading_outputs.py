"""Outputs that lead their inputs: a negative delay is set to zero with a warning, or refuses the fit."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import FitError
from middeck.identification.model.measurement_model import MeasurementModel, model_response
from middeck.identification.search.fit_warnings import LEFT, is_narrow
from middeck.identification.uncertainty.parameter_deviations import ParameterDeviations
from middeck.systems.plants.response import FrequencyResponse

# Deviations by which the fit of an output that is not delayed may lead by chance: once in 700 fits.
BY_CHANCE = 3.0
# A lead is only a little one if the model without it leaves no more than this many times as much.
LEAD_COST = 2.0
CHECK = "check which channel is the input, and that the period is long enough"
TAKE_MORE = "the band is too narrow to tell a delay from modes outside it: take a wider one, or delay=False"
PATHS = "where the inputs have delays of their own, fit one of each path (--delay path, delay='path')"
BEYOND = "of a velocity or an acceleration, take constants='complex'; with modes beyond the band, residuals"


def causal_delay(measured: FrequencyResponse, delay_s: np.ndarray) -> np.ndarray:
    """Delays of zero or more; a long advance is an error."""
    for port, tau in zip(measured.outputs, delay_s, strict=True):
        if tau < -1.0 / measured.frequency_hz[-1]:
            raise FitError(
                f"the output leads its input by {-tau:.6g} s",
                where=f"output {port.name}",
                hint=_hint(measured, CHECK),
            )
    return np.maximum(delay_s, 0.0)


def warnings_on_leads(
    measured: FrequencyResponse, delay_s: np.ndarray, uncertainty: ParameterDeviations
) -> list[str]:
    """Warnings for advances beyond chance, that `causal_delay` sets to zero."""
    return [
        f"output {port.name}: the fit leads by {-tau * 1e3:.3g} ms (+-{deviation * 1e3:.2g});"
        " its delay is set to zero"
        for port, tau, deviation in zip(measured.outputs, delay_s, uncertainty.delay_s, strict=True)
        if leads(tau, deviation)
    ]


def _hint(measured: FrequencyResponse, usual: str) -> str:
    first = TAKE_MORE if is_narrow(measured) else usual
    return "; ".join([first, *([PATHS] if len(measured.inputs) > 1 else []), BEYOND])


def leads(delay_s: float, deviation_s: float) -> bool:
    """Whether a delay is negative by more than `BY_CHANCE` standard deviations.

    >>> leads(-2e-3, 1e-3), leads(-4e-3, 1e-3)
    (False, True)
    """
    return bool(delay_s < 0.0 and not -delay_s <= BY_CHANCE * deviation_s < np.inf)


def refuse_a_lead(measured: FrequencyResponse, found: MeasurementModel, model: MeasurementModel) -> None:
    """`FitError` where ``found`` follows an output that leads, and ``model``, without the lead, does not."""
    left, kept = (
        np.sum(np.abs(model_response(m, measured.frequency_hz) - measured.H) ** 2, axis=(0, 2))
        for m in (found, model)
    )
    size = size_of(measured)
    worse = (kept > LEAD_COST**2 * left) & (kept > LEFT**2 * size)
    lost = (found.delay_s < 0.0) & (worse | (kept > size))
    if lost.any():
        o = int(np.argmax(lost))
        raise FitError(
            f"the output leads its input by {-found.delay_s[o]:.6g} s, and no model follows without",
            where=f"output {measured.outputs[o].name}",
            hint=_hint(measured, "leave the output out"),
        )


def size_of(measured: FrequencyResponse) -> Float[np.ndarray, " output"]:
    """Sum of |H|^2 of each output."""
    return np.sum(np.abs(measured.H) ** 2, axis=(0, 2))
