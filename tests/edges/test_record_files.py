"""Kinds of files that others write: plain matrices, MATLAB 7.3, universal files, foreign CSV."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from middeck.errors import ConfigError, DataError
from middeck.files.measured.models import load_model, write_model
from middeck.files.records import (
    load_campaign,
    load_record,
    load_records,
    load_response,
    name_columns,
    read_record,
    write_record,
)
from middeck.files.records.uff58 import Place
from middeck.files.records.uff58_write import Header, write_58
from middeck.identification.fit.fit_response import fit_response
from middeck.identification.spectra.estimate import estimate_response
from middeck.signals.ports import Channel, Port
from middeck.signals.record import Record

RNG = np.random.default_rng(4)
MATRIX = RNG.standard_normal((50, 3))
DAISY = name_columns(["u [N m]"], ["y1", "y2 [m/s^2]"], sample_hz=10.0)


def a_record(signals, inputs, outputs, periodic=False) -> Record:
    return Record(
        sample_hz=4.0, u=signals[0], y=signals[1], inputs=inputs, outputs=outputs, periodic=periodic
    )


def mat_5(path: Path) -> None:
    scipy.io.savemat(path, {"arm_dat": MATRIX})


def mat_73(path: Path, **texts: object) -> None:
    """As MATLAB writes it: a user block with its name, axes reversed."""
    with h5py.File(path, "w", userblock_size=512) as archive:
        archive["arm_dat"] = MATRIX.T
        archive["arm_dat"].attrs["MATLAB_class"] = np.bytes_("double")
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def hdf5(path: Path) -> None:
    with h5py.File(path, "w") as archive:
        archive["arm_dat"] = MATRIX


def npy(path: Path) -> None:
    np.save(path, MATRIX)


def bare_csv(path: Path) -> None:
    np.savetxt(path, MATRIX, delimiter=",", fmt="%.17g")


@pytest.mark.parametrize(
    ("write", "name"),
    [(mat_5, "a.mat"), (mat_73, "a.mat"), (hdf5, "a.h5"), (npy, "a.npy"), (bare_csv, "a.csv")],
)
def test_a_matrix_named_by_options(tmp_path: Path, write, name: str) -> None:
    write(tmp_path / name)
    record = load_record(tmp_path / name, DAISY)
    assert (record.sample_hz, record.periodic) == (10.0, False)
    assert np.array_equal(record.u[0, 0], MATRIX[:, :1])
    assert np.array_equal(record.y[0, 0], MATRIX[:, 1:])
    assert record.inputs == (Port("u", "N m"),)
    assert record.outputs == (Port("y1", ""), Port("y2", "m/s^2"))


def test_columns_by_number_and_variable(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"A": MATRIX, "B": MATRIX + 1.0})
    chosen = name_columns(["3=u"], ["1=y"], sample_hz=1.0, variable="B")
    record = load_record(tmp_path / "a.mat", chosen)
    assert np.array_equal(record.u[0, 0, :, 0], MATRIX[:, 2] + 1.0)
    assert np.array_equal(record.y[0, 0, :, 0], MATRIX[:, 0] + 1.0)


def test_every_matrix_of_a_mat_file_is_offered_with_its_shape(tmp_path: Path) -> None:
    """Fields of structures too, of either version; and they can be chosen."""
    inner = {"force": MATRIX, "gain": 2.0}
    scipy.io.savemat(
        tmp_path / "5.mat", {"A": MATRIX, "text": "as run", "run": inner | {"deep": {"B": MATRIX[:, :2]}}}
    )
    with h5py.File(tmp_path / "73.mat", "w", userblock_size=512) as archive:
        archive["A"] = MATRIX.T
        archive["run/force"] = MATRIX.T
        archive["run/gain"] = np.array([[2.0]])
        archive["run/deep/B"] = MATRIX.T[:2]
        archive["#refs#/a"] = MATRIX
    with open(tmp_path / "73.mat", "r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file")
    rows = len(MATRIX)
    for name in ("5.mat", "73.mat"):
        with pytest.raises(DataError, match="variables") as caught:
            load_record(tmp_path / name, DAISY)
        for offered in (f"A {rows}x3", f"run.force {rows}x3", "run.gain 1x1", f"run.deep.B {rows}x2"):
            assert offered in caught.value.hint
        assert "#refs#" not in caught.value.hint
        field = name_columns(["3=u"], ["1=y"], sample_hz=1.0, variable="run.force")
        assert np.array_equal(load_record(tmp_path / name, field).u[0, 0, :, 0], MATRIX[:, 2])


def test_a_file_of_channels_beside_the_record(tmp_path: Path) -> None:
    mat_5(tmp_path / "a.mat")
    (tmp_path / "a.mat.toml").write_text(
        'sample_hz = 10.0\n[[channel]]\ncolumn = 2\nname = "tip"\nunit = "m/s^2"\nside = "output"\n'
        'node = "12"\ndirection = "+z"\nrole = "sensor"\ngain = 9.81\nraw_unit = "V"\n'
        'calibrated = "2026-01-31"\n[[channel]]\ncolumn = 1\nname = "torque"\nside = "input"\n'
    )
    record = load_record(tmp_path / "a.mat")
    tip = Channel(node="12", direction="+z", role="sensor", gain=9.81, raw_unit="V", calibrated="2026-01-31")
    assert record.outputs == (Port("tip", "m/s^2", tip),)
    assert record.inputs == (Port("torque", ""),)


def test_channels_that_the_file_names_are_only_described(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text("time [s],u:torque [N m],y:angle [rad]\n0,1,2\n0.01,2,3\n")
    (tmp_path / "r.csv.toml").write_text('[[channel]]\nname = "angle"\nnode = "hinge"\n')
    record = load_record(path)
    assert record.outputs == (Port("angle", "rad", Channel(node="hinge")),)
    assert record.inputs == (Port("torque", "N m"),)


def test_the_transducer_goes_with_its_port(tmp_path: Path) -> None:
    """From the record through response and model to the model's file."""
    tip = Port(
        "tip",
        "m",
        Channel(node="12", direction="+z", role="sensor", gain=9.81, raw_unit="V", calibrated="2026-01-31"),
    )
    f = np.fft.rfftfreq(256, 1.0 / 64.0)
    s = 2j * np.pi * f
    U = np.where((f > 0) & (f < 20.0), np.exp(2j * np.pi * RNG.random(len(f))), 0.0)
    u, y = (np.fft.irfft(x)[None, None, :, None].repeat(2, 1) for x in (U, U * 900 / (s**2 + 3 * s + 900)))
    y = y + 1e-3 * y.std() * RNG.standard_normal(y.shape)
    model = fit_response(
        estimate_response(
            Record(sample_hz=64.0, u=u, y=y, inputs=(Port("u", "N"),), outputs=(tip,), periodic=True)
        ),
        states=2,
    ).model
    assert model.outputs == (tip,)
    write_model(tmp_path / "model.json", model)
    assert load_model(tmp_path / "model.json").outputs == (tip,)


