"""Records and JSON: round trips, and what bad files get."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from middeck.errors import DataError, NumericalError
from middeck.files.json.output import json_text, write_json
from middeck.files.records import load_record, load_records, write_record
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.structure.model.article import JointState

FINITE = st.floats(allow_nan=False, allow_infinity=False)


def sample_record(samples: int = 20, hz: float = 500.0) -> Record:
    rng = np.random.default_rng(3)
    u, y = rng.standard_normal((2, 3, samples, 1)), rng.standard_normal((2, 3, samples, 2))
    return Record(
        sample_hz=hz,
        u=u,
        y=y,
        inputs=(Port("torque", "N m"),),
        outputs=(Port("a", "rad"), Port("b", "rad/s")),
        periodic=True,
    )


def rewritten(path: Path, **changes: Any) -> Path:
    """An NPZ of the sample record with arrays changed, or left out where None."""
    write_record(path, sample_record())
    with np.load(path) as archive:
        contents = {k: archive[k] for k in archive.files} | changes
    np.savez(path, **{k: v for k, v in contents.items() if v is not None})
    return path


def refused(path: Path) -> DataError:
    with pytest.raises(DataError) as caught:
        load_record(path)
    assert caught.value.exit_code == 4
    assert str(path) in caught.value.where
    return caught.value


def test_one_period_of_input_stands_for_all(tmp_path: Path) -> None:
    u = sample_record().u
    record = load_record(rewritten(tmp_path / "r.npz", u=u[:, :1]))
    assert np.array_equal(record.u, np.repeat(u[:, :1], 3, axis=1))


@pytest.mark.parametrize("keep", [0.02, 0.3, 0.7, 0.95, 0.999])
def test_a_truncated_archive(tmp_path: Path, keep: float) -> None:
    path = tmp_path / "r.npz"
    write_record(path, sample_record())
    content = path.read_bytes()
    path.write_bytes(content[: int(keep * len(content))])
    assert "truncated" in refused(path).what


def test_a_flipped_byte(tmp_path: Path) -> None:
    path = tmp_path / "r.npz"
    write_record(path, sample_record())
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(bytes(content))
    refused(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"y": None}, "arrays missing: y"),
        ({"schema": np.int64(2)}, "schema is 2"),
        ({"sample_hz": np.array([500.0, 250.0])}, "several rates"),
        ({"sample_hz": np.float64(-1.0)}, "must be > 0 Hz"),
        ({"sample_hz": np.float64("nan")}, "must be > 0 Hz"),
        ({"u": np.zeros((2, 3, 19, 1))}, "mismatched lengths"),
        ({"u": np.zeros((2, 2, 20, 1))}, "mismatched lengths"),
        ({"u": np.zeros((2, 3, 20))}, "u has shape (2, 3, 20)"),
        ({"u": np.array([["a"]])}, "must be numbers"),
        ({"output_names": np.array(["a"])}, "1 names and 2 units for 2 output channels"),
        ({"output_names": np.array(["a", "a"])}, "two channels are named 'a'"),
        (
            {"u": np.zeros((2, 3, 20, 0)), "input_names": np.array([]), "input_units": np.array([])},
            "no input channels",
        ),
        ({"u": np.zeros((2, 3, 0, 1)), "y": np.zeros((2, 3, 0, 2))}, "no samples"),
        ({"u": np.array([{"pickled": 1}], dtype=object)}, "truncated or not an NPZ archive"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_inconsistent_archives(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    assert message in refused(rewritten(tmp_path / "r.npz", **changes)).what


def test_a_sample_that_is_no_number_names_its_channel(tmp_path: Path) -> None:
    y = sample_record().y.copy()
    y[1, 2, 7, 1] = np.nan
    error = refused(rewritten(tmp_path / "r.npz", y=y))
    assert error.where.endswith("channel b")
    assert "experiment 1, period 2, sample 7" in error.what
    assert error.hint


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("r.npz", b"", "the file is empty"),
        ("r.csv", b"", "the file is empty"),
        ("r.csv", b"\n\n", "no lines"),
        ("r.csv", b"\xff\xfe\x00", "not CSV text"),
        ("r.txt", b"1 2 3", "no reader for '.txt'"),
        ("r.npz", b"\x93NUMPY nonsense", "not an NPZ archive"),
    ],
)
def test_files_that_are_none(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    error = refused(path)
    assert message in error.what
    assert error.hint


def test_a_missing_file(tmp_path: Path) -> None:
    assert refused(tmp_path / "none.npz").what == "no such file"


HEADER = "time [s],u:torque [N m],y:angle [rad]\n"


def csv_file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "r.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_csv_in_words(tmp_path: Path) -> None:
    rows = "".join(f"{k * 0.002:.3f},{k},{-k}\n" for k in range(5))
    record = load_record(csv_file(tmp_path, "# bench 3\n" + HEADER + rows))
    assert record.sample_hz == 500.0
    assert record.u[0, 0, :, 0].tolist() == [0, 1, 2, 3, 4]
    assert record.y.shape == (1, 1, 5, 1)
    assert record.inputs == (Port("torque", "N m"),)
    assert not record.periodic


def test_rounded_time_stamps_are_even(tmp_path: Path) -> None:
    rows = "".join(f"{k / 6400:.6f},{k},{-k}\n" for k in range(6401))  # last stamp is exact
    assert load_record(csv_file(tmp_path, HEADER + rows)).sample_hz == 6400.0


@pytest.mark.parametrize(
    ("text", "place", "message"),
    [
        (HEADER + "0.0,1,2\n0.1,3,4\n0.25,5,6\n", "channel time", "uneven time steps"),
        (HEADER + "0.0,1,2\n0.1,3,4\n0.1,5,6\n", "channel time", "uneven time steps"),
        (HEADER + "0.2,1,2\n0.1,3,4\n", "channel time", "time falls"),
        (HEADER + "0.0,1,2\n0.1,3\n", ":3", "mismatched lengths: 2 values for 3 columns"),
        (HEADER + "0.0,1,2\n0.1,3,x\n", ":3", "could not convert"),
        (HEADER + "0.0,1,2\n0.1,nan,3\n", "channel torque", "not finite"),
        (HEADER + "nan,1,2\n0.1,2,3\n", "sample 0", "time is not finite"),
        (HEADER, "r.csv", "0 samples"),
        ("time [s],y:a [rad]\n0.0,1\n0.1,2\n", "r.csv", "no input channels; there is a"),
        ("time [s],torque [N m]\n0.0,1\n0.1,2\n", "r.csv", "nothing says which channels are inputs"),
        ("time [s],u:torque\n0.0,1\n", ":1", "column 2 is headed 'u:torque'"),
        ("time [min],u:t [V],y:a [V]\n0,1,2\n", ":1", "not time [s]"),
        ("time [s],u:t [V],y:a [V],y:a [V]\n0,1,2,3\n1,2,3,4\n", "r.csv", "two channels are named 'a'"),
    ],
)
def test_bad_csv(tmp_path: Path, text: str, place: str, message: str) -> None:
    error = refused(csv_file(tmp_path, text))
    assert place in error.where
    assert message in error.what


def test_several_files_are_experiments_of_one_record(tmp_path: Path) -> None:
    paths = [tmp_path / "a.npz", tmp_path / "b.npz"]
    for path in paths:
        write_record(path, sample_record())
    with pytest.raises(DataError, match=r"the same samples as .*a.npz: one test counts once"):
        load_records(paths)
    write_record(paths[1], dataclasses.replace(sample_record(), y=2.0 * sample_record().y))
    assert load_records(paths).u.shape == (4, 3, 20, 1)
    write_record(paths[1], sample_record(hz=250.0))
    with pytest.raises(DataError, match=r"mismatched sampling rate \[Hz\]: 250.0") as caught:
        load_records(paths)
    assert caught.value.where == str(paths[1])
    write_record(paths[1], sample_record(samples=19))
    with pytest.raises(DataError, match="mismatched periods and samples"):
        load_records(paths)


def test_nothing_half_written_stays(tmp_path: Path) -> None:
    path = tmp_path / "out.json"
    write_json(path, {"a": 1})
    with pytest.raises(NumericalError):
        write_json(path, {"a": float("nan")})
    assert json.loads(path.read_text(encoding="utf-8")) == {"a": 1}
    assert list(tmp_path.iterdir()) == [path]


def test_json_of_values() -> None:
    value = {
        "z": np.array([[1 + 2j, 3.0]]), "n": np.int64(3), "f": np.float32(0.5), "b": np.bool_(True),
        "port": Port("a", "rad"), "state": JointState.FREE, "none": None, "t": (1, 2.5), "p": Path("a/b"),
        "c": 1j, "names": np.array(["x"]),
    }  # fmt: skip
    assert json.loads(json_text(value)) == {
        "z": {"re": [[1.0, 3.0]], "im": [[2.0, 0.0]]}, "n": 3, "f": 0.5, "b": True,
        "port": {"name": "a", "unit": "rad"}, "state": "free", "none": None, "t": [1, 2.5], "p": "a/b",
        "c": {"re": 0.0, "im": 1.0}, "names": ["x"],
    }  # fmt: skip


@given(FINITE)
def test_numbers_keep_every_digit(number: float) -> None:
    assert json.loads(json_text({"x": number}))["x"] == number


@pytest.mark.parametrize(
    ("value", "where"),
    [
        ({"a": {"b": [1.0, float("inf")]}}, "a.b.1"),
        ({"a": np.array([[0.0, np.nan]])}, "a.0.1"),
        ({"a": np.array([complex(0.0, np.nan)])}, "a.im.0"),
    ],
)
def test_what_is_not_finite_is_named(value: Any, where: str) -> None:
    with pytest.raises(NumericalError) as caught:
        json_text(value)
    assert caught.value.where == where
