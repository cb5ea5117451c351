"""Records as other programs save them: decimal commas, times in ms, u and y with fs, units that differ."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io

import middeck as md
from middeck.errors import DataError
from middeck.files.records import load_record, name_columns, open_record, read_record
from middeck.signals.record import Record

RNG = np.random.default_rng(3)
U, Y = RNG.standard_normal((2, 50))


def written(path: Path, unit: str, scale: float, mark: str, point: str) -> Path:
    lines = [mark.join((f"time [{unit}]", "u:force [N]", "y:way [m]"))]
    for k, (u, y) in enumerate(zip(U, Y, strict=True)):
        lines.append(
            mark.join((f"{scale * k / 256.0:.6f}", repr(float(u)), repr(float(y)))).replace(".", point)
        )
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(("unit", "scale"), [("ms", 1e3), ("s", 1.0), ("us", 1e6)])
@pytest.mark.parametrize(("mark", "point"), [(";", ","), ("\t", ","), (",", ".")])
def test_times_and_decimals_of_csv(tmp_path: Path, unit: str, scale: float, mark: str, point: str) -> None:
    path = written(tmp_path / "run.csv", unit, scale, mark, point)
    found = read_record(path)
    assert found.record.sample_hz == 256.0
    assert np.array_equal(found.record.u[0, 0, :, 0], U)
    assert np.array_equal(found.record.y[0, 0, :, 0], Y)
    warnings = [f.what for f in found.faults]
    expected = (("decimal commas",) if point == "," else ()) + (() if unit == "s" else ("times",))
    assert len(warnings) == bool(expected)
    assert all(word in warnings[0] for word in expected)
    stream = open_record(path)
    assert np.array_equal(np.concatenate([y for _, y in stream.blocks(16)])[:, 0], Y)
    assert stream.sample_hz == 256.0


@pytest.mark.parametrize(
    ("heads", "message"),
    [
        (("time (ms)", "force (left) (kN)", "rate (rad/s^2)"), ["decimal commas", "0.001 s"]),
        (("time", "force (in) [kN]", "rate [rad/s^2]"), ["decimal commas", "times are read as seconds"]),
    ],
)
def test_units_in_round_brackets_and_quoted_decimal_commas(tmp_path, heads, message) -> None:
    rows = [
        ",".join(f'"{x!r}"'.replace(".", ",") for x in row)
        for row in zip((np.arange(50) / 0.256).tolist(), U.tolist(), Y.tolist(), strict=True)
    ]
    (tmp_path / "run.csv").write_text("\n".join([",".join(heads), *rows, ""]))
    found = read_record(tmp_path / "run.csv", name_columns([heads[1].rsplit(" ", 1)[0]], ["rate"]))
    assert found.record.sample_hz == pytest.approx(256.0 if "ms" in heads[0] else 0.256, rel=1e-12)
    assert np.array_equal(found.record.u[0, 0, :, 0], U)
    assert [port.unit for port in (*found.record.inputs, *found.record.outputs)] == ["kN", "rad/s^2"]
    assert all(any(word in fault.what for fault in found.faults) for word in message)


@pytest.mark.parametrize("cell", ["1.234,5", "1,234,567", "1,2,3"])
def test_marks_between_thousands_are_refused(tmp_path: Path, cell: str) -> None:
    (tmp_path / "run.csv").write_text(f"time [s];u:force [N];y:way [m]\n0,0;{cell};1\n0,1;2;3\n")
    with pytest.raises(DataError, match="is no number"):
        load_record(tmp_path / "run.csv")


@pytest.mark.parametrize("rate", [{"fs": 256.0}, {"Ts": 1.0 / 256.0}, {"Fs": 256.0, "Ts": 1.0 / 256.0}])
@pytest.mark.parametrize("as_row", [False, True])
def test_u_and_y_of_a_mat_file(tmp_path: Path, rate: dict[str, float], as_row: bool) -> None:
    u = U[None, :] if as_row else U[:, None]
    scipy.io.savemat(tmp_path / "run.mat", {"u": u, "y": np.column_stack([Y, U]), **rate})
    found = load_record(tmp_path / "run.mat")
    expected = Record(
        sample_hz=256.0,
        u=U[None, None, :, None],
        y=np.column_stack([Y, U])[None, None],
        inputs=(md.Port("u", ""),),
        outputs=(md.Port("y1", ""), md.Port("y2", "")),
        periodic=False,
    )
    assert found == expected
    named = load_record(tmp_path / "run.mat", name_columns(["1=force [N]"], ["2=way [m]"]))
    assert (named.inputs[0].unit, named.outputs[0].name) == ("N", "way")


@pytest.mark.parametrize(
    ("contents", "says"),
    [
        ({"u": U[:, None], "y": Y[:, None]}, "no sampling rate"),
        ({"u": U[:, None], "y": Y[:, None], "fs": 256.0, "Ts": 0.01}, "no one sampling rate"),
        ({"u": U[:, None], "y": Y[:, None], "fs": -1.0}, "no one sampling rate"),
        ({"u": U[:, None], "y": Y[:40, None], "fs": 256.0}, "40 and 50 samples"),
        ({"u": U[:, None] + 1j, "y": Y[:, None], "fs": 256.0}, "complex128"),
    ],
)
def test_a_mat_file_that_contradicts_itself_is_refused(
    tmp_path: Path, contents: dict[str, np.ndarray | float], says: str
) -> None:
    scipy.io.savemat(tmp_path / "run.mat", contents)
    with pytest.raises(DataError, match=says):
        load_record(tmp_path / "run.mat")


def test_a_unit_that_the_file_states_otherwise_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "run.csv", "s", 1.0, ",", ".")
    assert load_record(path, name_columns(["force [N]"], ["way"])).inputs[0].unit == "N"
    with pytest.raises(DataError, match="'N'; 'kN' was stated"):
        load_record(path, name_columns(["force [kN]"], ["way [m]"]))


def test_a_channel_on_both_sides_is_refused(tmp_path: Path) -> None:
    """A fit of a channel to itself is exact."""
    path = written(tmp_path / "run.csv", "s", 1.0, ",", ".")
    with pytest.raises(DataError, match="channel way is named twice"):
        load_record(path, name_columns(["force", "way"], ["way"]))


@pytest.mark.parametrize(
    ("heading", "step", "message"),
    [("time", 3.90625, "256 Hz"), ("time", 1.0, "count the lines"), ("time [s]", 1.0, "count the lines")],
)
def test_times_that_are_hardly_seconds_are_doubted(
    tmp_path: Path, heading: str, step: float, message: str
) -> None:
    lines = [f"{k * step:g},{u},{y}" for k, (u, y) in enumerate(zip(U, Y, strict=True))]
    (tmp_path / "run.csv").write_text("\n".join((f"{heading},u:force [N],y:way [m]", *lines)) + "\n")
    (fault,) = read_record(tmp_path / "run.csv").faults
    assert (fault.severity, message in fault.what) == ("serious", True)
    assert read_record(tmp_path / "run.csv", name_columns(sample_hz=1.0 / step)).faults == ()
    assert read_record(written(tmp_path / "run.csv", "s", 1.0, ",", ".")).faults == ()


def test_a_point_beside_decimal_commas_may_part_thousands(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("time [s];u:force [N];y:way [m]\n0,0;1.234;1\n0,1;2.345;3\n")
    with pytest.raises(DataError, match=r"'1\.234' is no number"):
        load_record(tmp_path / "run.csv")


def test_quoted_commas_that_may_part_thousands_are_refused(tmp_path: Path) -> None:
    lines = [f'{k / 256},"{900 + 20 * k:,}",{y}' for k, y in enumerate(Y)]
    (tmp_path / "run.csv").write_text("\n".join(("time [s],u:force [N],y:way [m]", *lines)) + "\n")
    with pytest.raises(DataError, match=r"'1,000' may be 1000 times"):
        load_record(tmp_path / "run.csv")


@pytest.mark.parametrize(("before", "last"), [("", ";"), ("sep=;\n", ""), ("sep=;\n", ";")])
def test_what_spreadsheets_add_to_lines_is_no_column(tmp_path: Path, before: str, last: str) -> None:
    path = written(tmp_path / "run.csv", "s", 1.0, ";", ",")
    plain = load_record(path)
    path.write_text(before + path.read_text().replace("\n", f"{last}\n"))
    assert load_record(path) == plain


@pytest.mark.parametrize("line", ["[s];[N];[m]", "Instrument 7"])
def test_words_that_are_no_names_get_the_hint_where_they_belong(tmp_path: Path, line: str) -> None:
    names, *rows = written(tmp_path / "run.csv", "s", 1.0, ";", ".").read_text().splitlines()
    first = (names, line) if ";" in line else (line, names)
    (tmp_path / "run.csv").write_text("\n".join((*first, *rows)) + "\n")
    with pytest.raises(DataError) as refused:
        load_record(tmp_path / "run.csv")
    assert "one line names the columns" in refused.value.hint


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("0,001,2,0", "decimal commas.*or name every column"),
        ("0.001,2,0,5", "decimal commas.*or name every column"),
        ("0,001,2,5,3,5", "decimal commas"),
        ("0.001,2.0,#N/A", "nan where there is no sample"),
        ("0.001,--,2.0", "nan where there is no sample"),
        ("0.001,2.0,1.2e", "numbers with a decimal point"),
        ("0.001,2.0", "truncated"),
    ],
)
def test_a_line_that_is_none_is_reported_with_its_cure(tmp_path: Path, line: str, says: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(f"time [s],u:force [N],y:way [m]\n0.0,1.0,2.0\n{line}\n0.002,1.0,2.0\n")
    with pytest.raises(DataError, match=says):
        read_record(path)
