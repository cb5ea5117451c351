"""Compensators and models to and from files, JSON or MAT by their endings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from middeck.control.law.compensator import Compensator
from middeck.errors import DataError
from middeck.files.exchange.mat import load_mat, write_mat
from middeck.files.laws.compensators import StoredCompensator, load_compensator, write_compensator
from middeck.files.measured.models import write_mat_model, write_model
from middeck.identification.fit.standing import Standing
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.uncertainty.covariance import ModelCovariance


def is_mat(path: str | Path) -> bool:
    """Whether a file is MATLAB's by its name."""
    return Path(path).suffix.lower() == ".mat"


def write_law(path: str, law: Compensator) -> None:
    """Write u = K y."""
    (write_mat if is_mat(path) else write_compensator)(path, law)


def load_law(path: str) -> StoredCompensator:
    """The compensator in a file; raises `DataError` for anything else."""
    if not is_mat(path):
        return load_compensator(path)
    found = load_mat(path)
    if isinstance(found, StoredCompensator):
        return found
    raise DataError(
        "a system, and nothing says that it is a compensator, nor its sign",
        where=path,
        hint="s.Kind = 'compensator' and s.Feedback = 'positive' (u = K y) or 'negative' (u = -K y)",
    )


def write_fit(
    path: str,
    model: MeasurementModel,
    covariance: ModelCovariance | None,
    standing: Sequence[Standing] = (),
) -> None:
    """Write a fitted model; its covariance and the standing of its modes have a place in JSON only."""
    if is_mat(path):
        write_mat_model(path, model)
    else:
        write_model(path, model, covariance, standing)
