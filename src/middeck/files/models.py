"""Measurement models and compensators as JSON, so that one verb's result is another's input."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np

from middeck.control.compensator import Compensator
from middeck.errors import DataError
from middeck.files.channels import build_channel
from middeck.files.json_input import json_numbers, read_json
from middeck.files.json_output import write_json
from middeck.identification.measurement_model import MeasurementModel
from middeck.systems.ports import Port

MODEL_SCHEMA = "middeck.model/1"
COMPENSATOR_SCHEMA = "middeck.compensator/1"
COMPLEX = ("poles", "shapes", "participation")
AGAIN = "write the model again"
REAL = ("direct", "lower", "delay_s")
OPTIONAL = ("path_delay_s", "rigid")


def write_model(path: str | Path, model: MeasurementModel) -> None:
    """Write ``model`` whole or not at all: poles [rad/s] and residues as ``re``, ``im``, delays in s.

    Delays of paths and rigid-body modes are written where the model has any.
    """
    given = (*COMPLEX, *REAL, *(name for name in OPTIONAL if getattr(model, name) is not None))
    arrays = {name: getattr(model, name) for name in given}
    ports = {"inputs": model.inputs, "outputs": model.outputs}
    write_json(path, {"schema": MODEL_SCHEMA, "sample_hz": model.sample_hz, **ports, **arrays})


def load_model(path: str | Path) -> MeasurementModel:
    """The model in file ``path``.

    Raises `DataError`, naming file and key, if it is missing, empty, truncated, of another schema, incomplete
    or inconsistent, or if a number is not finite.
    """
    data = read_json(path, MODEL_SCHEMA, "a model of middeck identify -o")
    _require(data, ("sample_hz", "inputs", "outputs", *COMPLEX, *REAL), str(path))
    given = (*REAL, *(name for name in OPTIONAL if data.get(name) is not None))
    arrays = {name: _array(data[name], f"{path}, {name}") for name in given}
    for name in COMPLEX:
        _require(data[name], ("re", "im"), f"{path}, {name}")
        re, im = (_array(data[name][part], f"{path}, {name}.{part}") for part in ("re", "im"))
        if re.shape != im.shape:
            raise DataError(f"re has shape {re.shape}, im {im.shape}", where=f"{path}, {name}")
        arrays[name] = re + 1j * im
    inputs, outputs = (_ports(data[side], f"{path}, {side}") for side in ("inputs", "outputs"))
    rate = _rate(data["sample_hz"], str(path))
    try:
        model = MeasurementModel(**arrays, inputs=inputs, outputs=outputs, sample_hz=rate)
    except ValueError as error:
        raise DataError(str(error), where=str(path), hint=AGAIN) from None
    if model.direct.shape != (len(model.outputs), len(model.inputs)):
        raise DataError(
            f"{len(outputs)} outputs and {len(inputs)} inputs named, direct is {model.direct.shape}",
            where=str(path),
        )
    return model


def write_compensator(path: str | Path, compensator: Compensator) -> None:
    """Write u = K(s) y whole or not at all: A, B, C, D and the ports read and driven, in their order."""
    system = {name: getattr(compensator.system, name) for name in "ABCD"}
    ports = {"inputs": compensator.inputs, "outputs": compensator.outputs}
    write_json(path, {"schema": COMPENSATOR_SCHEMA, **ports, **system})


def _require(data: Any, keys: tuple[str, ...], where: str) -> None:
    missing = [k for k in keys if not isinstance(data, dict) or k not in data]
    if missing:
        raise DataError(f"keys missing: {', '.join(missing)}", where=where, hint=AGAIN)


def _array(value: Any, where: str) -> np.ndarray:
    return json_numbers(value, where, ragged=AGAIN, infinite=AGAIN)


def _ports(value: Any, where: str) -> tuple[Port, ...]:
    if not isinstance(value, list) or not value:
        raise DataError("no ports", where=where, hint='a list of {"name": ..., "unit": ...}')
    return tuple(_port(item, where) for item in cast("list[Any]", value))


def _port(item: Any, where: str) -> Port:
    _require(item, ("name", "unit"), where)
    channel = item.get("channel")
    if channel is None:
        return Port(str(item["name"]), str(item["unit"]))
    return Port(str(item["name"]), str(item["unit"]), build_channel(channel, f"{where}, channel"))


def _rate(value: Any, where: str) -> float | None:
    if value is None:
        return None
    rate = _array(value, f"{where}, sample_hz")
    if rate.shape != () or not rate > 0.0:
        raise DataError(f"sample_hz is {value}; must be > 0 Hz, or null", where=where)
    return float(rate)
