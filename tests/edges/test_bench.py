"""What is said of a closed loop's record is kept with it; what is said of arithmetic stays a warning."""

import warnings
from types import SimpleNamespace

import numpy as np
import pytest

from middeck.laboratory import bench


def test_warnings_on_a_record_are_kept_and_others_stay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def estimate(record: object, band_hz: object) -> None:
        warnings.warn("y drifts", UserWarning, stacklevel=2)
        with warnings.catch_warnings():
            warnings.simplefilter("default", RuntimeWarning)
            warnings.warn("divided by zero", RuntimeWarning, stacklevel=2)

    run = SimpleNamespace(cause="", record="taken", control=np.ones((1, 1)), events=None)
    monkeypatch.setattr(bench, "run_closed_loop", lambda *_, **__: run)
    monkeypatch.setattr(bench, "emulate", lambda *_: None)
    monkeypatch.setattr(bench, "estimate_response", estimate)
    of = SimpleNamespace(
        rig=SimpleNamespace(period_s=1.0), closed_loop=None, periods=2, rest_s=0.0, band_hz=(1.0, 2.0)
    )
    with pytest.warns(RuntimeWarning, match="divided by zero"):
        taken = bench.take_closed_loop(of, None, np.random.default_rng(0))  # ty: ignore[invalid-argument-type]
    assert taken.warnings == ("y drifts",)