def test_matlab_drops_axes_of_one(tmp_path: Path) -> None:
    """One output: u(1,1,:,1) is saved as an array of three axes."""
    record = a_record(RNG.standard_normal((2, 1, 1, 9, 1)), (Port("u", "V"),), (Port("y", "m"),))
    write_record(tmp_path / "r.mat", record)
    contents = scipy.io.loadmat(tmp_path / "r.mat")
    kept = {k: v for k, v in contents.items() if not k.startswith("__")}
    scipy.io.savemat(tmp_path / "s.mat", kept | {k: kept[k][..., 0] for k in "uy"})
    assert load_record(tmp_path / "s.mat") == record


def test_own_layout_in_matlab_7_3(tmp_path: Path) -> None:
    record = a_record(RNG.standard_normal((2, 2, 3, 9, 2)),
                    (Port("a", "V"), Port("bb", "N m")), (Port("c", "m"), Port("d", "")), True)  # fmt: skip
    path = tmp_path / "r.mat"
    with h5py.File(path, "w", userblock_size=512) as archive:
        for key, value in (("u", record.u), ("y", record.y), ("sample_hz", 4.0), ("schema", 1.0)):
            archive[key] = np.atleast_2d(value).T
        archive["periodic"] = np.array([[1]], dtype=np.uint8)
        for side, ports in (("input", record.inputs), ("output", record.outputs)):
            for key, texts in (("names", [p.name for p in ports]), ("units", [p.unit for p in ports])):
                cells = [_char(archive, f"#refs#/{side}{key}{k}", t) for k, t in enumerate(texts)]
                archive[f"{side}_{key}"] = np.array(cells, dtype=h5py.ref_dtype)[:, None]
                archive[f"{side}_{key}"].attrs["MATLAB_class"] = np.bytes_("cell")
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    assert load_record(path) == record


