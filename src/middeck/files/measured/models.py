"""Measurement models as JSON (and MAT), so that one verb's result is another's input."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from middeck.errors import ConfigError, DataError
from middeck.files.exchange.matlab_systems import write_mat
from middeck.files.json.input import json_numbers, read_json, read_ports, require_keys
from middeck.files.json.output import write_json
from middeck.identification.fit.mode_trust import Standing
from middeck.identification.model.measurement_model import MeasurementModel, path_delay
from middeck.identification.plants.measured_plant import rational_statespace
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.model_unknowns import ModelStructure, places_of
from middeck.systems.plants.plant import Plant, delay_plant

MODEL_SCHEMA = "middeck.model/1"
COMPLEX = ("poles", "shapes", "participation")
AGAIN = "write the model again"
REAL = ("direct", "lower", "delay_s")
OPTIONAL = ("path_delay_s", "rigid", "integral")
COVARIANCE = ("structure", "root", "inflation", "degrees", "robust", "loose")


def write_model(
    path: str | Path,
    model: MeasurementModel,
    covariance: ModelCovariance | None = None,
    standing: Sequence[Standing] = (),
) -> None:
    """Write ``model`` whole or not at all: poles [rad/s] and residues as ``re``, ``im``, delays in s.

    Delays of paths, rigid-body modes and integrators are written where the model has any, and so is the joint
    covariance of its unknowns (a root of it): infinitely many degrees of freedom are null; and, where it is
    given, the ``standing`` of each mode.

    Raises `ConfigError` if ``covariance`` is that of another model.
    """
    given = (*COMPLEX, *REAL, *(name for name in OPTIONAL if getattr(model, name) is not None))
    arrays = {name: getattr(model, name) for name in given}
    ports = {"inputs": model.inputs, "outputs": model.outputs}
    known = {} if model.hold_s is None else {"hold_s": model.hold_s}
    document = {"schema": MODEL_SCHEMA, "sample_hz": model.sample_hz, **known, **ports, **arrays}
    if covariance is not None:
        if covariance.model != model:
            raise ConfigError("the covariance is that of another model", hint="fit.model and fit.covariance")
        known = {name: getattr(covariance, name) for name in COVARIANCE}
        degrees = None if np.isinf(covariance.degrees) else covariance.degrees
        document["covariance"] = known | {"degrees": degrees}
    if standing:
        document["standing"] = standing
    write_json(path, document)


def load_model(path: str | Path) -> MeasurementModel:
    """The model in file ``path``.

    Raises `DataError`, naming file and key, if it is missing, empty, truncated, of another schema, incomplete
    or inconsistent, or if a number is not finite.
    """
    return load_fitted(path)[0]


def load_fitted(path: str | Path) -> tuple[MeasurementModel, ModelCovariance | None]:
    """The model in file ``path`` and the covariance of its unknowns; None where the file has none.

    Raises `DataError` as `load_model` does, and for a covariance that is not of this model.
    """
    data = read_json(path, MODEL_SCHEMA, "a model of middeck identify -o")
    model = _model(data, str(path))
    known = data.get("covariance")
    return model, None if known is None else _covariance(known, model, f"{path}, covariance")


def load_standing(path: str | Path) -> tuple[Standing, ...]:
    """Standing of each mode of the model in file ``path`` (`Standing`); empty where the file has none.

    Raises `DataError` as `load_model` does, and for words that are none.
    """
    data = read_json(path, MODEL_SCHEMA, "a model of middeck identify -o")
    found, modes = data.get("standing"), len(load_model(path).poles)
    if found is None:
        return ()
    if not isinstance(found, list) or len(found) != modes or not set(found) <= set(get_args(Standing)):
        raise DataError(
            f"standing is no list of {modes} of {', '.join(get_args(Standing))}", where=str(path), hint=AGAIN
        )
    return tuple(found)


def _model(data: dict[str, Any], path: str) -> MeasurementModel:
    require_keys(data, ("sample_hz", "inputs", "outputs", *COMPLEX, *REAL), path, AGAIN)
    given = (*REAL, *(name for name in OPTIONAL if data.get(name) is not None))
    arrays = {name: _array(data[name], f"{path}, {name}") for name in given}
    for name in COMPLEX:
        require_keys(data[name], ("re", "im"), f"{path}, {name}", AGAIN)
        re, im = (_array(data[name][part], f"{path}, {name}.{part}") for part in ("re", "im"))
        if re.shape != im.shape:
            raise DataError(f"re has shape {re.shape}, im {im.shape}", where=f"{path}, {name}", hint=AGAIN)
        arrays[name] = re + 1j * im
    inputs, outputs = (read_ports(data[side], f"{path}, {side}", AGAIN) for side in ("inputs", "outputs"))
    rate, hold_s = _number(data, "sample_hz", path, "> 0 Hz"), _number(data, "hold_s", path, ">= 0 s")
    try:
        model = MeasurementModel(**arrays, inputs=inputs, outputs=outputs, sample_hz=rate, hold_s=hold_s)
    except ConfigError as error:
        raise DataError(f"{error.where}: {error.what}", where=path, hint=AGAIN) from None
    if model.direct.shape != (len(model.outputs), len(model.inputs)):
        raise DataError(
            f"{len(outputs)} outputs and {len(inputs)} inputs named, direct is {model.direct.shape}",
            where=path,
            hint=AGAIN,
        )
    return model


def _covariance(known: Any, model: MeasurementModel, where: str) -> ModelCovariance:
    require_keys(known, COVARIANCE, where, AGAIN)
    structure = _structure(known["structure"], f"{where}, structure")
    root, inflation = (_array(known[name], f"{where}, {name}") for name in ("root", "inflation"))
    size = places_of(model, structure).size
    if root.ndim != 2 or len(root) != size or inflation.shape != (size,):
        raise DataError(
            f"root has shape {root.shape}, inflation {inflation.shape}; the model has {size} unknowns",
            where=where,
            hint=AGAIN,
        )
    degrees = np.inf if known["degrees"] is None else _array(known["degrees"], f"{where}, degrees")
    if np.shape(degrees) != () or not degrees > 0.0:
        raise DataError(f"degrees is {known['degrees']}; must be > 0, or null", where=where, hint=AGAIN)
    robust = _truth(known["robust"], f"{where}, robust")
    return ModelCovariance(
        model=model,
        structure=structure,
        root=root,
        inflation=inflation,
        degrees=float(degrees),
        robust=robust,
        loose=_count(known["loose"], root.shape[1], where),
    )


def _count(value: Any, most: int, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise DataError(
            f"loose is {value!r}; must be a count of columns, 0 to {most}", where=where, hint=AGAIN
        )
    return value


def _structure(value: Any, where: str) -> ModelStructure:
    names = tuple(f.name for f in dataclasses.fields(ModelStructure))
    require_keys(value, names, where, AGAIN)
    return ModelStructure(**{name: _truth(value[name], f"{where}, {name}") for name in names})


def _truth(value: Any, where: str) -> bool:
    if not isinstance(value, bool):
        raise DataError(f"{value!r} is neither true nor false", where=where, hint=AGAIN)
    return value


def _array(value: Any, where: str) -> np.ndarray:
    return json_numbers(value, where, AGAIN)


def _number(data: dict[str, Any], key: str, path: str, allowed: str) -> float | None:
    """A number that is ``allowed``: "> 0 Hz" or ">= 0 s"; None where the file has none."""
    value = data.get(key)
    if value is None:
        return None
    number = _array(value, f"{path}, {key}")
    if number.shape != () or number < 0.0 or (number == 0.0 and allowed.startswith("> ")):
        raise DataError(f"{key} is {value}; must be {allowed}, or null", where=path, hint=AGAIN)
    return float(number)


def write_mat_model(path: str | Path, model: MeasurementModel) -> None:
    """Write a fitted model as a MAT file of `write_mat`, its delays [s] as ``ss`` has them.

    Terms in 1/s^2 of modes below the band are states. The model itself is in the JSON file of `write_model`.
    """
    plant = Plant(dynamics=rational_statespace(model), inputs=model.inputs, outputs=model.outputs)
    write_mat(path, delay_plant(plant, path_delay(model)))
