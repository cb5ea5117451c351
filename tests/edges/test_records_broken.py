"""Every broken record is refused with what, where and a hint, whole, streamed and on the command line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from broken_records import (
    HEADER,
    Builder,
    beside,
    flipped,
    hdf5_bit_lost,
    hdf5_never_written,
    hdf5_with,
    mat_with,
    mended,
    npy_with,
    text,
    truncated,
    uff_rows,
    uff_with,
    without,
)

from cli_runner import middeck
from middeck.errors import ConfigError, DataError, MiddeckError
from middeck.files.records import load_record, open_record

U, Y = np.zeros((2, 1, 64, 1)), np.zeros((2, 1, 64, 2))
NAN = np.where(np.arange(64)[:, None] == 7, np.nan, U)
PLAIN = np.random.default_rng(0).standard_normal((64, 3))

CASES: dict[str, tuple[Builder, str]] = {
    # truncated
    "npz cut": (truncated(".npz", 0.7), "truncated"),
    "hdf5 cut": (truncated(".h5", 0.7), "truncated"),
    "mat cut": (truncated(".mat", 0.7), "truncated"),
    "uff cut in the numbers": (truncated(".uff", 0.6), "truncated"),
    "uff cut in a header": (truncated(".uff", 0.02), "truncated"),
    "ascii uff cut in the numbers": (truncated(".uff", 0.6, ascii=True), "truncated"),
    "csv cut in a line": (text(HEADER + "0.0,1,2\n0.1,3,4\n0.2,5"), "mismatched lengths"),
    # empty
    "empty csv": (text(""), "the file is empty"),
    "empty uff": (text("", "r.uff"), "the file is empty"),
    "blank uff": (text("\n\n", "r.uff"), "no time functions"),
    "empty mat": (text("", "r.mat"), "the file is empty"),
    "empty hdf5": (text("", "r.h5"), "the file is empty"),
    "no samples in hdf5": (hdf5_with(u=U[:, :, :0], y=Y[:, :, :0]), "no samples"),
    # not what the name says
    "csv named h5": (text(HEADER, "r.h5"), "not HDF5"),
    "csv named mat": (text(HEADER * 10, "r.mat"), "not a MAT file"),
    "octave's text": (text("# Created by Octave 9.2.0\n# name: u\n", "r.mat"), "not a MAT file"),
    "csv named uff": (text(HEADER, "r.uff"), "stands outside of a data set"),
    "csv named npz": (text(HEADER, "r.npz"), "not an NPZ archive"),
    "csv named npy": (text(HEADER, "r.npy"), "not an NPY array"),
    "an unknown ending": (text(HEADER, "r.xlsx"), "no reader for '.xlsx'"),
    # wrong type
    "texts for samples in hdf5": (hdf5_with(u=np.array([[[["a"]]]], dtype="S1")), "must be numbers"),
    "complex samples in hdf5": (hdf5_with(u=U + 1j), "must be numbers"),
    "three axes in hdf5": (hdf5_with(u=U[0]), "u has shape"),
    "a cell array for a matrix": (mat_with(x=np.array([[1], ["a"]], dtype=object)), "must be numbers"),
    "a matrix with channels in rows": (npy_with(PLAIN.T), "fewer samples than channels"),
    "an array of four axes": (npy_with(Y), "must be numbers by (sample, channel)"),
    "integers for texts in hdf5": (hdf5_with(periodic=np.array([1.5])), "periodic is"),
    # not a number
    "nan in hdf5": (hdf5_with(u=NAN), "not finite"),
    "nan in csv": (text(HEADER + "0.0,1,2\n0.1,nan,3\n0.2,2,3\n"), "not finite"),
    "nan in ascii uff": (uff_rows(mended(13, "2.040919121385e+00", "               nan")), "not finite"),
    "a word in csv": (text(HEADER + "0.0,1,2\n0.1,3,x\n"), "could not convert"),
    "a word in ascii uff": (uff_rows(mended(13, "2.040919121385e+00", "2.0409191213x5e+00")), "no numbers"),
    # unlike lengths
    "unlike lengths in hdf5": (hdf5_with(u=U[:, :, :-1]), "mismatched lengths"),
    "unlike lengths in csv": (text(HEADER + "0.0,1,2\n0.1,3\n"), "mismatched lengths"),
    "ascii uff lacks a line of numbers": (uff_rows(without(13)), "truncated"),
    "uff has fewer values than bytes": (
        uff_with(b"         4        64", b"         4        63", 6), "512 bytes for 63 values"),
    "a channel comes once, the others twice": (
        uff_with(b"a" + b" " * 0 + b"\nNONE\nNONE\nmiddeck 1 output", b"c\nNONE\nNONE\nmiddeck 1 output"),
        "1 time functions"),
    # units
    "no unit in csv": (text("time [s],u:torque,y:angle [rad]\n0,1,2\n"), "column 2 is headed 'u:torque'"),
    "time in minutes": (text("time [min],u:torque [V],y:angle [rad]\n0,1,2\n1,2,3\n"), "not time [s]"),
    "no unit in uff": (
        uff_rows(lambda rows: [r.replace("middeck 1", "bench   1").replace("rad", "") for r in rows]),
        "does not say its unit"),
    # decimal commas, marks and encodings
    "decimal commas": (text("time [s];u:torque [N m];y:angle [rad]\n0,0;1.001,5;2\n"), "no number"),
    "decimal commas between commas": (text(HEADER + "0,0,1,5,2,0\n0,1,3,0,4,0\n"), "mismatched lengths"),
    "utf-16": (text(HEADER + "0.0,1,2\n", encoding="utf-16"), "not CSV text"),
    # byte order
    "little endian said to be big": (uff_with(b"    58b     1", b"    58b     2", 6), "other byte order"),
    "numbers of a VAX": (uff_with(b"    58b     1     2", b"    58b     1     1"), "numbers of format 1"),
    # rates
    "two rates in hdf5": (hdf5_with(sample_hz=np.array([500.0, 250.0])), "several rates"),
    "two rates in uff": (
        uff_rows(mended(8, "2.000000e-03", "4.000000e-03")), "unlike rates"),
    "no rate in a matrix": (mat_with(x=PLAIN), "nothing says which channels"),
    "a negative rate": (hdf5_with(sample_hz=-1.0), "must be > 0 Hz"),
    "uneven steps": (text(HEADER + "0.0,1,2\n0.1,3,4\n0.25,5,6\n"), "uneven time steps"),
    "channels that start apart": (
        uff_rows(mended(8, " 0.000000e+00 2.000000e-03", " 7.000000e-04 2.000000e-03")), "misaligned starts"),
    # names
    "two of one name in csv": (
        text("time [s],u:t [V],y:a [V],y:a [V]\n0,1,2,3\n1,2,3,4\n"), "two channels are named 'a'"),
    "two of one name in hdf5": (hdf5_with(output_names=["a", "a"]), "two channels are named 'a'"),
    "too few names": (hdf5_with(output_names=["a"]), "1 names and 2 units"),
    # the rest
    "another schema": (hdf5_with(schema=2), "schema is 2"),
    "an array missing": (hdf5_with(y=None), "arrays missing: y"),
    "two matrices": (mat_with(A=PLAIN, B=PLAIN), "2 variables"),
    "a gain that is none": (hdf5_with(output_gain=np.array([0.0, 1.0])), "gain is"),
    "samples never written": (hdf5_never_written, "of 1024 bytes"),
    "a bit lost among samples": (hdf5_bit_lost, "truncated or not HDF5"),
    "a date that is none": (hdf5_with(output_calibrated=["31.1.2026", ""]), "not a date"),
    "a role that is none": (hdf5_with(input_role=["motor"]), "role is"),
    "a wrong comment in csv": (text('# channel "u:torque" = { node = \n' + HEADER + "0.0,1,2\n"), "channel"),
    "periods that do not fit": (text("# periods = 2\n" + HEADER + "0,1,2\n1,2,3\n2,3,4\n"), "whole periods"),
    "a strange number of values": (uff_rows(mended(8, "        64", "       6x4")), "the number of values"),
    "an unknown kind of number": (uff_rows(mended(8, "         4   ", "         7   ")), "data type 7"),
    "numbers before a data set": (uff_rows(lambda rows: ["1 2 3", *rows]), "stands outside"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_it_is_refused(tmp_path: Path, case: str, capfd: pytest.CaptureFixture[str]) -> None:
    build, message = CASES[case]
    path = build(tmp_path)
    with pytest.raises(DataError) as caught:
        load_record(path)
    assert message in str(caught.value)
    assert str(path) in caught.value.where
    assert caught.value.hint
    streamed = _streamed(path)
    assert streamed is None or streamed.hint
    if "not finite" in message:  # shown as a gap, which is why
        ended = middeck(capfd, "record", path)
        assert (ended.code, "gap" in ended.out) == (0, True)
    else:
        ended = middeck(capfd, "record", path)
        assert (ended.code, ended.out) == (4, "")
        assert message in ended.err
        assert re.search(r"\n  try: \S", ended.err)


def _streamed(path: Path) -> MiddeckError | None:
    try:
        for _ in open_record(path).blocks(16):
            pass
    except MiddeckError as error:
        return error
    return None


@pytest.mark.parametrize(
    "case", ["csv cut in a line", "nan in hdf5", "nan in csv", "nan in ascii uff", "uneven steps",
             "ascii uff lacks a line of numbers", "npz cut", "hdf5 cut", "unlike lengths in hdf5"],
)  # fmt: skip
def test_a_stream_refuses_it_too(tmp_path: Path, case: str) -> None:
    assert isinstance(_streamed(CASES[case][0](tmp_path)), DataError)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("sample_hz = -1.0\n", "must be > 0"),
        ('[[channel]]\nname = "torque"\nunits = "N m"\n', "did you mean 'unit'"),
        ('[[channel]]\nname = "torque"\nside = "output"\n[[channel]]\nname = "angle"\n', "all or none"),
        ("[[channel]\n", "not valid TOML"),
        ("", "the file is empty"),
    ],
)
def test_a_wrong_file_of_channels(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)) as caught:
        load_record(beside(content)(tmp_path))
    assert "r.csv.toml" in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('[[channel]]\nname = "force"\nnode = "1"\n', "no channel is named 'force'"),
        ("sample_hz = 100.0\n", "sampled at 10 Hz; 100 Hz were stated"),
        ('[[channel]]\nname = "torque"\nside = "input"\ncolumn = 9\n', "column 9"),
        ('[[channel]]\nname = "torque"\ncalibrated = "soon"\n', "not a date"),
    ],
)
def test_a_file_of_channels_that_does_not_fit(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(DataError, match=re.escape(message)):
        load_record(beside(content)(tmp_path))


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat", ".uff"])
def test_a_flipped_byte_is_refused_or_read_but_never_a_fault_of_ours(tmp_path: Path, suffix: str) -> None:
    for seed in range(60):
        path = flipped(suffix, seed)(tmp_path)
        error = refused_or_read(path)
        assert error is None or error.hint, str(error)


def refused_or_read(path: Path) -> MiddeckError | None:
    try:
        record = load_record(path)
    except MiddeckError as error:
        return error
    assert np.isfinite(record.u).all()
    assert np.isfinite(record.y).all()
    return None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--inputs", "torque"), "named together"),
        (("--inputs", "a=b=c", "--outputs", "y"), "names no column"),
        (("--sample-hz", "-2"), "not in the range"),
        (("--stream",), "--stream writes one record to another"),
    ],
)
def test_wrong_options(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], arguments: tuple[str, ...], message: str
) -> None:
    path = beside("sample_hz = 10.0\n")(tmp_path)
    ended = middeck(capfd, "record", path, *arguments)
    assert ended.code == 2
    assert message in ended.err
