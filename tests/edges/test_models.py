"""Model files: round trips. What broken ones get: test_cli_errors.py."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from middeck.files.models import load_model, write_model
from middeck.identification.measurement_model import MeasurementModel
from middeck.systems.ports import Port

FINITE = st.floats(allow_nan=False, allow_infinity=False)
COMPLEX = st.complex_numbers(allow_nan=False, allow_infinity=False)


@st.composite
def models(draw: st.DrawFn) -> MeasurementModel:
    modes, inputs, outputs = (draw(st.integers(1, 3)) for _ in range(3))
    return MeasurementModel(
        draw(arrays(complex, (modes,), elements=COMPLEX)),
        draw(arrays(complex, (outputs, modes), elements=COMPLEX)),
        draw(arrays(complex, (modes, inputs), elements=COMPLEX)),
        draw(arrays(float, (outputs, inputs), elements=FINITE)),
        draw(arrays(float, (outputs, inputs), elements=FINITE)),
        draw(arrays(float, (outputs,), elements=FINITE)),
        tuple(Port(f"u{i}", "N m") for i in range(inputs)),
        tuple(Port(f"y{o}", "rad") for o in range(outputs)),
        draw(st.none() | st.floats(1e-3, 1e6)),
        *(draw(st.none() | arrays(float, (outputs, inputs), elements=FINITE)) for _ in range(2)),
    )


@given(model=models())
def test_a_model_comes_back_as_it_was(model: MeasurementModel, tmp_path_factory: object) -> None:
    path = Path(tmp_path_factory.mktemp("model")) / "model.json"  # type: ignore[attr-defined]
    write_model(path, model)
    assert load_model(path) == model
    assert json.loads(path.read_text())["schema"] == "middeck.model/1"
    assert np.array_equal(load_model(path).poles, model.poles)