def _char(archive: h5py.File, name: str, text: str) -> h5py.Reference:
    if text:
        archive[name] = np.array([[ord(c)] for c in text], dtype=np.uint16)
    else:
        archive[name] = np.zeros(2, dtype=np.uint64)
        archive[name].attrs["MATLAB_empty"] = np.uint8(1)
    archive[name].attrs["MATLAB_class"] = np.bytes_("char")
    return archive[name].ref


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_foreign_csv(tmp_path: Path, separator: str) -> None:
    path = tmp_path / "r.csv"
    rows = [["Time [s]", "Force [N]", "Tip"], ["0", "1", "2"], ["0.5", "2", "3"], ["1", "3", "5"]]
    path.write_text("\ufeff" + "\r\n".join(separator.join(row) for row in rows), encoding="utf-8")
    record = load_record(path, name_columns(["Force"], ["Tip [m]"]))
    assert record.sample_hz == 2.0
    assert record.u[0, 0, :, 0].tolist() == [1.0, 2.0, 3.0]
    assert (record.inputs, record.outputs) == ((Port("Force", "N"),), (Port("Tip", "m"),))


def test_missing_lines_of_csv_are_a_gap(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    kept = [k for k in range(3000) if k not in (1000, 1001, 2000)]
    rows = "".join(f"{k / 6400:.6f},{k},{-k}\n" for k in kept)  # stamps rounded to a hundredth of a step
    path.write_text("time [s],u:force [N],y:tip [m]\n" + rows)
    reading = read_record(path)
    assert reading.record.sample_hz == pytest.approx(6400.0, rel=1e-5)  # of the stamps' rounding
    assert np.flatnonzero(np.isnan(reading.record.y[0, 0, :, 0])).tolist() == [1000, 1001, 2000]
    assert [(f.kind, f.channel, f.samples) for f in reading.faults] == [
        ("gap", "force", ((1000, 1002), (2000, 2001))), ("gap", "tip", ((1000, 1002), (2000, 2001)))
    ]  # fmt: skip
    with pytest.raises(DataError, match="3 samples are not finite"):
        load_record(path)


def universal(path: Path, runs: list[tuple[str, Place, int, str, np.ndarray]], *, first: float = 0.0) -> Path:
    with open(path, "ab") as stream:
        for text, place, quantity, unit, x in runs:
            header = Header(
                texts=(text, "", "", "", ""),
                kind=1,
                response=place,
                reference=Place("", 0, 0),
                axis=17,
                axis_unit="s",
                quantity=quantity,
                unit=unit,
            )
            write_58(stream, header, first, 1.0 / 6000.0, x, binary=True)
    return path


FORCE, TIP = Place("", 1, 3), Place("wing", 0, -2)


def test_a_title_is_no_name(tmp_path: Path) -> None:
    u, y = RNG.standard_normal((2, 20))
    path = universal(tmp_path / "r.uff", [("Run 7", FORCE, 13, "", u), ("Run 7", TIP, 12, "", y)])
    record = load_record(path)
    # The step is printed as 1.666667e-04: 5999.9988 Hz, of which 6000 is the roundest it can stand for.
    assert record.sample_hz == 6000.0
    assert record.inputs == (Port("1+z", "N", Channel(node="1", direction="+z")),)
    assert record.outputs == (Port("wing-y", "m/s^2", Channel(node="wing", direction="-y")),)


@pytest.mark.parametrize(
    ("name", "right", "wrong"),
    [
        ("time", np.arange(50) / 4.0, 250.0 * np.arange(50)),  # milliseconds
        ("t", np.arange(50)[:, None] / 4.0, np.arange(50)[:, None]),  # counted
        ("fs", 4.0, 8.0 * np.pi),
        ("Ts", 0.25, 4.0),
    ],
)
def test_times_that_contradict_the_rate_of_the_layout_are_refused(
    tmp_path: Path, name: str, right, wrong
) -> None:
    u, y = MATRIX[None, None, :, :1], MATRIX[None, None, :, 1:]
    ports = (Port("force", "N"),), (Port("a", "m"), Port("b", "m"))
    write_record(tmp_path / "own.npz", a_record((u, y), *ports))
    with np.load(tmp_path / "own.npz") as archive:
        arrays = dict(archive)
    for value in (right, np.array(["4 Hz"]), np.zeros(50), np.arange(50, dtype=np.uint8)[::-1]):
        np.savez(tmp_path / "more.npz", **arrays, **{name: value})
        assert load_record(tmp_path / "more.npz").sample_hz == 4.0
    np.savez(tmp_path / "more.npz", **arrays, **{name: wrong})
    with pytest.raises(DataError, match=f"sample_hz is 4 Hz, by {name} the rate is"):
        load_record(tmp_path / "more.npz")


def test_unlike_starts_are_cut_and_reported(tmp_path: Path) -> None:
    u, y = RNG.standard_normal((2, 20))
    path = universal(tmp_path / "r.uff", [("force", FORCE, 13, "N", u)])
    universal(path, [("tip", TIP, 8, "m", y)], first=3.0 / 6000.0)
    reading = read_record(path)
    assert np.array_equal(reading.record.u[0, 0, :, 0], u[3:])
    assert np.array_equal(reading.record.y[0, 0, :, 0], y[:17])
    assert [(f.kind, f.channel) for f in reading.faults] == [("starts", "force"), ("starts", "tip")]


def test_experiments_of_unlike_lengths(tmp_path: Path) -> None:
    u, y = RNG.standard_normal((2, 20))
    path = universal(tmp_path / "r.uff", [("force", FORCE, 13, "N", u), ("tip", TIP, 8, "m", y)])
    universal(path, [("force", FORCE, 13, "N", u[:15]), ("tip", TIP, 8, "m", y[:15])])
    with pytest.raises(DataError, match="unlike channels, rates or lengths") as caught:
        load_record(path)
    assert "load_campaign" in caught.value.hint
    campaign = load_campaign([path])
    assert [r.u.shape for r in campaign.records] == [(1, 1, 20, 1), (1, 1, 15, 1)]


def test_a_campaign_refuses_other_rates_and_channels(tmp_path: Path) -> None:
    base = a_record(RNG.standard_normal((2, 1, 1, 9, 1)), (Port("u", "V"),), (Port("y", "m"),))
    for k, changed in enumerate((
        dataclasses.replace(base, sample_hz=5.0),
        dataclasses.replace(base, outputs=(Port("z", "m"),)),
    )):  # fmt: skip
        paths = [tmp_path / f"a{k}.npz", tmp_path / f"b{k}.npz"]
        write_record(paths[0], base)
        write_record(paths[1], changed)
        with pytest.raises(DataError, match=r"sampled at 5 Hz|channels differ"):
            load_campaign(paths)


def test_a_sensor_calibrated_anew_is_the_same_channel(tmp_path: Path) -> None:
    for name, date in (("a.npz", "2026-01-31"), ("b.npz", "2026-06-30")):
        x = RNG.standard_normal((2, 1, 1, 9, 1))
        port = Port("y", "m", Channel(node="1", direction="+z", gain=2.0, calibrated=date))
        write_record(tmp_path / name, a_record(x, (Port("u", "V"),), (port,)))
    joined = load_records([tmp_path / "a.npz", tmp_path / "b.npz"])
    assert joined.u.shape == (2, 1, 9, 1)


def test_what_a_universal_file_cannot_hold(tmp_path: Path) -> None:
    x = RNG.standard_normal((2, 1, 1, 9, 1))
    for port in (Port("y" * 81, "m"), Port("y", "m", Channel(direction="radial")), Port("y", "m" * 21)):
        with pytest.raises(DataError) as caught:
            write_record(tmp_path / "r.uff", a_record(x, (Port("u", "V"),), (port,)))
        assert caught.value.hint
    assert list(tmp_path.iterdir()) == [], "half a file was left"


def test_what_csv_cannot_hold(tmp_path: Path) -> None:
    x = RNG.standard_normal((2, 2, 1, 9, 1))
    with pytest.raises(DataError, match="2 experiments do not fit"):
        write_record(tmp_path / "r.csv", a_record(x, (Port("u", "V"),), (Port("y", "m"),)))


def test_responses_that_lack_one_or_are_none(tmp_path: Path) -> None:
    path = tmp_path / "r.uff"
    H = RNG.standard_normal(9) + 1j * RNG.standard_normal(9)
    with open(path, "wb") as stream:
        for output, at in ((1, 1), (2, 1), (2, 2)):
            write_58(
                stream,
                Header(
                    texts=("H", "", "", "", ""),
                    kind=4,
                    response=Place("", output, 3),
                    reference=Place("", at, 3),
                    axis=18,
                    axis_unit="Hz",
                    quantity=8,
                    unit="m",
                ),
                1.0,
                0.5,
                H,
                binary=False,
            )
    with pytest.raises(DataError, match="no response between them") as caught:
        load_response(path)
    assert "1+z by 2+z" in caught.value.where
    u, y = RNG.standard_normal((2, 20))
    other = universal(tmp_path / "t.uff", [("f", FORCE, 13, "N", u), ("t", TIP, 8, "m", y)])
    with pytest.raises(DataError, match="no frequency responses"):
        load_response(other)


@pytest.mark.parametrize("text", ["", "[N]", "a=b", "u [N"])
def test_texts_that_name_no_column(text: str) -> None:
    with pytest.raises(ConfigError, match="names no column"):
        name_columns([text], ["y"])


@pytest.mark.parametrize("node", ["0", "9999999999", "007", "näh 3", "-5", "12a", ""])
def test_any_node_comes_back_from_a_universal_file(tmp_path, node):
    """Node 0 is none there: it goes as a name, as all do that are no numbers of ten columns."""
    x = np.arange(6.0).reshape(1, 1, 6, 1)
    ports = [(Port(name, "N", Channel(node=node, direction="+x")),) for name in "uy"]
    write_record(tmp_path / "a.uff", a_record((x, x), *ports))
    found = load_record(tmp_path / "a.uff")
    assert (*found.inputs, *found.outputs) == (*ports[0], *ports[1])


@pytest.mark.parametrize(
    ("port", "message"),
    [
        (Port("y", "N", Channel(node="12345678901")), "longer than 10"),
        (Port("y", "N", Channel(node="NONE")), "'NONE' is no name in a universal file"),
        (Port("NONE", "N"), "'NONE' is no name"),
        (Port("y", "NONE"), "'NONE' is no name"),
        (Port("y ", "N"), "'y ' is no name"),
        (Port("y", " N"), "' N' is no name"),
    ],
)
def test_what_a_universal_file_would_lose_is_refused(tmp_path, port, message):
    x = np.arange(6.0).reshape(1, 1, 6, 1)
    with pytest.raises(DataError, match=message):
        write_record(tmp_path / "a.uff", a_record((x, x), (Port("u", "N"),), (port,)))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "port",
    [
        *(Port("y [N]", "N"), Port("y ", "N"), Port("a\nb", "N"), Port("y", "N]")),
        *(Port("a;b", "N"), Port("y", "N;m"), Port("y", "N ")),
    ],
)
def test_a_heading_that_would_not_be_read_back_is_refused(tmp_path, port):
    x = np.arange(6.0).reshape(1, 1, 6, 1)
    with pytest.raises(DataError, match="is no heading of a CSV column"):
        write_record(tmp_path / "a.csv", a_record((x, x), (Port("u", "N"),), (port,)))
    assert not list(tmp_path.iterdir())
    kept = Port('an (in) "é" µ, y', "um/m")
    write_record(tmp_path / "a.csv", a_record((x, x), (Port("u", ""),), (kept,)))
    assert load_record(tmp_path / "a.csv").outputs == (kept,)
