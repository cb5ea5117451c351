"""Responses and anti-resonances of surveys in refinements: their forms, and the values built of them."""

import dataclasses
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from middeck.errors import ConfigError
from middeck.files.disk.kind_of_content import SCHEMAS, looks_like
from middeck.files.measured.models import load_fitted
from middeck.files.records import load_response
from middeck.files.toml.form import Form, NotNegative, Positive
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.systems.plants.response import FrequencyResponse
from middeck.updating.residuals.measured_response import AntiResonance, MeasuredResponse


class ResponseForm(Form):
    """A measured response beside the modes of a survey."""

    file: str
    relative_std: Positive | None = None
    delay_s: NotNegative = 0.0
    band_hz: Annotated[tuple[NotNegative, Positive], Field(strict=False)] | None = None
    modal_error: NotNegative = 0.02
    line_error: Positive = 0.002


class AntiResonanceForm(Form):
    """A zero of one path between its modes."""

    input: str
    output: str
    frequency_hz: Positive
    std_hz: Positive


def build_response(
    form: ResponseForm | None, zeros: tuple[AntiResonanceForm, ...], beside: Path
) -> MeasuredResponse | None:
    """The measured response of ``form``, its file relative to ``beside``; None without form and zeros.

    Raises `ConfigError` and `DataError` as the readers and `MeasuredResponse` do, for a universal file
    without ``relative_std``, and for a model that has a covariance and this beside.
    """
    found = tuple(AntiResonance(**z.model_dump()) for z in zeros)
    if form is None:
        return MeasuredResponse(anti_resonances=found) if found else None
    return MeasuredResponse(
        response=_load(beside / form.file, form),
        anti_resonances=found,
        delay_s=form.delay_s,
        band_hz=form.band_hz,
        modal_error=form.modal_error,
        line_error=form.line_error,
    )


def _load(file: Path, form: ResponseForm) -> FrequencyResponse | ModelCovariance:
    if looks_like(file) == SCHEMAS["model"]:
        _, known = load_fitted(file)
        if known is None or form.relative_std is not None:
            raise ConfigError(
                "the model has no covariance"
                if known is None
                else "relative_std beside a model's covariance",
                where=str(file),
                hint="a model as middeck identify -o writes it, without relative_std",
            )
        return known
    if form.relative_std is None:
        raise ConfigError(
            "a universal file holds no standard deviation of its response",
            where=str(file),
            hint="relative_std = 0.01",
        )
    response = load_response(file)
    return dataclasses.replace(response, variance=(form.relative_std * np.abs(response.H)) ** 2)
