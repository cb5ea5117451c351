"""Fitted models as MAT files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from middeck.files.exchange.mat import write_variables
from middeck.files.exchange.named import NamedSystem
from middeck.identification.model.measurement_model import MeasurementModel, path_delay
from middeck.identification.plants.modal_states import rational_statespace
from middeck.systems.delayed_sampling import split_delays


def write_mat_model(path: str | Path, model: MeasurementModel) -> None:
    """Write a fitted model as a MAT file of `write_mat`, its delays [s] as ``ss`` has them.

    InputDelay and OutputDelay, and IODelay [output, input] for what a path is delayed beyond their sum. Terms
    in 1/s^2 of modes below the band are states. `load_mat` refuses such delays: the model itself is in the
    JSON file of `write_model`.
    """
    named = NamedSystem(rational_statespace(model), model.inputs, model.outputs)
    split = split_delays(path_delay(model))
    delays = {"InputDelay": split.input_s, "OutputDelay": split.output_s, "IODelay": split.rest_s}
    write_variables(path, named, {"Kind": "system"} | {name: x for name, x in delays.items() if np.any(x)})
