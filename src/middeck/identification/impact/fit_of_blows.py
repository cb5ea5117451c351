"""A fit of windowed blows, and the damping of the window taken out of it again."""

import dataclasses
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.identification.fit.fit_response import FitResult, fit_response, marked
from middeck.identification.impact.averaged_blows import ImpactTest
from middeck.identification.impact.scatter_of_blows import with_scatter
from middeck.identification.model.fit_options import usual_constants
from middeck.identification.model.measurement_model import (
    MeasurementModel,
    damping_ratio,
    double_pole,
    natural_hz,
)
from middeck.identification.model.refused_data import check_word
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.model_unknowns import unknowns_of
from middeck.identification.uncertainty.parameter_deviations import uncertainty_of
from middeck.signals.record import Record
from middeck.values import require_kind

# Least decay rate that is left to a mode, as a share of its frequency, where noise makes it none or negative.
LEAST = 1e-9


@named_kinds
def fit_impact(
    test: ImpactTest, *, of: Literal["samples", "response"] = "samples", **options: Any
) -> FitResult:
    """The model of an impact test, the damping of its exponential window taken out.

    Args:
        of: "samples": the good blows without an exponential window, each with a transient of the model's own
            poles (`fit_record`), so that neither the ends of blocks nor what rings from the blow before
            count. "response": the averaged response (`fit_response`), which is faster.
        options: Those of that fit, but for the band. A continuous model is fitted unless ``sampled`` is True.

    Raises `ConfigError` for terms that a window does not leave what they are: residuals, rigid modes,
    integrators, delays of paths; `DataError` and `FitError` as the fit does.
    """
    require_kind(test, ImpactTest, "impact test", "average_blows(record) makes one")
    check_word("of", of, ("samples", "response"))
    if of == "samples":
        first, last = (float(f) for f in test.response.frequency_hz[[0, -1]])
        # However far a blow reaches, its force is not held from sample to sample.
        options.setdefault("sampled", False)
        record = _with_what_was_before(test)
        noise = _with_lead(test.rest[..., None], test.before.shape[1])
        found = fit_record(record, band_hz=(first, last), input_noise=noise, **options)
        # A hammer's force is measured, unless the blows are likelier as those of a simulation in steps.
        return marked(found, 0.0) if found.model.hold_s is None and not found.model.sample_hz else found
    if np.isfinite(test.window_s) and not {"direct", "relative_degree"} & set(options):
        # No terms for modes outside the band but a constant: a window makes others of 1/s^2.
        constants = options.get("constants") or usual_constants(test.response.outputs, None)
        options["direct"] = constants == "complex"
    return without_window(with_scatter(fit_response(test.response, **options), test), test.window_s)


def _with_what_was_before(test: ImpactTest) -> Record:
    """The blocks that have outputs before them, each with these; the force is zero there."""
    blocks, led = test.blocks, list(test.led)
    y = np.concatenate([test.before[:, None], blocks.y[led]], axis=2)
    return dataclasses.replace(blocks, u=_with_lead(blocks.u[led], test.before.shape[1]), y=y)


def _with_lead(
    x: Float[np.ndarray, "... sample channel"], lead: int
) -> Float[np.ndarray, "... longer channel"]:
    return np.pad(x, (*((0, 0),) * (x.ndim - 2), (lead, 0), (0, 0)))


def without_window(fit: FitResult, window_s: float) -> FitResult:
    """``fit`` corrected for the exponential window exp(-t / window_s): H(s) from H(s + 1 / window_s).

    Each pole moves by +1 / window_s, and an output that is delayed by tau is exp(tau / window_s) larger;
    frequencies of the damped motion, modal constants and delays are what they were. The covariance goes with
    them. Raises `ConfigError` for a model with poles at zero, or delays of paths: they have no such form.
    """
    if np.isinf(window_s):
        return fit
    model = fit.model
    if np.any(double_pole(model)) or model.integral is not None or model.path_delay_s is not None:
        raise ConfigError(
            "an exponential window moves poles at zero, and scales paths of different delay differently",
            hint="no residuals, rigid modes, integrators or delays of paths; or window_s=inf",
        )
    moved = model.poles + 1.0 / window_s
    lost = np.real(moved) >= -LEAST * np.abs(moved)
    poles = np.where(lost, -LEAST * np.abs(moved) + 1j * np.imag(moved), moved)
    gain = np.exp(model.delay_s / window_s)
    bare = dataclasses.replace(
        model, poles=poles, shapes=model.shapes * gain[:, None], direct=model.direct * gain[:, None]
    )
    covariance = _moved(fit.covariance, bare, window_s, gain)
    uncertainty = uncertainty_of(covariance)
    f, zeta = natural_hz(bare), damping_ratio(bare)
    warnings = [
        f"mode at {f[m]:.4g} Hz: without the window's damping ({1.0 / (window_s * abs(moved[m])):.2%}) "
        f"nothing certain is left of it ({zeta[m]:.2%}); a longer block, or a weaker window"
        for m in np.flatnonzero(lost | (uncertainty.damping > 0.5 * zeta))
    ]
    return dataclasses.replace(
        fit,
        model=bare,
        covariance=covariance,
        uncertainty=uncertainty,
        warnings=(*fit.warnings, *warnings),
        order_reason=f"{fit.order_reason}; the window's damping of {1.0 / window_s:.4g} 1/s is taken out",
    )


def _moved(
    covariance: ModelCovariance, bare: MeasurementModel, window_s: float, gain: np.ndarray
) -> ModelCovariance:
    """The covariance without the window, by derivatives of log decay rates, output vectors and constants."""
    at = covariance.at
    x = unknowns_of(bare, covariance.structure)
    J = np.eye(at.size)
    first, m = np.unique(at.sigma, return_index=True)
    J[first, first] = np.real(covariance.model.poles[m]) / np.real(bare.poles[m])
    for o, size in enumerate(gain):
        own = np.concatenate([at.c[o].ravel(), at.direct[o]])
        own = own[own >= 0]
        J[own, own] = size
        if at.delay[o] >= 0:
            J[own, at.delay[o]] = x[own] / window_s
    return dataclasses.replace(covariance, model=bare, root=J @ covariance.root)
