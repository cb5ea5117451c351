"""Universal files that pyuff wrote (tests/cross/uff/make.py), read by ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from middeck.files.records import load_record, load_response
from middeck.systems.ports import Channel, Port

FOLDER = Path(__file__).parent / "uff"
HZ, SAMPLES, LINES = 1024.0, 40, 12


def signals() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As in make.py."""
    rng = np.random.default_rng(58)
    force, acceleration = rng.standard_normal((2, 2, SAMPLES))
    return force, acceleration, rng.standard_normal((LINES, 2)) + 1j * rng.standard_normal((LINES, 2))


# pyuff prints twelve digits: half a unit of the last; binary has all.
DIGITS = {"ascii": 5e-12, "binary": 0.0}


@pytest.mark.parametrize("kind", DIGITS)
def test_time_functions(kind: str) -> None:
    force, acceleration, _ = signals()
    record = load_record(FOLDER / f"time-{kind}.uff")
    # The step is printed as 9.76562e-04: read as it stands, that is 1024.0005 Hz.
    assert record.sample_hz == HZ
    assert np.allclose(record.u[:, 0, :, 0], force, rtol=DIGITS[kind], atol=0.0)
    assert np.allclose(record.y[:, 0, :, 0], acceleration, rtol=DIGITS[kind], atol=0.0)
    assert record.inputs == (Port("force", "N", Channel(node="1", direction="-z")),)
    assert record.outputs == (Port("tip", "m/s^2", Channel(node="2", direction="-z")),)


@pytest.mark.parametrize("kind", DIGITS)
@pytest.mark.parametrize("spacing", ["even", "uneven"])
def test_responses(kind: str, spacing: str) -> None:
    H = signals()[2]
    response = load_response(FOLDER / f"response-{kind}-{spacing}.uff")
    assert np.array_equal(response.frequency_hz, 2.0 + 0.5 * np.arange(LINES))
    for part in (np.real, np.imag):
        assert np.allclose(part(response.H[:, :, 0]), part(H), rtol=DIGITS[kind], atol=0.0)
    assert [p.name for p in response.outputs] == ["1-z", "2-z"]
    assert response.inputs == (Port("1+z", "N", Channel(node="1", direction="+z")),)
