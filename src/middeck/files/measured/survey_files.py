"""Modes of a survey from a file: as a modal test hands them over, or as a fitted record holds them."""

from __future__ import annotations

from pathlib import Path

from middeck.errors import DataError
from middeck.files.disk.looks import SCHEMAS, looks_like
from middeck.files.measured.models import load_fitted, load_standing
from middeck.files.measured.modes import load_measured_modes
from middeck.files.setups import load_structure
from middeck.structure.correlation.measured_modes import MeasuredModes
from middeck.updating.residuals.fitted_survey import survey_from_fit


def load_survey_modes(path: str | Path, article: str | Path) -> MeasuredModes:
    """Measured modes, or those of a fitted model whose ports are sensors and actuators of ``article``.

    Raises as `load_measured_modes`, `load_fitted` and `survey_from_fit`, and `DataError` for a model without
    deviations.
    """
    if looks_like(path) != SCHEMAS["model"]:
        return load_measured_modes(path)
    _, covariance = load_fitted(path)
    if covariance is None:
        raise DataError(
            "the model does not say how well it is known: no survey",
            where=str(path),
            hint="a model of middeck identify holds a covariance",
        )
    return survey_from_fit(load_structure(article), covariance, standing=load_standing(path))
