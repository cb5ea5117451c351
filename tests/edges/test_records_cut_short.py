"""Text files that were cut: refused, or told as faults; whole ones are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from cli_runner import middeck
from middeck.errors import DataError
from middeck.files.records import load_record, read_record, write_record
from middeck.signals.ports import Port
from middeck.signals.record import Record

HEADER = "time [s],u:torque [N m],y:angle [rad]"
FORMATS = {"fixed": "%.6f", "all digits": "%.17g", "exponents": "%.6e"}


def a_record() -> Record:
    u, v = np.random.default_rng(3).standard_normal((2, 1, 1, 300, 1))
    y = lfilter([0.0, 1.0], [1.0, -1.6, 0.95], u, axis=2) + 1e-2 * v
    return Record(
        sample_hz=100.0,
        u=u,
        y=y * 1e-3,
        inputs=(Port("torque", "N m"),),
        outputs=(Port("angle", "rad"),),
        periodic=False,
    )


def written(path: Path, style: str) -> bytes:
    record = a_record()
    table = np.column_stack([np.arange(300) / 100.0, record.u[0, 0], record.y[0, 0]])
    np.savetxt(path, table, delimiter=",", header=HEADER, comments="", fmt=FORMATS[style])
    return path.read_bytes()


@pytest.mark.parametrize("style", FORMATS)
def test_a_number_cut_short_is_refused_or_a_fault(style: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    whole = written(path, style)
    assert read_record(path).faults == ()
    end = whole.index(b"\n", len(whole) // 2)
    line = whole.rindex(b"\n", 0, end) + 1
    last = whole.rindex(b",", 0, end) + 1
    # All but the last digits of 17: without those the number is the same to 1e-14.
    for at in range(line + 1, end - (4 if style == "all digits" else 0)):
        path.write_bytes(whole[:at])
        if at <= last or whole[last:at] == b"-":
            with pytest.raises(DataError):
                read_record(path)
            continue
        try:
            faults = read_record(path).faults
        except DataError:
            assert whole[at - 1 : at] in b"e+-", at  # an exponent without its digits
            continue
        assert [(f.kind, f.severity, f.channel) for f in faults] == [("truncated", "serious", "angle")], at


def test_a_cut_file_does_not_pass(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run.csv"
    whole = written(path, "fixed")
    assert middeck(capfd, "record", path, "--require").code == 0
    path.write_bytes(whole[: whole.index(b"\n", len(whole) // 2) - 3])
    ended = middeck(capfd, "record", path, "--require")
    assert ended.code == 1
    assert "the file was cut there" in ended.out
    assert any(
        "was cut there" in line for line in middeck(capfd, "identify", path, "--states", 2).err.split("\n")
    )


def test_a_line_without_its_end_is_only_noted(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(written(path, "fixed").rstrip(b"\n"))
    assert [(f.kind, f.severity) for f in read_record(path).faults] == [("truncated", "note")]


def test_a_cut_number_whose_line_was_ended_is_reported(tmp_path: Path) -> None:
    # A logger that starts again, or an editor, ends the line that was cut.
    path = tmp_path / "run.csv"
    path.write_bytes(written(path, "fixed")[:-4] + b"\n")
    assert [(f.kind, f.severity) for f in read_record(path).faults] == [("truncated", "serious")]
    with pytest.warns(UserWarning, match="was cut there"):
        load_record(path)
    path.write_bytes(written(path, "all digits"))
    assert read_record(path).faults == ()


@pytest.mark.parametrize("last", ["0", "0.0", "-0.0", "nan"])
def test_a_signal_that_ends_in_zero_or_in_no_sample_is_not_cut(tmp_path: Path, last: str) -> None:
    path = tmp_path / "run.csv"
    whole = written(path, "all digits").decode()
    path.write_text(f"{whole}3.0,1.25,{last}\n")
    assert [f.kind for f in read_record(path).faults] == []


def test_a_file_of_ours_says_how_many_samples_it_has(tmp_path: Path) -> None:
    path = tmp_path / "ours.csv"
    write_record(path, a_record())
    assert load_record(path) == a_record()
    whole = path.read_bytes()
    path.write_bytes(whole[: whole.index(b"\n", len(whole) // 2) + 1])
    with pytest.raises(DataError, match=r"truncated: \d+ of 300 samples"):
        load_record(path)


@pytest.mark.parametrize(
    ("last", "message"),
    [("0.2,3,", "cell 3 of 3 is empty.*truncated"), ("0.2,,3", "cell 2 of 3 is empty.*nan where")],
)
def test_an_empty_cell_of_a_csv_is_called_that(tmp_path: Path, last: str, message: str) -> None:
    path = tmp_path / "cut.csv"
    path.write_text(f"time,u,y\n0,1,2\n0.1,1,2\n{last}\n")
    with pytest.raises(DataError, match=f"(?s){message}"):
        load_record(path)
