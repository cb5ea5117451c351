"""Model files: round trips, and covariances that are none. Other broken ones: test_cli_errors.py."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from middeck.errors import ConfigError, DataError
from middeck.files.measured.models import load_fitted, load_model, write_model
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.model_unknowns import ModelStructure, places_of
from middeck.signals.ports import Port

FINITE = st.floats(allow_nan=False, allow_infinity=False)
COMPLEX = st.complex_numbers(allow_nan=False, allow_infinity=False)


@st.composite
def models(draw: st.DrawFn) -> MeasurementModel:
    modes, inputs, outputs = (draw(st.integers(1, 3)) for _ in range(3))
    return MeasurementModel(
        poles=draw(arrays(complex, (modes,), elements=COMPLEX)),
        shapes=draw(arrays(complex, (outputs, modes), elements=COMPLEX)),
        participation=draw(arrays(complex, (modes, inputs), elements=COMPLEX)),
        direct=draw(arrays(float, (outputs, inputs), elements=FINITE)),
        lower=draw(arrays(float, (outputs, inputs), elements=FINITE)),
        delay_s=draw(arrays(float, (outputs,), elements=FINITE)),
        inputs=tuple(Port(f"u{i}", "N m") for i in range(inputs)),
        outputs=tuple(Port(f"y{o}", "rad") for o in range(outputs)),
        sample_hz=draw(st.none() | st.floats(1e-3, 1e6)),
        path_delay_s=draw(st.none() | arrays(float, (outputs, inputs), elements=FINITE)),
        rigid=draw(st.none() | arrays(float, (outputs, inputs), elements=FINITE)),
    )


@given(model=models())
def test_a_model_comes_back_as_it_was(model: MeasurementModel, tmp_path_factory: object) -> None:
    path = Path(tmp_path_factory.mktemp("model")) / "model.json"
    write_model(path, model)
    assert load_model(path) == model
    assert json.loads(path.read_text())["schema"] == "middeck.model/1"
    assert np.array_equal(load_model(path).poles, model.poles)


def fitted(*, double: bool = False, rigid: bool = False, degrees: float = np.inf) -> ModelCovariance:
    """Two pairs and a real pole, three outputs, two inputs, with some covariance of all unknowns."""
    rng = np.random.default_rng(7)
    poles = np.array([-0.1 + 9j, -0.1 + 9j if double else -0.3 + 40j, -2.0])
    single = np.imag(poles) == 0.0
    c, b = (
        rng.standard_normal(shape) + 1j * rng.standard_normal(shape) * ~single for shape in ((3, 3), (2, 3))
    )
    zero, delay_s = np.zeros((3, 2)), np.array([0.01, 0.01, 0.02])
    ports = tuple(Port(f"u{i}", "N") for i in range(2)), tuple(Port(f"y{o}", "m") for o in range(3))
    R = np.outer([1.0, 0.5, -0.3], [2.0, 1.0]) if rigid else None
    model = MeasurementModel(
        poles=poles,
        shapes=c,
        participation=b.T,
        direct=zero,
        lower=zero,
        delay_s=delay_s,
        inputs=ports[0],
        outputs=ports[1],
        rigid=R,
    )
    structure = ModelStructure(real_constants=False, with_delay=True, with_lower=False, with_direct=False)
    size = places_of(model, structure).size
    root = rng.standard_normal((size, size)) * np.exp(rng.uniform(-12.0, 6.0, size))[:, None]
    return ModelCovariance(
        model=model,
        structure=structure,
        root=root,
        inflation=rng.uniform(1.0, 9.0, size),
        degrees=degrees,
        robust=True,
    )


@pytest.mark.parametrize(
    "kind", [{}, {"double": True}, {"rigid": True}, {"double": True, "rigid": True}, {"degrees": 84.5}]
)
def test_a_covariance_comes_back_as_it_was(kind: dict[str, Any], tmp_path: Path) -> None:
    covariance = fitted(**kind)
    write_model(tmp_path / "model.json", covariance.model, covariance)
    assert load_fitted(tmp_path / "model.json") == (covariance.model, covariance)
    assert load_model(tmp_path / "model.json") == covariance.model
    write_model(tmp_path / "model.json", covariance.model)
    assert load_fitted(tmp_path / "model.json") == (covariance.model, None)


def test_the_covariance_of_another_model_is_not_written(tmp_path: Path) -> None:
    covariance = fitted()
    other = dataclasses.replace(covariance.model, delay_s=np.zeros(3))
    with pytest.raises(ConfigError, match="of another model"):
        write_model(tmp_path / "model.json", other, covariance)
    assert not (tmp_path / "model.json").exists()


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("root", [[1.0]], "the model has"),
        ("root", None, "not finite"),
        ("loose", 99, "loose is 99"),
        ("loose", True, "loose is True"),
        ("inflation", [1.0], "the model has"),
        ("degrees", 0.0, "degrees is 0.0"),
        ("degrees", "many", "not an array"),
        ("robust", 1, "neither true nor false"),
        ("structure", {"real_constants": True}, "keys missing: with_delay"),
    ],
)
def test_what_is_no_covariance(key: str, value: Any, says: str, tmp_path: Path) -> None:
    file = tmp_path / "model.json"
    write_model(file, fitted().model, fitted())
    document = json.loads(file.read_text())
    document["covariance"][key] = value
    file.write_text(json.dumps(document))
    with pytest.raises(DataError, match=says) as refused:
        load_fitted(file)
    assert f"{file}, covariance" in str(refused.value)
