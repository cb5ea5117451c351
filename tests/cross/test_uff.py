"""Universal files that pyuff wrote (tests/cross/uff/make_uff.py), read by ours."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from middeck.errors import DataError
from middeck.files.records import load_record, load_response, write_response
from middeck.signals.ports import Channel, Port
from middeck.systems.plants.response import FrequencyResponse

FOLDER = Path(__file__).parent / "uff"
HZ, SAMPLES, LINES = 1024.0, 40, 12


def signals() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As in make_uff.py."""
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


def responses(even: bool) -> FrequencyResponse:
    rng = np.random.default_rng(59)
    lines = 0.1 + np.arange(LINES) / 3.0 if even else np.geomspace(0.1, 60.0, LINES)
    H = rng.standard_normal((LINES, 3, 2)) + 1j * rng.standard_normal((LINES, 3, 2))
    tip = Channel(node="12", direction="-z", role="sensor", gain=9.81, raw_unit="V", calibrated="2026-01-31")
    # Two outputs without a place: only their names tell them apart.
    outputs = (Port("tip", "m/s^2", tip), Port("left", "rad"), Port("right", "m"))
    return FrequencyResponse(
        frequency_hz=lines,
        H=H,
        inputs=(Port("shaker", "N", Channel(node="1", direction="+x")), Port("u", "V")),
        outputs=outputs,
    )


@pytest.mark.parametrize("even", [True, False])
def test_responses_come_back_as_they_were_written(tmp_path: Path, even: bool) -> None:
    held = responses(even)
    write_response(tmp_path / "binary.uff", held)
    found = load_response(tmp_path / "binary.uff")
    # Even lines are a first one and a step: to rounding.
    assert np.allclose(found.frequency_hz, held.frequency_hz, rtol=1e-15 if even else 0.0, atol=0.0)
    assert replace(found, frequency_hz=held.frequency_hz) == held
    write_response(tmp_path / "ascii.uff", held, ascii=True)
    found = load_response(tmp_path / "ascii.uff")
    assert (found.inputs, found.outputs) == (held.inputs, held.outputs)
    # Half a unit of the thirteenth digit; of frequencies of their own, of the seventh.
    assert np.allclose(found.H.real, held.H.real, rtol=5e-13, atol=0.0)
    assert np.allclose(found.H.imag, held.H.imag, rtol=5e-13, atol=0.0)
    assert np.allclose(found.frequency_hz, held.frequency_hz, rtol=1e-15 if even else 5e-7, atol=0.0)


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("ascii", [True, False])
def test_what_is_written_is_what_pyuff_read(tmp_path: Path, even: bool, ascii: bool) -> None:
    """The files of the folder, to the byte, and what read.py had pyuff make of them."""
    held = responses(even)
    name = f"written-{'ascii' if ascii else 'binary'}-{'even' if even else 'uneven'}"
    write_response(tmp_path / "r.uff", held, ascii=ascii)
    assert (tmp_path / "r.uff").read_bytes() == (FOLDER / f"{name}.uff").read_bytes()
    read = np.load(FOLDER / "read.npz")
    # Thirteen digits of ASCII; frequencies have seven there, and everywhere where they are even.
    assert np.allclose(read[f"{name}/H"], held.H, rtol=1e-12 if ascii else 0.0, atol=0.0)
    exact = not (even or ascii)
    assert np.allclose(read[f"{name}/f"], held.frequency_hz, rtol=0.0 if exact else 2e-6, atol=0.0)
    assert read[f"{name}/names"].tolist() == [p.name for p in held.outputs]
    assert read[f"{name}/units"].tolist() == [p.unit for p in (*held.outputs, *held.inputs)]
    assert read[f"{name}/ends"].tolist() == [
        [[12, -3, 1, 1], [12, -3, 0, 0]], [[0, 0, 1, 1], [0, 0, 0, 0]], [[0, 0, 1, 1], [0, 0, 0, 0]]
    ]  # fmt: skip


def test_responses_that_no_universal_file_holds(tmp_path: Path) -> None:
    held = responses(even=True)
    with pytest.raises(DataError, match="no writer of responses"):
        write_response(tmp_path / "r.npz", held)
    with pytest.raises(DataError, match="not finite"):
        write_response(tmp_path / "r.uff", replace(held, H=held.H * np.nan))
    long = replace(held, inputs=(Port("u" * 90, "N"), held.inputs[1]))
    with pytest.raises(DataError, match="longer than 80"):
        write_response(tmp_path / "r.uff", long)
    assert list(tmp_path.iterdir()) == []
