"""Universal files of other programs: units are never guessed wrong, and zero hertz is left out."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from middeck.errors import DataError
from middeck.files.records import load_record, load_response, read_record

FORCE, ACCELERATION = 13, 12


def function_58(
    values: np.ndarray, *, kind: int, node: int, quantity: int, step: float, axis: str, unit: str = "NONE"
) -> str:
    """ASCII data set 58 with an even abscissa from zero, by the columns of its definition."""
    numbers = np.column_stack([values.real, values.imag]).ravel() if np.iscomplexobj(values) else values
    form = 6 if np.iscomplexobj(values) else 4
    lines = [
        "    -1", "    58", *["NONE"] * 5,
        f"{kind:5d}{0:10d}{1:5d}{0:10d} {'NONE':>10s}{node:10d}{3:4d} {'NONE':>10s}{1:10d}{3:4d}",
        f"{form:10d}{len(values):10d}{1:10d}{0.0:13.5E}{step:13.5E}{0.0:13.5E}",
        f"{17 if kind == 1 else 18:10d}{0:5d}{0:5d}{0:5d} {'NONE':>20s} {axis:>20s}",
        f"{quantity:10d}{0:5d}{0:5d}{0:5d} {'NONE':>20s} {unit:>20s}",
        f"{FORCE:10d}{0:5d}{0:5d}{0:5d} {'NONE':>20s} {'N':>20s}",
        f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':>20s} {'NONE':>20s}",
        *("".join(f"{x:20.12E}" for x in row) for row in np.array_split(numbers, -(-len(numbers) // 4))),
        "    -1",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def units_164(code: int) -> str:
    factors = "  1.0D+03  1.0D+00  1.0D+00\n  0.0D+00\n"
    return f"    -1\n   164\n{code:10d}{'of the exporter':20s}{2:10d}\n{factors}    -1\n"


def two_channels(path: Path, *, axis: str = "s", code: int | None = None, unit: str = "NONE") -> Path:
    x = np.random.default_rng(0).standard_normal((2, 64))
    path.write_text(
        ("" if code is None else units_164(code))
        + function_58(x[0], kind=1, node=1, quantity=FORCE, step=0.01, axis=axis, unit="N")
        + function_58(x[1], kind=1, node=2, quantity=ACCELERATION, step=0.01, axis=axis, unit=unit)
    )
    return path


@pytest.mark.parametrize("code", [None, 1])
def test_an_empty_label_is_si_where_nothing_says_otherwise(tmp_path: Path, code: int | None):
    record = load_record(two_channels(tmp_path / "a.uff", code=code))
    assert (record.sample_hz, record.outputs[0].unit) == (100.0, "m/s^2")


def test_an_empty_label_of_a_file_in_millimetres_is_no_metre(tmp_path: Path):
    with pytest.raises(DataError, match="does not say its unit"):
        load_record(two_channels(tmp_path / "a.uff", code=5))
    assert load_record(two_channels(tmp_path / "b.uff", code=5, unit="mm/s^2")).outputs[0].unit == "mm/s^2"


def test_an_abscissa_in_milliseconds_is_refused(tmp_path: Path):
    with pytest.raises(DataError, match="'ms'"):
        load_record(two_channels(tmp_path / "a.uff", axis="ms"))


def test_a_response_loses_its_line_at_zero_hertz(tmp_path: Path):
    H = np.arange(8) + 1.0 + 0.5j
    path = tmp_path / "a.uff"
    path.write_text(function_58(H, kind=4, node=2, quantity=ACCELERATION, step=0.5, axis="Hz"))
    with pytest.warns(UserWarning, match=r"a\.uff: the line at 0 Hz, which has no phase, is left out"):
        found = load_response(path)
    assert found.frequency_hz.tolist() == [0.5 * k for k in range(1, 8)]
    assert found.H[:, 0, 0].tolist() == H[1:].tolist()


def response_58(
    node: int = 2, *, axis: str = "Hz", quantity: int = ACCELERATION, unit: str = "m/s^2", step: float = 0.5
) -> str:
    H = np.arange(8) + 1.0 + 0.5j
    return function_58(H, kind=4, node=node, quantity=quantity, step=step, axis=axis, unit=unit)


def of_types(text: str, kind: int) -> str:
    """With another specific data type of the abscissa."""
    return text.replace(f"\n{18:10d}{0:5d}", f"\n{kind:10d}{0:5d}")


def against(text: str, node: int, unit: str = "N") -> str:
    """With another reference node, and its unit."""
    text = text.replace(f"{1:10d}{3:4d}\n", f"{node:10d}{3:4d}\n")
    return text.replace(f"{'N':>20s}\n{0:10d}", f"{unit:>20s}\n{0:10d}")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (response_58(axis="mHz"), "'mHz'"),
        (response_58(axis="rad/sec"), "'rad/sec'"),
        (response_58(axis="Orders"), "'Orders'"),
        (of_types(response_58(axis="NONE"), 19), "type 19, not 18"),
        (of_types(response_58(), 17), "type 17, not 18"),
        (response_58() + response_58(quantity=8, unit="m"), r"second response of 2\+z to 1\+z.*line 2"),
        (
            response_58() + against(response_58(unit="mm/s^2"), 3),
            r"2\+z in mm/s\^2 here, in m/s\^2 on line 2",
        ),
        (response_58() + against(response_58(3), 1, "lbf"), r"1\+z in lbf here, in N on line 2"),
    ],
)
def test_responses_that_would_be_confused_are_refused(tmp_path: Path, text: str, says: str):
    path = tmp_path / "a.uff"
    path.write_text(text)
    with pytest.raises(DataError, match=says):
        load_response(path)


def test_a_response_that_is_exported_twice_counts_once(tmp_path: Path):
    path = tmp_path / "a.uff"
    path.write_text(response_58() + response_58(3) + response_58())
    with pytest.warns(UserWarning, match="0 Hz"):
        assert load_response(path).H.shape == (7, 2, 1)
    path.write_text(response_58() + response_58().replace("5.000000000000E-01", "6.000000000000E-01", 1))
    with pytest.raises(DataError, match="second response"):
        load_response(path)


def along(text: str, direction: int) -> str:
    """With another direction of its response end."""
    return text.replace(f"{3:4d} {'NONE':>10s}{1:10d}", f"{direction:4d} {'NONE':>10s}{1:10d}")


@pytest.mark.parametrize("kind", [1, 4])
def test_a_file_that_is_cut_between_data_sets_is_reported_by_its_nodes(tmp_path: Path, kind: int):
    """Nodes in x, y, z with places: nothing is said of whole files, or of nodes that are only drawn."""
    x = np.random.default_rng(0).standard_normal(40) * (1.0 + 0.0j if kind == 4 else 1.0)
    sets = [
        along(function_58(x, kind=kind, node=n, quantity=12, step=0.1, axis="", unit="m/s^2"), d)
        for n in (2, 3, 4, 5)
        for d in (1, 2, 3)
    ]
    force = function_58(x, kind=1, node=1, quantity=FORCE, step=0.1, axis="", unit="N") if kind == 1 else ""
    places = "".join(f"{n:10d}{0:10d}{0:10d}{8:10d}\n   0.0   0.0   0.0\n" for n in range(1, 6))
    path, places = tmp_path / "a.uff", f"    -1\n  2411\n{places}    -1\n"

    def said(text: str) -> list[str]:
        path.write_text(text)
        if kind == 1:
            return [f.what for f in read_record(path).faults]
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            load_response(path)
        return [w for f in found if "0 Hz" not in (w := str(f.message))]

    assert said(places + force + "".join(sets)) == said(places + force + "".join(sets[3:])) == []
    (lacks,) = said(places + force + "".join(sets[:-2]))
    assert "node, 5, has no y, z" in lacks
    (silent,) = said(places + force + "".join(sets[:-3]))
    assert "1 of the 5 nodes with places or trace lines have no function (5)" in silent


@pytest.mark.parametrize("axis", ["NONE", "HZ", "[Hz]", "Hertz", "Hz.", "cycles/sec"])
def test_other_words_for_hertz_are_read_and_the_mark_of_an_end(tmp_path: Path, axis: str):
    path = tmp_path / "a.uff"
    path.write_text(response_58(axis=axis) + against(response_58(axis=axis), 3) + "\x1a")
    with pytest.warns(UserWarning, match="0 Hz"):
        assert load_response(path).H.shape == (7, 1, 2)


@pytest.mark.parametrize("order", [slice(None, None, -1), [0, 1, 2, 2, 3]])
def test_frequencies_that_do_not_rise_are_refused(tmp_path: Path, order: slice | list[int]):
    even = response_58().splitlines()
    even[8] = f"{6:10d}{len(np.arange(5)[order]):10d}{0:10d}{0.0:13.5E}{0.0:13.5E}{0.0:13.5E}"
    f = np.linspace(1.0, 3.0, 5)[order]
    rows = [f"{hz:13.5E}{1.0:20.12E}{0.5:20.12E}" for hz in f]
    path = tmp_path / "a.uff"
    path.write_text("\n".join([*even[:13], *rows, "    -1", ""]))
    with pytest.raises(DataError, match="frequencies do not rise"):
        load_response(path)


@pytest.mark.parametrize("axis", ["Msec", "milliseconds", "h", "samples", "mm"])
def test_times_in_other_units_are_refused(tmp_path: Path, axis: str):
    with pytest.raises(DataError, match=f"'{axis}'"):
        load_record(two_channels(tmp_path / "a.uff", axis=axis))


def test_a_unit_that_changes_between_experiments_is_refused(tmp_path: Path):
    path = two_channels(tmp_path / "a.uff", unit="m/s^2")
    first = path.read_text()
    path.write_text(first + first)
    assert load_record(path).y.shape[0] == 2
    path.write_text(first + two_channels(tmp_path / "b.uff", unit="g").read_text())
    with pytest.raises(DataError, match=r"in g, in the first experiment in m/s\^2"):
        load_record(path)
