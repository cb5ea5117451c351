"""Fitted models as MAT files."""

from __future__ import annotations

from pathlib import Path

from middeck.files.exchange.mat import write_mat
from middeck.identification.model.measurement_model import MeasurementModel, path_delay
from middeck.identification.plants.modal_states import rational_statespace
from middeck.systems.plant import Plant, delay_plant


def write_mat_model(path: str | Path, model: MeasurementModel) -> None:
    """Write a fitted model as a MAT file of `write_mat`, its delays [s] as ``ss`` has them.

    Terms in 1/s^2 of modes below the band are states. The model itself is in the JSON file of `write_model`.
    """
    plant = Plant(dynamics=rational_statespace(model), inputs=model.inputs, outputs=model.outputs)
    write_mat(path, delay_plant(plant, path_delay(model)))
