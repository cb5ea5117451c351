"""Time stamps of CSV files as laboratories print them: rounded, but on an even grid."""

from pathlib import Path

import numpy as np
import pytest

from middeck.errors import DataError, FitError
from middeck.files.records import load_record, name_columns, open_record, read_record, write_record
from middeck.identification.record_fit.fit_record import fit_record

SAMPLES = 4000


def write(path: Path, time: list[str]) -> Path:
    rows = [f"{t},{k % 7},{k % 5}" for k, t in enumerate(time)]
    path.write_text("time [s],u:torque [N m],y:angle [rad]\n" + "\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("digits", [3, 4])
@pytest.mark.parametrize("hz", [256.0, 400.0 / 3.0])
@pytest.mark.parametrize("start", [0.0, 12.3456])
def test_rounded_stamps_are_an_even_rate(tmp_path: Path, digits: int, hz: float, start: float) -> None:
    time = start + np.arange(SAMPLES) / hz
    path = write(tmp_path / "run.csv", [f"{t:.{digits}f}" for t in time])
    record = load_record(path)
    # The rate of a straight line whose ends are half a digit off, each in the worst direction.
    assert record.sample_hz == pytest.approx(hz, rel=2.0 * 10.0**-digits * hz / SAMPLES)
    assert record.u.shape == (1, 1, SAMPLES, 1)
    assert np.isfinite(record.y).all()
    stream = open_record(path)
    assert stream.sample_hz == record.sample_hz
    assert sum(len(u) for u, _ in stream.blocks(1000)) == SAMPLES


def test_a_rate_that_is_given_is_used(tmp_path: Path) -> None:
    time = [f"{t:.3f}" for t in np.arange(SAMPLES) / 256.0]
    path = write(tmp_path / "run.csv", time)
    assert load_record(path, name_columns(sample_hz=256.0)).sample_hz == 256.0
    with pytest.raises(DataError, match="were stated"):
        load_record(path, name_columns(sample_hz=250.0))


@pytest.mark.parametrize(("hz", "doubted"), [(0.1, True), (0.002, True), (1.5, False)])
def test_seconds_that_are_rather_milliseconds_are_doubted(tmp_path: Path, hz: float, doubted: bool) -> None:
    path = write(tmp_path / "run.csv", [f"{t:.6g}" for t in np.arange(100) / hz])
    found = read_record(path)
    assert [f.kind for f in found.faults] == ["rate"] * doubted
    assert found.record.sample_hz == pytest.approx(hz)
    assert read_record(path, name_columns(sample_hz=hz)).faults == ()
    # What we wrote ourselves is in seconds.
    write_record(tmp_path / "ours.csv", found.record)
    assert read_record(tmp_path / "ours.csv").faults == ()


def test_a_band_beyond_all_lines_names_the_rate(tmp_path: Path) -> None:
    """Milliseconds said to be seconds: the record itself is sound, at a thousandth of its rate."""
    path = write(tmp_path / "run.csv", [f"{5.0 * k:.1f}" for k in range(SAMPLES)])
    with pytest.raises(FitError, match=r"at 0\.2 Hz, has lines from .* to 0\.0999\d* Hz\n.*unit of times"):
        fit_record(read_record(path).record, band_hz=(0.5, 60.0), states=2)


@pytest.mark.parametrize(("digits", "doubted"), [(0, True), (1, False), (3, False)])
def test_one_sample_a_second_is_no_count_where_stamps_have_decimals(
    tmp_path: Path, digits: int, doubted: bool
) -> None:
    found = read_record(write(tmp_path / "run.csv", [f"{t:.{digits}f}" for t in range(100)]))
    assert [f.kind for f in found.faults] == ["rate"] * doubted
    write_record(tmp_path / "ours.csv", found.record)
    assert read_record(tmp_path / "ours.csv").faults == ()


def test_channels_without_times_need_a_rate(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("u:torque [N m],y:angle [rad]\n" + "1,2\n3,4\n" * 20)
    with pytest.raises(DataError, match="no sampling rate"):
        load_record(path)
    taken = load_record(path, name_columns(sample_hz=50.0))
    assert (taken.sample_hz, taken.y[0, 0, :2, 0].tolist()) == (50.0, [2.0, 4.0])


def test_a_short_record_leaves_its_rate_open(tmp_path: Path) -> None:
    time = [f"{t:.3f}" for t in np.arange(200) / 250.03]
    path = write(tmp_path / "run.csv", time)
    # 0.03 Hz are 0.1 ms over the record: no stamp of a millisecond tells them.
    assert load_record(path, name_columns(sample_hz=250.03)).sample_hz == 250.03
    assert open_record(path, name_columns(sample_hz=250.03)).sample_hz == 250.03


def test_jitter_beyond_the_printed_digits_is_refused(tmp_path: Path) -> None:
    time = np.arange(SAMPLES) / 256.0
    time[1234] += 0.001
    with pytest.raises(DataError, match="uneven time steps"):
        load_record(write(tmp_path / "run.csv", [f"{t:.3f}" for t in time]))


def test_stamps_coarser_than_the_samples_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="print more digits"):
        load_record(write(tmp_path / "run.csv", [f"{t:.2f}" for t in np.arange(SAMPLES) / 256.0]))


def test_missing_lines_of_rounded_stamps_are_a_gap(tmp_path: Path) -> None:
    from middeck.files.records import read_record

    time = np.delete(np.arange(SAMPLES), np.arange(50, 53)) / 256.0
    found = read_record(write(tmp_path / "run.csv", [f"{t:.3f}" for t in time]))
    assert found.record.u.shape[2] == SAMPLES
    assert np.isnan(found.record.y[0, 0, 50:53]).all()
    assert found.record.sample_hz == pytest.approx(256.0, rel=1e-4)
