"""The settings by which another record is fitted as a model in a file was."""

from __future__ import annotations

import numpy as np

from middeck.cli.settings import FitSettings
from middeck.identification.model.measurement_model import MeasurementModel, rank_of
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.parameters import distinct_poles
from middeck.identification.uncertainty.unknowns import Structure


def alike(settings: FitSettings, model: MeasurementModel, covariance: ModelCovariance | None) -> FitSettings:
    """``settings``, with open choices taken from ``model``; always sampled or continuous as it is."""
    modes = distinct_poles(model)
    rigid, integrators = rank_of(model.rigid), rank_of(model.integral)
    kind: dict[str, object] = {
        # A residue of full rank has its pole several times, but in the order once.
        "states": int(np.sum(np.where(model.is_pair, 2, 1)[modes])) + 2 * rigid + integrators,
        "full_rank": len(modes) < len(model.poles),
        "rigid": rigid,
        "integrators": integrators,
    }
    if model.hold_s is not None:
        kind["held"] = model.hold_s > 0.0
    if covariance is not None and model.sample_hz is None:
        kind |= _choices(model, covariance.structure)
    default = FitSettings()
    left = {name: value for name, value in kind.items() if getattr(settings, name) == getattr(default, name)}
    return settings.model_copy(update={**left, "sampled": model.sample_hz is not None})


def _choices(model: MeasurementModel, structure: Structure) -> dict[str, object]:
    late = "common" if structure.common_delay else "output" if model.path_delay_s is None else "path"
    return {
        "constants": "real" if structure.real_constants else "complex",
        "delay": late if structure.with_delay else "none",
        "residuals": structure.with_lower,
        "relative_degree": _relative_degree(structure),
    }


def _relative_degree(structure: Structure) -> int | None:
    """None where it is that of the constants, or of residual terms, anyway."""
    if structure.relative_degree_two:
        return 2
    if structure.with_lower or structure.with_direct is not structure.real_constants:
        return None
    return 0 if structure.with_direct else 1
